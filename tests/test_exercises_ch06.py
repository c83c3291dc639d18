"""Exercises of chapter 06: stub, solution, and the mistakes that the hints are written for."""

import numpy as np
from notebook_cells import defined

from pfslam.teaching.ch06.checks import check_best_view, check_blind_ring, check_optical_point

FOCAL, U0, V0 = 585.051, 315.838, 242.941


def from_notebook(tag, name):
    checks = {
        "check_blind_ring": check_blind_ring,
        "check_optical_point": check_optical_point,
        "check_best_view": check_best_view,
    }
    return defined("06", tag, **checks)[name]


def point(u, v, z):
    return np.array([(u - U0) / FOCAL * z, (v - V0) / FOCAL * z, z])


def z(d):
    return 1.03 / (3.31 - 0.00304 * d)


def test_optical_point_stub_and_solution():
    assert check_optical_point(from_notebook("exercise-1", "optical_point")).verdict == "unanswered"
    assert check_optical_point(from_notebook("solution-1", "optical_point_solution"))


def test_optical_point_hints():
    swapped = check_optical_point(lambda u, v, d: point(u + U0 - V0, v + V0 - U0, z(d)))
    assert "as it is printed" in swapped.message
    along_ray = check_optical_point(
        lambda u, v, d: point(u, v, z(d)) * z(d) / np.linalg.norm(point(u, v, z(d)))
    )
    assert "length of the ray" in along_ray.message
    assert "exchanged" in check_optical_point(lambda u, v, d: point(v, u, z(d))).message
    assert (
        "inverse depth"
        in check_optical_point(lambda u, v, d: point(u, v, 1.03 * (3.31 - 0.00304 * d))).message
    )
    assert "Multiply" in check_optical_point(lambda u, v, d: point(u, v, 1.0)).message
    assert "Begin with Z" in check_optical_point(lambda u, v, d: point(u, v, 2.0)).message
    assert "Three numbers" in check_optical_point(lambda u, v, d: z(d)).message
    assert "KeyError" in check_optical_point(lambda u, v, d: {}[u]).message


def test_blind_ring_stub_and_solution():
    assert check_blind_ring(from_notebook("exercise-2", "blind_ring")).verdict == "unanswered"
    assert check_blind_ring(from_notebook("solution-2", "blind_ring_solution"))


def test_blind_ring_hints():
    def half(rows, v0, focal):
        return np.arctan((rows - 0.5 - v0) / focal)

    axis = check_blind_ring(lambda height, pitch, rows, v0, focal: height / np.tan(pitch))
    assert "optical axis" in axis.message
    no_pitch = check_blind_ring(lambda height, pitch, rows, v0, focal: height / np.tan(half(rows, v0, focal)))
    assert "forgot the pitch" in no_pitch.message
    degrees = check_blind_ring(
        lambda height, pitch, rows, v0, focal: height / np.tan(np.deg2rad(pitch) + half(rows, v0, focal))
    )
    assert "radians already" in degrees.message
    ray = check_blind_ring(
        lambda height, pitch, rows, v0, focal: height / np.sin(pitch + half(rows, v0, focal))
    )
    assert "length of the ray" in ray.message
    assert "lowest ray" in check_blind_ring(lambda *_: 3.0).message


def test_best_view_stub_and_solution():
    assert check_best_view(from_notebook("exercise-3", "best_view")).verdict == "unanswered"
    assert check_best_view(from_notebook("solution-3", "best_view_solution"))


def painted(order):
    """Paint in the order that a rule gives: the last one written stays."""

    def paint(cells, ranges, colours, n):
        canvas = np.full(n, -1)
        for k in order(ranges):
            canvas[cells[k]] = colours[k]
        return canvas

    return paint


def test_best_view_hints():
    def average(cells, ranges, colours, n):
        seen = np.bincount(cells, minlength=n)
        return np.where(seen > 0, np.bincount(cells, colours, n) / np.maximum(seen, 1), -1)

    assert check_best_view(painted(lambda ranges: np.argsort(-ranges)))
    assert "last view wins" in check_best_view(painted(lambda ranges: range(len(ranges)))).message
    assert "first view wins" in check_best_view(painted(lambda ranges: range(len(ranges))[::-1])).message
    assert "farthest view wins" in check_best_view(painted(np.argsort)).message
    assert "average" in check_best_view(average).message
    assert "Unseen" in check_best_view(lambda cells, ranges, colours, n: np.zeros(n)).message
    assert "shape" in check_best_view(lambda cells, ranges, colours, n: colours).message
