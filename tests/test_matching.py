"""What a particle makes of the scores: the report's jump, the prior, the step within a cell."""

from dataclasses import replace

import numpy as np
import pytest

from pfslam.correlation import best_perturbations
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.particles import Particles
from pfslam.poses import transform_points, wrap_angle
from pfslam.refined.field import score_field
from pfslam.refined.matching import SearchConfig, match, window_for
from pfslam.search.lattice import Lattice, Window
from pfslam.slam import SlamConfig

SPEC = GridSpec((-1.013, -1.021), 0.05, (40, 41))
LATTICE = Lattice(0.05, 0.005)
REPORT = SlamConfig.report().search
COUNTING = SearchConfig.counting(REPORT)
CLIMB = SearchConfig(
    yaw_step=0.005, field="distance", prior=True, sub_cell=False, keep_offset=False, weight="likelihood"
)
SIGMAS = (0.05, 0.006)


def case(seed=0, beams=30, particles=15):
    rng = np.random.default_rng(seed)
    return (
        rng.random(SPEC.shape) < 0.1,
        rng.uniform(-0.9, 0.9, (beams, 2)),
        rng.normal(0, [0.05, 0.05, 0.01], (particles, 3)),
    )


def matched(occupied, points, poses, config, sigmas=SIGMAS, seed=1):
    return match(
        score_field(occupied, config.field), SPEC, points, poses, sigmas, config, np.random.default_rng(seed)
    )


def jumped(occupied, points, poses):
    """Where the report's search leads, which the accurate filter's search in its settings repeats to the last bit."""
    grid, particles = (
        OccupancyGrid(SPEC, np.where(occupied, 1.0, -1.0)),
        Particles(poses, np.zeros(len(poses))),
    )
    report = best_perturbations(grid, points, particles, REPORT, np.random.default_rng(1))
    found = matched(occupied, points, poses, COUNTING)
    np.testing.assert_array_equal(report.particles.poses, found.poses)
    np.testing.assert_array_equal(report.log_likelihood, found.log_likelihood)
    np.testing.assert_array_equal(report.score, found.score)
    return found


def window_scores(occupied, points, pose, config):
    """For one particle: the lattice poses of its window and their scores, summed end point by end point."""
    field = score_field(occupied, config.field).values.astype(int)
    steps = window_for(config, Lattice(0.05, config.yaw_step), *SIGMAS).steps()
    nodes = (np.rint(pose / [0.05, 0.05, config.yaw_step]) + steps) * [0.05, 0.05, config.yaw_step]
    scores = []
    for node in nodes:
        cells = SPEC.world_to_cell(transform_points(node, points))
        ix, iy = cells[SPEC.contains(cells)].T
        scores.append(field[iy, ix].sum())
    return nodes, np.array(scores)


def test_report_jumps_to_a_pose_of_greatest_count_and_keeps_its_offset():
    occupied, points, poses = case()
    found = jumped(occupied, points, poses)
    for k, pose in enumerate(poses):
        nodes, scores = window_scores(occupied, points, pose, COUNTING)
        offset = pose - np.rint(pose / LATTICE.steps) * LATTICE.steps
        landed = np.flatnonzero(np.abs(nodes + offset - found.poses[k]).max(axis=1) < 1e-9)
        assert len(landed) == 1
        assert scores[landed[0]] == scores.max()
        assert found.log_likelihood[k] == pytest.approx(np.log(scores.max()))
        assert found.score[k] == pytest.approx(scores.max() / len(points))


def test_ties_are_broken_evenly_at_random():
    # One occupied cell and one end point in it: every shift that keeps the point in the cell scores 1, in all
    # headings.
    occupied = np.zeros(SPEC.shape, dtype=bool)
    occupied[25, 25] = True
    middle = SPEC.cell_to_world([25, 25])
    # That is one shift in x and y for each of nine headings: a turn by 0.02 rad moves the point by 1 cm.
    tied = 9
    poses = np.zeros((9000, 3))
    found = jumped(occupied, middle[None], poses).poses
    np.testing.assert_allclose(found[:, :2], 0.0, atol=1e-12)
    counts = np.bincount(np.rint(found[:, 2] / 0.005).astype(int) + 4, minlength=tied)
    # Each count is binomial with variance N p (1 - p); five standard deviations.
    assert np.abs(counts - 1000).max() < 5 * np.sqrt(9000 * (1 / 9) * (8 / 9))


def test_where_nothing_scores_the_report_leaves_the_particle_and_gives_it_no_likelihood():
    _, points, poses = case()
    found = jumped(np.zeros(SPEC.shape, dtype=bool), points, poses)
    np.testing.assert_allclose(found.poses, poses, atol=1e-15)  # round-off of the wrapped heading
    assert (found.log_likelihood == -np.inf).all()


@pytest.mark.parametrize("prior", [True, False])
@pytest.mark.parametrize("weight", ["likelihood", "count"])
def test_climb_takes_the_lattice_pose_that_maximises_score_less_prior(prior, weight):
    """J = B S - |dxy|^2 / 2 s_xy^2 - dtheta^2 / 2 s_th^2 with S the mean field value, from 0 to 1.

    Without a prior the nearest of equals wins. The weight is exp(J), or the sum of the field's values.
    """
    occupied, points, poses = case(2)
    found = matched(occupied, points, poses, replace(CLIMB, prior=prior, weight=weight))
    for k, q in enumerate(poses):
        nodes, scores = window_scores(occupied, points, q, CLIMB)
        away = 0.5 * (((nodes - q) / [SIGMAS[0], SIGMAS[0], SIGMAS[1]]) ** 2).sum(axis=1)
        J = CLIMB.sharpness * scores / (1000 * len(points)) - (1.0 if prior else 1e-9) * away
        best = np.argmax(J)
        np.testing.assert_allclose(found.poses[k], nodes[best], atol=1e-12)
        if weight == "likelihood":
            assert found.log_likelihood[k] == pytest.approx(J[best], abs=1e-9 if prior else 1e-4)
        else:  # sums are kept in single precision
            assert found.log_likelihood[k] == pytest.approx(np.log(scores[best]), rel=1e-6)


@pytest.mark.parametrize("prior", [True, False])
def test_on_a_blank_map_the_step_within_a_cell_returns_the_predicted_pose(prior):
    # J is then the prior alone, a parabola on each axis with its peak at q: the fit is exact up to round-off.
    # Without a prior the tie-break is a parabola too, a millionth as high, with as many digits fewer.
    _, points, poses = case(3, particles=50)
    config = replace(CLIMB, sub_cell=True, prior=prior)
    found = matched(np.zeros(SPEC.shape, dtype=bool), points, poses, config).poses
    np.testing.assert_allclose(found, poses, atol=1e-12 if prior else 1e-8)


@pytest.mark.parametrize(
    "cells", [(1, 1), (2, 5)]
)  # three poses along x: the best one has just two neighbours
def test_step_within_a_cell_is_the_peak_of_the_parabola_through_three_scores(cells):
    # Two cells side by side, one end point: scores along x are known, and the parabola through them by
    # polyfit.
    occupied = np.zeros(SPEC.shape, dtype=bool)
    occupied[20, [24, 25, 28]] = True
    point = SPEC.cell_to_world([[25, 20]])
    config = replace(CLIMB, sub_cell=True, yaws=(0, 0), cells=cells)
    q = np.array([[0.012, 0.0, 0.0]])
    found = matched(occupied, point, q, config).poses[0]
    nodes, scores = window_scores(occupied, point, q[0], config)
    J = config.sharpness * scores / 1000 - 0.5 * (((nodes - q[0]) / [0.05, 0.05, 0.006]) ** 2).sum(axis=1)
    row = np.abs(nodes[:, 1]) < 1e-9
    x, values = nodes[row, 0] / 0.05, J[row]
    best = int(np.argmax(values))
    a, b, _ = np.polyfit(x[best - 1 : best + 2], values[best - 1 : best + 2], 2)
    assert abs(-b / (2 * a) - x[best]) < 0.5
    assert found[0] == pytest.approx(0.05 * -b / (2 * a), abs=1e-9)


def test_headings_across_pi_come_back_wrapped():
    occupied, points, _ = case(5)
    poses = np.array([[0.0, 0.0, np.pi - 0.001], [0.0, 0.0, -np.pi + 0.001]])
    found = matched(occupied, points, poses, replace(CLIMB, sub_cell=True)).poses
    assert ((found[:, 2] > -np.pi) & (found[:, 2] <= np.pi)).all()
    assert (np.abs(wrap_angle(found[:, 2] - poses[:, 2])) <= 4.5 * 0.005 + 0.0025).all()


@pytest.mark.parametrize("config", [COUNTING, replace(CLIMB, sub_cell=True)], ids=["report", "climb"])
def test_how_the_particles_are_parted_does_not_change_where_any_of_them_goes(monkeypatch, config):
    occupied, points, poses = case(10, particles=60)
    together = matched(occupied, points, poses, config)
    monkeypatch.setattr("pfslam.search.volume.CHUNK", 5 * 729)
    monkeypatch.setattr("pfslam.search.boxes.MAX_SCORES", 8 * 729)
    apart = matched(occupied, points, poses, config)
    for field in ("poses", "log_likelihood", "score"):
        np.testing.assert_array_equal(getattr(apart, field), getattr(together, field))


def test_window_spans_three_sigmas_within_its_limits():
    config = SearchConfig(yaw_step=0.01, cells=(4, 10), yaws=(4, 30))
    lattice = Lattice(0.05, 0.01)
    assert window_for(config, lattice, 0.11, 0.06) == Window(7, 18)
    assert window_for(config, lattice, 0.11, 0.041) == Window(7, 13)  # 6.6 cells and 12.3 steps, rounded up
    assert window_for(config, lattice, 0.0, 0.0) == Window(4, 4)
    assert window_for(config, lattice, 9.0, 9.0) == Window(10, 30)


def test_prior_without_any_noise_pins_the_particle_to_its_prediction():
    # The smallest sigma is a thousandth of a step, so a full score outweighs 54 = (x / sigma)^2 / 2: about
    # ten sigmas.
    occupied, points, poses = case(9)
    found = matched(occupied, points, poses, replace(CLIMB, sub_cell=True), sigmas=(0.0, 0.0)).poses
    assert (np.abs(found - poses) < 0.011 * LATTICE.steps).all()
