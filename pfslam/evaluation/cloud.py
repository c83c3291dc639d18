"""Consistency of cloud and covariance: whether the truth lies inside as often as their spread says.

The mean and covariance of a cloud define ellipsoids that should hold the truth half of the time, nine times out of ten,
and so on. If the truth lies outside more often, the cloud is overconfident, and a planner that relies on it takes risks
that it does not know of. The measure is the normalised estimation error squared, NEES (Bar-Shalom, Li and Kirubarajan,
"Estimation with Applications to Tracking and Navigation", 2001, 5.4).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from pfslam.errors import DataError
from pfslam.evaluation.trajectory import rms
from pfslam.particles import Particles
from pfslam.poses import Trajectory, average_pose, compose, invert, wrap_angle
from pfslam.slam import Step

CLAIMS = {0.5: 2.365974, 0.9: 6.251389, 0.99: 11.344867}
"""Probabilities whose ellipsoids are checked, each with the chi-square of 3 dimensions that it stands for."""
LEAST_SPREAD = 1e-9
"""A cloud that spreads by less (m, or rad) along some direction counts as certain there."""


@dataclass(frozen=True, eq=False)
class CloudConsistency:
    """How well the spread of a run's clouds, or of its covariances, agrees with their errors.

    ``nees (K,)`` is the normalised estimation error squared: the squared Mahalanobis distance of the truth from each
    cloud (infinite if the cloud has no spread in some direction), 3 on average if the clouds are consistent. ``inside``
    maps each probability of ``CLAIMS`` to the share of clouds whose ellipsoid holds the truth. ``claimed_m`` and
    ``actual_m`` are root mean squares of the clouds' spread and of the truth's distance from their means.
    """

    nees: np.ndarray
    inside: dict[float, float]
    claimed_m: float
    actual_m: float


def cloud_moments(particles: Particles) -> tuple[np.ndarray, np.ndarray]:
    """Return mean pose ``(3,)`` and covariance ``(3, 3)`` (m, m, rad) of a weighted cloud, headings on the circle."""
    mean = average_pose(particles.poses, particles.weights)
    away = _difference(particles.poses, mean)
    return mean, away.T @ (particles.weights[:, None] * away)


def squared_mahalanobis(error: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Compute e' P^-1 e of errors ``(..., n)`` under covariances ``(..., n, n)``; infinite where P has no spread."""
    certain = np.linalg.eigvalsh(covariance)[..., :1] < LEAST_SPREAD**2
    solved = np.linalg.solve(
        np.where(certain[..., None], np.eye(error.shape[-1]), covariance), error[..., None]
    )
    return np.where(certain[..., 0], np.inf, (error * solved[..., 0]).sum(axis=-1))


def cloud_consistency(infos: Iterable[Step], truth: Trajectory) -> CloudConsistency:
    """Compare the clouds of a run with the truth, in position and heading.

    The run is moved as a whole so that its first estimate is true, as for the trajectory error; that first cloud,
    which knows its place by definition, is not counted. Clouds count as they gave the estimate, before resampling.
    """
    known = _known(infos, truth, "particles")
    return _consistency(known, [cloud_moments(info.particles) for info in known[1:]], truth)


def covariance_consistency(infos: Iterable[Step], truth: Trajectory) -> CloudConsistency:
    """Compare the estimates of a run and their covariances with the truth, as ``cloud_consistency`` does its clouds."""
    known = _known(infos, truth, "covariance")
    return _consistency(known, [(info.estimate, info.covariance) for info in known[1:]], truth)


def _known(infos: Iterable[Step], truth: Trajectory, what: str) -> list:
    """Keep the infos of a run that hold ``what`` is compared, within the truth's time."""
    known = [info for info in infos if getattr(info, what) is not None and truth.covers(info.t)]
    if len(known) < 2:
        raise DataError("consistency", what, f"{len(known)} with known truth", "2 or more")
    return known


def _consistency(infos: list[Step], moments: list[tuple], truth: Trajectory) -> CloudConsistency:
    """Compare means and covariances of all infos but the first with the truth, moved to the first estimate."""
    first = compose(infos[0].estimate, invert(truth.at(infos[0].t)))
    true_poses = compose(first, truth.at(np.array([info.t for info in infos[1:]])))
    means, covariances = (np.array(part) for part in zip(*moments, strict=True))
    error, variance = _difference(true_poses, means), np.diagonal(covariances, axis1=1, axis2=2)
    nees = squared_mahalanobis(error, covariances)
    return CloudConsistency(
        nees=nees,
        inside={share: float(np.mean(nees <= reach)) for share, reach in CLAIMS.items()},
        claimed_m=rms(np.sqrt(variance[:, 0] + variance[:, 1])),
        actual_m=rms(np.hypot(error[:, 0], error[:, 1])),
    )


def _difference(poses: np.ndarray, reference: np.ndarray) -> np.ndarray:
    away = poses - reference
    away[..., 2] = wrap_angle(away[..., 2])
    return away
