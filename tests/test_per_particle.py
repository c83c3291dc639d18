"""Maps for every particle and scan matching: the same interface, maps of their own, histories that stay whole."""

from dataclasses import replace

import numpy as np
import pytest
from rooms import CURVES, ENCODER_STEP, LIDAR, SCAN_STEP, drive

from pfslam.beyond.per_particle import Histories, per_particle_step
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.io.datasets import load
from pfslam.io.selection import select
from pfslam.particles import RESAMPLERS
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


@pytest.mark.parametrize("scheme", RESAMPLERS)
def test_the_map_of_a_run_is_that_of_the_heaviest_before_resampling(scheme):
    """Every hypothesis draws every scan from a pose of its own, so the pose of the last scan drawn names its map."""
    config = replace(CONFIG, draw_metres=0.0, draw_radians=0.0, resample_below=1.0, resampler=scheme)
    events, rng, not_first = config.used_scans(SHORT).events(), np.random.default_rng(3), 0
    belief, _ = config.step(config.start(), next(events), rng)
    for event in events:
        before, (belief, info) = belief, config.step(belief, event, rng)
        assert info.resampled
        heaviest = int(np.argmax(info.particles.log_weights))
        not_first += heaviest != 0
        assert len(np.unique(info.particles.poses, axis=0)) == CONFIG.particles
        np.testing.assert_array_equal(belief.best.map.drawn_at, info.particles.poses[heaviest])
        np.testing.assert_array_equal(belief.best.estimate, info.estimate)
        assert belief.best.map is before.beliefs[heaviest].map  # written in place
        np.testing.assert_array_equal(belief.log_weights, np.full(6, -np.log(6)))
    assert not_first > 3
    result = run_slam(SHORT, config, rng=np.random.default_rng(3))
    np.testing.assert_array_equal(result.grid.log_odds, belief.best.map.grid.log_odds)


BARE = np.array([[-60.0, -1.03, 60.0, -1.03], [-60.0, 1.02, 60.0, 1.02]])
"""Two long walls, of which a scanner that sees six metres sees no end."""


def test_along_walls_that_say_nothing_hypotheses_are_spread_like_the_motion():
    """Each has its own noise of every step along the corridor; across it the walls hold them together."""
    corridor = drive([(2.0, 12, 0.0)], BARE, replace(LIDAR, range_max=6.0))
    config = replace(SlamConfig.per_particle(), particles=24, resample_below=0.0)
    infos = run_slam(corridor, config).infos
    assert all(info.silent_direction is not None for info in infos[1:])
    ends = infos[-1].particles.poses
    assert len(np.unique(ends, axis=0)) == 24
    one = config.noise.sigmas(0.012 / ENCODER_STEP * SCAN_STEP, 0.0)[0]
    expected = one * np.sqrt(len(infos) - 1)
    # The variance of 24 draws is chi-square: five of its standard deviations, as a share of a deviation.
    assert ends[:, 0].std() == pytest.approx(expected, rel=0.5 * 5 * np.sqrt(2 / 23))
    assert ends[:, 1].std() < 0.1 * expected
    for info in infos[1:]:
        assert len(np.unique(info.particles.poses, axis=0)) == 24


@pytest.mark.slow
def test_in_a_ring_of_corridors_hypotheses_stay_different_however_often_they_are_resampled():
    ring = select(replace(load("ring"), camera=None), until=40.0)
    infos = run_slam(ring, replace(SlamConfig.per_particle(), particles=5)).infos
    matched = [info for info in infos if info.matched]
    assert sum(info.resampled for info in infos) > 3
    assert all(len(np.unique(info.particles.poses, axis=0)) == 5 for info in matched)
    silent = [info.particles.poses for info in matched if info.silent_direction is not None]
    assert len(silent) > 100
    spread = [np.hypot(*poses[:, :2].std(axis=0)) for poses in silent]
    assert np.median(spread) > SlamConfig.per_particle().noise.xy


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
