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
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pfslam.config import SlamConfig
from pfslam.errors import DataError
from pfslam.evaluation.faults import DISTURBANCES
from pfslam.io.files import read_text
from pfslam.limits import MAX_EVERY, MAX_PARTICLES
from pfslam.simulator import PRESETS as BUILDINGS
from pfslam.simulator import SimulatorConfig
from pfslam.study.settings import as_type, depth, field_type, with_settings

MAX_CASES = 1_000_000
METHODS = {
    "report": SlamConfig.report,
    "refined": SlamConfig.refined,
    "per-particle": SlamConfig.per_particle,
    "matching": SlamConfig.matching,
    "dead-reckoning": SlamConfig.refined,
}
"""What each method starts from; dead reckoning takes only the choice of scans from it."""
PAIR = tuple[float, float]
OWN_KEYS: dict[str, Any] = {
    "dataset": str,
    "data_dir": str,
    "method": str,
    "seed": int,
    "simulator.seed": int,
    **{f"disturb.{name}": PAIR if name in ("blind", "kidnap") else float for name in DISTURBANCES},
}
LIMITS = {
    "seed": (0, 2**63 - 1),
    "simulator.seed": (0, 2**63 - 1),
    "particles": (1, MAX_PARTICLES),
    "every": (1, MAX_EVERY),
}
"""As on the command line."""
DEFAULTS = {"dataset": "hall", "method": "refined", "seed": 0}


@dataclass(frozen=True)
class Case:
    """One run: a label for tables and the settings that make it, by their dotted names."""

    label: str
    settings: tuple[tuple[str, Any], ...]

    @property
    def key(self) -> str:
        """Twenty hexadecimal digits for the settings; the label does not change what is run."""
        text = json.dumps(dict(self.settings), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:20]

    def get(self, key: str, default: Any = None) -> Any:
        """The value of one setting."""
        return dict(self.settings).get(key, default)

    def group(self, prefix: str) -> dict[str, Any]:
        """The settings below ``prefix``: for "disturb." what harms the recording."""
        return {key.removeprefix(prefix): value for key, value in self.settings if key.startswith(prefix)}

    def config(self) -> SlamConfig:
        """The filter's configuration."""
        own = ("disturb.", "simulator.")
        changes = {k: v for k, v in self.settings if k not in OWN_KEYS and not k.startswith(own)}
        config = with_settings(METHODS[self.get("method")](), changes, self.label)
        if self.get("method") == "matching" and config.particles != 1:
            raise DataError(self.label, "particles", config.particles, "1 with matching: it has one pose")
        return config


@dataclass(frozen=True)
class Study:
    """Cases in order. ``tolerance`` is how far a number may differ on another machine (relative), if stated."""

    name: str
    about: str
    cases: tuple[Case, ...]
    tolerance: float | None = None


def read_study(path: str | Path) -> Study:
    """The study that a TOML file defines. Raises ``DataError`` naming the key for all that makes no sense."""
    try:
        content = tomllib.loads(read_text(path))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise DataError(path, "file", error, "a study in TOML") from None
    return make_study(content, path)


def make_study(content: dict[str, Any], source: object = "study") -> Study:
    """The study that a nested dictionary defines, laid out as the file."""
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


def _variants(content: dict[str, Any], name: str, source: object) -> Iterator[tuple[str, dict[str, list]]]:
    """Label and grid of each variant; a study without any is one variant with the study's name."""
    seen: set[str] = set()
    for number, variant in enumerate(content.get("variant", [{"label": name}]), start=1):
        if not isinstance(variant, dict) or not isinstance(variant.get("label"), str) or not variant["label"]:
            raise DataError(source, f"variant {number}", "no label", 'label = "..." in every [[variant]]')
        if variant["label"] in seen:
            raise DataError(source, f"variant {number}", repr(variant["label"]), "a label of its own")
        seen.add(variant["label"])
        yield variant["label"], _grid({k: v for k, v in variant.items() if k != "label"}, source)


def _grid(table: dict[str, Any], source: object) -> dict[str, list]:
    """Every key's list of values."""
    return {key: _values(key, value, source) for key, value in _flat(table)}


def _flat(table: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Nested tables as dotted keys; ``{ count = 10 }`` stays a value."""
    for key, value in table.items():
        if isinstance(value, dict) and not ("count" in value and set(value) <= {"count", "from"}):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _values(key: str, value: Any, source: object) -> list:
    """The values of one key, each checked: a list of values is a grid, unless one value is itself a list."""
    hint = _type_of(key, source)
    if isinstance(value, dict):
        value = _counted(key, value, hint, source)
    levels = _levels(value) if depth(hint) else int(isinstance(value, list))
    values = value if levels > depth(hint) else [value]
    if not values:
        raise DataError(source, key, "an empty list", "at least one value")
    if key == "dataset":
        values = [str(v) if isinstance(v, int) and not isinstance(v, bool) else v for v in values]
    return [_checked(key, item, hint, source) for item in values]


def _type_of(key: str, source: object) -> Any:
    if key in OWN_KEYS:
        return OWN_KEYS[key]
    if key.startswith("simulator."):
        return field_type(SimulatorConfig, key.removeprefix("simulator."), source)
    if key.startswith("disturb."):
        known = ", ".join(f"disturb.{name}" for name in DISTURBANCES)
        raise DataError(source, "key", repr(key), f"one of {known}")
    return field_type(SlamConfig, key, source)


def _levels(value: Any) -> int:
    return 1 + max(map(_levels, value), default=0) if isinstance(value, list) else 0


def _counted(key: str, value: dict[str, Any], hint: Any, source: object) -> list[int]:
    """``{ count = 10, from = 5 }`` is 5 to 14."""
    count, first = value["count"], value.get("from", 0)
    fits = all(isinstance(n, int) and not isinstance(n, bool) and n >= 0 for n in (count, first))
    if hint is not int or not fits or not 1 <= count <= MAX_CASES:
        raise DataError(source, key, value, f"a count from 1 to {MAX_CASES}, for a key of whole numbers")
    return list(range(first, first + count))


def _checked(key: str, value: Any, hint: Any, source: object) -> Any:
    try:
        value = value if value is False and as_type(value, hint) is None else as_type(value, hint)
    except ValueError as error:
        raise DataError(source, key, repr(value), str(error)) from None
    if key == "method" and value not in METHODS:
        raise DataError(source, key, repr(value), f"one of {', '.join(METHODS)}")
    low, high = LIMITS.get(key, (None, None))
    if low is not None and value is not False and not low <= value <= high:
        raise DataError(source, key, value, f"a whole number from {low} to {high}")
    return value


def _cases(label: str, grid: dict[str, list], source: object) -> Iterator[Case]:
    """The cases of one variant, the first key changing slowest.

    The first of them must make a configuration, also with any other number of the grid in it.
    """
    grid = {key: [value] for key, value in DEFAULTS.items()} | grid
    simulated = any(key.startswith("simulator.") for key in grid)
    strange = [name for name in grid["dataset"] if simulated and name not in BUILDINGS]
    if strange:
        raise DataError(source, "dataset", repr(strange[0]), "hall or ramp with keys of the simulator")
    for n, values in enumerate(itertools.product(*grid.values())):
        case = Case(label, tuple(zip(grid, values, strict=True)))
        if n == 0:
            _configurable(case, source)
            for key, value in _other_numbers(grid):
                _configurable(Case(label, tuple({**dict(case.settings), key: value}.items())), source)
        yield case


def _other_numbers(grid: dict[str, list]) -> Iterator[tuple[str, Any]]:
    """The numbers, and lists of numbers, that stand behind the first of their key. Own keys have been checked."""
    for key, values in grid.items():
        if key not in OWN_KEYS:
            numbers = (
                v for v in values[1:] if isinstance(v, (int, float, tuple)) and not isinstance(v, bool)
            )
            yield from ((key, value) for value in numbers)


def _configurable(case: Case, source: object) -> None:
    """Complain in the study's name if a case makes no configuration, or no building."""
    building = {key: value for key, value in case.group("simulator.").items() if key != "seed"}
    for prefix, make in (
        ("", case.config),
        ("simulator.", lambda: with_settings(BUILDINGS.get(case.get("dataset")), building, case.label)),
    ):
        try:
            make()
        except DataError as error:
            field = f"{case.label}: {prefix}{error.field}"
            raise DataError(source, field, error.found, error.expected) from None
