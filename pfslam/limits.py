"""The check of the numbers in a configuration, and the limits that files and the command line state as well."""

from __future__ import annotations

from numbers import Integral, Real

from pfslam.errors import DataError

MAX_PARTICLES = 100_000
MAX_EVERY = 10**6
MAX_BEAMS = 20_000
MAX_RANGE = 1e4
"""Metres."""


def check_numbers(config: object, **ranges: tuple[float, float]) -> None:
    """``DataError`` for the first of the named fields of a dataclass that is not within its range, both ends included.

    A range of whole numbers asks for whole numbers; NaN is in no range. Every number of a tuple counts. None passes
    where it is the field's default.
    """
    for name, (low, high) in ranges.items():
        value = getattr(config, name)
        if value is None and type(config).__dataclass_fields__[name].default is None:  # type: ignore[attr-defined]
            continue
        kind, what = (Integral, "whole number") if isinstance(low, int) else (Real, "number")
        found = value if isinstance(value, tuple) else (value,)
        if not all(isinstance(number, kind) and low <= number <= high for number in found):  # type: ignore[operator]
            what = f"{what}s" if isinstance(value, tuple) else f"a {what}"
            raise DataError(
                type(config).__name__, name, repr(value), f"{what} from {low:.12g} to {high:.12g}"
            )
