"""Chapter 08: cures that are measured, and faults that need no picture."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from pfslam.evaluation.trajectory import trajectory_error
from pfslam.particles import Particles, resample, reweight
from pfslam.recording import Recording
from pfslam.run import run_slam
from pfslam.slam import SlamConfig
from pfslam_book.ch08.data import BENDS, LAB, corrections, turn_ratio
from pfslam_book.ch08.data_exhibits import DELAY, MIRRORED_X
from pfslam_book.show.faults import (
    clockwise,
    heading_from_wheels,
    late_scans,
    lidar_at,
    scaled_gyro,
    scans_between,
)
from pfslam_book.show.tables import Shown


@dataclass(frozen=True)
class Cure:
    """Error (m) of the estimate against the truth: healthy, with the fault, and with what was found put right."""

    healthy: float
    broken: float
    cured: float


def cures(recording: Recording) -> dict[str, Cure]:
    """Return clock and lever arm, cured by the numbers that the corrections gave away."""
    part = scans_between(recording, *BENDS)
    healthy = corrections(part).ate
    late, moved = late_scans(part, DELAY), lidar_at(part, MIRRORED_X, 0.0)
    late_found, moved_found = corrections(late), corrections(moved)
    x, y = MIRRORED_X + moved_found.lever[0], moved_found.lever[1]
    return {
        "clock": Cure(healthy, late_found.ate, corrections(late_scans(late, -late_found.delay)).ate),
        "lever arm": Cure(healthy, moved_found.ate, corrections(lidar_at(moved, float(x), float(y))).ate),
    }


def cures_table(found: dict[str, Cure]) -> Shown:
    """Return one row per fault, in centimetres."""
    rows = ((name, *(f"{100 * e:.1f}" for e in (c.healthy, c.broken, c.cured))) for name, c in found.items())
    return Shown(("error [cm]", "healthy", "broken", "cured"), rows)


@dataclass(frozen=True)
class World:
    """Median score per beam of a run, its error (m), and how far the wheels turn for each radian of the gyro."""

    score: float
    error: float
    wheels_per_gyro: float


def mirrored_worlds(recording: Recording) -> dict[str, World]:
    """Return the healthy recording, the scan read in the wrong sense, and the gyro turned round as well."""
    flipped = clockwise(recording)
    worlds = {"healthy": recording, "scan flipped": flipped, "both flipped": scaled_gyro(flipped, -1.0)}
    return {name: _world(world) for name, world in worlds.items()}


def _world(recording: Recording) -> World:
    config = replace(SlamConfig.refined(), particles=20, every=20, tilt=False)
    part = scans_between(recording, *BENDS)
    result = run_slam(part, config, rng=np.random.default_rng(0), keep_particles=False, second_look=False)
    score = float(np.median([info.score for info in result.infos if info.matched]))
    error = trajectory_error(result.trajectory, part.true_path()).ate_rmse_m
    return World(score, error, turn_ratio(heading_from_wheels(recording), recording, *LAB))


def mirrored_table(worlds: dict[str, World]) -> Shown:
    """Return one row for each world."""
    rows = (
        (name, f"{w.score:.2f}", f"{w.error:.2f}", f"{w.wheels_per_gyro:+.2f}") for name, w in worlds.items()
    )
    return Shown(("world", "mean score", "error [m]", "turn by wheels / by gyro"), rows)


def standing_cloud(scans: int, n: int = 200, sigma: float = 0.05, off: float = 0.03) -> Particles:
    """Return a cloud of 0.1 m around the truth, 0, after the *same* scan has been used ``scans`` times at rest.

    The scan's noise makes ``off`` its best place, and ``sigma`` is how well one scan knows a place (m).
    """
    rng = np.random.default_rng(0)
    x = 0.1 * rng.standard_normal(n)
    cloud = Particles(np.column_stack([x, np.zeros((n, 2))]), np.zeros(n))
    for _ in range(scans):
        cloud, _ = reweight(cloud, -0.5 * ((cloud.poses[:, 0] - off) / sigma) ** 2)
        cloud = resample(cloud, rng)
    return cloud


def standing_table(scans: Iterable[int]) -> Shown:
    """Return the mean and spread (cm) of the standing cloud after each number of scans."""
    clouds = {n: 100 * standing_cloud(n).poses[:, 0] for n in scans}
    rows = ((str(n), f"{x.mean():.1f}", f"{x.std():.1f}") for n, x in clouds.items())
    return Shown(("scans used", "mean [cm]", "spread [cm]"), rows)
