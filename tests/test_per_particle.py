"""Maps for every particle and scan matching: the same interface, maps of their own, histories that stay whole."""

from dataclasses import replace

import numpy as np
import pytest
from rooms import CURVES, drive

from pfslam.beyond.per_particle import Histories, per_particle_step
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.poses import compose
from pfslam.refined.noise import MotionNoise, predicted
from pfslam.refined.step import RefinedConfig, refined_step
from pfslam.run import run_slam, slam_steps
from pfslam.slam import SlamConfig

DRIVE, SHORT = drive(CURVES), drive([(1.0, 10, 0.4)])
CONFIG = replace(SlamConfig.per_particle(), particles=6)


def owners(histories):
    """How many different maps the hypotheses write into."""
    return len({id(belief.map) for belief in histories.beliefs})


def test_heirs_of_one_history_have_its_map_and_do_not_write_into_one_anothers():
    config = replace(CONFIG, draw_metres=0.0, draw_radians=0.0, resample_below=0.0)
    events, rng = config.used_scans(SHORT).events(), np.random.default_rng(1)
    histories, _ = per_particle_step(Histories.start(config), next(events), config, rng)
    assert owners(histories) == 6
    histories, info = per_particle_step(histories, next(events), config, rng)
    assert not info.resampled
    heavy = replace(histories, log_weights=np.log([1e-300, 1.0, 1e-300, 1e-300, 1e-300, 1e-300]))
    histories, info = per_particle_step(heavy, next(events), replace(config, resample_below=0.5), rng)
    assert info.resampled
    assert owners(histories) == 6
    maps = [belief.map for belief in histories.beliefs]
    for one in maps:
        np.testing.assert_array_equal(one.grid.log_odds, maps[0].grid.log_odds)
        np.testing.assert_array_equal(one.moments.sums, maps[0].moments.sums)
    np.testing.assert_allclose(np.exp(histories.log_weights), 1 / 6)
    before, scans = maps[0].copy(), len(maps[0].drawn)
    for event in events:
        refined_step(histories.beliefs[1], event, config, rng)
    assert len(maps[0].drawn) == scans
    np.testing.assert_array_equal(maps[0].grid.log_odds, before.grid.log_odds)
    np.testing.assert_array_equal(maps[0].field.values, before.field.values)
    np.testing.assert_array_equal(maps[0].moments.slots.values, before.moments.slots.values)


def test_the_heaviest_history_speaks_for_all():
    for histories, info in slam_steps(SHORT, CONFIG, np.random.default_rng(3)):
        heaviest = int(np.argmax(info.particles.log_weights))
        np.testing.assert_array_equal(info.estimate, info.particles.poses[heaviest])
        assert info.resampled or histories.best is histories.beliefs[heaviest]


def test_one_history_is_the_shared_filter_with_one_particle():
    """With a single particle nothing is left to tell the two apart: same map, same poses, same random numbers."""
    single = replace(SlamConfig.per_particle(), particles=1)
    plain = RefinedConfig(**vars(single))
    alone = run_slam(SHORT, single, rng=np.random.default_rng(4))
    shared = run_slam(SHORT, plain, rng=np.random.default_rng(4))
    np.testing.assert_array_equal(alone.trajectory.poses, shared.trajectory.poses)
    np.testing.assert_array_equal(alone.grid.log_odds, shared.grid.log_odds)


def test_scan_matching_needs_no_random_numbers():
    one, other = (run_slam(SHORT, SlamConfig.matching(), rng=np.random.default_rng(seed)) for seed in (5, 6))
    np.testing.assert_array_equal(one.trajectory.poses, other.trajectory.poses)
    assert one.resamplings == 0
    events = list(SlamConfig.matching().used_scans(SHORT).events())
    particles, noise = SlamConfig.matching().start().particles, MotionNoise(sampled=False)
    moved, variance = predicted(particles, events[1], noise, np.random.default_rng(0))
    np.testing.assert_array_equal(moved.poses[0], compose(particles.poses[0], events[1].motion))
    assert (variance > 0).all()  # the search still knows how far to look


@pytest.mark.parametrize("config", [CONFIG, SlamConfig.matching()], ids=["per-particle", "matching"])
def test_both_follow_a_noiseless_room_to_within_half_a_cell(config):
    result = run_slam(DRIVE, config)
    assert trajectory_error(result.trajectory, DRIVE.truth).ate_max_m < 0.025
