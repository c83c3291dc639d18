"""Closing loops: the graph against finite differences and a dense oracle, false edges, and whole drives."""

from dataclasses import replace

import numpy as np
import pytest
from drives import simulated
from scipy.optimize import least_squares

from pfslam.beyond.loops import graph
from pfslam.beyond.loops.closing import (
    LOOP_FLOOR,
    Revision,
    certain,
    close_loops,
    confirming,
    matched,
    softened,
)
from pfslam.beyond.loops.graph import Edges, jacobians, relax, residuals
from pfslam.beyond.loops.places import Place, align, compare, search_window
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.poses import between, compose
from pfslam.run import SlamResult, run_slam
from pfslam.simulator import HALL, simulate
from pfslam.slam import SlamConfig


def edges_of(i, j, pose, sigma=0.02, wheels=0.0, doubtful=True) -> Edges:
    n = len(i)
    information = np.broadcast_to(np.diag([sigma**-2, sigma**-2, (0.5 * sigma) ** -2]), (n, 3, 3)).copy()
    marks = np.full(n, wheels), np.full(n, doubtful)
    return Edges(np.array(i), np.array(j), np.array(pose, dtype=float), information, *marks)


def square(K=12, drift=0.0, wheels=0.0):
    """True poses round a square, and the chain that measures them, each heading off by ``drift`` (rad)."""
    poses = [np.zeros(3)]
    for k in range(1, K):
        poses.append(compose(poses[-1], [1.0, 0.0, 0.5 * np.pi if k % 3 == 0 else 0.0]))
    poses = np.array(poses)
    index = np.arange(K)
    motion = between(poses[:-1], poses[1:]) + [0.0, 0.0, drift]
    return poses, edges_of(index[:-1], index[1:], motion, wheels=wheels, doubtful=False)


def driven(chain: Edges) -> np.ndarray:
    poses = [np.zeros(3)]
    for motion in chain.pose:
        poses.append(compose(poses[-1], motion))
    return np.array(poses)


def test_jacobians_are_the_derivatives_of_the_residuals():
    rng = np.random.default_rng(3)
    poses, scale = rng.normal(size=(5, 3)), 0.05 * rng.normal(size=5)
    edges = edges_of([0, 1, 2, 3, 4], [1, 2, 3, 4, 1], rng.normal(size=(5, 3)), wheels=0.7)
    J, step = jacobians(edges, poses), 1e-6
    for e, (i, j) in enumerate(zip(edges.i, edges.j, strict=True)):
        for column in range(7):
            ends = []
            for sign in (1.0, -1.0):
                moved, stretched = poses.copy(), scale.copy()
                if column == 6:
                    stretched[i] += sign * step
                else:
                    moved[i if column < 3 else j, column % 3] += sign * step
                ends.append(residuals(edges, moved, stretched)[e])
            assert J[e, :, column] == pytest.approx((ends[0] - ends[1]) / (2.0 * step), abs=1e-8)


def test_the_graph_finds_the_least_squares_of_a_dense_solver():
    rng = np.random.default_rng(1)
    _, chain = square(drift=0.01, wheels=0.5)
    loops = edges_of([0, 1], [11, 10], rng.normal(0, 0.05, (2, 3)) + [[1.0, 1.0, 0.3], [1.0, 2.0, 0.5]])
    edges, start = chain.joined(replace(loops, doubtful=np.zeros(2, dtype=bool))), driven(chain)
    K = len(start)
    root = np.linalg.cholesky(edges.information)

    def cost(x):
        poses, scale = np.vstack([np.zeros(3), x[: 3 * K - 3].reshape(-1, 3)]), x[3 * K - 3 :]
        error = np.einsum("eji,ej->ei", root, residuals(edges, poses, scale))
        walk = np.diff(scale) / graph.WALK_SIGMA
        return np.concatenate([error.ravel(), walk, scale[:1] / graph.SCALE_SIGMA])

    found = least_squares(cost, np.append(start[1:].ravel(), np.zeros(K)), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    poses, scale, _ = relax(edges, start)
    assert np.append(poses[1:].ravel(), scale) == pytest.approx(found.x, abs=1e-6)
    assert np.array_equal(poses[0], np.zeros(3))


def test_a_wheel_that_is_always_wrong_is_found_by_what_sees_the_way():
    K = 30
    index, step = np.arange(K), np.tile([1.02, 0.0, 0.0], (K - 1, 1))
    chain = edges_of(index[:-1], index[1:], step, sigma=0.005, wheels=1.0, doubtful=False)
    seen = edges_of([0, 2, 4], [3, 5, 7], np.tile([3.0, 0.0, 0.0], (3, 1)), sigma=0.003)
    poses, scale, _ = relax(chain.joined(seen), driven(chain))
    assert poses[-1, 0] == pytest.approx(29.0, abs=0.05)  # far beyond the last match; the wheels say 29.58
    assert scale.mean() == pytest.approx(1.0 / 1.02 - 1.0, abs=0.002)


def test_a_planted_false_loop_is_left_out():
    truth, chain = square(drift=0.02)
    good = edges_of(
        [0, 0, 1], [10, 11, 11], [between(truth[i], truth[j]) for i, j in ((0, 10), (0, 11), (1, 11))]
    )
    false = edges_of([2], [9], [between(truth[2], truth[9]) + [1.5, -1.0, 0.3]])
    edges, start = chain.joined(good, false), driven(chain)
    poses, _, weights = relax(edges, start)
    believing, _, _ = relax(replace(edges, doubtful=np.zeros(len(edges), dtype=bool)), start)
    off, off_believing = (np.abs(p - truth)[:, :2].max() for p in (poses, believing))
    assert weights[-1] < 0.01 < 0.5 < weights[-4:-1].min()
    assert off < 0.1 < 0.3 < off_believing


def test_loops_that_agree_with_the_path_leave_it_alone_and_one_that_does_not_pulls():
    truth, chain = square()
    ends = np.array([[0, 11], [1, 10], [2, 9]])
    noise = np.array([[0.02, -0.01, 0.002], [-0.02, 0.0, -0.005], [0.0, 0.3, 0.0]])
    loops = edges_of(*ends.T, [between(truth[i], truth[j]) for i, j in ends] + noise)
    agreeing = confirming(loops.chosen(np.array([True, True, False])), truth)
    assert relax(chain.joined(agreeing), truth)[0] == pytest.approx(truth, abs=1e-9)
    held = confirming(loops, truth)
    assert held.pose[:2] == pytest.approx(between(truth[ends[:2, 0]], truth[ends[:2, 1]]))
    assert np.array_equal(held.pose[2], loops.pose[2])


def corridor_place(rng, jambs=()) -> Place:
    """Two bare walls of 16 m, 2 m apart, with noise, and pieces that face along them at ``jambs`` (m)."""
    x = np.arange(-8.0, 8.0, 0.04)
    walls = [np.column_stack([x, np.full_like(x, side)]) for side in (-1.0, 1.0)]
    faces = [np.tile([0.0, -side], (len(x), 1)) for side in (-1.0, 1.0)]
    for at in jambs:
        y = np.arange(1.0, 1.2, 0.02)
        walls.append(np.column_stack([np.full_like(y, at), y]))
        faces.append(np.tile([-1.0, 0.0], (len(y), 1)))
    points = np.vstack(walls)
    return Place(points + 0.005 * rng.standard_normal(points.shape), np.vstack(faces))


def test_a_bare_corridor_closes_only_across_and_a_door_frame_also_along():
    rng = np.random.default_rng(0)
    start = np.array([0.1, 0.05, 0.01])
    for jambs, along in (((), False), ((2.0,), True)):
        places = corridor_place(rng, jambs), corridor_place(rng, jambs)
        pose = align(*places, start)
        _, information, share = compare(*places, pose)
        assert pose[1:] == pytest.approx([0.0, 0.0], abs=0.01)
        assert information[1, 1] > 1000.0
        assert (information[0, 0] > 1000.0) == along
        # The jamb faces along x, 1.1 m to the left: turning left moves it towards -x.
        assert information[0, 2] == pytest.approx(-1.1 * information[0, 0], rel=0.1, abs=1e-6)
        assert (abs(pose[0]) < 0.02) == along
        assert share > 0.9


def test_a_twin_takes_away_what_a_match_says_along_the_line_to_it():
    """(Omega^-1 + Sigma)^-1 by another way, and one over the variance of the step to the twin."""
    factor = np.random.default_rng(0).normal(size=(3, 3))
    information, d = 1e4 * factor @ factor.T + np.eye(3), np.array([1.2, 0.0, 0.0])
    covariance = np.diag([1e-4, 1e-4, 1e-5]) + np.outer(d, d)
    found = softened(information, covariance)
    assert found == pytest.approx(np.linalg.inv(np.linalg.inv(information) + covariance), rel=1e-6)
    assert d @ found @ d <= 1.0
    assert softened(np.diag([0.0, 1e4, 1e4]), covariance)[0] == pytest.approx(0.0, abs=1e-9)


def test_the_search_finds_the_pose_and_names_the_twin_of_a_place_that_repeats():
    rng = np.random.default_rng(0)
    once = corridor_place(rng, (2.0,))
    moved = once.seen_from(np.array([0.6, -0.3, 0.05]))
    (best, score), _ = search_window(moved, once, np.zeros(3), 1.5, 0.15)
    assert best[1:] == pytest.approx([-0.3, 0.05], abs=0.06)
    assert score > 0.8
    (best, score), (twin, second) = search_window(
        corridor_place(rng), corridor_place(rng), np.zeros(3), 1.5, 0.15
    )
    assert second > 0.9 * score
    assert abs((twin - best)[0]) > 0.3 > abs((twin - best)[1])


def test_a_match_in_a_place_that_repeats_says_nothing_along_the_corridor():
    rng = np.random.default_rng(0)
    places = [corridor_place(rng, np.arange(-6.5, 8.0, 2.0)) for _ in range(2)]
    match = matched(places, np.zeros((2, 3)), [(0, 1, 2.5)], 0, LOOP_FLOOR)
    (found,) = match.information
    assert found[1, 1] > 500.0
    assert found[0, 0] < 1.0
    assert not certain(match).any()  # a spring across the corridor, and not a loop


def test_a_loop_knows_where_to_half_a_metre_in_the_direction_that_it_knows_least():
    turned = Edges(*(np.zeros(3, dtype=int),) * 2, np.zeros((3, 3)), np.zeros((3, 3, 3)), *(np.zeros(3),) * 2)
    for k, deviation in enumerate((0.49, 0.51, np.inf)):
        axis = np.array([np.cos(0.7), np.sin(0.7)])
        across = 1e4 * (np.eye(2) - np.outer(axis, axis))
        turned.information[k, :2, :2] = across + np.outer(axis, axis) / deviation**2
    assert certain(turned).tolist() == [True, False, False]


def closed(recording, every=20) -> tuple[SlamResult, Revision, np.ndarray]:
    """A run of scan matching, its revision, and the squared error of each loop in units of its own deviation."""
    result = run_slam(recording, replace(SlamConfig.matching(), every=every), keep_particles=False)
    revision = close_loops(recording, result)
    loops, t = revision.loops, np.clip(result.trajectory.t, *recording.truth.t[[0, -1]])
    truth = recording.truth.at(t)[revision.keys]
    error = between(between(truth[loops.i], truth[loops.j]), loops.pose)
    return result, revision, np.einsum("ei,eij,ej->e", error, loops.information, error)


@pytest.mark.slow
def test_no_false_loop_in_the_hall_and_the_path_stays_as_good_and_the_same_each_time():
    recording = simulated("hall", None).recording
    result, revision, chi2 = closed(recording)
    assert len(revision.loops) >= 10
    assert chi2.max() < 16.0
    assert np.linalg.eigvalsh(np.linalg.inv(revision.loops.information[:, :2, :2])).max() < 0.5**2
    assert trajectory_error(revision.trajectory, recording.truth).ate_rmse_m < 0.02
    assert np.abs(revision.trajectory.poses - result.trajectory.poses)[:, :2].max() < 0.03
    again = close_loops(recording, result)
    assert np.array_equal(again.trajectory.poses, revision.trajectory.poses)
    assert np.array_equal(again.grid.log_odds, revision.grid.log_odds)


@pytest.mark.slow
def test_a_long_ring_with_wrong_wheels_is_mended():
    recording = simulated("ring", None).recording
    result, revision, _ = closed(recording)
    before, after = (trajectory_error(r.trajectory, recording.truth) for r in (result, revision))
    assert before.ate_rmse_m > 0.4
    assert after.ate_rmse_m < 0.15


@pytest.mark.slow
def test_a_building_that_looks_the_same_after_half_a_turn_gives_no_false_loop():
    robot = simulated("hall", None).config.robot
    recording = simulate(replace(HALL, layout="symmetric", laps=2, robot=robot), 1).recording
    _, revision, chi2 = closed(recording, every=40)
    assert len(revision.loops) > 10
    assert (chi2 < 25.0).all()
