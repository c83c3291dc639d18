"""What a run is asked for: method, seed and settings from the command line, a file, or an earlier run's summary."""

from __future__ import annotations

import json
import tomllib
from argparse import Namespace
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pfslam.errors import DataError
from pfslam.io.files import read_text
from pfslam.settings import changed, flat
from pfslam.slam import PRESETS, SlamConfig


def wishes(arguments: Namespace) -> tuple[str, int, SlamConfig]:
    """Return method, seed and configuration of a run.

    ``--config`` comes first, then ``--set`` in order, then the options with names of their own.
    """
    source, content = arguments.config, {} if arguments.config is None else read_settings(arguments.config)
    said = {key: content.pop(key) for key in ("method", "seed") if key in content}
    method = arguments.method or said.get("method", "refined")
    if not isinstance(method, str) or method not in PRESETS:
        raise DataError(source, "method", repr(method), f"one of {', '.join(PRESETS)}")
    seed = said.get("seed", 0) if arguments.seed is None else arguments.seed
    if type(seed) is not int or not 0 <= seed < 2**63:
        raise DataError(source, "seed", repr(seed), "a whole number from 0 on")
    config = changed(PRESETS[method](), content, source)
    for text in arguments.set:
        name, found, value = text.partition("=")
        if not found:
            raise DataError("run", "--set", repr(text), "NAME=VALUE, such as search.sharpness=30")
        config = changed(config, {name.strip(): meant(value.strip())}, "run", "--set ")
    return method, seed, changed(config, given(arguments, "particles", "every"), "run", "--")


def given(arguments: Namespace, *names: str) -> dict[str, Any]:
    """Return the options that were given, by name."""
    return {name: value for name in names if (value := getattr(arguments, name)) is not None}


def read_settings(path: Path) -> dict[str, Any]:
    """Read settings from a TOML file, or those of an earlier run from its ``summary.json``."""
    text, is_json = read_text(path), path.suffix == ".json"
    try:
        content = json.loads(text) if is_json else tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise DataError(path, "file", error, "JSON, as a run writes it" if is_json else "TOML") from None
    if not is_json:
        return dict(flat(content))
    if not isinstance(content, Mapping) or not isinstance(content.get("config"), Mapping):
        raise DataError(path, "config", "nothing", "the settings of a run")
    # Which kind of noise or search it was is said inside, and is switched on first.
    settings = dict(flat(content["config"]))
    kinds = {key.removesuffix(".kind"): value for key, value in settings.items() if key.endswith(".kind")}
    rest = {key: value for key, value in settings.items() if not key.endswith(".kind")}
    return kinds | rest | {key: content[key] for key in ("method", "seed") if key in content}


def meant(text: str) -> Any:
    """Read a value as TOML does: a number, true or false, a list; anything else is text."""
    try:
        return tomllib.loads(f"x = {text}")["x"]
    except tomllib.TOMLDecodeError:
        return text
