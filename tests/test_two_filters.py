"""The report's filter, written twice: ``slam_step``, and ``refined_step`` with the report's settings, are one run."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from rooms import CURVES, LIDAR, SQUARE, drive

import pfslam
from pfslam.io.selection import select
from pfslam.particles import RESAMPLERS
from pfslam.refined.lines import LineConfig
from pfslam.refined.matching import SearchConfig
from pfslam.refined.noise import MotionNoise
from pfslam.refined.step import RefinedConfig, with_changes
from pfslam.slam import SlamConfig

REPORT = replace(SlamConfig.report(), particles=15)
TOLD = "t", "estimate", "effective_sample_size", "beams", "matched", "scored", "resampled", "drawn", "score"


def assert_one_run(recording, config):
    """Poses, weights, N_eff and map are the same to the last bit; returns the report's run."""
    plain, rich = (pfslam.run_slam(recording, c) for c in (config, RefinedConfig.of(config)))
    assert (type(plain.config), type(rich.config)) == (SlamConfig, RefinedConfig)
    for a, b in zip(plain.infos, rich.infos, strict=True):
        for name in TOLD + ("log_evidence",) * a.matched:
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=f"{name} at {a.t}")
        np.testing.assert_array_equal(a.particles.poses, b.particles.poses)
        np.testing.assert_array_equal(a.particles.log_weights, b.particles.log_weights)
    assert plain.grid.spec == rich.grid.spec
    np.testing.assert_array_equal(plain.grid.log_odds, rich.grid.log_odds)
    return plain


@cache
def part(name, start, until):
    return select(replace(pfslam.load(name), camera=None), start=start, until=until)


@pytest.mark.parametrize("every", [20, None])
@pytest.mark.parametrize("which", [("hall", 0.0, 15.0), ("ramp", 22.0, 32.0)], ids=["hall", "ramp"])
def test_on_a_level_floor_and_on_slopes(which, every):
    assert assert_one_run(part(*which), replace(REPORT, every=every)).updates > 10


@pytest.mark.parametrize("beams", [2, 5, 9, 31])
def test_with_a_scanner_of_few_beams(beams):
    result = assert_one_run(drive(CURVES, lidar=replace(LIDAR, beams=beams)), REPORT)
    assert result.updates > 40


@pytest.mark.parametrize("scheme", RESAMPLERS)
@pytest.mark.parametrize("below", [0.0, 0.999, 1.0])
def test_however_particles_are_resampled(scheme, below):
    result = assert_one_run(drive(SQUARE), replace(REPORT, every=4, resampler=scheme, resample_below=below))
    assert (result.resamplings > 0) == (below > 0.0)


def test_through_scans_that_see_nothing_at_the_start_and_on_the_way():
    recording = drive(CURVES)
    ranges = recording.lidar.ranges.copy()
    ranges[[0, 1, 8, 9, 30]] = np.inf
    ranges[40:42, 3:] = np.nan
    blinded = replace(recording, lidar=replace(recording.lidar, ranges=ranges))
    result = assert_one_run(blinded, replace(REPORT, resample_below=1.0))
    assert result.dropped == {"scans without any return": 5}


# Settings that only the accurate filter has


def test_a_change_of_its_own_settings_leaves_the_reports_class():
    changed = with_changes(
        REPORT, {"particles": 7, "noise.sigma_v": 0.5, "search.cells": 3, "map.hit": 1.0}, "x"
    )
    expected = replace(REPORT, particles=7, noise=replace(REPORT.noise, sigma_v=0.5))
    search, drawing = replace(REPORT.search, cells=3), replace(REPORT.map, hit=1.0)
    assert type(changed) is SlamConfig
    assert changed == replace(expected, search=search, map=drawing)
    assert type(with_changes(REPORT, {}, "x")) is SlamConfig
    kinds = {"noise": "ControlNoise", "search": "Perturbations", "map": "MapConfig"}  # as in a summary.json
    assert with_changes(REPORT, kinds | {"every": False}, "x") == SlamConfig(particles=15)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"lines": True}, {"lines": LineConfig()}),
        ({"estimate": "mean", "particles": 3}, {"estimate": "mean", "particles": 3}),
        ({"noise": "MotionNoise"}, {"noise": MotionNoise()}),
        ({"search": "SearchConfig", "search.cells": [4, 6]}, {"search": SearchConfig(cells=(4, 6))}),
    ],
)
def test_a_change_of_a_foreign_setting_widens_them_and_leaves_the_rest(changes, expected):
    changed = with_changes(REPORT, changes, "x")
    assert type(changed) is RefinedConfig
    assert changed == replace(RefinedConfig.of(REPORT), **expected)


def test_settings_of_the_accurate_filter_come_back_as_they_are():
    for config in (SlamConfig.refined(), SlamConfig.matching(), SlamConfig.per_particle()):
        assert RefinedConfig.of(config) is config
        assert type(with_changes(config, {"min_beams": 5}, "x")) is type(config)
