"""Numbers in configurations: what makes no sense, or would take any amount of memory, is refused by name."""

import math
import os
import pickle
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Annotated, get_args, get_type_hints

import numpy as np
import pytest
from box_recording import box_recording

from pfslam.errors import DataError
from pfslam.grid import MapConfig
from pfslam.methods import METHODS, preset
from pfslam.particles import RESAMPLERS, ControlNoise, Scheme
from pfslam.refined.floor import map_texture
from pfslam.refined.matching import SearchConfig
from pfslam.refined.step import RefinedConfig
from pfslam.run import run_slam
from pfslam.search.volume import MAX_SCORES
from pfslam.sensors import LidarModel, RobotModel
from pfslam.settings import Range, Settings, changed, plain
from pfslam.simulator import HALL, simulate
from pfslam.simulator.drive import MAX_HOURS
from pfslam.slam import SlamConfig
from pfslam.texture import TextureConfig

CASES = int(os.environ.get("PFSLAM_CASES", "60"))
CONFIGURATIONS = [
    *map(preset, METHODS),
    replace(SlamConfig.refined(), every=3),
    replace(TextureConfig.refined(), z_max=5.0),
    HALL,
]


def numbers(config, prefix=""):
    """Dotted names and values of all numbers, and pairs and triples of numbers, in nested configurations."""
    for f in fields(config):
        value = getattr(config, f.name)
        if is_dataclass(value):
            yield from numbers(value, f"{prefix}{f.name}.")
        elif isinstance(value, (int, float, tuple)) and not isinstance(value, bool) and value != ():
            yield prefix + f.name, value


def replaced(config, name, value):
    """A configuration with the field ``name``, dotted, replaced."""
    first, _, rest = name.partition(".")
    return replace(config, **{first: replaced(getattr(config, first), rest, value) if rest else value})


def field_of(config, name):
    """The dataclass field that a dotted name means."""
    first, _, rest = name.partition(".")
    return field_of(getattr(config, first), rest) if rest else type(config).__dataclass_fields__[first]


FIELDS = {
    (type(top).__name__, name): (top, name, value) for top in CONFIGURATIONS for name, value in numbers(top)
}


def spoilt(value, by):
    """``by`` in place of a number, or of the last of several."""
    return (*value[:-1], by) if isinstance(value, tuple) else by


@pytest.mark.parametrize("key", FIELDS, ids=" ".join)
def test_every_number_of_every_configuration_has_its_range(key):
    """None of them takes what is no number, a number without any measure, or a fraction for a whole number."""
    config, name, value = FIELDS[key]
    may_be_none = field_of(config, name).default is None
    is_whole = isinstance(value[0] if isinstance(value, tuple) else value, int)
    for bad in (math.nan, -1e300, "1", *([] if may_be_none else [None]), *([1.5] if is_whole else [])):
        with pytest.raises(DataError) as found:
            replaced(config, name, spoilt(value, bad))
        assert name.split(".")[-1] in found.value.field


@dataclass(frozen=True)
class Walk(Settings):
    steps: Annotated[int, Range(1, 5)] = 3


def test_both_ends_of_a_range_belong_to_it():
    assert (Walk(steps=1).steps, Walk(steps=5).steps) == (1, 5)


CHOICES = {
    (type(part), name): hint
    for top in CONFIGURATIONS
    for part in [top, *(value for value in vars(top).values() if isinstance(value, Settings))]
    for name, hint in get_type_hints(type(part)).items()
    if all(isinstance(word, str) for word in get_args(hint) or [0])
}


@pytest.mark.parametrize("key", CHOICES, ids=lambda key: f"{key[0].__name__} {key[1]}")
def test_every_choice_is_checked_where_it_is_declared(key):
    kind, name = key
    for word in get_args(CHOICES[key]):
        assert getattr(kind(**{name: word}), name) == word
    for bad in ("blur", 3, None, ["last"]):
        with pytest.raises(DataError, match=f"{kind.__name__}: {name}: found .*, expected one of "):
            kind(**{name: bad})


SEARCH = SlamConfig.refined().search


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        (Walk, {"steps": 6}, "Walk: steps: found 6, expected a whole number from 1 to 5"),
        (SlamConfig, {"particles": True}, "SlamConfig: particles: found True, expected a whole number"),
        (SearchConfig, {"prior": 1}, "SearchConfig: prior: found 1, expected true or false"),
        (SearchConfig, {"sharpness": False}, "sharpness: found False, expected a number from 0 to 1000000"),
        (SlamConfig, {"noise": 3}, "SlamConfig: noise: found 3, expected ControlNoise"),
        (RefinedConfig, {"noise": 3}, "noise: found 3, expected ControlNoise or MotionNoise"),
        (SlamConfig, {"map": None}, "map: found None, expected MapConfig"),
        (MapConfig, {"clamp": 10**400}, "MapConfig: clamp: found 1000"),
        (MapConfig, {"clamp": 1e300}, "clamp: found 1e.300, expected a number from 0 to 1000000, or inf"),
        (
            LidarModel,
            {"position_b": (0.0, math.nan, 0.0)},
            "position_b: found .*, expected a list of 3, each a",
        ),
        (LidarModel, {"angle_min": 1.0, "angle_max": 0.5}, "angle_min, angle_max: found .* the lesser first"),
        (LidarModel, {"range_min": 5.0, "range_max": 4.0}, "range_min, range_max: found .* the lesser first"),
        (SEARCH, {"cells": (5, 4)}, r"cells: found \(5, 4\), expected a least and a greatest half width"),
        (SEARCH, {"yaws": (1, 2, 3)}, "yaws: found .*, expected a list of 2, each a whole number"),
        (
            SEARCH,
            {"cells": (0, 2000), "yaws": (0, 2000)},
            f"poses in a window, expected at most {MAX_SCORES}",
        ),
        (SlamConfig.matching(), {"particles": 2}, "particles: found 2, expected 1 with matching"),
    ],
)
def test_what_no_type_takes_is_one_line(kind, change, message):
    with pytest.raises(DataError, match=message) as found:
        replace(kind() if isinstance(kind, type) else kind, **change)
    assert "\n" not in str(found.value)


def test_lists_become_tuples_and_whole_numbers_floats_and_numbers_from_numpy_are_numbers():
    config = replace(SlamConfig.refined(), particles=np.int64(7), draw_metres=np.float32(0.5))
    assert (config.particles, config.draw_metres) == (7, 0.5)
    assert SearchConfig(cells=[1, 2]).cells == (1, 2)
    changed_drive = replace(HALL, timing=replace(HALL.timing, imu=[1, 2]), path_length=30)
    assert changed_drive.timing.imu == (1.0, 2.0)
    assert isinstance(changed_drive.path_length, float)


def test_the_names_that_can_be_chosen_are_those_there_are():
    assert set(get_args(Scheme)) == set(RESAMPLERS)


def test_settings_are_values():
    for config in CONFIGURATIONS:
        assert replace(config) == pickle.loads(pickle.dumps(config)) == config
        assert hash(config) == hash(replace(config))


PLAIN = replace(RefinedConfig.of(SlamConfig.report()), search=SearchConfig(cells=(4, 4)))


def test_dotted_and_nested_names_change_the_same_fields():
    nested = changed(SlamConfig.refined(), {"search": {"prior": False, "cells": [1, 2]}, "particles": 7})
    dotted = changed(SlamConfig.refined(), {"search.prior": False, "search.cells": (1, 2), "particles": 7})
    search = replace(SlamConfig.refined().search, prior=False, cells=(1, 2))
    assert nested == dotted == replace(SlamConfig.refined(), search=search, particles=7)


def test_parts_are_switched_on_off_and_filled():
    config = changed(PLAIN, {"lines": True, "lines.min_hits": 2, "tilt": False, "every": False})
    assert config.lines == replace(SlamConfig.refined().lines, min_hits=2)
    assert (config.tilt, config.every) == (False, None)
    noisy = changed(SlamConfig.refined(), {"noise": "ControlNoise", "noise.sigma_v": 1})
    assert noisy.noise == ControlNoise(1.0, math.sqrt(0.02))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"search.speed": 1}, "key: found 'search.speed', expected a field of SearchConfig: yaw_step, "),
        ({"speed": 1}, "key: found 'speed', expected a field of RefinedConfig: particles, "),
        ({"lines.reach": 1}, "lines.reach: found is off, expected a field of what is switched on"),
        ({"search.cells": [4, 1]}, r"search.cells: found \(4, 1\), expected a least and a greatest"),
        ({"search": {"cells": 3}}, "search.cells: found 3, expected a list of 2"),
        ({"particles.number": 1}, "particles.number: found particles = 200, expected"),
        ({"lines": "Tilt"}, "lines: found 'Tilt', expected LineConfig"),
    ],
)
def test_a_change_that_makes_no_sense_names_its_source(changes, message):
    with pytest.raises(DataError, match=f"x.toml: {message}"):
        changed(PLAIN, changes, "x.toml")


def test_plain_settings_can_be_written():
    config = replace(PLAIN, draw_metres=math.inf)
    written = config.as_dict()
    assert written == {name: value for name, value in plain(config).items() if name != "kind"}
    assert written["noise"] == {"kind": "ControlNoise"} | vars(config.noise)
    assert (written["search"]["cells"], written["lines"], written["draw_metres"]) == ([4, 4], None, None)
    assert plain({1: np.float32(0.5), "b": (np.int64(2), math.nan)}) == {"1": 0.5, "b": [2, None]}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cruise_speed": 0.01}, f"simulate: duration: found .* hours, expected at most {MAX_HOURS}"),
        ({"robot": RobotModel(lidar=LidarModel(beams=20_000))}, "expected at most 8 GiB of ranges"),
    ],
)
def test_a_drive_that_would_take_days_or_fill_the_memory_is_refused(changes, message):
    with pytest.raises(DataError, match=message):
        simulate(replace(HALL, laps=30, **changes))


# A campaign: whatever passes the ranges ends well. ``make nightly`` tries 2,000 cases.


def any_number(like, rng):
    """A number of the kind of ``like`` and of any size, or what is none; pairs for pairs."""
    if isinstance(like, tuple):
        return tuple(any_number(part, rng) for part in like)
    strange = rng.choice([0.0, -1.0, np.nan, np.inf, -np.inf, 1e300, 1e-300])
    size = 10.0 ** rng.uniform(-6, 6) if isinstance(like, float) else int(10.0 ** rng.uniform(0, 4))
    return float(strange) if rng.random() < 0.2 else size


def with_any_numbers(config, rng):
    """The configuration with two of its numbers replaced, or None where their ranges refuse them by name."""
    fields = [field for field in numbers(config) if field[0] != "particles"]
    changes = {
        name: any_number(value, rng) for name, value in (fields[k] for k in rng.choice(len(fields), 2))
    }
    try:
        for name, value in changes.items():
            config = replaced(config, name, value)
    except DataError as error:
        assert any(name in str(changes) for name in error.field.split(", "))  # noqa: PT017
        return None
    return config


def result_or_complaint(work):
    """What ``work()`` gives, or None after one clear line about the recording or the grid."""
    try:
        return work()
    except DataError as error:
        assert str(error).startswith(("box", "GridSpec"))  # noqa: PT017
        return None


@pytest.mark.parametrize("seed", range(CASES // 5))
def test_any_numbers_are_refused_by_name_or_make_a_run(seed):
    """Whatever passes the ranges ends in a run that stays finite, or in one clear line."""
    rng = np.random.default_rng(seed)
    presets = [preset(method) for method in METHODS]
    particles = int(rng.integers(1, 6)) if seed % 4 < 3 else 1  # matching has one pose
    config = replace(presets[seed % 4], particles=particles, every=3)
    config = with_any_numbers(config, rng)
    result = config and result_or_complaint(lambda: run_slam(box_recording(2.0, images=0), config))
    assert result is None or np.isfinite(result.trajectory.poses).all()
    assert result is None or np.isfinite(result.grid.log_odds).all()


@pytest.mark.parametrize("seed", range(CASES // 10))
def test_any_numbers_are_refused_by_name_or_make_a_texture(seed):
    rng, steps = np.random.default_rng(seed), list(TextureConfig.steps().values())
    config, box = with_any_numbers(steps[seed % len(steps)], rng), box_recording(3.0, images=4)
    texture = config and result_or_complaint(lambda: map_texture(box, box.truth, config=config))
    assert texture is None or (texture.rgb[texture.seen][:, 1:] == [20, 30]).all()
