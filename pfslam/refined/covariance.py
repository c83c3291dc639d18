"""How well the estimate is known: a covariance for every pose.

A pose is known as well as the walls it was measured against, plus the measurement itself. The particle cloud knows the
second part only: it starts again from the map at every scan, as if the map were exact. So every scan that is drawn
keeps its covariance, every cell remembers which scan hit it first, and a new scan inherits the errors of those
scans whose walls it lies on. Where new ground is drawn these errors add up, link by link; back at an old place the
scans rest on the first walls again, and the covariance shrinks.

The measurement's own covariance follows from the residuals of the alignment by the sandwich formula H^-1 B H^-1
(Huber, "The behavior of maximum likelihood estimates under nonstandard conditions", 1967) with the beams in clusters
(Liang and Zeger, "Longitudinal data analysis using generalized linear models", 1986): no noise of the LiDAR is assumed.
What is not seen in the residuals is not in the covariance: people, glass, and a scan that fits the wrong place.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pfslam.refined.lines import HitMoments, LineFit

CLUSTER = 10
"""Beams side by side whose residuals may depend on one another."""
REPEATED = 60.0
"""How much more the errors weigh that neighbouring beams share than those that each beam has by itself.

Noise differs from beam to beam and from scan to scan and averages out in the map. A wall that is not as straight as its
line misses neighbouring beams by the same amount, and does so again in the scans that follow. Chosen on simulated
halls and ramps, where the 90 % ellipsoid then holds the truth at somewhat more than nine scans of ten.
"""
LEAST_SIGMA = 1e-3
"""Standard deviation (m) that a beam has at least: ranges are written to the millimetre."""


def transported(covariance: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Move a pose covariance ``(3, 3)`` to a place ``offset (2,)`` (m, world axes) away, as on one rigid body.

    An error of the heading moves what lies (dx, dy) away by (-dy, dx) times that error: A P A' with the Jacobian A.
    """
    A = np.array([[1.0, 0.0, -offset[1]], [0.0, 1.0, offset[0]], [0.0, 0.0, 1.0]])
    return A @ covariance @ A.T


def predicted_covariance(
    covariance: np.ndarray, before: np.ndarray, after: np.ndarray, variance: np.ndarray
) -> np.ndarray:
    """Move a covariance ``(3, 3)`` from one pose to the next and add the motion's variance ``(2,)`` (m^2, rad^2)."""
    return transported(covariance, after[:2] - before[:2]) + np.diag(variance[[0, 0, 1]])


def aligned_covariance(
    drawn: Sequence[np.ndarray], moments: HitMoments, pose: np.ndarray, fit: LineFit, variance: np.ndarray
) -> np.ndarray:
    """Return the covariance ``(3, 3)`` of a pose aligned to the map's lines: that of the walls plus the measurement's.

    ``drawn`` holds the covariance ``(3, 3)`` of every scan in the map, moved to the world's origin: there it stands for
    the error of all that the scan has drawn, and can be averaged. The motion's ``variance (2,)`` (m^2, rad^2) is the
    prior of the measurement.
    """
    prior = np.diag(1.0 / np.maximum(variance[[0, 0, 1]], 1e-12))
    found = wall_covariance(drawn, moments, pose, fit) + np.linalg.inv(line_information(fit) + prior)
    return 0.5 * (found + found.T)


def wall_covariance(
    drawn: Sequence[np.ndarray], moments: HitMoments, pose: np.ndarray, fit: LineFit
) -> np.ndarray:
    """Return the mean covariance ``(3, 3)`` of the scans that first hit the walls, moved to the aligned pose.

    A mean, as if all their errors were the same: scans drawn one after another do share most of them.
    """
    first = moments.first_scan(fit.points_w)
    scans, which = np.unique(first[first >= 0], return_inverse=True)
    if len(scans) == 0:
        return np.zeros((3, 3))
    total = np.bincount(which, fit.weight[first >= 0])
    seen = total > 0.0
    share = total[seen] / np.sum(total[seen])
    errors = np.array([drawn[k] for k in scans[seen]])
    return transported((share @ errors.reshape(-1, 9)).reshape(3, 3), pose[:2])


def with_silent_direction(found: np.ndarray, silent: np.ndarray, predicted: np.ndarray) -> np.ndarray:
    """Replace the variance along a direction ``(2,)`` that no line constrains by odometry's, ``predicted (3, 3)``.

    That is where the pose itself comes from, in the length of a bare corridor.
    """
    along = np.zeros((3, 3))
    along[:2, :2] = np.outer(silent, silent)
    across = np.eye(3) - along
    return across @ found @ across + along @ predicted @ along


def line_information(fit: LineFit) -> np.ndarray:
    """Return what a scan's beams on lines say about the pose, as an information matrix ``(3, 3)``: H B^-1 H.

    H is the normal matrix of the weighted least squares, B the sum of squares of the clusters' gradients.
    """
    H = fit.jacobian.T @ (fit.weight[:, None] * fit.jacobian)
    gradient = np.add.reduceat(
        fit.jacobian * (fit.weight * fit.residual)[:, None], np.arange(0, len(fit.weight), CLUSTER)
    )
    B = (1.0 + REPEATED * shared_error(fit)) * (gradient.T @ gradient) + LEAST_SIGMA**2 * H
    return H @ np.linalg.solve(B + 1e-12 * np.eye(3), H)


def shared_error(fit: LineFit) -> float:
    """Return the share, from 0 to 1, of a beam's error that its neighbour has too: the residuals' autocorrelation."""
    error = fit.residual * np.sqrt(fit.weight)
    total = float(error @ error)
    return max(float(error[1:] @ error[:-1]) / total, 0.0) if total > 0.0 else 0.0
