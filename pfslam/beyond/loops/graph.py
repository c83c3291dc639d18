"""The pose graph: poses joined by measured motions as by springs, relaxed by Gauss-Newton.

Lu and Milios ("Globally consistent range scan alignment", 1997) posed the problem; this form, with sparse normal
equations, is that of Grisetti et al. ("A tutorial on graph-based SLAM", 2010). Beside the poses x_k the wheels' scale
is unknown: s_k says by which share the way is longer where only the wheels measured it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from scipy.sparse import block_diag, coo_array, csr_array, diags_array
from scipy.sparse.linalg import spsolve

from pfslam.poses import between, wrap_angle

SCALE_SIGMA, WALK_SIGMA = 0.05, 0.002
"""How wrong the wheels' scale is at first, and how far it changes from one key scan to the next (another floor)."""
KERNELS, ITERATIONS = (np.inf, 100.0, 30.0, 10.0, 3.0), 5
"""Widths of the robust kernel (standard deviations), one after the other, and Gauss-Newton steps with each."""


@dataclass(frozen=True, eq=False)
class Edges:
    """Measured motions: ``pose (E, 3)`` of key scan ``j`` seen from ``i``, with ``information (E, 3, 3)``.

    ``wheels (E,)`` from 0 to 1 is the share of the way that only the wheels measured; ``doubtful (E,)`` bool marks
    matches, which may be false and get the robust kernel.
    """

    i: np.ndarray
    j: np.ndarray
    pose: np.ndarray
    information: np.ndarray
    wheels: np.ndarray
    doubtful: np.ndarray

    def __len__(self) -> int:
        return len(self.i)

    def joined(self, *others: Edges) -> Edges:
        """Return all edges in one."""
        return Edges(*(np.concatenate([getattr(e, f.name) for e in (self, *others)]) for f in fields(Edges)))

    def chosen(self, which: np.ndarray) -> Edges:
        """Return the edges of a mask ``(E,)``."""
        return Edges(*(getattr(self, field.name)[which] for field in fields(Edges)))


def residuals(edges: Edges, poses: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return the error ``(E, 3)`` of each edge, what the poses say less what was measured, in the frame of pose i.

    e = (R(theta_i)^T (p_j - p_i) - (1 + w s_i) z_xy,  theta_j - theta_i - z_theta), the heading wrapped.
    """
    error = between(poses[edges.i], poses[edges.j]) - edges.pose
    error[:, :2] -= (edges.wheels * scale[edges.i])[:, None] * edges.pose[:, :2]
    error[:, 2] = wrap_angle(error[:, 2])
    return error


def chi_square(edges: Edges, poses: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return the squared errors ``(E,)`` in units of their standard deviations, e^T Omega e."""
    error = residuals(edges, poses, scale)
    return np.einsum("ei,eij,ej->e", error, edges.information, error)


def jacobians(edges: Edges, poses: np.ndarray) -> np.ndarray:
    """Return the derivatives ``(E, 3, 7)`` of the errors for x, y, theta of pose i, of pose j, and for s_i."""
    J, (x, y, _) = np.zeros((len(edges), 3, 7)), between(poses[edges.i], poses[edges.j]).T
    c, s = np.cos(poses[edges.i, 2]), np.sin(poses[edges.i, 2])
    J[:, 0, 3], J[:, 0, 4], J[:, 1, 3], J[:, 1, 4] = c, s, -s, c
    J[:, :2, :2] = -J[:, :2, 3:5]
    J[:, 0, 2], J[:, 1, 2], J[:, 2, 2], J[:, 2, 5] = y, -x, -1.0, 1.0
    J[:, :2, 6] = -edges.wheels[:, None] * edges.pose[:, :2]
    return J


def robust_weights(chi2: np.ndarray, width: float) -> np.ndarray:
    """Return the weight of a squared error under Geman and McClure's kernel: (k^2 / (k^2 + chi^2))^2.

    >>> robust_weights(np.array([0.0, 9.0, 9900.0]), width=3.0).round(3).tolist()
    [1.0, 0.25, 0.0]
    """
    return np.ones_like(chi2) if np.isinf(width) else (width**2 / (width**2 + chi2)) ** 2


def gauss_newton_step(edges: Edges, poses: np.ndarray, scale: np.ndarray, weights: np.ndarray):
    """Solve H d = -b once, and return the revised poses ``(K, 3)`` and scales ``(K,)``.

    H = sum w J^T Omega J and b = sum w J^T Omega e; an edge fills only the rows and columns of its own unknowns. Pose 0
    is held fast: all motions are relative, so the whole graph could move without any error.
    """
    K, xyz = len(poses), np.arange(3)
    own = np.hstack([3 * edges.i[:, None] + xyz, 3 * edges.j[:, None] + xyz, 3 * K + edges.i[:, None]])
    J, e = jacobians(edges, poses), residuals(edges, poses, scale)
    JtO = np.swapaxes(J, 1, 2) @ (weights[:, None, None] * edges.information)
    rows, columns = np.broadcast_arrays(own[:, :, None], own[:, None, :])
    H = coo_array(((JtO @ J).ravel(), (rows.ravel(), columns.ravel())), shape=(4 * K, 4 * K))
    b = np.bincount(own.ravel(), (JtO @ e[:, :, None]).ravel(), minlength=4 * K)
    # The scales: the first near zero, each near the one before.
    change = diags_array([np.ones(K), -np.ones(K - 1)], offsets=[0, -1])
    prior = change.T @ diags_array(np.append(SCALE_SIGMA, np.full(K - 1, WALK_SIGMA)) ** -2) @ change
    H, b[3 * K :] = H + block_diag([csr_array((3 * K, 3 * K)), prior]), b[3 * K :] + prior @ scale
    step = np.append(np.zeros(3), spsolve(H.tocsc()[3:, 3:], -b[3:]))
    poses = poses + step[: 3 * K].reshape(K, 3)
    return np.column_stack([poses[:, :2], wrap_angle(poses[:, 2])]), scale + step[3 * K :]


def relax(edges: Edges, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Revise poses ``(K, 3)`` until the errors of all edges are least; also return scales ``(K,)``, weights ``(E,)``.

    The kernel is wide at first and narrows: a metre after two hundred is no reason to distrust a match before the graph
    has had a chance to bend (graduated non-convexity, Yang et al., 2020).
    """
    scale, weights = np.zeros(len(poses)), np.ones(len(edges))
    for width in np.repeat(KERNELS, ITERATIONS):
        chi2 = chi_square(edges, poses, scale)
        weights = np.where(edges.doubtful, robust_weights(chi2, width), 1.0)
        poses, scale = gauss_newton_step(edges, poses, scale, weights)
    return poses, scale, weights
