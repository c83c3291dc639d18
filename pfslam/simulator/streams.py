"""Recordings too long for memory: scans written into a file piece by piece, and read back through a memory map.

An hour of scans is 600 MB. Here no more than one chunk of it is in memory, while the file is made and while a filter
reads it. The file is an uncompressed ``.npz``, as ``numpy.savez`` writes it. Scans come from the simulator, which casts
them chunk by chunk, or from a CARMEN log, which is read twice.
"""

from __future__ import annotations

import math
import os
import struct
import zipfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from pfslam.errors import DataError
from pfslam.io.carmen import log_recording
from pfslam.io.carmen_lines import ranges_again, read_log
from pfslam.io.files import UNREADABLE, atomic_write, read_npy_header, reason
from pfslam.recording import LidarScans, Recording
from pfslam.simulator import DEFAULT_SEED, Simulation, SimulatorConfig, simulate
from pfslam.simulator.clocks import START_OF_TIME
from pfslam.simulator.lidar import measured, true_ranges

CHUNK = 960
"""Scans at a time: 4 MB of ranges, and some tens of MB while they are cast."""


def write_rows(path: str | Path, name: str, shape: tuple[int, int], parts: Iterable[np.ndarray]) -> None:
    """Write one float32 array of ``shape`` into an uncompressed archive, from parts ``(n, columns)`` one by one.

    The file is whole or absent.
    """
    header = {"descr": "<f4", "fortran_order": False, "shape": tuple(int(n) for n in shape)}
    written = 0
    with atomic_write(path) as file, zipfile.ZipFile(file, "w") as archive:
        with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
            np.lib.format.write_array_header_1_0(member, header)
            for part in parts:
                member.write(np.ascontiguousarray(part, dtype="<f4").tobytes())
                written += len(part)
        if written != shape[0]:
            raise DataError(path, name, f"{written} rows", f"{shape[0]} rows")


def map_npz(path: str | Path, name: str) -> np.ndarray:
    """One array of an uncompressed ``.npz``, read from the file only where it is looked at. It cannot be changed.

    A compressed member has no place in the file that could be looked at: ``DataError`` says so.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            held = {m.filename.removesuffix(".npy"): m for m in archive.infolist()}
            if name not in held:
                raise DataError(
                    path, "keys", ", ".join(sorted(held))[:200] or "nothing", f"a key named {name}"
                )
            member = held[name]
            if member.compress_type != zipfile.ZIP_STORED:
                raise DataError(path, name, "a compressed array", "one written without compression")
            with archive.open(member) as file:
                dtype, shape, fortran = read_npy_header(path, name, file)
                begin = _data_begin(path, member) + file.tell()
    except DataError:
        raise
    except OSError as error:
        raise DataError(path, "reading", reason(error), "a readable .npz archive") from error
    except (*UNREADABLE, SyntaxError, TypeError, KeyError) as error:
        raise DataError(path, "file", f"an unreadable archive ({error})", "a whole .npz archive") from error
    size = math.prod(shape)
    if begin + size * dtype.itemsize > os.path.getsize(path):
        raise DataError(path, name, f"shape {shape} of {dtype}", "as many bytes as the shape needs")
    return (
        np.memmap(path, dtype, "r", begin, shape, "F" if fortran else "C") if size else np.zeros(shape, dtype)
    )


def _data_begin(path: str | Path, member: zipfile.ZipInfo) -> int:
    """Where in the archive a member's own bytes begin: after its local header of 30 bytes, its name and extras."""
    with open(path, "rb") as file:
        file.seek(member.header_offset + 26)
        name, extra = struct.unpack("<HH", file.read(4))
    return member.header_offset + 30 + name + extra


def scan_chunks(simulation: Simulation, chunk: int = CHUNK) -> Iterator[np.ndarray]:
    """The drive's scans in order, as ranges ``(n, beams)`` float32, at most ``chunk`` at a time.

    The noise is drawn chunk by chunk: another draw than that of ``simulate``, from the same distribution.
    """
    config = simulation.config
    rng = np.random.default_rng([simulation.seed, config.number, 1])
    seconds = simulation.recording.scans().t - START_OF_TIME
    for first in range(0, len(seconds), chunk):
        t = seconds[first : first + chunk]
        exact = true_ranges(simulation.world, simulation.drive, config.robot.lidar, t, config.scan_time)
        yield measured(exact, config, rng)


def simulate_to_file(
    what: str | SimulatorConfig, path: str | Path, seed: int = DEFAULT_SEED, progress: Callable | None = None
) -> Simulation:
    """As ``simulate``, with the ranges in the uncompressed archive ``path`` instead of in memory.

    ``progress`` wraps the chunks, as tqdm does.
    """
    simulation = simulate(what, seed, cast=False)
    scans = simulation.recording.scans()
    chunks = scan_chunks(simulation)
    write_rows(path, "ranges", scans.ranges.shape, progress(chunks) if progress else chunks)
    mapped = LidarScans(scans.t, map_npz(path, "ranges"))
    return replace(simulation, recording=replace(simulation.recording, lidar=mapped))


def carmen_to_file(log: str | Path, path: str | Path) -> Recording:
    """As ``load_carmen``, with the ranges in the uncompressed archive ``path`` instead of in memory.

    The log is read twice: once for stamps and poses, with every check, and once for the ranges, scan by scan in the
    order of their stamps. ``DataError`` is that of ``load_carmen``, and then no archive is left.
    """
    if Path(path).exists() and Path(log).exists() and Path(path).samefile(log):
        raise DataError(path, "archive", "the log itself", "another file to write to")
    lines = read_log(log, lambda ranges: None)

    def into_file(order: np.ndarray) -> np.ndarray:
        write_rows(path, "ranges", (len(order), lines.beams), ranges_again(lines, order))
        return map_npz(path, "ranges")

    return log_recording(lines, into_file)
