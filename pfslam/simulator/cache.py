"""Simulated scans kept between runs: casting them takes seconds, everything else a tenth of one.

A file is named by the configuration, the seed and the simulator's source, so stale scans are never read. Without a
folder to write to, the scans are cast anew each time.
"""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import platformdirs

from pfslam.errors import DataError
from pfslam.io.files import read_npz, write_npz

if TYPE_CHECKING:
    from pfslam.simulator import Simulation, SimulatorConfig

SOURCES = ("simulator/*.py", "motion.py", "poses.py", "sensors.py")
log = logging.getLogger("pfslam")


def cache_folder() -> Path:
    """Return ``$PFSLAM_CACHE``, else the user's cache folder for pfslam."""
    return Path(os.environ.get("PFSLAM_CACHE") or platformdirs.user_cache_dir("pfslam"))


def cached_simulation(name: str, progress: Callable | None = None) -> Simulation:
    """Simulate the built-in data set ``name``, with its scans read from the cache or put there.

    A damaged file is replaced, with a warning. Two processes may do this at once: each writes a file of its own and
    renames it, and both files hold the same. ``progress`` wraps the casting of scans.
    """
    from pfslam.simulator import DEFAULT_SEED, PRESETS, simulate

    path = cache_folder() / f"{name}-{_key(PRESETS[name], DEFAULT_SEED)}.npz"
    if path.exists():
        try:
            return simulate(name, ranges=read_npz(path, ("ranges",))["ranges"])
        except DataError as error:
            log.warning("pfslam: simulating %s again, the cache is damaged: %s", name, error)
    simulation = simulate(name, progress=progress)
    _keep(path, name, simulation.recording.scans().ranges)
    return simulation


def _keep(path: Path, name: str, ranges: np.ndarray) -> None:
    """Put scans into the cache and remove those of older versions, or say why not."""
    try:
        write_npz(path, ranges=ranges)
    except DataError as error:
        log.warning("pfslam: %s is not kept for the next time: %s", name, error)
        return
    for other in path.parent.glob(f"{name}-*.npz"):
        if other != path:
            with suppress(OSError):
                other.unlink()


def _key(config: SimulatorConfig, seed: int) -> str:
    """Hash the configuration, the seed and the source of the simulator to twenty hexadecimal digits."""
    digest = hashlib.sha256(f"{config!r} {seed}".encode())
    package = Path(__file__).parents[1]
    for source in sorted(path for pattern in SOURCES for path in package.glob(pattern)):
        digest.update(source.read_bytes().replace(b"\r\n", b"\n"))
    return digest.hexdigest()[:20]
