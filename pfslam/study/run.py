"""One case from settings to figures. Everything follows from the case: no state, no clock, no order of runs."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.evaluation.cloud import cloud_consistency, covariance_consistency
from pfslam.evaluation.trajectory import aligned_at_first, map_agreement, relations_error, trajectory_error
from pfslam.io.datasets import data_folder, load
from pfslam.io.formats import read_relations
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.refined.health import in_doubt
from pfslam.refined.run import RefinedResult, judged
from pfslam.run import run_slam
from pfslam.simulator import PRESETS as BUILDINGS
from pfslam.simulator import Simulation, SimulatorConfig, simulate
from pfslam.simulator.cache import cached_simulation
from pfslam.study.definition import Case, Disturbances
from pfslam.study.disturbances import disturb

COSTS = ("cpu_seconds",)
"""Columns that say what a run cost; they differ from run to run and are never compared."""
OFF = 0.3
"""A position so far (m) from the truth is wrong enough to need a word."""


@dataclass(frozen=True, eq=False)
class Source:
    """Hold a recording with the simulation that made it, or with the file of its known relations."""

    recording: Recording
    simulation: Simulation | None = None
    relations: Path | None = None


def run_case(case: Case, run: Callable[[Case], dict[str, Any]] | None = None) -> dict[str, Any]:
    """Make one row: the case, the figures of its run, an empty ``error`` or what went wrong, and the cost.

    ``run`` is that of the study. Errors become rows so that they do not stop a study.
    """
    row: dict[str, Any] = {"label": case.label} | dict(case.settings)
    begin = time.process_time()
    try:
        row |= (run or figures)(case) | {"error": ""}
    except Exception as error:
        row["error"] = " ".join(f"{type(error).__name__}: {error}".split())[:300]
    row["cpu_seconds"] = round(time.process_time() - begin, 3)
    return {key: None if value != value else value for key, value in row.items()}


def figures(case: Case) -> dict[str, Any]:
    """Run a case and return its figures."""
    source, config = _source(*recording_key(case)), case.config()
    faults = {name: value for name, value in vars(case.parts()[Disturbances]).items() if value is not None}
    recording = disturb(source.recording, faults, case.get("seed"))
    odometry = dead_reckoning(recording)
    if case.get("method") == "dead-reckoning":
        t = config.used_scans(recording).t
        path = Trajectory(t, odometry.at(t))
        return {"scans": len(t)} | errors(path, odometry, recording, source.relations)
    rng, clouds = np.random.default_rng(case.get("seed")), bool(case.get("clouds"))
    # One look unless asked for: a study measures the filter as it was set.
    twice = bool(case.get("second_look"))
    result = judged(recording, run_slam(recording, config, rng=rng, keep_particles=clouds, second_look=twice))
    found = counts(result, config) | errors(result.trajectory, odometry, recording, source.relations)
    if clouds and recording.truth is not None:
        found |= consistency(result, recording.truth)
    if twice and recording.truth is not None:
        found |= doubts(result, recording.truth)
    return found | (agreement(result, source.simulation) if source.simulation else {})


def counts(result: RefinedResult, config: Any) -> dict[str, Any]:
    """Count the steps of a run, and take the medians of N_eff and of the mean score over matched scans."""
    row: dict[str, Any] = {name: getattr(result, name) for name in ("updates", "resamplings")}
    row["scans"] = len(result.trajectory)
    if matched := [info for info in result.infos if info.matched]:
        share = np.median([info.effective_sample_size for info in matched]) / config.particles
        row |= {"n_eff_median": float(share), "score_median": float(np.median([i.score for i in matched]))}
    return row


def errors(
    estimate: Trajectory, odometry: Trajectory, recording: Recording, relations: Path | None
) -> dict[str, float]:
    """Compare an estimate with the truth and with known relations, where there are any."""
    row: dict[str, float] = {}
    truth = recording.truth
    if truth is not None and truth.covers(estimate.t).any():
        error = asdict(trajectory_error(estimate, truth))
        row |= {name: error[name] for name in ("ate_rmse_m", "ate_max_m", "heading_rmse_deg")}
        odometry_there = Trajectory(estimate.t, odometry.at(estimate.t))
        row["odometry_ate_rmse_m"] = trajectory_error(odometry_there, truth).ate_rmse_m
        poses, true_poses = aligned_at_first(estimate, truth)
        row["end_error_m"] = float(np.hypot(*(poses[-1] - true_poses[-1])[:2]))
    if relations is not None:
        known = read_relations(relations).at_stamps(estimate.t)
        if len(known.t1):
            metres, radians = relations_error(estimate, known.t1, known.t2, known.poses)
            row |= {"relation_xy_m": float(metres.mean()), "relation_deg": float(np.rad2deg(radians.mean()))}
    return row


def consistency(result: RefinedResult, truth: Trajectory) -> dict[str, float]:
    """Say how often the ellipsoids of a run's clouds held the truth, and how wide and how wrong the clouds were."""
    cloud = cloud_consistency(result.infos, truth)
    row = {f"inside_{100 * claim:.0f}": share for claim, share in cloud.inside.items()}
    row["nees_median"] = float(np.median(cloud.nees))
    row |= {"cloud_claimed_m": cloud.claimed_m, "cloud_actual_m": cloud.actual_m}
    if result.covariances is not None:
        of_pose = covariance_consistency(result.infos, truth)
        row |= {"nees_mean": float(cloud.nees.mean()), "covariance_inside_90": of_pose.inside[0.9]}
        row["covariance_nees_mean"] = float(of_pose.nees.mean())
    return row


def doubts(result: RefinedResult, truth: Trajectory) -> dict[str, float]:
    """Compare the doubts of a run with its errors: shares of the scans that are off, that are doubted, and both."""
    poses, true_poses = aligned_at_first(result.trajectory, truth)
    t = result.trajectory.t[truth.covers(result.trajectory.t)]
    off = np.hypot(*(poses - true_poses)[:, :2].T) > OFF
    doubted = in_doubt(result.distrust, t)
    return {"off": off.mean(), "doubted": doubted.mean(), "off_and_doubted": (off & doubted).mean()}


def agreement(result: RefinedResult, simulation: Simulation) -> dict[str, float]:
    """Compare the map with the simulated building."""
    spec, world = result.grid.spec, simulation.world
    walls = world.true_grid(spec)
    found = map_agreement(result.grid, walls, world.free_area(spec) & ~walls)
    return {"map_iou_occupied": found.occupied_iou, "map_iou_free": found.free_iou}


def recording_key(case: Case) -> tuple:
    """Return what the recording of a case depends on; cases that agree in it share one recording."""
    return case.get("dataset"), case.get("data_dir"), case.drive()


@lru_cache(maxsize=2)
def _source(dataset: str, data_dir: str | None, drive: tuple[SimulatorConfig, int | None] | None) -> Source:
    """Load or simulate a recording; each process keeps the last two."""
    if dataset not in BUILDINGS:
        name, folder = _found(dataset, data_dir)
        relations = Path(name).with_suffix(".relations")
        return Source(load(name, folder), relations=relations if relations.is_file() else None)
    simulation = simulate(*drive) if drive else cached_simulation(dataset)
    return Source(replace(simulation.recording, camera=None), simulation)


def _found(dataset: str, data_dir: str | None) -> tuple[str, str | None]:
    """Find a folder, or the path of a log, as it is written or else within the data folder."""
    inside = data_folder() / (data_dir or "")
    if data_dir is not None and not Path(data_dir).is_dir() and inside.is_dir():
        data_dir = str(inside)
    log = data_folder(data_dir) / dataset
    return str(log) if log.is_file() and not Path(dataset).is_file() else dataset, data_dir
