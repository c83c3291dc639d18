"""Exercises of chapter 00: stub, solution, and the mistakes that the hints are written for."""

import numpy as np
import pytest
from notebook_cells import check_nonsense_is_named, check_stub_and_solution

from pfslam.teaching.ch00.checks import (
    check_distance_at,
    check_end_points,
    check_nearest_within,
    check_to_world,
)

EXERCISES = [
    (check_end_points, "end_points"),
    (check_nearest_within, "nearest_within"),
    (check_to_world, "to_world"),
    (check_distance_at, "distance_at"),
]
CHECKS = {check.__name__: check for check, _ in EXERCISES}


@pytest.mark.parametrize(("check", "name"), EXERCISES)
def test_stub_and_solution(check, name):
    check_stub_and_solution("00", 1 + EXERCISES.index((check, name)), name, check, CHECKS)


@pytest.mark.parametrize(("check", "name"), EXERCISES)
def test_nonsense_is_named_and_never_raises(check, name):
    check_nonsense_is_named(check, 1.0, 3)


def polar(r, angle):
    return np.column_stack([r * np.cos(angle), r * np.sin(angle)])


def test_end_point_hints():
    def good(r, low, high):
        return np.isfinite(r) & (r >= low) & (r <= high)

    def renumbered(r, angle, low, high):
        kept = r[good(r, low, high)]
        return polar(kept, angle[: len(kept)])

    def no_lower_limit(r, angle, low, high):
        valid = np.isfinite(r) & (r <= high)
        return polar(r[valid], angle[valid])

    def swapped(r, angle, low, high):
        valid = good(r, low, high)
        return polar(r[valid], angle[valid])[:, ::-1]

    def converted(r, angle, low, high):
        valid = good(r, low, high)
        return polar(r[valid], np.deg2rad(angle[valid]))

    assert "numbered the rest anew" in check_end_points(renumbered).message
    assert "not distances" in check_end_points(lambda r, angle, low, high: polar(r, angle)).message
    assert "range_min" in check_end_points(no_lower_limit).message
    assert "swapped" in check_end_points(swapped).message
    assert "radians already" in check_end_points(converted).message


def test_nearest_hints():
    def gap_only_after(t, query, max_gap):
        after = np.minimum(np.searchsorted(t, query), len(t) - 1)
        return np.where(np.abs(t[after] - query) <= max_gap, after, -1)

    def nearest(t, query, max_gap):
        return np.abs(t[None] - query[:, None]).argmin(axis=1)

    assert "not near" in check_nearest_within(nearest).message
    assert "only forward" in check_nearest_within(lambda t, q, gap: np.searchsorted(t, q)).message
    assert "only at the next" in check_nearest_within(gap_only_after).message
    assert "by number" in check_nearest_within(lambda t, q, gap: np.arange(len(q))).message
    assert "index" in check_nearest_within(lambda t, q, gap: t[nearest(t, q, gap)]).message


def rotation(theta):
    return np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda pose, p, arm: p @ rotation(pose[2]).T + pose[:2], "missing"),
        (lambda pose, p, arm: p @ rotation(pose[2]).T + pose[:2] + arm, "in the world"),
        (lambda pose, p, arm: (p + arm[::-1]) @ rotation(pose[2]).T + pose[:2], "wrong axis"),
        (lambda pose, p, arm: (p - arm) @ rotation(pose[2]).T + pose[:2], "sign"),
        (lambda pose, p, arm: (p + arm) @ rotation(pose[2]) + pose[:2], "wrong way"),
        (lambda pose, p, arm: (p + arm - pose[:2]) @ rotation(pose[2]), "T_bw"),
        (lambda pose, p, arm: (p + arm + pose[:2]) @ rotation(pose[2]).T, "position gets turned"),
    ],
)
def test_to_world_hints(wrong, words):
    assert words in check_to_world(wrong).message


def test_distance_hints():
    def cumulated(t, counts, metres):
        return np.cumsum(counts.mean(axis=1) * metres) - counts[0].mean() * metres

    def nearest(t_scan, t):
        return np.abs(t[None] - t_scan[:, None]).argmin(axis=1)

    def single(t_scan, t, counts, metres):
        return (counts.mean(axis=1) * metres)[nearest(t_scan, t)]

    def four_times(t_scan, t, counts, metres):
        return np.interp(t_scan, t, 4 * cumulated(t, counts, metres))

    def with_the_first(t_scan, t, counts, metres):
        return np.interp(t_scan, t, np.cumsum(counts.mean(axis=1) * metres))

    assert "running sum" in check_distance_at(single).message
    assert "are lost" in check_distance_at(lambda *a: np.cumsum(single(*a))).message
    assert "interpolate" in check_distance_at(lambda s, t, c, m: cumulated(t, c, m)[nearest(s, t)]).message
    assert "Four times" in check_distance_at(four_times).message
    assert "before the first" in check_distance_at(with_the_first).message
