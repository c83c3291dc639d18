"""Chapter 09: what its helpers compute, against values known beforehand."""

import numpy as np
import pytest
from texture_steps import SEEDS, measured_steps

from pfslam.evaluation.trajectory import trajectory_error
from pfslam.poses import Trajectory, compose
from pfslam.teaching.ch09 import beyond as ch09_beyond
from pfslam.teaching.ch09 import kinds as ch09_kinds
from pfslam.teaching.ch09 import particles as ch09_particles
from pfslam.teaching.ch09 import runs as ch09_runs
from pfslam.teaching.ch09 import tables as ch09
from pfslam.teaching.ch09 import walls as ch09_walls
from pfslam.teaching.ch09.texture import read_steps
from pfslam.texture.mapping import TextureConfig


def circle():
    s = np.linspace(0.0, 4.0, 50)
    return Trajectory(s, np.column_stack([3 * np.sin(s), 3 - 3 * np.cos(s), s]))


def test_best_fit_forgives_any_rigid_motion_and_nothing_else():
    truth = circle()
    moved = Trajectory(truth.t, compose(np.array([4.0, -2.0, 1.1]), truth.poses))
    assert ch09_beyond.best_fit_rmse(moved, truth) == pytest.approx(0.0, abs=1e-9)
    stretched = Trajectory(truth.t, truth.poses * [1.1, 1.1, 1.0])
    centred = truth.poses[:, :2] - truth.poses[:, :2].mean(axis=0)
    expected = 0.1 * np.sqrt(np.mean(np.sum(centred**2, axis=1)))
    assert ch09_beyond.best_fit_rmse(stretched, truth) == pytest.approx(expected)


def test_one_wrong_first_heading_shows_by_first_pose_and_nearly_vanishes_in_the_fit():
    truth = circle()
    wrong = ch09_beyond.turned_start(truth, 1.0)
    distance = np.hypot(*(truth.poses[:, :2] - truth.poses[0, :2]).T)
    expected = np.sqrt(np.mean((2 * np.sin(np.deg2rad(0.5)) * distance) ** 2))
    assert trajectory_error(wrong, truth).ate_rmse_m == pytest.approx(expected)
    assert ch09_beyond.best_fit_rmse(wrong, truth) < 1e-9


def test_the_polish_holds_the_heading_that_the_grid_loses():
    errors = np.abs(ch09_runs.grid_lock(np.array([-0.2, 0.1, 0.2])))
    assert errors[..., 0].max() > 0.15
    assert errors[..., 1].max() < 0.08


def test_lineages_follow_the_ancestors():
    clouds = np.arange(12.0).reshape(3, 4, 1) * np.ones(3)
    ancestors = np.array([[0, 0, 2, 3], [1, 1, 1, 2], [0, 1, 2, 3]])
    run = ch09_kinds.Histories(None, np.arange(3.0), clouds, ancestors, np.array([2]), ())
    assert run.lineages(2).tolist() == [[0, 0, 0, 2], [1, 1, 1, 2], [0, 1, 2, 3]]
    assert run.alive(2).tolist() == [2, 2, 4]
    assert run.paths(2)[0, :, 0].tolist() == [0.0, 0.0, 0.0, 2.0]


def test_two_places_that_only_their_beams_tell_apart():
    points = ch09_walls.scan_without_inner_wall()
    places = [ch09_walls.room(inner) for inner in (False, True)]
    assert [ch09_walls.field_score(place, points) for place in places] == [1.0, 1.0]
    shares = [ch09_walls.blocked_share(place, points) for place in places]
    assert shares[0] == 0.0
    assert shares[1] == pytest.approx(np.mean(points[:, 1] > 0), abs=0.02)


def test_lengths_in_words():
    assert [ch09.length(m) for m in (0.0072, 0.0434, 1.635)] == ["7.2 mm", "4.3 cm", "1.64 m"]


@pytest.mark.parametrize("situation", ["ordinary", "loop", "symmetric", "blind for 10 s", "kidnapped"])
def test_every_situation_has_runs_for_every_number_of_particles(situation):
    table = ch09_particles.load_particles()
    assert situation in ch09_particles.situations(table)
    for side in ch09_particles.SIDES:
        for n in ch09_particles.NUMBERS:
            assert len(ch09_particles.errors_of(table, situation, side, n)) >= 2


def test_the_stored_texture_table_is_complete():
    rows = read_steps()
    each = [(row["drive"], int(row["seed"]), row["step"]) for row in rows]
    assert each == [
        (d, seed, step) for d in ("hall", "ramp") for seed in SEEDS for step in TextureConfig.steps()
    ]


@pytest.mark.weekly
def test_a_row_of_the_texture_table_comes_out_again():
    (again,) = measured_steps("hall", seeds=(0,), steps=("report",))
    stored = read_steps()[0]
    assert again["coverage"] == pytest.approx(stored["coverage"], abs=0.01)
    assert again["position_median_cells"] == pytest.approx(stored["position_median_cells"], abs=0.1)
    assert again["colour_mean"] == pytest.approx(stored["colour_mean"], abs=0.5)
