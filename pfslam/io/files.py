"""Files that are either whole or absent, and NumPy archives read under limits.

Nothing here unpickles. Before any memory is taken, the size that an archive claims is checked against what
its bytes can hold, so that a damaged header cannot ask for more than the file could ever contain.
"""

from __future__ import annotations

import ast
import math
import os
import re
import secrets
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

import numpy as np

from pfslam.errors import DataError

MAX_FIELD_BYTES = 8 * 2**30
"""Largest array that is read from an archive: ten hours of scans in double precision fit."""
MAX_TEXT_BYTES = 2**30
MAX_HEADER_BYTES = 10_000
DEFLATE_LIMIT = 1032
"""One compressed byte cannot stand for more than so many bytes."""
NPY_MAGIC = b"\x93NUMPY"
UNREADABLE = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    NotImplementedError,
    RuntimeError,
    ValueError,
)
"""What ``zipfile`` raises for damaged, encrypted or unknown archives."""
LOT = re.compile(r"[0-9a-f]{8}\.tmp")
"""How temporary names end: no two writers of one file draw the same."""
ABANDONED = 86_400.0
"""A temporary file that nobody has written to for so many seconds was left by a process that was killed."""


@contextmanager
def atomic_write(path: str | Path) -> Iterator[BinaryIO]:
    """A binary file to write; it appears as ``path`` when the block ends well, and not at all otherwise.

    The bytes go to a hidden name in the same folder, which is made if it is missing, and are then renamed. What
    processes that were killed have left of the same file is removed when it is a day old.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(temporary, "xb") as file:
            yield file
        os.replace(temporary, path)
        _remove_abandoned(path)
    except OSError as error:
        raise DataError(path, "writing", reason(error), "a writable folder with room on the disk") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def _remove_abandoned(path: Path) -> None:
    """Remove temporary files of this name that are a day older than the file itself: no clock but the disk's."""
    begin = f".{path.name}."
    with suppress(OSError):
        names = [name for name in os.listdir(path.parent) if name.startswith(begin)]
        for other in (path.with_name(name) for name in names if LOT.fullmatch(name.removeprefix(begin))):
            if path.stat().st_mtime - other.stat().st_mtime > ABANDONED:
                other.unlink()


def check_writable(folder: str | Path) -> None:
    """Make ``folder`` if needed and see that a file can be written there, before any work depends on it."""
    probe = Path(folder) / f".{secrets.token_hex(4)}.tmp"
    try:
        probe.parent.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        raise DataError(folder, "folder", reason(error), "a folder that can be written") from error


def write_text(path: str | Path, text: str) -> None:
    """Write ``text`` as UTF-8 with Unix line ends, whole or not at all."""
    with atomic_write(path) as file:
        file.write(text.encode())


def read_text(path: str | Path) -> str:
    """The text of a file of at most ``MAX_TEXT_BYTES``; bytes that are not UTF-8 become question marks."""
    return read_bytes(path, MAX_TEXT_BYTES).decode("utf-8", errors="replace")


def write_npz(path: str | Path, **arrays: np.ndarray) -> None:
    """Write named arrays, not compressed, whole or not at all; the same arrays give the same bytes.

    Scans compress to half their size, but that takes a hundred times as long as writing them.
    """
    with atomic_write(path) as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]  # its stubs know no arrays by name


def reason(error: OSError) -> str:
    """Why the system refused, in words."""
    return error.strerror or type(error).__name__


def read_bytes(path: str | Path, limit: int) -> bytes:
    """The bytes of a file of at most ``limit`` bytes."""
    try:
        with open(path, "rb") as file:
            data = file.read(limit + 1)
    except OSError as error:
        raise DataError(path, "reading", reason(error), "a file that can be read") from error
    if len(data) > limit:
        raise DataError(path, "size", f"more than {limit} bytes", f"at most {limit} bytes")
    return data


def read_npz(path: str | Path, required: tuple[str, ...]) -> dict[str, np.ndarray]:
    """The named arrays of an ``.npz`` archive; others in it are not looked at.

    Raises ``DataError`` for a file that is not such an archive, a missing key, an array of objects or text, a
    damaged member, or a size beyond ``MAX_FIELD_BYTES``.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = {m.filename.removesuffix(".npy"): m for m in archive.infolist()}
            missing = [name for name in required if name not in members]
            if missing:
                held = ", ".join(sorted(members)[:8]) or "nothing"
                raise DataError(path, "keys", held[:200], f"a key named {missing[0]}")
            return {name: _read_member(path, archive, members[name], name) for name in required}
    except DataError:
        raise
    except OSError as error:
        raise DataError(path, "reading", reason(error), "a readable .npz archive") from error
    except UNREADABLE as error:
        raise DataError(path, "file", f"an unreadable archive ({error})", "a whole .npz archive") from error


def _read_member(path, archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str) -> np.ndarray:
    limit = min(MAX_FIELD_BYTES, member.compress_size * DEFLATE_LIMIT + 1024)
    if member.file_size > limit or member.compress_size > os.path.getsize(path):
        raise DataError(path, name, f"a stated size of {member.file_size} bytes", f"at most {limit} bytes")
    try:
        with archive.open(member) as file:
            dtype, shape, fortran = read_npy_header(path, name, file)
            expected = math.prod(shape) * dtype.itemsize
            if expected > MAX_FIELD_BYTES or expected > member.file_size:
                found = f"shape {shape} of {dtype} in a member of {member.file_size} bytes"
                raise DataError(path, name, found, "as many bytes as the shape needs")
            data = file.read()
    except DataError:
        raise
    except (*UNREADABLE, OSError, SyntaxError, RecursionError, MemoryError, TypeError) as error:
        raise DataError(path, name, f"a damaged array ({error})", "a whole array written by NumPy") from error
    if len(data) != expected:
        raise DataError(path, name, f"{len(data)} bytes", f"{expected} bytes for {dtype} of shape {shape}")
    values = np.frombuffer(data, dtype=dtype)
    return values.reshape(shape[::-1]).T if fortran else values.reshape(shape)


def read_npy_header(path, name: str, file) -> tuple[np.dtype, tuple[int, ...], bool]:
    """The dtype, shape and storage order of a ``.npy`` file that is open at its start. Plain numbers only."""
    magic = file.read(8)
    if magic[:6] != NPY_MAGIC or magic[6] not in (1, 2, 3):
        raise DataError(path, name, "no NumPy header", "an array written by NumPy")
    size_format = "<H" if magic[6] == 1 else "<I"
    (length,) = struct.unpack(size_format, file.read(struct.calcsize(size_format)))
    if length > MAX_HEADER_BYTES:
        raise DataError(path, name, f"a header of {length} bytes", f"at most {MAX_HEADER_BYTES} bytes")
    header = ast.literal_eval(file.read(length).decode("latin1").strip())
    dtype, shape = np.dtype(header["descr"]), header["shape"]
    if dtype.kind not in "biuf" or dtype.shape:
        raise DataError(path, name, f"an array of {dtype}"[:120], "plain numbers, never objects or text")
    if not (isinstance(shape, tuple) and len(shape) <= 4 and all(type(n) is int and n >= 0 for n in shape)):
        raise DataError(path, name, f"shape {shape}"[:120], "a shape of at most four sizes")
    return dtype, shape, bool(header["fortran_order"])
