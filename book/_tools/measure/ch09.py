"""Chapter 09: what scoring on a lattice costs the report's filter, and where private maps win."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
from pfslam_book.ch09.tables import PARTED
from pfslam_book.ch10.building import SCANS_PER_SECOND, driven, world_of
from pfslam_book.show.faults import with_fault

from measure import cases
from pfslam.beyond.loops.closing import close_loops
from pfslam.correlation import Match, best_perturbations
from pfslam.evaluation.trajectory import aligned_at_first, rms, trajectory_error
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.io.datasets import load
from pfslam.particles import Particles
from pfslam.poses import Trajectory, transform_points
from pfslam.recording import Recording
from pfslam.run import run_slam, slam_steps
from pfslam.search.lattice import Lattice
from pfslam.sensors import scan_points
from pfslam.simulator import simulate
from pfslam.simulator.config import RING
from pfslam.slam import SlamConfig
from pfslam.study import Case, Study
from pfslam.study.disturbances import first_seconds

LAP = [(2.0, -0.2), (35.0, -0.3), (68.0, -0.2), (68.4, 0.2), (35.0, 0.3), (1.6, 0.2)]
"""The way along a corridor of 70 m and back."""


def exactly(grid, points_b, particles, config, rng) -> Match:
    """Every particle scored at its own pose: the map and the scan are shifted so that it comes to lie on a node."""
    lattice, poses, counts = Lattice(grid.spec.resolution, config.yaw_step), [], []
    for pose in particles.poses:
        node = lattice.pose(lattice.nearest(pose[None])[0])
        off = pose - node
        c, s = np.cos(off[2]), np.sin(off[2])
        moved = GridSpec(tuple(np.asarray(grid.spec.origin) - off[:2]), grid.spec.resolution, grid.spec.shape)
        turned = points_b @ np.array([[c, -s], [s, c]]).T
        one = best_perturbations(
            OccupancyGrid(moved, grid.log_odds), turned, Particles.at(node, 1), config, rng
        )
        poses.append(one.particles.poses[0] + off)
        counts.append(one.counts[0])
    return Match(Particles(np.array(poses), particles.log_weights), np.array(counts), len(points_b))


def scored(case: Case) -> dict[str, Any]:
    """Run the report's filter with 20 particles on the first 45 s of hall, every fifth scan."""
    recording = first_seconds(load("hall"), 45.0)
    config = replace(SlamConfig.report(), particles=20, every=5)
    rng, faults = np.random.default_rng(case.get("seed")), {"slam.best_perturbations": exactly}
    faults = faults if case.label == "exact" else {}
    path = with_fault(faults, partial(run_slam, recording, config, rng=rng)).trajectory
    return {"ate_rmse_m": trajectory_error(path, recording.true_path()).ate_rmse_m}


def on_floors(recording: Recording, percent: float) -> Recording:
    """The same drive on three floors: the wheels count so much too much, then too little, then half of it too much."""
    encoders, share = recording.encoders, percent / 100.0
    third = 3 * np.arange(len(encoders.t)) // len(encoders.t)
    factor = np.array([1.0 + share, 1.0 - share, 1.0 + share / 2])[third]
    rolled = np.rint(np.cumsum(encoders.counts * factor[:, None], axis=0))
    counts = np.diff(rolled, axis=0, prepend=0.0).astype(encoders.counts.dtype)
    return replace(recording, encoders=replace(encoders, counts=counts))


def doors_at(seed: int) -> np.ndarray:
    """Where along a corridor its doors begin (m), ``(3,)``: two near its start, one near its far end."""
    rng = np.random.default_rng(seed)
    return np.array([*rng.uniform(2.0, 9.0, 2), rng.uniform(58.0, 66.0)])


@lru_cache(maxsize=1)
def drive(place: str, percent: float, seed: int) -> Recording:
    """Once round a ring of corridors, or along a corridor of 70 m and back, on three floors."""
    if place == "ring":
        slip = replace(RING.slip, true_metres_per_count=RING.slip.true_metres_per_count * 1.02)
        ring = replace(simulate(replace(RING, slip=slip), seed).recording, camera=None)
        return on_floors(ring, percent)
    doors = [(x, -1.15, x + 0.9, 1.15) for x in doors_at(seed)]
    world = world_of(np.array([(0.0, -1.0, 70.0, 1.0), *doors]), np.array(LAP))
    return on_floors(driven(world, seed), percent)


def histories(recording: Recording, config: Any, seed: int) -> dict[str, np.ndarray]:
    """Run private maps and keep, for K scans, all N hypotheses.

    ``hypotheses (K, N, 3)`` and ``log_weights (K, N)`` are those before resampling, ``parents (K, N)`` says from which
    of them each of those after it comes, and ``told (K, 3)`` is the estimate.
    """
    scans = []
    for belief, step in slam_steps(recording, config, np.random.default_rng(seed)):
        before, after = step.particles.poses, belief.particles.poses
        same = (after[:, None] == before).all(axis=2)
        parents = same.argmax(axis=1) if step.resampled else np.arange(len(before))
        scans.append((step.t, step.estimate, before, step.particles.log_weights, parents, step.resampled))
    names = ("t", "told", "hypotheses", "log_weights", "parents", "resampled")
    return dict(zip(names, map(np.array, zip(*scans, strict=True)), strict=True))


def as_driven_and_as_told(recording: Recording, config: Any, seed: int) -> tuple[Trajectory, Trajectory]:
    """The path as it was told scan by scan, and the path of the particle that is heaviest at the end."""
    run = histories(recording, config, seed)
    heaviest = int(np.argmax(run["log_weights"][-1]))
    path = [run["hypotheses"][-1][heaviest]]
    for parent, cloud in zip(run["parents"][-2::-1], run["hypotheses"][-2::-1], strict=True):
        heaviest = parent[heaviest]
        path.append(cloud[heaviest])
    return Trajectory(run["t"], run["told"]), Trajectory(run["t"], np.array(path[::-1]))


def compared(method: str, n: int, every: int) -> Any:
    """Make the settings of a method with so many particles."""
    presets = {"shared": SlamConfig.refined, "private": SlamConfig.per_particle}
    preset = presets.get(method, SlamConfig.matching)
    return replace(preset(), particles=n, every=every, draw_metres=0.2, draw_radians=0.1)


def at_the_return(case: Case) -> dict[str, Any]:
    """Measure a path as told, and where it ends, back at the start; ``path_rmse_m`` is that of the path known then.

    That path is the heaviest history of private maps, and the revised one of a graph.
    """
    place, method, n = case.get("place"), case.get("method"), case.get("particles")
    recording = drive(place, case.get("percent"), case.get("building"))
    every = 80 if place == "ring" else 2 * SCANS_PER_SECOND
    config = compared(method, n, every)
    if method == "private":
        told, known = as_driven_and_as_told(recording, config, 0)
    else:
        result = run_slam(recording, config, rng=np.random.default_rng(0), keep_particles=False)
        told = known = result.trajectory
        if method == "graph":
            told = known = close_loops(recording, result).trajectory
    pairs = (aligned_at_first(path, recording.true_path()) for path in (told, known))
    off, off_known = (np.hypot(*(path - true)[:, :2].T) for path, true in pairs)
    return {"ate_rmse_m": rms(off), "return_m": float(off[-1]), "path_rmse_m": rms(off_known)}


COMPARED = {
    "scan matching": ("matching", 1),
    "scan matching, loops closed": ("graph", 1),
    "shared map, 30": ("shared", 30),
    "own maps, 10": ("private", 10),
    "own maps, 30": ("private", 30),
}


def drives_by(place: str, percent: float, methods: int) -> tuple[Case, ...]:
    """Six buildings by the first so many methods, building by building."""
    return tuple(
        Case(
            label,
            (
                ("place", place),
                ("percent", percent),
                ("building", building),
                ("method", method),
                ("particles", n),
            ),
        )
        for building in range(1, 7)
        for label, (method, n) in list(COMPARED.items())[:methods]
    )


def private_maps() -> tuple[Case, ...]:
    """Every drive; on floors that are 6 % off without the larger numbers of maps."""
    drives = itertools.product((3.0, 6.0), ("corridor", "ring"))
    return sum((drives_by(place, percent, 5 if percent == 3.0 else 4) for percent, place in drives), ())


STUDIES = [
    Study(
        "ch09_lattice",
        "The report's filter, scored at the nearest nodes of a lattice and exactly at its particles.",
        cases("scoring", scoring=["lattice", "exact"], seed=range(12)),
        run=scored,
    ),
    Study(
        "ch09_private",
        "Long corridors and rings on floors where wheels count 3 or 6 % too much or too little: whose map closes them.",
        private_maps(),
        run=at_the_return,
    ),
]


def parted(building: int = 2) -> dict[str, np.ndarray]:
    """Both filters in one corridor at 6 %: every hypothesis, the shared map's path, the truth, and the scans.

    Doors are given by their way from the start (m). ``points`` are the end points on the first 9 m of the corridor,
    in the robot's axes, one scan after another, and ``counts (K,)`` says how many each scan has.
    """
    recording, every = drive("corridor", 6.0, building), 2 * SCANS_PER_SECOND
    run = histories(recording, compared("private", 10, every), 0)
    shared = run_slam(
        recording, compared("shared", 30, every), rng=np.random.default_rng(0), keep_particles=False
    )
    truth = recording.true_path().at(run["t"])
    used = recording.lidar.ranges[np.searchsorted(recording.lidar.t, run["t"])]
    scans = [scan_points(ranges, recording.robot.lidar) for ranges in used]
    scans = [some[transform_points(pose, some)[:, 0] < 9.0] for pose, some in zip(truth, scans, strict=True)]
    found = {
        "doors": doors_at(building) - LAP[0][0],
        "resampled": run["resampled"],
        "t": run["t"] - run["t"][0],
        "parents": run["parents"].astype(np.int8),
        "points": np.concatenate(scans).astype(np.float16),
        "counts": np.array([len(points) for points in scans], dtype=np.int16),
    }
    paths = {"truth": truth, "shared": shared.trajectory.poses}
    paths |= {name: run[name] for name in ("hypotheses", "log_weights", "told")}
    return found | {name: values.astype(np.float32) for name, values in paths.items()}


if __name__ == "__main__":
    np.savez_compressed(PARTED, **parted())
