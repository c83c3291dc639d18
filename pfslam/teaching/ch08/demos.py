"""Chapter 08: cures that are measured, and faults that need no picture."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pfslam.config import SlamConfig
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.particles import Particles, resample, reweight
from pfslam.recording import Recording
from pfslam.runs import run_slam
from pfslam.teaching.ch08.data import BENDS, corrections, cut
from pfslam.teaching.ch08.data_exhibits import DELAY, MIRRORED_X
from pfslam.teaching.show.faults import clockwise, gyro_flipped, late_scans, lidar_at


@dataclass(frozen=True)
class Cure:
    """Error (m) of the estimate against the truth: healthy, with the fault, and with what was found put right."""

    healthy: float
    broken: float
    cured: float


def cures(recording: Recording) -> dict[str, Cure]:
    """Clock and lever arm, cured by the numbers that the corrections gave away."""
    lab = cut(recording, *BENDS)
    healthy = corrections(lab).ate
    late, moved = late_scans(lab, DELAY), lidar_at(lab, MIRRORED_X, 0.0)
    late_found, moved_found = corrections(late), corrections(moved)
    x, y = MIRRORED_X + moved_found.lever[0], moved_found.lever[1]
    return {
        "clock": Cure(healthy, late_found.ate, corrections(late_scans(late, -late_found.delay)).ate),
        "lever arm": Cure(healthy, moved_found.ate, corrections(lidar_at(moved, float(x), float(y))).ate),
    }


def cure_table(table: dict[str, Cure]) -> str:
    """One line per fault, in centimetres."""
    lines = [f"{'error [cm]':12s} healthy  broken   cured"]
    for name, c in table.items():
        lines.append(f"{name:12s} {100 * c.healthy:7.1f} {100 * c.broken:7.1f} {100 * c.cured:7.1f}")
    return "\n".join(lines)


def mirrored_worlds(recording: Recording) -> dict[str, tuple[float, float]]:
    """(median score per beam, error in m) with the scan turned round, with the gyro turned round too, and healthy."""
    lab = cut(recording, *BENDS)
    worlds = {"healthy": lab, "scan flipped": clockwise(lab), "both flipped": gyro_flipped(clockwise(lab))}
    config = replace(SlamConfig.refined(), particles=20, every=20, tilt=None)
    return {name: _score_and_error(world, config) for name, world in worlds.items()}


def _score_and_error(recording: Recording, config: SlamConfig) -> tuple[float, float]:
    result = run_slam(recording, config, rng=np.random.default_rng(0), keep_particles=False)
    error = trajectory_error(result.trajectory, recording.true_path()).ate_rmse_m
    return float(np.median([info.score for info in result.infos if info.matched])), error


def standing_cloud(scans: int, n: int = 200, sigma: float = 0.05, off: float = 0.03) -> Particles:
    """A cloud of 0.1 m around the truth, 0, after the *same* scan has been used ``scans`` times at rest.

    The scan's noise makes ``off`` its best place, and ``sigma`` is how well one scan knows a place (m).
    """
    rng = np.random.default_rng(0)
    x = 0.1 * rng.standard_normal(n)
    cloud = Particles(np.column_stack([x, np.zeros((n, 2))]), np.zeros(n))
    for _ in range(scans):
        cloud, _ = reweight(cloud, -0.5 * ((cloud.poses[:, 0] - off) / sigma) ** 2)
        cloud = resample(cloud, rng)
    return cloud
