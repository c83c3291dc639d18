"""Settings: frozen dataclasses whose types say which values they take, changed by dotted name, written as plain data.

A field's type is all there is to say about it: ``Annotated[int, Range(1, 10)]`` is a whole number from 1 to 10,
``Literal["last", "best"]`` one of two words. Both ends belong to a range; NaN is in none, and a bool is no number.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import fields, replace
from functools import cache
from math import inf, isfinite
from numbers import Integral, Real
from types import NoneType
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from pfslam.errors import DataError, naming_source

T = TypeVar("T")


class Range(NamedTuple):
    """Limit a number to values from ``low`` to ``high``, both included."""

    low: float
    high: float


class Settings:
    """Check the fields of a frozen dataclass against their types, and refuse a bad value with one ``DataError``.

    NumPy's numbers become Python's, whole numbers become floats where those are asked for, and lists become tuples.

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Walk(Settings):
    ...     steps: Annotated[int, Range(1, 9)] = 4
    >>> Walk(steps=10)
    Traceback (most recent call last):
    pfslam.errors.DataError: Walk: steps: found 10, expected a whole number from 1 to 9
    """

    def __post_init__(self):
        kind: Any = type(self)
        for name, hint in type_hints(kind).items():
            value = getattr(self, name)
            try:
                object.__setattr__(self, name, converted(value, hint))
            except (ValueError, OverflowError):
                raise DataError(kind.__name__, name, repr(value), words_for(hint)) from None


def converted(value: Any, hint: Any) -> Any:
    """Return a value in the form that the type ``hint`` holds it, or raise ``ValueError`` if it does not fit."""
    kind, parts = get_origin(hint), get_args(hint)
    if kind is Annotated:
        value, limits = converted(value, parts[0]), parts[1]
        fits = limits.low <= value <= limits.high
    elif kind is Literal:
        fits = isinstance(value, str) and value in parts
    elif kind is tuple:
        inner = parts[:1] * len(value) if Ellipsis in parts and isinstance(value, (list, tuple)) else parts
        fits = isinstance(value, (list, tuple)) and len(value) == len(inner)
        value = tuple(map(converted, value, inner)) if fits else value
    elif len(options(hint)) > 1:
        for option in parts:
            with suppress(ValueError):
                return converted(value, option)
        fits = False
    elif hint in _NUMBERS:
        fits = isinstance(value, _NUMBERS[hint]) and (hint is bool) == isinstance(value, (bool, np.bool_))
        value = hint(value) if fits else value
        fits = fits and value == value
    else:
        fits = isinstance(value, hint)
    if not fits:
        raise ValueError(value)
    return value


_NUMBERS: dict[Any, Any] = {float: Real, int: Integral, bool: (bool, np.bool_)}


def words_for(hint: Any) -> str:
    """Say in words which values a type takes."""
    kind, parts = get_origin(hint), get_args(hint)
    if kind is Annotated:
        low, high = parts[1]
        ends = f"of at least {low:.12g}" if high == inf else f"from {low:.12g} to {high:.12g}"
        return f"{words_for(parts[0])} {ends}"
    if kind is Literal:
        return "one of " + ", ".join(parts)
    if kind is tuple:
        number = "" if Ellipsis in parts else f" of {len(parts)}"
        return f"a list{number}, each {words_for(parts[0])}"
    if len(options(hint)) > 1:
        return " or ".join(words_for(option) for option in parts if option is not NoneType)
    words = {float: "a number", int: "a whole number", bool: "true or false", str: "text"}
    return words.get(hint) or hint.__name__


@cache
def type_hints(kind: Any) -> dict[str, Any]:
    """Return the types of a dataclass's fields, with their ranges."""
    hints = get_type_hints(kind, include_extras=True)
    return {f.name: hints[f.name] for f in fields(kind)}


def options(hint: Any) -> tuple:
    """Return the types that a value may have: several for a union."""
    is_one = isinstance(hint, type) or get_origin(hint) in (Annotated, Literal, tuple)
    return (hint,) if is_one else get_args(hint)


def _parts(hint: Any) -> dict[str, Any]:
    """Return the groups of settings that a field may hold, by the names of their types."""
    kinds = (kind for kind in options(hint) if isinstance(kind, type))
    return {kind.__name__: kind for kind in kinds if issubclass(kind, Settings)}


def type_of(kind: Any, key: str) -> Any:
    """Return the type of the field that a dotted name means, or None if there is no such field."""
    name, _, rest = key.partition(".")
    hint = type_hints(kind).get(name)
    if hint is None or not rest:
        return hint
    found = (type_of(part, rest) for part in _parts(hint).values())
    return next((hint for hint in found if hint is not None), None)


def flat(nested: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the entries of nested mappings as pairs of dotted name and value."""
    for key, value in nested.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def changed(config: T, changes: Mapping[str, Any], source: object = None, prefix: str = "") -> T:
    """Return settings with some values replaced, as files, command lines and studies ask for it.

    ``changes`` is nested, or its names are dotted: ``"search.prior"`` is the field ``prior`` of the field ``search``.
    A part that can be left out is switched off with False, on with True (its defaults) or by the name of its type.
    Raises ``DataError`` that names ``source`` and the dotted name.
    """
    kind: Any = type(config)
    source = kind.__name__ if source is None else source
    whole: dict[str, Any] = {}
    inner: dict[str, dict[str, Any]] = {}
    for key, value in flat(changes):
        name, _, rest = key.partition(".")
        if name not in type_hints(kind):
            known = f"a field of {kind.__name__}: {', '.join(type_hints(kind))}"
            raise DataError(source, "key", repr(prefix + key), known)
        if rest:
            inner.setdefault(name, {})[rest] = value
        else:
            whole[name] = _switched(value, type_hints(kind)[name])
    for name, below in inner.items():
        part = whole.get(name, getattr(config, name))
        if not isinstance(part, Settings):
            found = "is off" if part is None else f"{name} = {part!r}"
            key = f"{prefix}{name}.{next(iter(below))}"
            raise DataError(source, key, found, "a field of what is switched on")
        whole[name] = changed(part, below, source, f"{prefix}{name}.")
    with naming_source(source, prefix):
        return replace(config, **whole)  # type: ignore[type-var]


def _switched(value: Any, hint: Any) -> Any:
    """Turn False into None, and True or the name of a type into that type's default settings."""
    parts = _parts(hint)
    if value is False and NoneType in options(hint):
        return None
    if value is True and parts:
        return next(iter(parts.values()))()
    return parts[value]() if isinstance(value, str) and value in parts else value


def value_of(config: Any, key: str) -> Any:
    """Return the value of a dotted name as ``changed`` takes it: False for None, a type's name for a group."""
    for name in key.split("."):
        config = getattr(config, name)
    if config is None:
        return False
    return type(config).__name__ if isinstance(config, Settings) else config


def written(kind: Any, content: Mapping[str, Any]) -> dict[str, Any]:
    """Return what ``plain`` made of settings of a ``kind`` as ``changed`` takes it: by dotted name, infinite again."""
    values = {key: value for key, value in flat(content) if key != "kind"}
    # Which kind of noise or search it was is said inside, and is switched on first.
    kinds = {key.removesuffix(".kind"): value for key, value in values.items() if key.endswith(".kind")}
    rest = {key: value for key, value in values.items() if not key.endswith(".kind")}
    return kinds | {key: inf if _is_infinite(kind, key, value) else value for key, value in rest.items()}


def _is_infinite(kind: Any, key: str, value: Any) -> bool:
    """Whether null, which ``plain`` has for no value and for infinity, is a number."""
    hint = type_of(kind, key)
    return value is None and hint is not None and NoneType not in options(hint)


def plain(value: Any) -> Any:
    """Return a value in the types that JSON knows.

    Settings become dictionaries with their ``kind``, tuples become lists, and numbers that are not finite become null.
    """
    if isinstance(value, Settings):
        kind: Any = type(value)
        return {"kind": kind.__name__} | {name: plain(getattr(value, name)) for name in type_hints(kind)}
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not isfinite(value) else value
