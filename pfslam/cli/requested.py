"""What a run or a search is asked for: settings and a part of a drive, from the command line, a file, or a summary."""

from __future__ import annotations

import json
import tomllib
from argparse import Namespace
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from pfslam.beyond.localization import LocalizationConfig
from pfslam.cli.parser import MENDED, TOPICS, UsageError, selection_parser
from pfslam.errors import DataError
from pfslam.io.files import read_text
from pfslam.methods import METHODS, preset
from pfslam.refined.step import RefinedConfig, with_changes
from pfslam.settings import changed, flat, written

SELECTION = {
    "start": "--from",
    "until": "--until",
    "range": "--range",
    "mask": "--mask",
    "lidar_at": "--lidar-at",
}
SELECTION |= {option[2:].replace("-", "_"): option for option in MENDED}
SELECTION |= {"no_odometry": "--no-odometry", "slice": "--slice"}
SELECTION |= {"odom_frame": "--odom-frame"} | {name: f"--{name}" for name in TOPICS}
"""The options that say what is used of a data set, by the names of their values."""
CORRECTED = {"masks": "mask", "delay": "scan_delay", "yaw": "lidar_yaw", "scale": "odometry_scale"}
"""The options of what the drive itself can tell, by the names that ``select`` has for them."""


def requested_run(arguments: Namespace) -> tuple[str, int, bool, Any]:
    """Return method, seed, whether a second look is allowed, and the configuration of a run.

    ``--config`` comes first, then all ``--set``, then the options with names of their own.
    """
    source, content = arguments.config, read_settings(arguments.config, RefinedConfig)
    take_selection(arguments, content.pop("selection", []))
    method = content.pop("method", "refined") if arguments.method is None else arguments.method
    if not isinstance(method, str) or method not in METHODS:
        raise DataError(source, "method", repr(method), f"one of {', '.join(METHODS)}")
    again = content.pop("second_look", True)
    if not isinstance(again, bool):
        raise DataError(source, "second_look", repr(again), "true or false")
    again = again if arguments.second_look is None else arguments.second_look
    seed = _seed(arguments, content)
    content.pop("method", None)
    config = with_changes(preset(method), content, source)
    config = with_changes(config, _set_values(arguments, "run"), "run", "--set ")
    return method, seed, again, with_changes(config, given(arguments, "particles", "every"), "run", "--")


def requested_search(arguments: Namespace) -> tuple[int, LocalizationConfig]:
    """Return seed and settings of a search, from the same places as those of a run.

    ``--particles`` also sets how many there are at the first scan, ten times as many, and lowers the fewest.
    """
    content = read_settings(arguments.config, LocalizationConfig)
    take_selection(arguments, content.pop("selection", []))
    seed = _seed(arguments, content)
    config = changed(LocalizationConfig(), content, arguments.config)
    if (most := arguments.particles) is not None:
        least, config = config.least, changed(replace(config, least=1), {"particles": most}, "locate", "--")
        config = replace(config, first=10 * most, least=min(least, most))
    return seed, changed(config, _set_values(arguments, "locate"), "locate", "--set ")


def _seed(arguments: Namespace, content: dict[str, Any]) -> int:
    """Take the seed out of what a file says; the option comes first, and 0 last."""
    found = content.pop("seed", 0)
    seed = found if arguments.seed is None else arguments.seed
    if type(seed) is not int or not 0 <= seed < 2**63:
        raise DataError(arguments.config, "seed", repr(seed), "a whole number from 0 on")
    return seed


def _set_values(arguments: Namespace, command: str) -> dict[str, Any]:
    """Return what every ``--set`` of the command line says, by name; of two for one name the last counts."""
    values: dict[str, Any] = {}
    for text in arguments.set:
        name, found, value = text.partition("=")
        if not found:
            raise DataError(command, "--set", repr(text), "NAME=VALUE, such as noise.xy=0.05")
        values[name.strip()] = toml_value(value.strip())
    return values


def selected(arguments: Namespace) -> dict[str, Any]:
    """Return what a command line says for ``select``; what is to be found out is not among it."""
    stated = {name: getattr(arguments, option) for name, option in CORRECTED.items()}
    stated = {name: value for name, value in stated.items() if value not in (None, "auto")}
    return {"start": arguments.start, "until": arguments.until, "limits": arguments.range} | stated


def selection(arguments: Namespace) -> list[str]:
    """Return the words of a command line that say what is used of its data set."""
    words: list[Any] = []
    for name, option in SELECTION.items():
        value = getattr(arguments, name)
        values = [value] if name != "mask" or value is None else value
        words += [] if values else ["--no-mask"]
        for each in values:
            words += [] if each is None else [option, *(each if isinstance(each, list) else [each])]
    return list(map(str, words))


def take_selection(arguments: Namespace, words: Any) -> None:
    """Use the same part of a data set as an earlier run, where the command line does not ask for another."""
    try:
        before = vars(selection_parser().parse_args(words))
    except (UsageError, TypeError, AttributeError) as error:
        expected = "words of a command line, such as --from 20"
        raise DataError(arguments.config, "selection", error, expected) from None
    for name in (name for name in SELECTION if getattr(arguments, name) is None):
        setattr(arguments, name, before[name])


def given(arguments: Namespace, *names: str) -> dict[str, Any]:
    """Return the options that were given, by name."""
    return {name: value for name in names if (value := getattr(arguments, name)) is not None}


def read_settings(path: Path | None, kind: type) -> dict[str, Any]:
    """Read settings of a ``kind`` by dotted name from a TOML file, or from the ``summary.json`` of an earlier run.

    ``method``, ``seed``, ``second_look`` and ``selection`` are among them where the file has them. No file has no
    settings.
    """
    if path is None:
        return {}
    text, is_json = read_text(path), path.suffix == ".json"
    try:
        content = json.loads(text) if is_json else tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise DataError(path, "file", error, "JSON, as a run writes it" if is_json else "TOML") from None
    if not is_json:
        return dict(flat(content))
    if not isinstance(content, Mapping) or not isinstance(content.get("config"), Mapping):
        raise DataError(path, "config", "nothing", "the settings of a run")
    names = {
        "method": "method",
        "seed": "seed",
        "second_look_allowed": "second_look",
        "selection": "selection",
    }
    beside = {name: content[key] for key, name in names.items() if key in content}
    return written(kind, content["config"]) | beside


def toml_value(text: str) -> Any:
    """Read a value as TOML does: a number, true or false, a list; anything else is text."""
    try:
        return tomllib.loads(f"x = {text}")["x"]
    except tomllib.TOMLDecodeError:
        return text
