"""What a particle makes of the scores: likelihood times prior, in a window that follows the motion."""

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
SEARCH = SearchConfig(yaw_step=0.005)
SIGMAS = (0.05, 0.006)


def case(seed=0, beams=30, particles=15):
    rng = np.random.default_rng(seed)
    return (
        rng.random(SPEC.shape) < 0.1,
        rng.uniform(-0.9, 0.9, (beams, 2)),
        rng.normal(0, [0.05, 0.05, 0.01], (particles, 3)),
    )


def matched(occupied, points, poses, config=SEARCH, sigmas=SIGMAS):
    return match(score_field(occupied), SPEC, points, poses, sigmas, config)


def jumped(occupied, points, poses):
    """Where the report's search leads."""
    grid = OccupancyGrid(SPEC, np.where(occupied, 1.0, -1.0))
    particles = Particles(poses, np.zeros(len(poses)))
    return best_perturbations(grid, points, particles, REPORT, np.random.default_rng(1))


def window_scores(field, points, pose, window):
    """For one particle: the lattice steps of its window and their scores at its node, summed point by point."""
    steps = window.steps() * LATTICE.steps
    scores = []
    for node in np.rint(pose / LATTICE.steps) * LATTICE.steps + steps:
        cells = SPEC.world_to_cell(transform_points(node, points))
        ix, iy = cells[SPEC.contains(cells)].T
        scores.append(field[iy, ix].astype(int).sum())
    return steps, np.array(scores)


def test_report_jumps_to_a_pose_of_greatest_count_and_keeps_its_offset():
    occupied, points, poses = case()
    found = jumped(occupied, points, poses)
    for k, pose in enumerate(poses):
        steps, scores = window_scores(occupied, points, pose, Window(4, 4))
        landed = np.flatnonzero(np.abs(pose + steps - found.particles.poses[k]).max(axis=1) < 1e-9)
        assert len(landed) == 1
        assert scores[landed[0]] == scores.max() == found.counts[k]
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
    found = jumped(occupied, middle[None], poses).particles.poses
    np.testing.assert_allclose(found[:, :2], 0.0, atol=1e-12)
    counts = np.bincount(np.rint(found[:, 2] / 0.005).astype(int) + 4, minlength=tied)
    # Each count is binomial with variance N p (1 - p); five standard deviations.
    assert np.abs(counts - 1000).max() < 5 * np.sqrt(9000 * (1 / 9) * (8 / 9))


def test_where_nothing_scores_the_report_leaves_the_particle_and_gives_it_no_likelihood():
    _, points, poses = case()
    found = jumped(np.zeros(SPEC.shape, dtype=bool), points, poses)
    np.testing.assert_allclose(found.particles.poses, poses, atol=1e-15)  # round-off of the wrapped heading
    assert (found.log_likelihood == -np.inf).all()


@pytest.mark.parametrize("prior", [True, False])
def test_particles_take_the_step_that_maximises_score_less_prior(prior):
    """J = B S - |dxy|^2 / 2 s_xy^2 - dtheta^2 / 2 s_th^2 with S the mean field value, from 0 to 1.

    Without a prior the nearest of equals wins. The weight is exp(J).
    """
    occupied, points, poses = case(2)
    found = matched(occupied, points, poses, replace(SEARCH, prior=prior))
    field, window = score_field(occupied), window_for(SEARCH, LATTICE, *SIGMAS)
    for k, pose in enumerate(poses):
        steps, scores = window_scores(field, points, pose, window)
        away = 0.5 * ((steps / [SIGMAS[0], SIGMAS[0], SIGMAS[1]]) ** 2).sum(axis=1)
        J = SEARCH.sharpness * scores / (1000 * len(points)) - (1.0 if prior else 1e-9) * away
        best = np.argmax(J)
        np.testing.assert_allclose(found.poses[k], pose + steps[best], atol=1e-12)
        assert found.score[k] == pytest.approx(scores[best] / (1000 * len(points)), rel=1e-6)
        assert found.log_likelihood[k] == pytest.approx(J[best], abs=1e-5 if prior else 1e-3)


@pytest.mark.parametrize("prior", [True, False])
def test_on_a_blank_map_the_predicted_pose_stays(prior):
    _, points, poses = case(3, particles=50)
    found = matched(np.zeros(SPEC.shape, dtype=bool), points, poses, replace(SEARCH, prior=prior)).poses
    np.testing.assert_allclose(found, poses, atol=1e-15)


def test_headings_across_pi_come_back_wrapped():
    occupied, points, _ = case(5)
    poses = np.array([[0.0, 0.0, np.pi - 0.001], [0.0, 0.0, -np.pi + 0.001]])
    found = matched(occupied, points, poses).poses
    assert ((found[:, 2] > -np.pi) & (found[:, 2] <= np.pi)).all()
    assert (np.abs(wrap_angle(found[:, 2] - poses[:, 2])) <= 4.5 * 0.005).all()


@pytest.mark.parametrize(
    "moved", [lambda *case: jumped(*case).particles.poses, lambda *case: matched(*case).poses]
)
def test_how_the_particles_are_parted_does_not_change_where_any_of_them_goes(monkeypatch, moved):
    drawn = case(10, particles=60)
    together = moved(*drawn)
    monkeypatch.setattr("pfslam.search.volume.CHUNK", 5 * 729)
    monkeypatch.setattr("pfslam.search.volume.MAX_SCORES", 8 * 729)
    np.testing.assert_array_equal(moved(*drawn), together)


def test_window_spans_three_sigmas_within_its_limits():
    config = SearchConfig(yaw_step=0.01, cells=(4, 10), yaws=(4, 30))
    lattice = Lattice(0.05, 0.01)
    assert window_for(config, lattice, 0.11, 0.06) == Window(7, 18)
    assert window_for(config, lattice, 0.11, 0.041) == Window(7, 13)  # 6.6 cells and 12.3 steps, rounded up
    assert window_for(config, lattice, 0.0, 0.0) == Window(4, 4)
    assert window_for(config, lattice, 9.0, 9.0) == Window(10, 30)


def test_prior_without_any_noise_pins_the_particle_to_its_prediction():
    occupied, points, poses = case(9)
    np.testing.assert_allclose(matched(occupied, points, poses, sigmas=(0.0, 0.0)).poses, poses, atol=1e-15)
