"""The one error that bad input raises."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager


class DataError(ValueError):
    """Report input that cannot be used.

    The message is one line that names the source, the field, the value found and what was expected, so that the
    command line can print it as it is.
    """

    def __init__(self, source: object, field: str, found: object, expected: str):
        self.source, self.field, self.found, self.expected = str(source), field, _short(found), expected
        line = " ".join(f"{self.source}: {field}: found {self.found}, expected {expected}".split())
        super().__init__(printable(line))


def printable(text: str) -> str:
    """Replace control characters, which a terminal would obey: names of files and topics can hold any character."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)


@contextmanager
def naming_source(source: object, prefix: str = "") -> Iterator[None]:
    """Let a ``DataError`` raised inside name this source, and the place ``prefix`` before its own field."""
    try:
        yield
    except DataError as error:
        raise DataError(source, prefix + error.field, error.found, error.expected) from None


def need(package: str, extra: str) -> None:
    """Raise ``DataError`` that says what to install if a package is not here, which only an extra of ours brings."""
    if importlib.util.find_spec(package) is None:
        raise DataError("pfslam", "package", f"no {package}", f"the extra {extra}, or: pip install {package}")


def _short(found: object) -> str:
    """Cut what was found where it gets long, because damaged input can have any length."""
    # The parts of a tuple as one would write them: NumPy's numbers name their type.
    text = f"({', '.join(map(str, found))})" if isinstance(found, tuple) else str(found)
    return text if len(text) <= 160 else text[:157] + "..."
