"""Dotted names of fields, and values from a text file put where they belong.

``"search.prior"`` is the field ``prior`` of the field ``search``. A field that holds settings of its own can be
switched off with ``false`` (None), on with ``true`` (its defaults), or named: ``noise = "ControlNoise"``.
"""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass, replace
from functools import cache
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from pfslam.config import SlamConfig
from pfslam.errors import DataError


def field_type(kind: type, key: str, source: object) -> Any:
    """The type of the field that the dotted ``key`` names in the dataclass ``kind``; ``DataError`` if none."""
    name, _, rest = key.partition(".")
    hint = _hints(kind).get(name)
    if hint is not None and not rest:
        return hint
    inner = [option for option in _options(hint) if _has_fields(option)]
    for option in inner:
        if rest.partition(".")[0] in _hints(option):
            return field_type(option, rest, source)
    known = ", ".join(_hints(inner[0] if inner and rest else kind))
    raise DataError(source, "key", repr(key), f"a field of {(inner or [kind])[0].__name__}: {known}")


def _has_fields(kind: Any) -> bool:
    """Whether something is a dataclass or one of its objects."""
    return is_dataclass(kind)


@cache
def _hints(kind: Any) -> dict[str, Any]:
    """Types of the fields of a dataclass."""
    hints = get_type_hints(kind)
    return {f.name: hints[f.name] for f in fields(kind)}


def _options(hint: Any) -> tuple:
    """The types that a field may have."""
    is_union = isinstance(hint, UnionType) or get_origin(hint) is Union
    return get_args(hint) if is_union else () if hint is None else (hint,)


def depth(hint: Any) -> int:
    """How deep the lists of one value are: 0 for a number, 1 for a pair, 2 for a list of pairs."""
    inner = [1 + max(map(depth, get_args(o))) for o in _options(hint) if get_origin(o) is tuple]
    return max(inner, default=0)


def as_type(value: Any, hint: Any) -> Any:
    """``value`` as the type ``hint`` says; ``ValueError`` with what is expected if it does not fit."""
    for option in _options(hint):
        fits, result = _fit(value, option)
        if fits:
            return result
    raise ValueError(" or ".join(describe(option) for option in _options(hint)))


def _fit(value: Any, kind: Any) -> tuple[bool, Any]:
    if _has_fields(kind):
        return value is True or value == kind.__name__, kind.__name__ if value is True else value
    if kind in (None, NoneType):
        return value is False or value is None, None
    if kind is float:
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool) and not math.isnan(value)
        return is_number, float(value) if is_number else None
    if kind is int:
        return isinstance(value, int) and not isinstance(value, bool), value
    if get_origin(kind) is tuple:
        return _fit_tuple(value, get_args(kind))
    return isinstance(value, kind), value


def _fit_tuple(value: Any, kinds: tuple) -> tuple[bool, Any]:
    if not isinstance(value, (list, tuple)):
        return False, None
    kinds = kinds[:1] * len(value) if kinds[-1] is Ellipsis else kinds
    items = [_fit(item, kind) for item, kind in zip(value, kinds, strict=False)]
    return len(value) == len(kinds) and all(fits for fits, _ in items), tuple(item for _, item in items)


def describe(kind: Any) -> str:
    """A type in the words of a study file."""
    words = {float: "a number", int: "a whole number", bool: "true or false", str: "text", NoneType: "false"}
    if get_origin(kind) is tuple:
        return "a list, each " + describe(get_args(kind)[0])
    return f"true or {kind.__name__!r}" if _has_fields(kind) else words.get(kind, str(kind))


def with_settings(config: Any, settings: dict[str, Any], source: object) -> Any:
    """A frozen dataclass with fields replaced by dotted name, the outer ones first."""
    for key in sorted(settings, key=lambda key: key.count(".")):
        config = _replaced(config, key, settings[key], key, source)
    return config


def _replaced(config: Any, key: str, value: Any, whole_key: str, source: object) -> Any:
    name, _, rest = key.partition(".")
    kind: Any = type(config)
    hints = _hints(kind) if _has_fields(kind) else {}
    if name not in hints:
        found = "is off" if config is None else f"no field {name!r} in {type(config).__name__}"
        raise DataError(source, whole_key, found, "a field of what is switched on")
    if rest:
        value = _replaced(getattr(config, name), rest, value, whole_key, source)
    else:
        value = _placed(value, hints[name], whole_key, source)
    try:
        return replace(config, **{name: value})
    except DataError as error:
        raise DataError(source, whole_key, error.found, error.expected) from None


def _placed(value: Any, hint: Any, key: str, source: object) -> Any:
    """What a field of type ``hint`` holds for a value: settings of its own for their name."""
    try:
        value = as_type(value, hint)
    except ValueError as error:
        raise DataError(source, key, repr(value), str(error)) from None
    kinds = {kind.__name__: kind for kind in _options(hint) if _has_fields(kind)}
    return _defaults(kinds[value]) if value in kinds else value


def _defaults(kind: Any) -> Any:
    """An object with its default settings; the report's white noise has none of its own."""
    noise = SlamConfig.report().noise
    return noise if kind is type(noise) else kind()
