"""Numbers in configurations: what makes no sense, or would take any amount of memory, is refused by name."""

import math
from dataclasses import replace

import numpy as np
import pytest
from settings import field_of, numbers, replaced

from pfslam.config import SlamConfig
from pfslam.errors import DataError
from pfslam.limits import MAX_PARTICLES, check_numbers
from pfslam.search.boxes import MAX_SCORES
from pfslam.sensors import LidarModel
from pfslam.simulator import HALL, RAMP, simulate
from pfslam.simulator.drive import MAX_HOURS
from pfslam.texture.config import TextureConfig

CONFIGURATIONS = [
    SlamConfig.report(),
    SlamConfig.refined(),
    replace(SlamConfig.refined(), every=3),
    SlamConfig.per_particle(),
    SlamConfig.matching(),
    TextureConfig.report(),
    replace(TextureConfig.refined(), resolution=0.1),
    HALL,
    RAMP,
]


FIELDS = {
    (type(top).__name__, name): (top, name, value) for top in CONFIGURATIONS for name, value in numbers(top)
}


def spoilt(value, by):
    """``by`` in place of a number, or of the last of several."""
    return (*value[:-1], by) if isinstance(value, tuple) else by


def is_whole(value):
    return isinstance(value[0] if isinstance(value, tuple) else value, int)


@pytest.mark.parametrize("key", FIELDS, ids=" ".join)
def test_every_number_of_every_configuration_has_its_range(key):
    """None of them takes what is no number, or a number without any measure."""
    config, name, value = FIELDS[key]
    may_be_none = field_of(config, name).default is None
    for bad in (math.nan, -1e300, "1", *([] if may_be_none else [None])):
        with pytest.raises(DataError) as found:
            replaced(config, name, spoilt(value, bad))
        assert name.split(".")[-1] in found.value.field


@pytest.mark.parametrize("key", [key for key in FIELDS if is_whole(FIELDS[key][2])], ids=" ".join)
def test_whole_numbers_have_to_be_whole(key):
    config, name, value = FIELDS[key]
    with pytest.raises(DataError, match=r"found .*, expected (a )?whole number"):
        replaced(config, name, spoilt(value, 1.5))


def test_numbers_from_numpy_are_numbers():
    config = replace(SlamConfig.refined(), particles=np.int64(7), draw_metres=np.float32(0.5))
    assert (config.particles, config.draw_metres) == (7, 0.5)


@pytest.mark.parametrize("value", [1, 5])
def test_both_ends_of_a_range_belong_to_it(value):
    check_numbers(LidarModel(beams=value), beams=(1, 5))
    with pytest.raises(DataError, match="LidarModel: beams: found 6, expected a whole number from 1 to 5"):
        check_numbers(LidarModel(beams=6), beams=(1, 5))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"cells": (5, 4)}, r"cells: found \(5, 4\), expected a least and a greatest half width"),
        ({"yaws": (1, 2, 3)}, "yaws: found .*, expected a least and a greatest"),
        ({"cells": (0, 2000), "yaws": (0, 2000)}, f"poses in a window, expected at most {MAX_SCORES}"),
    ],
)
def test_windows_are_pairs_and_not_too_large(change, message):
    with pytest.raises(DataError, match=message):
        replace(SlamConfig.refined().search, **change)


@pytest.mark.parametrize(
    "change", [{"angle_min": 1.0, "angle_max": 0.5}, {"range_min": 5.0, "range_max": 4.0}]
)
def test_limits_of_a_scanner_are_in_order(change):
    with pytest.raises(DataError, match=r"_min, .*_max: found .*, expected the lesser first"):
        replace(LidarModel(), **change)


def test_the_dropouts_of_a_drive_are_in_order():
    with pytest.raises(DataError, match=r"dropouts: found \(\(5.0, 4.0\),\), expected pairs"):
        replace(HALL, dropouts=((5.0, 4.0),))


def test_a_drive_that_would_take_days_is_refused():
    with pytest.raises(DataError, match=f"simulate: duration: found .* hours, expected at most {MAX_HOURS}"):
        simulate(replace(HALL, laps=30, cruise_speed=0.01))


def test_a_drive_whose_scans_would_fill_the_memory_is_refused():
    lidar = replace(HALL.robot.lidar, beams=20_000)
    long = replace(HALL, laps=30, robot=replace(HALL.robot, lidar=lidar))
    with pytest.raises(DataError, match="expected at most 8 GiB of ranges"):
        simulate(long)


def test_the_most_particles_are_those_of_the_command_line():
    with pytest.raises(DataError, match=f"particles: .* from 1 to {MAX_PARTICLES}"):
        replace(SlamConfig.refined(), particles=MAX_PARTICLES + 1)
