"""Public CARMEN logs, each run as the command line would run it, and judged by the path that was published with it.

The logs themselves are never stored. They are looked for in ``logs`` in ``$PFSLAM_DATA``, under the names that they
have in public. ``python -m measure.logs``, in ``book/_tools``, keeps the maps and paths of the page.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from pfslam_book.show.logs import BELIEVED, DOUBTING, FIRST, KEPT, LOOPS, MATCHING, ONE_LOOK, SPARSE, TRIALS

import pfslam
from measure import cases
from measure.robots import laid_on
from pfslam.beyond.loops.closing import close_loops
from pfslam.cli.commands import MOSTLY
from pfslam.cli.parser import DOUBTED, SPOILED
from pfslam.evaluation.checkup import check_up
from pfslam.evaluation.trajectory import rms
from pfslam.grid import OccupancyGrid
from pfslam.io.carmen import read_log
from pfslam.io.datasets import data_folder
from pfslam.io.files import atomic_write
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory, between, wrap_angle
from pfslam.recording import LidarScans, Recording
from pfslam.refined.health import in_doubt
from pfslam.refined.noise import MotionNoise
from pfslam.refined.run import RefinedResult
from pfslam.run import run_slam
from pfslam.slam import SlamConfig
from pfslam.study import Case, Study

LOGS = {
    "Freiburg 079": "freiburg-079-corrected.log",
    "Freiburg 101": "freiburg-101-corrected.log",
    "Seattle": "seattle-corrected.log",
    "FHW museum": "fhw-corrected.log",
    "ACES": "aces-corrected.log",
    "Edmonton": "edmonton-corrected.log",
    "Acapulco": "acapulco-corrected.log",
    "MIT CSAIL": "mit-csail.clf",
    "Belgioioso": "belgioioso-corrected.log",
    "Infinite Corridor": "infinite-corridor-corrected.log",
    "Freiburg campus": "freiburg-campus-corrected.log",
    "Örebro": "orebro-corrected.log",
}
"""The buildings, and the file of each."""
CORRECTED = {"MIT CSAIL": "csail-corrected.log"}
"""Where the log has the odometry of the wheels: the file that has some of its scans with the published poses."""
EXAMINED = ("FHW museum", "ACES", "Edmonton", "Acapulco", "MIT CSAIL")
"""Where something is amiss, so that one thing after another is changed."""
METHODS = {
    FIRST: SlamConfig.refined(),
    **dict.fromkeys((MATCHING, SPARSE, ONE_LOOK, LOOPS), SlamConfig.matching()),
    BELIEVED: replace(SlamConfig.matching(), noise=MotionNoise(0.01, 0.01, 0.002, 0.01, 0.002, False)),
    DOUBTING: replace(SlamConfig.matching(), noise=MotionNoise(0.05, 0.2, 0.02, 0.2, 0.06, False)),
}
"""What the command does by default and with ``--method matching``; the others change one thing of the latter."""
METRE = 1.0
"""Way (m), and turn (rad), from scan to scan of most of these logs."""
SHARED = "scans with the stamp of another"
MARGIN, MOST_CELLS, MOST_POSES = 8.0, 240, 250
"""How far (m) about its path a map is stored, with how many cells along it, and poses along the path."""


@lru_cache(maxsize=1)
def log_of(building: str) -> tuple[Recording, Trajectory]:
    """The log of a building, and its published path."""
    folder = data_folder() / "logs"
    log = pfslam.load(folder / LOGS[building])
    if building not in CORRECTED:
        return log, dead_reckoning(log)
    poses = {scan.ranges.tobytes(): scan.poses[3:] for scan in read_log(folder / CORRECTED[building]).scans}
    keys = [ranges.tobytes() for ranges in log.scans().ranges]
    there = [k for k, key in enumerate(keys) if key in poses]
    return log, Trajectory(log.scans().t[there], np.array([poses[keys[k]] for k in there]))


def by_the_metre(log: Recording) -> Recording:
    """Keep a scan only where the robot has moved by a metre since the last one that was kept."""
    poses, keep = dead_reckoning(log).at(log.scans().t), [0]
    for k, pose in enumerate(poses):
        if np.linalg.norm(between(poses[keep[-1]], pose)) >= METRE:
            keep.append(k)
    lidar = LidarScans(log.scans().t[keep], log.scans().ranges[keep])
    return replace(log, lidar=lidar, odometry=Trajectory(lidar.t, poses[keep]))


@lru_cache(maxsize=1)
def run(building: str, method: str) -> RefinedResult:
    """Run a log as the command does, but for one thing."""
    log, rng = log_of(building)[0], np.random.default_rng(0)
    log, twice = by_the_metre(log) if method == SPARSE else log, method != ONE_LOOK
    result = run_slam(log, METHODS[method], rng=rng, keep_particles=False, second_look=twice)
    return replace(result, trajectory=close_loops(log, result).trajectory) if method == LOOPS else result


def off(published: Trajectory, path: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Return how far a path is from the published one (m, rad), laid on it, at the scans that both have."""
    both = np.isin(published.t, path.t)
    poses, others = laid_on(Trajectory(published.t[both], published.poses[both]), path)
    return np.hypot(*(poses - others)[:, :2].T), np.abs(wrap_angle(poses[:, 2] - others[:, 2]))


def judged(case: Case) -> dict[str, Any]:
    """Run one log; tell how far the path is from the published one (m, deg), and what the run said."""
    log, published = log_of(case.label)
    findings, scans = check_up(log), log.scans()
    told: dict[str, Any] = {
        "seconds": float(np.ptp(scans.t)),
        "beams": scans.ranges.shape[1],
        "scans": len(scans.t) + log.dropped.get(SHARED, 0),
        "kept": len(scans.t),
        "failed": sum(finding.ok is False for finding in findings),
        "scatter_m": log.range_scatter(),
        "complaints": "; ".join(f"{f.question} {f.found}" for f in findings if f.ok is False),
    }
    if any(finding.severity == "stop" for finding in findings):
        return told | {"exit": SPOILED}
    result = run(case.label, case.get("method"))
    metres, radians = off(published, result.trajectory)
    doubted = in_doubt(result.distrust, result.trajectory.t).mean()
    return told | {
        "metres": np.hypot(*np.diff(published.poses[:, :2], axis=0).T).sum(),
        "odometry_m": off(published, dead_reckoning(log))[0].mean(),
        "mean_m": metres.mean(),
        "max_m": metres.max(),
        "heading_deg": np.rad2deg(rms(radians)),
        "second_look": int(result.second_look),
        "doubted": doubted,
        "to_the_end": int(any(stretch["to"] is None for stretch in result.distrust)),
        "reasons": "; ".join(str(stretch["reason"]) for stretch in result.distrust),
        "exit": DOUBTED if doubted > MOSTLY else 0,
    }


STUDIES = [
    Study(
        "logs",
        "Public logs of twelve buildings, run as the command runs them: how far off, and what was said.",
        cases("log", log=LOGS, method=[FIRST, MATCHING])
        + cases("log", log=["Freiburg 079"], method=[SPARSE])
        + cases("log", log=EXAMINED, method=TRIALS),
        run=judged,
    )
]


def coarse(grid: OccupancyGrid, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the signs of a map about a path ``(K, 2)`` in larger cells, and their corner (x, y, size).

    A wall outweighs free floor. Beams that left through a window end at the margin.
    """
    known, driven = np.argwhere(grid.log_odds != 0), grid.spec.world_to_cell(path)[:, ::-1]
    margin = round(MARGIN / grid.spec.resolution)
    low = np.maximum(known.min(axis=0), driven.min(axis=0) - margin)
    high = np.minimum(known.max(axis=0), driven.max(axis=0) + margin) + 1
    size = -(-int((high - low).max()) // MOST_CELLS)
    signs = np.sign(grid.log_odds[low[0] : high[0], low[1] : high[1]]).astype(np.int8)
    signs = np.pad(signs, [(0, -length % size) for length in signs.shape])
    blocks = signs.reshape(signs.shape[0] // size, size, -1, size)
    wall, free = (blocks == 1).any(axis=(1, 3)), (blocks == -1).any(axis=(1, 3))
    corner = np.array(grid.spec.origin) + grid.spec.resolution * low[::-1]
    return np.where(wall, 1, -free.astype(int)).astype(np.int8), np.array(
        [*corner, grid.spec.resolution * size]
    )


def kept(result: RefinedResult, published: Trajectory) -> dict[str, np.ndarray]:
    """Return what is stored of a run: its map, and places (cm) along its path and along the published one."""
    signs, corner = coarse(result.grid, result.trajectory.poses[:, :2])
    paths = [poses[:: len(poses) // MOST_POSES + 1, :2] for poses in laid_on(published, result.trajectory)]
    places = [(100 * (path - corner[:2])).round().astype(np.int16) for path in paths]
    return {"map": signs, "corner": corner, "published": places[0], "path": places[1]}


if __name__ == "__main__":
    stored = {}
    for building in LOGS:
        if not any(finding.severity == "stop" for finding in check_up(log_of(building)[0])):
            arrays = kept(run(building, FIRST), log_of(building)[1])
            stored |= {f"{building}, {name}": values for name, values in arrays.items()}
    with atomic_write(KEPT) as file:
        np.savez_compressed(file, **stored)
