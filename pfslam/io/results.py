"""What a command leaves in a folder: all of its files or none, and nothing that is not its own replaced or deleted.

``summary.json`` names the command that wrote it, and holds the check sum of every file of that run, and of itself. A
file with that check sum was written by the last run, and nobody has changed it since: the next run of the same command
may replace it. Any other file is somebody's work, or the result of another command.
"""

from __future__ import annotations

import filecmp
import json
import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

from pfslam.errors import DataError
from pfslam.io.files import check_writable, reason, write_text
from pfslam.settings import plain

SUMMARY = "summary.json"
MADE_BY, SUMS = "made_by", "sha256"
"""The keys of the command that wrote a summary, and of its check sums."""


@contextmanager
def results_in(folder: str | Path, command: str, force: bool = False) -> Iterator[Path]:
    """Yield an empty folder, whose files move into ``folder`` when the block ends well, and not at all otherwise.

    A file that is there already is replaced if it would stay the same, or if the last run of this command wrote it.
    What else that run wrote is removed: two runs must not pass for one. Raises ``DataError``, before anything moves,
    for any other file, unless ``force`` is true.
    """
    folder = Path(folder)
    check_writable(folder)
    try:
        with tempfile.TemporaryDirectory(prefix=".pfslam-", dir=folder) as hidden:
            yield Path(hidden)
            _move(Path(hidden), folder, command, force)
    except OSError as error:
        raise DataError(folder, "writing", reason(error), "a folder that can be written") from error
    except DataError as error:
        place = error.source.replace(f"{hidden}{os.sep}", f"{folder}{os.sep}")
        raise DataError(place, error.field, error.found, error.expected) from error


def check_free(folder: str | Path, names: Iterable[str], command: str, force: bool = False) -> None:
    """Raise ``DataError`` if a file of one of these names is in ``folder`` and this command did not write it there.

    A command asks before its work begins; whether a file would stay the same is known only afterwards.
    """
    if not force:
        own = _own_files(Path(folder), command)
        for path in (Path(folder, name) for name in names):
            if os.path.lexists(path) and not _is(path, own.get(path.name)):
                raise foreign(path)


def write_summary(folder: Path, command: str, summary: Mapping[str, Any]) -> str:
    """Write the ``summary.json`` of a command with the check sums of its ``files``, and return it.

    What is not finite becomes null.
    """
    sums = {name: check_sum(folder / name) for name in summary["files"] if name != SUMMARY}
    content = plain(dict(summary)) | {MADE_BY: command, SUMS: sums}
    sums[SUMMARY] = _sum(_text(content).encode())
    write_text(folder / SUMMARY, text := _text(content))
    return text


def _text(summary: Mapping[str, Any]) -> str:
    return json.dumps(summary, indent=2, allow_nan=False) + "\n"


def _own_files(folder: Path, command: str) -> dict[str, str]:
    """Return the check sums of what the last run of a command wrote to a folder, by name.

    There is none if the summary is that of another command, or was changed.
    """
    with suppress(OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        text = (folder / SUMMARY).read_bytes()
        content = json.loads(text)
        sums = dict(content[SUMS])
        if content[MADE_BY] == command and content[SUMS].pop(SUMMARY) == _sum(_text(content).encode()):
            return {name: sums[name] for name in sums if name == Path(name).name} | {SUMMARY: _sum(text)}
    return {}


def _move(hidden: Path, folder: Path, command: str, force: bool) -> None:
    """Move all files of one folder into another; the summary last, because it says that all of them are there."""
    own = _own_files(folder, command)
    files = sorted(path.relative_to(hidden) for path in hidden.rglob("*") if path.is_file())
    for there, name in ((folder / name, name) for name in files):
        may = force or _is(there, own.get(str(name)))
        if there.is_dir() or (
            os.path.lexists(there) and not (may or filecmp.cmp(hidden / name, there, shallow=False))
        ):
            raise foreign(there)
    # The summary goes first and comes last: a folder without one is not taken for a finished run.
    for old in sorted(own, key=lambda name: name != SUMMARY):
        if _is(folder / old, own[old]):
            (folder / old).unlink()
    for name in sorted(files, key=lambda name: (name.name == SUMMARY, name)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        os.replace(hidden / name, folder / name)


def _is(path: Path, digest: str | None) -> bool:
    """Whether a path is a file, and no link, with this check sum."""
    return bool(digest) and path.is_file() and not path.is_symlink() and check_sum(path) == digest


def check_sum(path: Path) -> str:
    """Return the check sum of a file."""
    return _sum(path.read_bytes())


def _sum(data: bytes) -> str:
    return sha256(data).hexdigest()


def foreign(path: Path) -> DataError:
    """Return the error for a file that is not to be replaced."""
    found = "a file that this command did not write there, or that was changed since"
    return DataError(path, "file", found, "another folder, or --force to replace it")
