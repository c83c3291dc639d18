"""``make bench``: speed and memory of whole runs, each in a process of its own with one thread.

A run is timed as a user sees it: start, imports, loading, filter, files. What a laboratory of the book needs for one
frame is measured where a browser is: ``book/_tools/frame_time.py``.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from pfslam.events import UsedScans
from pfslam.io.datasets import load
from pfslam.io.recordings import save
from pfslam.methods import METHODS
from pfslam.recording import LidarScans, Recording
from pfslam.study.provenance import machine, versions

ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")
RUN = """
import sys
from pathlib import Path
from pfslam.__main__ import main
code, status = main(sys.argv[1:]), Path("/proc/self/status")
lines = status.read_text().splitlines() if status.exists() else []
print(next((int(line.split()[1]) * 1024 / 1e6 for line in lines if line.startswith("VmHWM")), "nan"))
sys.exit(code)
"""
PARTICLES = (5, 50, 200, 1000, 5000)
WIDTHS = (30.0, 100.0, 400.0)


def whole_run(*options: str | Path) -> tuple[float, float]:
    """Run the command line once in a fresh process: seconds by the clock, and peak memory (MB; NaN if unknown)."""
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-c", RUN, "run", *map(str, options), "--no-texture", "--out", out]
        begin = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, env=os.environ | ONE_THREAD)
        spent = time.perf_counter() - begin
    if done.returncode:
        raise SystemExit(done.stderr)
    return spent, float(done.stdout.split()[-1])


def used_scans(recording: Recording, every: int) -> int:
    """Count the scans that a run processes."""
    return len(UsedScans.of(recording, every))


def methods(name: str, recording: Recording) -> Iterator[str]:
    """Time each method against the recording's own time."""
    seconds = float(np.ptp(recording.scans().t))
    for method in METHODS:
        for every in (5,) if method == "per-particle" else (5, 1):
            spent, peak = whole_run(name, "--method", method, "--every", str(every))
            scan = 1e3 * spent / used_scans(recording, every)
            what = f"{method}, every {every}"
            yield f"{what:<24} {seconds / spent:6.1f} x real time  {scan:6.1f} ms a scan  {peak:6.0f} MB"


def particles(name: str, recording: Recording) -> Iterator[str]:
    """Time the refined filter for more and more particles."""
    for n in PARTICLES:
        spent, peak = whole_run(name, "--particles", str(n), "--every", "5")
        yield f"{n:>5} particles  {1e3 * spent / used_scans(recording, 5):6.1f} ms a scan  {peak:6.0f} MB"


def map_sizes(recording: Recording) -> Iterator[str]:
    """Time the same drive in maps of different width: one beam of the first scan ends far away."""
    for width in WIDTHS:
        scans, lidar = recording.scans(), recording.robot.lidar
        ranges = scans.ranges.copy()
        ranges[0, :: lidar.beams // 4] = 0.5 * width
        robot = replace(recording.robot, lidar=replace(lidar, range_max=max(lidar.range_max, width)))
        wide = replace(recording, robot=robot, lidar=LidarScans(scans.t, ranges), camera=None)
        with tempfile.TemporaryDirectory() as folder:
            save(wide, path := Path(folder) / "wide.npz")
            spent, peak = whole_run(path, "--every", "5")
        yield f"about {width:3.0f} m wide  {1e3 * spent / used_scans(wide, 5):6.1f} ms a scan  {peak:6.0f} MB"


def main() -> None:
    """Measure everything and print it line by line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("dataset", nargs="?", default="hall", help="what pfslam.load takes (default hall)")
    name = parser.parse_args().dataset
    recording = load(name)
    about = machine() | {"cores": os.cpu_count()} | versions()
    print(", ".join(f"{key} {value}" for key, value in about.items()))
    sections = {
        f"Whole runs of {name}": methods(name, recording),
        "More particles (refined, every 5th scan)": particles(name, recording),
        "A larger map (refined, every 5th scan)": map_sizes(recording),
    }
    for title, lines in sections.items():
        print(f"\n{title}")
        for line in lines:
            print(f"  {line}", flush=True)


if __name__ == "__main__":
    main()
