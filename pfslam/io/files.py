"""Files that are either whole or absent, NumPy archives that never unpickle anything, and PNG images.

Images are checked before they are decoded; colours are RGB everywhere in the package.
"""

from __future__ import annotations

import csv
import io
import os
import secrets
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO
from zipfile import ZipFile

import cv2
import numpy as np
from numpy.lib.format import read_array_header_1_0, read_array_header_2_0, read_magic, write_array
from numpy.lib.npyio import NpzFile

from pfslam.errors import DataError

MAX_FIELD_BYTES = 8 * 2**30
"""Largest array that is read from an archive: ten hours of scans in double precision fit."""
MAX_ROW_BYTES = 8 * 10 * 3600 * 1000
"""Largest array of one dimension: the stamps of ten hours at a thousand a second."""
MAX_TEXT_BYTES = 2**30
MAX_PNG_BYTES = 64 * 2**20
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
CHANNELS = {0: 1, 2: 3, 6: 4}
"""Channels by PNG colour type: grey, RGB, RGBA."""


@contextmanager
def atomic_write(path: str | Path) -> Iterator[BinaryIO]:
    """Open a binary file that appears as ``path`` when the block ends well, and not at all otherwise.

    The bytes go to a hidden file in the same folder, which is made if it is missing, and that file is then renamed.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(temporary, "xb") as file:
            yield file
        os.replace(temporary, path)
    except OSError as error:
        raise DataError(path, "writing", reason(error), "a writable folder with room on the disk") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def check_writable(folder: str | Path) -> None:
    """Make ``folder`` if needed and check that a file can be written there, before any work depends on it."""
    probe = Path(folder) / f".{secrets.token_hex(4)}.tmp"
    try:
        probe.parent.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"")
    except OSError as error:
        raise DataError(folder, "folder", reason(error), "a folder that can be written") from error
    finally:
        with suppress(OSError):
            probe.unlink()


def write_text(path: str | Path, text: str) -> None:
    """Write ``text`` as UTF-8 with Unix line ends, whole or not at all."""
    with atomic_write(path) as file:
        file.write(text.encode())


def write_csv(path: str | Path, rows: Iterable[Iterable[Any]]) -> None:
    """Write rows as comma-separated values, whole or not at all."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    write_text(path, text.getvalue())


def read_text(path: str | Path) -> str:
    """Read a text file of at most ``MAX_TEXT_BYTES``; bytes that are not UTF-8 become question marks."""
    return read_bytes(path, MAX_TEXT_BYTES).decode("utf-8", errors="replace")


def write_npz(path: str | Path, progress: Callable = iter, /, **arrays: Any) -> None:
    """Write named arrays into an archive, whole or not at all; the same arrays give the same bytes.

    A function in the place of an array makes it when it is written. Compression would halve the size of scans, but
    takes a hundred times as long as writing them. ``progress`` wraps the list of names.
    """
    with atomic_write(path) as file, ZipFile(file, "w") as archive:
        for name in progress(list(arrays)):
            values = arrays[name]
            values = values() if callable(values) else values
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                write_array(member, np.asanyarray(values), allow_pickle=False)


def reason(error: OSError) -> str:
    """Say in words why the system refused."""
    return error.strerror or type(error).__name__


def check_ends(path: str | Path) -> None:
    """Raise ``DataError`` for a pipe or a device, whose end may never come."""
    path = Path(path)
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise DataError(path, "reading", "a pipe or a device", "a file")


def open_file(path: str | Path) -> BinaryIO:
    """Open a file to read; pipes and devices are refused."""
    check_ends(path)
    return open(path, "rb")


def read_bytes(path: str | Path, limit: int) -> bytes:
    """Read a file of at most ``limit`` bytes."""
    try:
        with open_file(path) as file:
            data = file.read(limit + 1)
    except OSError as error:
        raise DataError(path, "reading", reason(error), "a file that can be read") from error
    if len(data) > limit:
        raise DataError(path, "size", f"more than {limit} bytes", f"at most {limit} bytes")
    return data


def read_npz(
    path: str | Path,
    required: tuple[str, ...],
    optional: tuple[str, ...] = (),
    check: Callable[[str, np.ndarray, Mapping[str, np.ndarray]], None] | None = None,
) -> dict[str, np.ndarray]:
    """Read the named arrays of an ``.npz`` archive, the optional ones if they are there; others are not looked at.

    A few bytes of an archive can unpack to gigabytes, so ``check(name, stated, before)`` may refuse an array before it
    is read: ``stated`` has its type and its shape, but takes no memory, and ``before`` are the arrays named earlier.
    Raises ``DataError`` for a file that is not such an archive, a missing key, an array of objects or text, a damaged
    member, or a size beyond ``MAX_FIELD_BYTES``.
    """
    data: dict[str, np.ndarray] = {}
    try:
        with open_file(path) as file, np.load(file, allow_pickle=False) as archive:
            if missing := [name for name in required if name not in archive.files]:
                held = ", ".join(sorted(archive.files)[:8]) or "nothing"
                raise DataError(path, "keys", held[:200], f"a key named {missing[0]}")
            for name in [*required, *(name for name in optional if name in archive.files)]:
                stated = _stated(path, archive, name)
                if check:
                    check(name, stated, data)
                data[name] = _read_member(path, archive, name)
            return data
    except DataError:
        raise
    except OSError as error:
        raise DataError(path, "reading", reason(error), "a readable .npz archive") from error
    except Exception as error:  # NumPy, zipfile and zlib raise many kinds for a damaged archive
        raise DataError(path, "file", f"an unreadable archive ({error})", "a whole .npz archive") from error


PLAIN = "plain numbers, never objects or text"


def _stated(path: str | Path, archive: NpzFile, name: str) -> np.ndarray:
    """Return an array of the type and the shape that a member states, all of whose numbers are one zero."""
    size = archive.zip.getinfo(f"{name}.npy").file_size  # type: ignore[union-attr]  # None once it is closed
    if size > MAX_FIELD_BYTES:
        found = f"a stated size of {size} bytes"
        raise DataError(path, name, found, f"at most {MAX_FIELD_BYTES} bytes")
    try:
        with archive.zip.open(f"{name}.npy") as member:  # type: ignore[union-attr]
            is_first = read_magic(member) == (1, 0)
            shape, _, dtype = (read_array_header_1_0 if is_first else read_array_header_2_0)(member)
        stated = np.broadcast_to(np.zeros((), dtype), shape)
    except Exception as error:  # whatever a damaged header makes NumPy stumble over
        raise DataError(path, name, f"a damaged array ({error})", PLAIN) from error
    if dtype.kind not in "biuf":
        raise DataError(path, name, f"an array of {dtype}", PLAIN)
    if stated.ndim < 2 and stated.nbytes > MAX_ROW_BYTES:
        raise DataError(path, name, f"a row of {stated.nbytes} bytes", f"at most {MAX_ROW_BYTES} bytes")
    return stated


def _read_member(path: str | Path, archive: NpzFile, name: str) -> np.ndarray:
    try:
        try:
            return archive[name]
        except SystemError:  # Python 3.11 can lose count while it parses a sound header (gh-106905)
            return archive[name]
    except Exception as error:
        raise DataError(path, name, f"a damaged array ({error})", PLAIN) from error


def decode_png(path: str | Path, data: bytes, shape: tuple[int, int, int], dtype: type) -> np.ndarray:
    """Decode the bytes of a PNG file, ``(H, W)`` or ``(H, W, 3)`` RGB; ``path`` names their source.

    ``shape`` is (H, W, channels) and must match, as must the type. The decoder silently fills what a damaged file lacks
    with zeros, so check sums are verified first.
    """
    found = _png_shape(path, data)
    wanted = (*shape, np.dtype(dtype).itemsize * 8)
    if found != wanted:
        said, expected = (
            f"{w} x {h}, {channels} channels of {bits} bits" for h, w, channels, bits in (found, wanted)
        )
        raise DataError(path, "image", said, expected)
    pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    expected_shape = shape[:2] if shape[2] == 1 else shape
    if pixels is None or pixels.shape != expected_shape or pixels.dtype != dtype:
        raise DataError(path, "image", "pixels that cannot be decoded", "a whole PNG image")
    return pixels if shape[2] == 1 else np.ascontiguousarray(pixels[..., ::-1])


def decode_map_png(path: str | Path, data: bytes, most: int) -> np.ndarray:
    """Decode the bytes of a PNG file of 8 bits and at most ``most`` pixels, ``(H, W)`` or ``(H, W, 3)`` RGB uint8."""
    height, width, channels, _ = _png_shape(path, data)
    if height * width > most:
        raise DataError(path, "image", f"{width} x {height} pixels", f"at most {most} pixels")
    if channels not in (1, 3):
        raise DataError(path, "image", f"{channels} channels", "one of grey, or three of colours")
    return decode_png(path, data, (height, width, channels), np.uint8)


def write_png(path: str | Path, pixels: np.ndarray) -> None:
    """Write ``(H, W)``, ``(H, W, 3)`` RGB or ``(H, W, 4)`` RGBA pixels as PNG, whole or not at all."""
    with atomic_write(path) as file:
        file.write(encode_png(pixels).tobytes())


def encode_png(pixels: np.ndarray) -> np.ndarray:
    """Return the bytes ``(N,)`` uint8 of a PNG file with these pixels, as ``write_png`` takes them."""
    if pixels.ndim == 3:
        pixels = pixels[..., [2, 1, 0, 3][: pixels.shape[2]]]
    return cv2.imencode(".png", np.ascontiguousarray(pixels))[1]


def _png_shape(path: str | Path, data: bytes) -> tuple[int, int, int, int]:
    """Read height, width, channels and bits per channel from the header; raises unless every chunk is whole."""
    if data[:8] != PNG_MAGIC or data[12:16] != b"IHDR" or len(data) < 33:
        raise DataError(path, "image", "no PNG header", "a PNG image")
    width, height, bits, colour = struct.unpack(">IIBB", data[16:26])
    at, kind = 8, b""
    while kind != b"IEND":
        if at + 12 > len(data):
            raise DataError(path, "image", f"an end after {len(data)} bytes", "a whole PNG image")
        (length,), kind = struct.unpack(">I", data[at : at + 4]), data[at + 4 : at + 8]
        body = data[at + 4 : at + 8 + length]
        if data[at + 8 + length : at + 12 + length] != struct.pack(">I", zlib.crc32(body)):
            raise DataError(path, "image", f"a damaged part at byte {at}", "a whole PNG image")
        at += 12 + length
    return height, width, CHANNELS.get(colour, 0), bits
