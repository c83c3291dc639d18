"""From a study file to a list of cases: a file names settings, lists of values make a grid.

See ``book/studies.md`` for the format. Everything is checked before the first run: a bad file is one clear line.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import re
import tomllib
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_origin

from pfslam.errors import DataError
from pfslam.io.files import read_text
from pfslam.methods import METHODS, preset
from pfslam.refined.step import RefinedConfig, with_changes
from pfslam.settings import Range, Settings, changed, flat, options, type_hints, type_of, value_of
from pfslam.simulator import HALL, SimulatorConfig
from pfslam.simulator import PRESETS as BUILDINGS

MAX_CASES = 1_000_000
Seed = Annotated[int, Range(0, 2**63 - 1)]
Share = Annotated[float, Range(0.0, 1.0)]


@dataclass(frozen=True)
class Basics(Settings):
    """Name what a run works on, its method, and the seed of its random numbers.

    Dead reckoning takes only the choice of scans from a filter's configuration. With ``clouds`` the spread of the
    particles is compared with the truth, which keeps every cloud of a run in memory. With ``second_look`` a run is made
    as by ``run``, which may do it again with more care, and its doubts are compared with its errors.
    """

    dataset: str = "hall"
    method: Literal["report", "refined", "per-particle", "matching", "dead-reckoning"] = "refined"
    seed: Seed = 0
    data_dir: str | None = None
    clouds: bool | None = None
    second_look: bool | None = None


@dataclass(frozen=True)
class Building(Settings):
    """Choose the building to simulate by its seed; None is the built-in one."""

    seed: Seed | None = None


@dataclass(frozen=True)
class Disturbances(Settings):
    """Say what is done to the recording before the run: the arguments of the functions in ``study.disturbances``."""

    seconds: Annotated[float, Range(0.0, math.inf)] | None = None
    kidnap: tuple[float, float] | None = None
    blind: tuple[float, float] | None = None
    range_noise: Annotated[float, Range(0.0, 100.0)] | None = None
    missing_beams: Share | None = None
    random_ranges: Share | None = None


GROUPS: dict[str, Any] = {"simulator": SimulatorConfig, "disturb": Disturbances}
"""Whose fields the keys name that begin so; all others are fields of the filter's configuration."""


@dataclass(frozen=True)
class Case:
    """Describe one run by a label for tables and its settings by their dotted names."""

    label: str
    settings: tuple[tuple[str, Any], ...]

    @property
    def key(self) -> str:
        """Return twenty hexadecimal digits that stand for the settings; the label does not change what is run."""
        text = json.dumps(dict(self.settings), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:20]

    def get(self, key: str, default: Any = None) -> Any:
        """Return the value of one setting."""
        return dict(self.settings).get(key, default)

    def parts(self) -> dict[type, Any]:
        """Return the settings as objects by their types: ``RefinedConfig``, ``SimulatorConfig`` and those above."""
        return _parts(dict(self.settings), self.label)

    def config(self) -> Any:
        """Return the filter's configuration."""
        return self.parts()[RefinedConfig]

    def drive(self) -> tuple[SimulatorConfig, int | None] | None:
        """Return the drive to simulate and the seed of its building, or None if the case does not name any."""
        parts = self.parts()
        is_own = any(key.startswith("simulator.") for key, _ in self.settings)
        return (parts[SimulatorConfig], parts[Building].seed) if is_own else None


def _place(key: str) -> tuple[Any, str]:
    """Return the kind of settings that a key belongs to, and its name there."""
    group, _, name = key.partition(".")
    if key == "simulator.seed":
        return Building, name
    if name and group in GROUPS:
        return GROUPS[group], name
    return Basics if key in type_hints(Basics) else RefinedConfig, key


def _parts(settings: Mapping[str, Any], source: object) -> dict[type, Any]:
    """Turn settings by dotted names into objects, by their types."""
    groups: dict[Any, dict[str, Any]] = defaultdict(dict)
    for key, value in settings.items():
        kind, name = _place(key)
        groups[kind][name] = value
    basics = changed(Basics(), groups[Basics], source)
    filter_ = preset(basics.method if basics.method in METHODS else "refined")
    drive = BUILDINGS.get(basics.dataset, HALL)
    return {
        Basics: basics,
        RefinedConfig: with_changes(filter_, groups[RefinedConfig], source),
        SimulatorConfig: changed(drive, groups[SimulatorConfig], source, "simulator."),
        Building: changed(Building(), groups[Building], source, "simulator."),
        Disturbances: changed(Disturbances(), groups[Disturbances], source, "disturb."),
    }


@dataclass(frozen=True)
class Study:
    """Hold the cases in order, and the relative tolerance of results on another machine, if one is stated.

    ``run`` turns a case into its figures, by column. None runs a filter over a recording. A function of one's own, that
    other processes must be able to import, measures anything else; its cases have whatever settings it reads.
    """

    name: str
    about: str
    cases: tuple[Case, ...]
    tolerance: float | None = None
    run: Callable[[Case], dict[str, Any]] | None = None


def read_study(path: str | Path) -> Study:
    """Read a study from a TOML file; a mistake in it raises ``DataError``, which names the key."""
    try:
        content = tomllib.loads(read_text(path))
    except (ValueError, RecursionError) as error:  # a number of ten thousand digits is a ValueError, too
        raise DataError(path, "file", error, "a study in TOML") from None
    return make_study(content, path)


def make_study(content: dict[str, Any], source: object = "study") -> Study:
    """Make the study that a nested dictionary defines, laid out as the file."""
    known = {"name": str, "about": str, "tolerance": float, "common": dict, "variant": list}
    for key, value in content.items():
        if key not in known:
            raise DataError(source, "key", repr(key), f"one of {', '.join(known)}")
        if not isinstance(value, (int, float) if known[key] is float else known[key]):
            raise DataError(source, key, repr(value), known[key].__name__)
    name = content.get("name", Path(str(source)).stem)
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,59}", name):
        raise DataError(source, "name", repr(name), "letters, digits, - and _, at most 60")
    common = _grid(content.get("common", {}), source)
    grids = [(label, common | own) for label, own in _variants(content, name, source)]
    number = sum(math.prod(map(len, grid.values())) for _, grid in grids)
    if number > MAX_CASES:
        raise DataError(source, "grid", f"{number} runs", f"at most {MAX_CASES}: split the study")
    cases = tuple(case for label, grid in grids for case in _cases(label, grid, source))
    return Study(name, content.get("about", ""), cases, content.get("tolerance"))


def _variants(content: dict[str, Any], name: str, source: object) -> Iterator[tuple[str, dict]]:
    """Yield label and grid of each variant; a study without any is one variant with the study's name."""
    seen: set[str] = set()
    for number, variant in enumerate(content.get("variant", [{"label": name}]), start=1):
        if not isinstance(variant, dict) or not isinstance(variant.get("label"), str) or not variant["label"]:
            raise DataError(source, f"variant {number}", "no label", 'label = "..." in every [[variant]]')
        if variant["label"] in seen:
            raise DataError(source, f"variant {number}", repr(variant["label"]), "a label of its own")
        seen.add(variant["label"])
        yield variant["label"], _grid({k: v for k, v in variant.items() if k != "label"}, source)


def _grid(table: dict[str, Any], source: object) -> dict[str, list | range]:
    """Return the list of values of every key; ``seed = { count = 10, from = 5 }`` counts from 5 to 14."""
    given = dict(flat(table))
    grid: dict[str, list | range] = {}
    for key, value in given.items():
        name, _, last = key.rpartition(".")
        if name and last == "count":
            grid[name] = _counted(name, value, given.get(f"{name}.from", 0), source)
        elif not (last == "from" and f"{name}.count" in given):
            grid[key] = _values(key, value, source)
    return grid


def _values(key: str, value: Any, source: object) -> list:
    """Return the values of one key: a list is a grid; of a key whose values are lists, a list of lists is."""
    takes_list = any(get_origin(hint) is tuple for hint in options(type_of(*_place(key))))
    is_grid = isinstance(value, list) and (not takes_list or any(isinstance(item, list) for item in value))
    values = value if is_grid else [value]
    if not values:
        raise DataError(source, key, "an empty list", "at least one value")
    if key == "dataset":
        values = [str(v) if isinstance(v, int) and not isinstance(v, bool) else v for v in values]
    return values


def _counted(key: str, count: Any, first: Any, source: object) -> range:
    fits = all(isinstance(n, int) and not isinstance(n, bool) and n >= 0 for n in (count, first))
    if not fits or not 1 <= count <= MAX_CASES:
        raise DataError(source, key, f"{count} from {first}", f"a count from 1 to {MAX_CASES}")
    return range(first, first + count)


def _cases(label: str, grid: dict[str, Any], source: object) -> Iterator[Case]:
    """Yield the cases of one variant, the first key changing slowest.

    The first of them must make a run, also with any other value of the grid in it.
    """
    grid = {key: [value] for key, value in vars(Basics()).items() if value is not None} | grid
    simulated = any(key.startswith("simulator.") for key in grid)
    strange = [name for name in grid["dataset"] if simulated and name not in BUILDINGS]
    if strange:
        raise DataError(source, "dataset", repr(strange[0]), "hall, ramp or ring with keys of the simulator")
    first = {key: values[0] for key, values in grid.items()}
    grid = {key: _checked(key, values, first, f"{source}: {label}") for key, values in grid.items()}
    for values in itertools.product(*grid.values()):
        yield Case(label, tuple(zip(grid, values, strict=True)))


def _checked(key: str, values: list | range, first: dict[str, Any], source: object) -> list | range:
    """Try each value of a key in the first case (of a range its ends), and return them as their type holds them."""
    kind, name = _place(key)
    ends = (values[0], values[-1]) if isinstance(values, range) else values
    tried = [value_of(_parts(first | {key: value}, source)[kind], name) for value in ends]
    if isinstance(values, range) and not all(isinstance(end, int) for end in tried):
        raise DataError(source, key, f"{len(values)} counted", "a count only for a key of whole numbers")
    return values if isinstance(values, range) else tried
