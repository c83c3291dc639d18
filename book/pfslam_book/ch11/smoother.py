"""Chapter 11: the same drive as a graph of poses and posts, solved with the package's pose graph (chapter 12)."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from pfslam.beyond.loops.graph import Edges, gauss_newton_step, jacobians
from pfslam_book.ch11.drives import Drive

SIDEWAYS, ANY = 1e-3, 1e3
"""A robot on wheels does not slide (m); nobody measures the heading of a post (rad)."""


def graph_of(drive: Drive) -> Edges:
    """Return the motions and sights as edges; a post is a pose whose heading is left open."""
    K, (t, k) = len(drive.path), np.nonzero(drive.seen)
    (way, turn), (r, bearing) = drive.controls.T, drive.sights[t, k].T
    c, s, zero = np.cos(bearing), np.sin(bearing), np.zeros(len(t))
    by_polar = np.array([[c, -r * s], [s, r * c]]).transpose(
        2, 0, 1
    )  # from errors of range and bearing to x and y
    covariance = np.zeros((K - 1 + len(t), 3, 3))
    covariance[: K - 1] = np.diag([drive.Q[0, 0], SIDEWAYS**2, drive.Q[1, 1]])
    covariance[K - 1 :, :2, :2] = by_polar @ drive.R @ by_polar.transpose(0, 2, 1)
    covariance[K - 1 :, 2, 2] = ANY**2
    measured = np.vstack([np.column_stack([way, 0 * way, turn]), np.column_stack([r * c, r * s, zero])])
    i, j, no = np.append(np.arange(K - 1), t), np.append(np.arange(1, K), K + k), np.zeros(len(measured))
    return Edges(i, j, measured, np.linalg.inv(covariance), no, no.astype(bool))


def smooth(drive: Drive, path: np.ndarray, posts: np.ndarray, steps: int = 8):
    """Relax the graph from a ``path (K, 3)`` and ``posts (M, 2)``.

    Return the new path, the new posts, and the covariance ``(2M, 2M)`` of the posts.
    """
    edges, K = graph_of(drive), len(path)
    poses, scale = np.vstack([path, np.column_stack([posts, np.zeros(len(posts))])]), np.zeros(K + len(posts))
    for _ in range(steps):
        poses, scale = gauss_newton_step(edges, poses, scale, np.ones(len(edges)))
    J = jacobians(edges, poses)[:, :, :6]
    own = np.hstack([3 * edges.i[:, None] + np.arange(3), 3 * edges.j[:, None] + np.arange(3)])
    rows, columns = np.broadcast_arrays(own[:, :, None], own[:, None, :])
    terms = np.swapaxes(J, 1, 2) @ edges.information @ J
    H = coo_array((terms.ravel(), (rows.ravel(), columns.ravel()))).tocsc()[3:, 3:]
    wanted = (3 * np.arange(K - 1, K - 1 + len(posts))[:, None] + [0, 1]).ravel()
    P = splu(H).solve(np.eye(H.shape[0])[:, wanted])[wanted]
    return poses[:K], poses[K:, :2], P
