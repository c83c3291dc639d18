"""Maps for every particle and scan matching: the same interface, maps of their own, histories that stay whole."""

from dataclasses import replace

import numpy as np
import pytest
from rooms import CURVES, ENCODER_STEP, SCAN_STEP, bare_corridor, blinded, drive

from pfslam.beyond.per_particle import family_step, per_particle_step, survivors
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.io.datasets import load
from pfslam.io.selection import select
from pfslam.particles import RESAMPLERS
from pfslam.poses import compose
from pfslam.refined.map import RefinedMap
from pfslam.refined.noise import MotionNoise, predicted
from pfslam.refined.step import RefinedConfig
from pfslam.run import run_slam
from pfslam.slam import SlamConfig

DRIVE, SHORT, LENGTH = drive(CURVES), drive([(1.0, 10, 0.4)]), bare_corridor()
CONFIG = replace(SlamConfig.per_particle(), particles=6)


def owners(histories):
    """How many different maps there are."""
    return len({id(family.map) for family in histories.families})


def layers(map):
    """All that a map holds, as arrays of their own."""
    held = (map.grid.log_odds, map.field, map.moments.sums, map.moments.slots.values, np.array(map.drawn))
    return [part.copy() for part in held]


def assert_same(one, other):
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


def test_where_walls_fix_the_pose_all_hypotheses_are_one_and_cost_one(monkeypatch):
    """In a room thirty are one: one alignment a scan, one map, full N_eff, and the path of scan matching."""
    aligned = []
    whole = RefinedMap.align
    monkeypatch.setattr(RefinedMap, "align", lambda *a: aligned.append(1) or whole(*a))
    config = replace(CONFIG, particles=30)
    result = run_slam(DRIVE, config)
    assert len(aligned) == sum(info.matched for info in result.infos) > 50
    assert result.resamplings == 0
    for info in result.infos:
        assert len(info.particles) == 30
        assert len(np.unique(info.particles.poses, axis=0)) == 1
        assert info.effective_sample_size == pytest.approx(30)
    one = replace(SlamConfig.matching(), draw_metres=config.draw_metres, draw_radians=config.draw_radians)
    np.testing.assert_allclose(result.trajectory.poses, run_slam(DRIVE, one).trajectory.poses, atol=1e-9)


def test_hypotheses_that_differ_get_maps_of_their_own_when_they_draw_and_leave_the_others_alone():
    events, rng = CONFIG.used_scans(LENGTH).events(), np.random.default_rng(1)
    histories, _ = per_particle_step(CONFIG.start(), next(events), CONFIG, rng)
    always, never = (replace(CONFIG, draw_metres=d, draw_radians=d, resample_below=0.0) for d in (0.0, 9.9))
    histories, info = per_particle_step(histories, next(events), never, rng)
    assert not info.drawn
    assert len(np.unique(histories.particles.poses, axis=0)) == 6
    assert owners(histories) == len(histories.families) == 1
    histories, info = per_particle_step(histories, next(events), always, rng)
    assert info.drawn
    assert owners(histories) == len(histories.families) == 6
    for family in histories.families:
        np.testing.assert_array_equal(family.map.drawn_at, family.estimate)
    before = [layers(family.map) for family in histories.families]
    family_step(histories.families[1], next(events), always, rng)
    histories.families[0].map.draw(next(events), histories.families[0].estimate)
    for family, held in list(zip(histories.families, before, strict=True))[1:]:
        assert_same(layers(family.map), held)


def test_heirs_of_one_hypothesis_share_its_map_until_they_draw():
    config = replace(CONFIG, draw_metres=0.0, draw_radians=0.0, resample_below=0.0)
    events, rng = config.used_scans(LENGTH).events(), np.random.default_rng(1)
    histories = config.start()
    for _ in range(3):
        histories, _ = per_particle_step(histories, next(events), config, rng)
    assert owners(histories) == 6
    heavy = [
        replace(f, log_weight=np.log(0.95 if k == 1 else 0.01)) for k, f in enumerate(histories.families)
    ]
    event = next(events)
    pairs = replace(config, resample_below=1.0)
    after, info = per_particle_step(replace(histories, families=tuple(heavy)), event, pairs, rng)
    assert info.resampled
    assert len(after.particles) == 6
    np.testing.assert_allclose(after.particles.weights, 1 / 6)
    largest = max(after.families, key=lambda family: len(family.particles))
    assert len(largest.particles) >= 4
    assert largest.map is after.best.map
    # Copies move apart at the next scan, and draw into maps of their own.
    after, _ = per_particle_step(after, next(events), config, rng)
    assert owners(after) == 6


def test_evidence_is_that_of_the_family_and_weights_of_heirs_add_up():
    """A family of five copies weighs five times as much as one of them."""
    events, rng = list(CONFIG.used_scans(LENGTH).events())[:8], np.random.default_rng(1)
    belief = CONFIG.start()
    for event in events[:-1]:
        belief, _ = per_particle_step(belief, event, replace(CONFIG, resample_below=0.0), rng)
    assert len(belief.families) == 6
    steps = [family_step(family, events[-1], CONFIG, rng)[0][1] for family in belief.families]
    expected = np.array([f.log_weight + s.log_evidence for f, s in zip(belief.families, steps, strict=True)])
    after, _ = per_particle_step(belief, events[-1], replace(CONFIG, resample_below=0.0), rng)
    found = np.array([family.log_weight for family in after.families])
    np.testing.assert_allclose(found - found[0], expected - expected[0], atol=1e-9)
    np.testing.assert_allclose(np.exp(found).sum(), 1.0)
    heirs = survivors(belief.families, np.array([0, 0, 0, 0, 0, 3]))
    assert [len(family.particles) for family in heirs] == [5, 1]
    np.testing.assert_allclose([np.exp(family.log_weight) for family in heirs], [5 / 6, 1 / 6])
    np.testing.assert_array_equal(heirs[1].estimate, belief.families[3].estimate)


@pytest.mark.parametrize("scheme", RESAMPLERS)
def test_the_map_of_a_run_is_that_of_the_heaviest_before_resampling(scheme):
    """Every hypothesis draws every scan from a pose of its own, so the pose of the last scan drawn names its map."""
    config = replace(CONFIG, draw_metres=0.0, draw_radians=0.0, resample_below=1.0, resampler=scheme)
    events, rng, not_first = config.used_scans(LENGTH).events(), np.random.default_rng(3), 0
    belief, _ = config.step(config.start(), next(events), rng)
    for event in events:
        belief, info = config.step(belief, event, rng)
        assert info.resampled
        heaviest = int(np.argmax(info.particles.log_weights))
        not_first += heaviest != 0
        assert len(np.unique(info.particles.poses, axis=0)) == CONFIG.particles
        np.testing.assert_array_equal(belief.best.map.drawn_at, info.particles.poses[heaviest])
        np.testing.assert_array_equal(belief.best.estimate, info.estimate)
        np.testing.assert_allclose(belief.particles.weights, np.full(6, 1 / 6))
    assert not_first > 3
    result = run_slam(LENGTH, config, rng=np.random.default_rng(3))
    np.testing.assert_array_equal(result.grid.log_odds, belief.best.map.grid.log_odds)


def test_along_walls_that_say_nothing_hypotheses_are_spread_like_the_motion():
    """Each has its own noise of every step along the corridor; across it the walls hold them together."""
    config = replace(SlamConfig.per_particle(), particles=24, resample_below=0.0)
    infos = run_slam(LENGTH, config).infos
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
    silent = [info.particles.poses for info in matched if info.silent_direction is not None]
    assert len(silent) > 100
    assert all(len(np.unique(poses, axis=0)) == 5 for poses in silent)
    spread = [np.hypot(*poses[:, :2].std(axis=0)) for poses in silent]
    assert np.median(spread) > SlamConfig.per_particle().noise.xy


def test_without_lines_one_history_is_the_shared_filter_with_one_particle():
    """With a single particle nothing is left to tell the two apart: same map, same poses, same random numbers."""
    single = replace(SlamConfig.per_particle(), particles=1, lines=None)
    plain = RefinedConfig(**vars(single))
    alone = run_slam(SHORT, single, rng=np.random.default_rng(4))
    shared = run_slam(SHORT, plain, rng=np.random.default_rng(4))
    np.testing.assert_array_equal(alone.trajectory.poses, shared.trajectory.poses)
    np.testing.assert_array_equal(alone.grid.log_odds, shared.grid.log_odds)


def test_through_scans_that_see_nothing_hypotheses_spread_and_the_next_one_gathers_them():
    config = replace(CONFIG, particles=40, noise=MotionNoise(xy=0.03))
    infos = run_slam(blinded(DRIVE, slice(40, 50)), config).infos
    blind = np.array([info.particles.poses[:, :2].std(axis=0) for info in infos[40:50]])
    expected = 0.03 + 0.08 * 0.012 / ENCODER_STEP * SCAN_STEP
    # Chi-square again, for 80 numbers; turns carry a little of it from one axis to the other.
    assert np.hypot(*blind[0]) == pytest.approx(expected * np.sqrt(2), rel=0.5)
    assert np.hypot(*blind[-1]) == pytest.approx(expected * np.sqrt(20), rel=0.5)
    assert all(len(np.unique(info.particles.poses, axis=0)) == 40 for info in infos[40:50])
    assert len(np.unique(infos[-1].particles.poses, axis=0)) < 40


def test_a_family_matched_to_different_places_is_stepped_one_by_one():
    """Hypotheses half a metre apart have no alignment in common: each is aligned by itself, and has its own map."""
    events, rng = list(CONFIG.used_scans(DRIVE).events())[:12], np.random.default_rng(0)
    belief = CONFIG.start()
    for event in events[:-1]:
        belief, _ = per_particle_step(belief, event, CONFIG, rng)
    (family,) = belief.families
    poses = family.particles.poses + np.outer(np.arange(6) >= 3, [0.0, 0.0, 0.6])
    split = replace(family, particles=replace(family.particles, poses=poses))
    found = family_step(split, events[-1], CONFIG, rng)
    assert len(found) == 6
    assert sum(np.exp(one.log_weight) for one, _ in found) == pytest.approx(1.0)
    apart = np.ptp([one.estimate[2] for one, _ in found])
    assert apart > 0.3
    assert len({id(one.map) for one, _ in found}) == 1


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
