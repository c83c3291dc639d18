"""The Python interface that others rely on: names, signatures, defaults."""

import inspect
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from rooms import drive

import pfslam

DRIVE = drive([(0.5, 10, 0.4)])


PROMISED = {
    "load": ("dataset", "data_dir"),
    "dead_reckoning": ("recording",),
    "run_slam": ("recording", "config", "rng"),
    "map_texture": ("recording", "trajectory", "grid"),
    "map_correlation": ("occupied", "spec", "points_w"),
}


@pytest.mark.parametrize("name", PROMISED)
def test_functions_take_what_was_promised(name):
    found = inspect.signature(getattr(pfslam, name)).parameters
    assert [p for p in found if p in PROMISED[name]] == [*PROMISED[name]]
    assert {p.name for p in found.values() if p.default is p.empty} <= set(PROMISED[name])
    assert all(found[p].default is None for p in {"data_dir", "config", "rng", "grid"} & set(PROMISED[name]))


def test_public_names_exist_and_bad_input_is_a_value_error():
    assert all(getattr(pfslam, name).__name__ == name for name in pfslam.__all__)
    assert set(pfslam.__all__) <= set(dir(pfslam))
    assert inspect.signature(pfslam.run_slam).parameters["rng"].kind is inspect.Parameter.KEYWORD_ONLY
    assert issubclass(pfslam.DataError, ValueError)


def test_defaults_of_a_run_are_the_refined_filter_and_seed_0():
    result = pfslam.run_slam(DRIVE)
    assert result.config == pfslam.SlamConfig.refined()
    explicit = pfslam.run_slam(DRIVE, pfslam.SlamConfig.refined(), rng=np.random.default_rng(0))
    np.testing.assert_array_equal(result.trajectory.poses, explicit.trajectory.poses)
    assert len(result.infos) == len(result.trajectory.t)
    assert result.grid.log_odds.shape == result.grid.spec.shape


@pytest.mark.parametrize("thing", [DRIVE, DRIVE.truth, pfslam.SlamConfig.refined(), DRIVE.robot])
def test_what_must_not_drift_apart_is_frozen(thing):
    with pytest.raises(FrozenInstanceError):
        thing.t = 1
