"""Packed bags: some kilobytes can unpack to gigabytes, so the library is held to what a bag has a use for."""

from __future__ import annotations

import os
from bz2 import BZ2Decompressor
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

MOST = 2**28
"""Bytes that a message, or a chunk of ROS 1, may unpack to: nothing in the file says how many they are."""
TIMES = 1000
"""A packed file may unpack to so many times its size."""


def limit_unpacking() -> None:
    """Bound what rosbags unpacks, of every kind; beyond it raises ``ValueError``."""
    from lz4.frame import LZ4FrameDecompressor
    from rosbags.rosbag1 import reader as old
    from rosbags.rosbag2 import reader as new
    from rosbags.rosbag2 import storage_mcap as mcap

    zstd: Any = mcap.zstd
    mcap.DECOMPRESSORS["zstd"] = partial(_unpacked, zstd.ZstdDecompressor)
    mcap.DECOMPRESSORS["lz4"] = partial(_unpacked, LZ4FrameDecompressor)
    old.decompressors["bz2"] = lambda data: _unpacked(BZ2Decompressor, data, MOST)
    old.decompressors["lz4"] = lambda data: _unpacked(LZ4FrameDecompressor, data, MOST)
    message = partial(_unpacked, zstd.ZstdDecompressor)
    vars(new)["zstd"] = SimpleNamespace(
        decompress=lambda data: message(data, MOST), open=partial(_opened, zstd)
    )


def _unpacked(unpacker: Callable, data: bytes, size: int) -> bytes:
    raw = unpacker().decompress(data, max_length=size + 1)
    if len(raw) > size:
        raise ValueError(f"{len(data)} bytes unpack to more than {size}")
    return raw


def _opened(zstd: Any, packed: Any, mode: str) -> Any:
    """Open a packed file to read; the library copies it, unpacked, to a folder of its own."""
    file, size = zstd.open(packed, mode), os.fstat(packed.fileno()).st_size
    read = file.read

    def bounded(count: int) -> bytes:
        if file.tell() > TIMES * size:
            raise ValueError(f"a file of {size} bytes unpacks to more than {TIMES} times as many")
        return read(count)

    file.read = bounded
    return file
