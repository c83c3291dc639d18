"""Alignment to lines: exact walls, known offsets, silent directions."""

from dataclasses import replace

import numpy as np
import pytest

from pfslam.grid import GridSpec
from pfslam.poses import invert, transform_points, wrap_angle
from pfslam.refined import lines as module
from pfslam.refined.lines import (
    LINE_SIGMA,
    MAX_STEP,
    RHO,
    THICKNESS,
    HitMoments,
    LineConfig,
    align_to_lines,
    nearby_lines,
    step_with_prior,
)

SPEC = GridSpec((-6.013, -6.021), 0.05, (240, 240))
CONFIG = LineConfig()
TRUE_POSE = np.array([0.3, -0.2, 0.4])
STOP = 1e-3 * MAX_STEP  # the alignment ends when its step has fallen below this


def line(ax, ay, bx, by, spacing=0.01):
    n = int(np.hypot(bx - ax, by - ay) / spacing) + 1
    return np.column_stack([np.linspace(ax, bx, n), np.linspace(ay, by, n)])


def turned(points, angle):
    return transform_points([0.0, 0.0, angle], points)


# Pieces of wall whose ends stay half a metre apart: near every hit there is exactly one line.
ROOM = np.vstack(
    [line(2, -1, 2, 1), line(-1, 1.6, 1.3, 1.6), line(-2.2, -1, -2.2, 1), line(-1.5, -1.7, 1, -1.7)]
)
CORRIDOR = np.vstack([line(-4, 1, 4, 1), line(-4, -1, 4, -1)])


def moments_of(*scans):
    """The moments of the hits of some scans."""
    moments = HitMoments(SPEC)
    for hits in scans:
        moments.add(hits)
    return moments


def seen_from(pose, hits):
    return transform_points(invert(pose), hits)


def aligned(hits, start, odometry=None, points_b=None):
    moments = moments_of(hits)
    points_b = seen_from(TRUE_POSE, hits) if points_b is None else points_b
    return align_to_lines(moments, points_b, start, start if odometry is None else odometry, CONFIG)


def test_every_cell_remembers_the_scan_that_hit_it_first():
    hits = np.array([[0.01, 0.01], [0.51, 0.01], [1.01, 0.01]])
    moments = HitMoments(SPEC)
    moments.add(hits[:2], 3)
    moments.add(hits, 5)
    np.testing.assert_array_equal(moments.first_scan(np.vstack([hits, [[2.0, 2.0]]])), [3, 3, 5, -1])
    moments.slots.cover(SPEC.grown(7, 5, 3, 2))
    np.testing.assert_array_equal(moments.first_scan(hits), [3, 3, 5])


def test_points_are_counted_that_lie_where_a_wall_was_hit_before():
    moments = HitMoments(SPEC)
    moments.add(np.array([[1.0, 1.0]]), 3)
    moments.add(np.array([[1.0, 1.0], [2.0, 1.0]]), 7)
    points = np.array([[1.0, 1.0], [2.0, 1.0], [3.0, 1.0], [1e3, 1.0]])
    assert [moments.share_hit_before(scan, points) for scan in (3, 4, 7, 8)] == [0.0, 0.25, 0.25, 0.5]
    assert moments.share_hit_before(8, np.zeros((0, 2))) == 0.0


def test_moments_around_a_cell_are_those_of_all_hits_near_it_also_when_the_map_has_grown():
    hits = np.random.default_rng(1).uniform(-1, 1, (3000, 2))
    moments, cells = moments_of(hits[:1200], hits[1200:]), SPEC.world_to_cell(hits)
    middle = np.array([[120, 121], [115, 124], [130, 118]])
    found = moments.around(middle)
    for centre, sums in zip(middle, found, strict=True):
        x, y = ((hits[(np.abs(cells - centre) <= 1).all(axis=1)] - SPEC.cell_to_world(centre)) / 0.05).T
        expected = [len(x), x.sum(), y.sum(), (x * x).sum(), (x * y).sum(), (y * y).sum()]
        np.testing.assert_allclose(sums, expected, atol=1e-4)
    outside = np.array([[0, 5], [5, 0], [239, 5], [5, 239], [-1, 5], [500, -3]])
    at_the_border = moments_of(SPEC.cell_to_world([[239, 4], [239, 5], [0, 5], [0, 6]]))
    assert not at_the_border.around(outside).any()
    assert not moments.around(outside).any()
    moments.slots.cover(SPEC.grown(3, 2, 5, 1))
    np.testing.assert_array_equal(moments.around(middle + [3, 5]), found)


def test_scattered_hits_and_few_hits_are_no_line():
    ring = 0.02 * np.column_stack(
        [np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4)]
    ) + SPEC.cell_to_world([100, 100])
    assert not nearby_lines(moments_of(ring), ring, CONFIG).found.any()
    few = line(0, 0, 0.02, 0)[: CONFIG.min_hits - 1]
    assert not nearby_lines(moments_of(few), few, CONFIG).found.any()


@pytest.mark.parametrize("world", [0.0, 0.02, 0.7, -2.5])
@pytest.mark.parametrize("heading", [0.4, np.pi - 0.004])
@pytest.mark.parametrize("offset", [(0, 0, 0), (0.03, -0.02, 0.01), (-0.02, -0.03, -0.015), (0.0, 0.0, 0.02)])
def test_alignment_finds_the_true_pose_from_a_known_offset(world, heading, offset):
    # All end points lie exactly on lines at the true pose alone. What remains is the last step, ten times at
    # most: the damping of a thousandth leaves a thousandth of each error, and the weights change little.
    hits, pose = turned(ROOM, world), np.array([0.3, -0.2, heading])
    found = aligned(hits, pose + offset, points_b=seen_from(pose, hits))
    assert (np.abs([*(found.pose - pose)[:2], wrap_angle(found.pose[2] - pose[2])]) <= 10 * STOP).all()
    assert -np.pi < found.pose[2] <= np.pi
    assert found.silent_direction is None
    assert len(found.fit.residual) > len(hits) // 2


def slow_lines(hits, points_w):
    """For each point centre, normal and trust of the hits in the 3 x 3 cells around it, or None."""
    cells, found = SPEC.world_to_cell(hits), []
    for cell in SPEC.world_to_cell(points_w):
        near = hits[(np.abs(cells - cell) <= 1).all(axis=1)] / SPEC.resolution
        if len(near) < CONFIG.min_hits:
            found.append(None)
            continue
        (short, long), axes = np.linalg.eigh(np.cov(near.T, bias=True))
        elongation = long / (max(short, 0.0) + THICKNESS)
        line = (near.mean(axis=0) * SPEC.resolution, axes[:, 0], elongation)
        found.append(line if elongation > CONFIG.elongation else None)
    typical = np.median([line[2] for line in found if line])
    return [line and (line[0], line[1], (line[2] / (line[2] + typical)) ** 2) for line in found]


def slow_round(hits, points_b, pose):
    """One Gauss-Newton step, beam by beam, slopes by small differences; and the shares of the normals."""
    H, b, information, total = np.zeros((3, 3)), np.zeros(3), np.zeros((2, 2)), 0.0
    lines = slow_lines(hits, transform_points(pose, points_b))
    for point, line in zip(points_b, lines, strict=True):
        if line is None:
            continue
        centre, normal, trust = line

        def distance(at, point=point, centre=centre, normal=normal):
            return normal @ (transform_points(at, point[None])[0] - centre)

        slopes = [(distance(pose + h) - distance(pose - h)) / 2e-6 for h in 1e-6 * np.eye(3)]
        weight = trust * np.exp(-0.5 * (distance(pose) / RHO) ** 2)
        H += weight * np.outer(slopes, slopes)
        b += weight * distance(pose) * np.array(slopes)
        information += weight * np.outer(normal, normal)
        total += weight
    step = -np.linalg.solve(H + 1e-3 * np.diag(np.diag(H)), b)
    return pose + step, np.linalg.eigvalsh(information / total)


def rough_room(seed):
    """The room's walls, some hits exact, some with 1 and some with 3 cm of noise."""
    rng = np.random.default_rng(seed)
    roughness = rng.choice([0.0, 0.01, 0.03], len(ROOM))
    return ROOM + roughness[:, None] * rng.normal(size=ROOM.shape)


def test_one_round_is_the_weighted_least_squares_step_of_the_definition(monkeypatch):
    monkeypatch.setattr(module, "ITERATIONS", 1)
    hits, start = rough_room(1), TRUE_POSE + [0.02, -0.015, 0.008]
    points_b = seen_from(TRUE_POSE, ROOM)[::5]
    points_b[::4] += 0.04  # beams that disagree: how little they count depends on rho
    moments = moments_of(hits)
    expected, shares = slow_round(hits, points_b, start)
    one = align_to_lines(moments, points_b, start, start, CONFIG)
    assert (np.abs(one.pose - start) < 0.9 * MAX_STEP).all()  # a step that was not held back
    np.testing.assert_allclose(one.pose - start, expected - start, rtol=1e-5, atol=1e-9)
    # The least share of the normals decides whether a direction is silent.
    for share, silent in ((shares[0] * (1 - 1e-6), False), (shares[0] * (1 + 1e-6), True)):
        monkeypatch.setattr(module, "DEGENERATE_BELOW", float(share))
        found = align_to_lines(moments, points_b, start, start, CONFIG)
        assert (found.silent_direction is not None) == silent


@pytest.mark.parametrize("hits", [np.zeros((0, 2)), [[5.5, 5.5], [5.0, -5.0]]])
def test_without_lines_the_pose_is_left_alone(hits):
    start = TRUE_POSE + [0.02, 0.01, 0.01]
    found = aligned(
        np.reshape(hits, (-1, 2)), start, odometry=np.zeros(3), points_b=seen_from(TRUE_POSE, ROOM)
    )
    np.testing.assert_array_equal(found.pose, start)
    assert found.fit is None
    assert found.silent_direction is None


@pytest.mark.parametrize("world", [0.0, 0.3, np.pi / 2, 2.0, -0.3])
def test_length_of_a_bare_corridor_is_silent_and_taken_from_the_odometry(world):
    hits, along = turned(CORRIDOR, world), np.array([np.cos(world), np.sin(world)])
    across = np.array([-along[1], along[0]])
    start = TRUE_POSE + [*(0.03 * across + 0.08 * along), 0.01]
    odometry = TRUE_POSE + [*(-0.05 * across + 0.02 * along), 0.0]
    found = aligned(hits, start, odometry)
    assert abs(found.silent_direction @ along) == pytest.approx(1.0, abs=1e-6)
    moved = found.pose[:2] - TRUE_POSE[:2]
    assert moved @ along == pytest.approx(0.02, abs=1e-6)
    assert abs(moved @ across) <= 10 * STOP[0]
    assert abs(found.pose[2] - TRUE_POSE[2]) <= 10 * STOP[2]


def test_end_wall_with_a_twentieth_of_the_beams_gives_the_corridor_its_length():
    hits = np.vstack([CORRIDOR, line(4.6, -0.4, 4.6, 0.4)])
    found = aligned(hits, TRUE_POSE + [0.02, 0.0, 0.0], odometry=np.zeros(3))
    assert found.silent_direction is None
    assert (np.abs(found.pose - TRUE_POSE) <= 10 * STOP).all()


# Lines weighed against odometry
# ------------------------------------------------------------------------------------------------

WEIGHED = replace(CONFIG, independent_beams=150.0)
VARIANCE = np.array([0.02, 0.01]) ** 2


def weighed(hits, start, odometry, variance=VARIANCE):
    moments = moments_of(hits)
    return align_to_lines(moments, seen_from(TRUE_POSE, hits), start, np.array(odometry), WEIGHED, variance)


def test_one_weighed_step_minimises_the_sum_of_both_costs():
    """Against the normal equations written out, beam by beam, as one long least-squares problem."""
    rng = np.random.default_rng(0)
    residual, weight = 0.01 * rng.standard_normal(30), rng.uniform(0.1, 1.0, 30)
    jacobian, departure = rng.standard_normal((30, 3)), np.array([0.01, -0.02, 0.005])
    for beams in (5.0, 1e6):
        config = replace(CONFIG, independent_beams=beams)
        k = min(1.0, beams / weight.sum())
        rows = [
            np.sqrt(k * w) / LINE_SIGMA * np.append(j, -r)
            for w, j, r in zip(weight, jacobian, residual, strict=True)
        ]
        for axis, sigma in enumerate(np.sqrt(VARIANCE[[0, 0, 1]])):
            rows.append(np.append(np.eye(3)[axis], -departure[axis]) / sigma)
        A, b = np.array(rows)[:, :3], np.array(rows)[:, 3]
        expected = np.linalg.lstsq(A, b, rcond=None)[0]
        assert (np.abs(expected) < MAX_STEP).all()
        found = step_with_prior(residual, jacobian, weight, departure, VARIANCE, config)
        np.testing.assert_allclose(found, expected, atol=1e-10)


def test_along_a_corridor_odometry_has_the_say_and_across_it_the_walls():
    ahead = np.array([0.3, -0.2, 0.0])
    moments = moments_of(CORRIDOR)
    points_b = seen_from(ahead, CORRIDOR)
    found = align_to_lines(moments, points_b, ahead, ahead + [0.05, 0.02, 0.0], WEIGHED, VARIANCE)
    np.testing.assert_allclose(found.pose, ahead + [0.05, 0.0, 0.0], atol=2e-3)
    assert abs(found.silent_direction[0]) == pytest.approx(1.0, abs=1e-6)


def test_walls_all_round_outvote_odometry_unless_that_is_sure():
    wrong = TRUE_POSE + [0.02, -0.02, 0.01]
    np.testing.assert_allclose(weighed(ROOM, wrong, wrong).pose, TRUE_POSE, atol=2e-3)
    np.testing.assert_allclose(weighed(ROOM, wrong, wrong, np.zeros(2)).pose, wrong, atol=1e-6)
