"""The machine that measures: what it is, how noisy it is, and how fast its memory and arithmetic are."""

from __future__ import annotations

import os
import platform
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np

THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
"""What the libraries read when they start; the benchmark runs with one thread each."""


@dataclass(frozen=True)
class Machine:
    """Names and speeds: ``bytes_per_second`` of a large copy, ``products_per_second`` (multiply and add) in cache.

    ``noise`` is the range of one piece of work done again and again, as a share of its median; ``wall`` how much longer
    it took by the clock than in processor time.
    """

    cpu: str
    cores: int
    blas: str
    threads: str
    python: str
    numpy: str
    opencv: str
    load: float | None
    noise: float
    wall: float
    bytes_per_second: float
    products_per_second: float

    def __str__(self) -> str:
        busy = "" if self.load is None else f", load {self.load:.1f}"
        return (
            f"{self.cpu}, {self.cores} cores{busy}; {self.blas} on {self.threads} thread(s); Python {self.python}, "
            f"NumPy {self.numpy}, OpenCV {self.opencv}\n"
            f"memory {self.bytes_per_second / 1e9:.1f} GB/s, arithmetic {self.products_per_second / 1e9:.1f} G "
            f"products/s; noise: the same work varies by {100 * self.noise:.0f} %, and takes {self.wall:.1f} times its "
            "processor time"
        )

    def as_dict(self) -> dict:
        """For JSON."""
        return asdict(self)


def describe() -> Machine:
    """This machine, measured now."""
    noise, wall = _noise()
    blas = np.show_config(mode="dicts").get("Build Dependencies", {}).get("blas", {})
    return Machine(
        cpu=_cpu(),
        cores=os.cpu_count() or 1,
        blas=blas.get("name", "unknown BLAS"),
        threads=os.environ.get(THREADS[0], "all"),
        python=platform.python_version(),
        numpy=np.__version__,
        opencv=cv2.__version__,
        load=os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        noise=noise,
        wall=wall,
        bytes_per_second=_bandwidth(),
        products_per_second=_arithmetic(),
    )


def _cpu() -> str:
    """The processor's name."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _seconds(job, times: int) -> np.ndarray:
    spent = np.zeros(times)
    for k in range(times):
        begin = time.process_time()
        job()
        spent[k] = time.process_time() - begin
    return spent


def _noise() -> tuple[float, float]:
    numbers = np.arange(300_000) * 7919 % 300_007
    begin = time.perf_counter()
    spent = _seconds(lambda: np.sort(numbers), 15)
    wall = time.perf_counter() - begin
    return float(np.ptp(spent) / np.median(spent)), float(wall / spent.sum())


def _bandwidth() -> float:
    """Bytes read and written per second by a copy too large for any cache."""
    source = np.ones(8_000_000)
    target = np.empty_like(source)
    return 2 * source.nbytes / float(np.min(_seconds(lambda: np.copyto(target, source), 5)))


def _arithmetic() -> float:
    """Products added up per second by a product of two float32 matrices that fit into cache."""
    a = np.ones((256, 256), dtype=np.float32)
    return 256**3 / float(np.min(_seconds(lambda: a @ a, 9)))
