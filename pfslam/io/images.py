"""PNG images, checked before they are decoded; colours are RGB everywhere in the package."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np

from pfslam.errors import DataError
from pfslam.io.files import atomic_write, read_bytes

MAX_PNG_BYTES = 64 * 2**20
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
CHANNELS = {0: 1, 2: 3, 6: 4}
"""Channels by PNG colour type: grey, RGB, RGBA."""


def read_png(path: str | Path, shape: tuple[int, int, int], dtype: np.dtype) -> np.ndarray:
    """Read a PNG file, ``(H, W)`` or ``(H, W, 3)`` RGB; ``shape`` is (H, W, channels) and must match."""
    return decode_png(path, read_bytes(path, MAX_PNG_BYTES), shape, dtype)


def decode_png(path: str | Path, data: bytes, shape: tuple[int, int, int], dtype: np.dtype) -> np.ndarray:
    """Decode the bytes of a PNG file, as ``read_png`` does; ``path`` names their source.

    The decoder silently fills what a damaged file lacks with zeros, so check sums are verified first.
    """
    found = _png_shape(path, data)
    if found != (shape, np.dtype(dtype).itemsize * 8):
        expected = f"{shape[1]} x {shape[0]}, {shape[2]} channels of {np.dtype(dtype).itemsize * 8} bits"
        (h, w, channels), bits = found
        raise DataError(path, "image", f"{w} x {h}, {channels} channels of {bits} bits", expected)
    pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    expected_shape = shape[:2] if shape[2] == 1 else shape
    if pixels is None or pixels.shape != expected_shape or pixels.dtype != dtype:
        raise DataError(path, "image", "pixels that cannot be decoded", "a whole PNG image")
    return pixels if shape[2] == 1 else np.ascontiguousarray(pixels[..., ::-1])


def decode_grey_png(path: str | Path, data: bytes, most: int) -> np.ndarray:
    """Decode the bytes of a PNG file with one channel of 8 bits and at most so many pixels, ``(H, W)`` uint8."""
    (height, width, _), _ = _png_shape(path, data)
    if height * width > most:
        raise DataError(path, "image", f"{width} x {height} pixels", f"at most {most} pixels")
    return decode_png(path, data, (height, width, 1), np.dtype(np.uint8))


def write_png(path: str | Path, pixels: np.ndarray) -> None:
    """Write ``(H, W)``, ``(H, W, 3)`` RGB or ``(H, W, 4)`` RGBA pixels as PNG, whole or not at all."""
    with atomic_write(path) as file:
        file.write(encode_png(pixels).tobytes())


def encode_png(pixels: np.ndarray) -> np.ndarray:
    """Return the bytes ``(N,)`` uint8 of a PNG file with these pixels, as ``write_png`` takes them."""
    if pixels.ndim == 3:
        pixels = pixels[..., [2, 1, 0, 3][: pixels.shape[2]]]
    return cv2.imencode(".png", np.ascontiguousarray(pixels))[1]


def _png_shape(path: str | Path, data: bytes) -> tuple[tuple[int, int, int], int]:
    """Read ((height, width, channels), bits per channel) from the header; raises unless every chunk is whole."""
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
    return (height, width, CHANNELS.get(colour, 0)), bits


def numbered_images(folder: Path | None, stem: str) -> dict[int, Path]:
    """Find the images ``stem_I.png`` of a folder, by index I - 1."""
    if folder is None or not folder.is_dir():
        return {}
    pattern = re.compile(re.escape(stem) + r"_([1-9][0-9]{0,8})\.png", re.IGNORECASE)
    matches = ((pattern.fullmatch(path.name), path) for path in folder.iterdir())
    return {int(match[1]) - 1: path for match, path in matches if match}


class ImageReader:
    """Reads image k of a stream from its file; ``shape`` is (height, width, channels)."""

    def __init__(self, files: Mapping[int, Path], shape: tuple[int, int, int], dtype: type):
        self.files, self.shape, self.dtype = files, shape, np.dtype(dtype)

    def __call__(self, k: int) -> np.ndarray:
        if int(k) not in self.files:
            raise DataError("images", "index", k, "the index of an image that exists")
        return read_png(self.files[int(k)], self.shape, self.dtype)
