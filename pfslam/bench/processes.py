"""Sections 6, 9 and 10: what only a fresh process can tell: memory, start-up, and the same results on two threads."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
from itertools import islice
from pathlib import Path

import numpy as np

from pfslam.bench.machine import THREADS
from pfslam.bench.setting import Setting
from pfslam.bench.tables import Row, Section
from pfslam.config import SlamConfig
from pfslam.datasets import load
from pfslam.errors import DataError
from pfslam.runs import slam_steps

MEMORY = """
import sys
from pfslam.__main__ import main
from pfslam.bench.processes import peak_megabytes
main(sys.argv[1:])
print(peak_megabytes())
"""
IMPORT = (
    "import time; t = time.process_time(); from pfslam import load, run_slam; print(time.process_time() - t)"
)
FIGURE = """
import io, time
from pfslam import dead_reckoning, load
from pfslam.teaching.show.figures import trajectory_figure
recording = load("hall")
figure = trajectory_figure(recording, dead_reckoning(recording), "odometry", "hall")
figure.savefig(io.BytesIO(), format="png")
print(time.process_time())
"""
HASH = """
import sys, cv2
cv2.setNumThreads(int(sys.argv[1]))
from pfslam.bench.processes import fingerprint
print(fingerprint(int(sys.argv[2])))
"""


def in_fresh_process(code: str, *arguments: str, threads: int = 1) -> str:
    """The last line that ``code`` prints in an interpreter of its own. Raises ``DataError`` if it fails."""
    environment = os.environ | {name: str(threads) for name in THREADS}
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, env=environment
    )
    if done.returncode != 0 or not done.stdout.strip():
        last = (done.stderr.strip().splitlines() or ["nothing"])[-1]
        raise DataError("pfslam bench", "fresh process", last, "a run without errors")
    return done.stdout.strip().splitlines()[-1]


def peak_megabytes() -> float:
    """Largest resident set of this process so far.

    Linux counts it from the start of the program; ``resource`` would add what the parent held before.
    """
    status = Path("/proc/self/status")
    if status.exists():
        return next(
            int(line.split()[1]) * 1024 / 1e6
            for line in status.read_text().splitlines()
            if line.startswith("VmHWM")
        )
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1 if sys.platform == "darwin" else 1024) / 1e6


def memory(setting: Setting, texture: bool) -> Section:
    """6. Peak memory of whole runs as the command line does them."""
    rows = []
    kinds = ["--no-texture", "--texture"] if texture else ["--no-texture"]
    for kind in kinds:
        what = f"hall, {kind}"
        with tempfile.TemporaryDirectory() as out:
            try:
                megabytes = float(in_fresh_process(MEMORY, "run", "hall", kind, "--out", out))
            except DataError as error:  # the module `resource` is not there on Windows
                rows.append(Row(what, None, "", note=str(error)))
                continue
        rows.append(Row(what, megabytes, "MB", target=400.0, best="at most"))
    return Section(
        6, "Peak memory of a full run", rows, "resident set of a fresh process, every library included"
    )


def start_up(setting: Setting) -> Section:
    """9. Import, and the first figure, in a fresh process."""
    imports = [float(in_fresh_process(IMPORT)) for _ in range(setting.effort.rounds)]
    rows = [Row.of("import pfslam, load and run_slam", imports, "s", target=0.4, best="at most")]
    try:
        figures = [float(in_fresh_process(FIGURE)) for _ in range(max(setting.effort.run_rounds, 1))]
        rows.append(Row.of("first figure, data in the cache", figures, "s", target=5.0, best="at most"))
    except DataError as error:
        rows.append(Row("first figure, data in the cache", None, "", note=str(error)))
    return Section(9, "Start-up", rows, "processor time; the figure's includes the interpreter's own start")


def fingerprint(scans: int, recording=None) -> str:
    """A hash of all bits of particles, weights, estimate and map after so many scans, refined and report."""
    recording = load("hall") if recording is None else recording
    digest = hashlib.sha256()
    for config in (SlamConfig.refined(), SlamConfig.report()):
        steps = slam_steps(recording, config, np.random.default_rng(0))
        for state, info in islice(steps, scans):
            cloud, log_odds = state.particles, state.grid.log_odds
            for values in (cloud.poses, cloud.log_weights, info.estimate, log_odds):
                digest.update(values.tobytes())
    return digest.hexdigest()


def threads(setting: Setting) -> Section:
    """10. The same bits on one thread and on two."""
    scans = setting.effort.scans
    hashes = [in_fresh_process(HASH, str(n), str(scans), threads=n) for n in (1, 2)]
    same = float(hashes[0] == hashes[1])
    row = Row("same particles, weights and map", same, "(1 = yes)", target=1.0, note=hashes[0][:16])
    return Section(10, "One thread and two", [row], f"hall, refined and report, {scans} scans each")
