"""Maps for every particle and scan matching: the same interface, shared arrays, histories that stay whole."""

from dataclasses import replace

import numpy as np
import pytest
from rooms import CURVES, drive

from pfslam.beyond.per_particle import Histories, per_particle_step
from pfslam.config import MotionNoise, SlamConfig
from pfslam.correlation import score_field
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.events import Drive
from pfslam.poses import compose
from pfslam.run import run_slam, slam_steps
from pfslam.slam import SlamState, predict_motion

DRIVE = drive(CURVES)
CONFIG = replace(SlamConfig.per_particle(), particles=6)


def test_all_begin_with_one_map_between_them():
    event = next(Drive.of(DRIVE, CONFIG).events())
    histories, info = per_particle_step(Histories.start(CONFIG), event, CONFIG, np.random.default_rng(0))
    assert len(histories.states) == 6
    assert len({id(state.grid.log_odds) for state in histories.states}) == 1
    np.testing.assert_allclose(np.exp(histories.log_weights), 1 / 6)
    assert info.drawn


def test_maps_differ_once_drawn_and_copies_share_them_again():
    """After a step each history has drawn a map of its own; resampling 0, 0, 1 needs two maps, not three."""
    config = replace(CONFIG, draw_metres=0.0, draw_radians=0.0, resample_below=0.0)
    events = Drive.of(DRIVE, config).events()
    rng = np.random.default_rng(1)
    histories, _ = per_particle_step(Histories.start(config), next(events), config, rng)
    histories, info = per_particle_step(histories, next(events), config, rng)
    assert not info.resampled
    assert len({id(state.grid.log_odds) for state in histories.states}) == 6
    heavy = np.log([1.0, 1e-300, 1e-300, 1e-300, 1e-300, 1e-300])
    histories, info = per_particle_step(
        Histories(histories.states, heavy), next(events), replace(config, resample_below=0.5), rng
    )
    assert info.resampled
    assert len({id(state.grid.log_odds) for state in histories.states}) == 1
    np.testing.assert_allclose(np.exp(histories.log_weights), 1 / 6)


def test_a_step_leaves_the_histories_before_it_alone():
    events = Drive.of(DRIVE, CONFIG).events()
    rng = np.random.default_rng(2)
    before, _ = per_particle_step(Histories.start(CONFIG), next(events), CONFIG, rng)
    maps = [state.grid.log_odds.copy() for state in before.states]
    for event in events:
        per_particle_step(before, event, CONFIG, rng)
        break
    for state, log_odds in zip(before.states, maps, strict=True):
        np.testing.assert_array_equal(state.grid.log_odds, log_odds)


def test_histories_at_rest_lose_nothing_and_take_half_the_room():
    config = replace(CONFIG, particles=2, draw_metres=0.0, draw_radians=0.0)
    *_, (histories, _) = slam_steps(DRIVE, config, np.random.default_rng(0))
    for history in histories.states:
        whole = history.opened()
        assert (whole.field.values.dtype, whole.moments.slots.dtype) == (np.float32, np.int32)
        np.testing.assert_array_equal(
            whole.field.values, score_field(history.grid.occupied, config.search.field).values
        )
        # Every slot is used by one cell, and row 0 by all the others.
        slots, cells = np.unique(whole.moments.slots, return_counts=True)
        np.testing.assert_array_equal(slots, np.arange(len(whole.moments.sums)))
        assert (cells[1:] == 1).all()
        kept = [a for s in (history.field, history.slots) for a in (s.index, s.values)]
        assert sum(a.nbytes for a in kept) < 0.5 * (whole.field.values.nbytes + whole.moments.slots.nbytes)


def test_the_heaviest_history_speaks_for_all():
    result = list(slam_steps(DRIVE, CONFIG, np.random.default_rng(3)))
    histories, info = result[-2]
    heaviest = int(np.argmax(info.particles.log_weights))
    np.testing.assert_array_equal(info.estimate, info.particles.poses[heaviest])
    if not info.resampled:
        assert histories.grid is histories.states[heaviest].grid


def test_one_history_is_the_shared_filter_with_one_particle():
    """With a single particle nothing is left to tell the two apart: same map, same poses, same random numbers."""
    single = replace(SlamConfig.per_particle(), particles=1)
    alone = run_slam(DRIVE, single, rng=np.random.default_rng(4))
    shared = run_slam(DRIVE, replace(single, maps="shared"), rng=np.random.default_rng(4))
    np.testing.assert_array_equal(alone.trajectory.poses, shared.trajectory.poses)
    np.testing.assert_array_equal(alone.grid.log_odds, shared.grid.log_odds)


def test_scan_matching_needs_no_random_numbers():
    one, other = (run_slam(DRIVE, SlamConfig.matching(), rng=np.random.default_rng(seed)) for seed in (5, 6))
    np.testing.assert_array_equal(one.trajectory.poses, other.trajectory.poses)
    assert one.resamplings == 0


def test_unsampled_motion_is_odometry_itself():
    config = replace(
        SlamConfig.matching(), search=replace(SlamConfig.matching().search), noise=MotionNoise(sampled=False)
    )
    events = list(Drive.of(DRIVE, config).events())
    particles = SlamState.start(config).particles
    moved, variance = predict_motion(particles, events[1], config, np.random.default_rng(0))
    np.testing.assert_array_equal(moved.poses[0], compose(particles.poses[0], events[1].motion))
    assert (variance > 0).all()  # the search still knows how far to look


@pytest.mark.parametrize("config", [CONFIG, SlamConfig.matching()], ids=["per-particle", "matching"])
def test_both_follow_a_noiseless_room_to_within_half_a_cell(config):
    result = run_slam(DRIVE, config)
    assert trajectory_error(result.trajectory, DRIVE.truth).ate_max_m < 0.025
