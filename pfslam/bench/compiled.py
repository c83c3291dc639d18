"""The rival: a loop over the same poses, compiled by Numba. It lives here only; the package does without."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def compiled_loop() -> Callable | None:
    """``(field, origin, resolution, points_b, poses, scores)`` fills ``scores (P,)``; None where Numba is missing."""
    try:
        from numba import njit
    except ImportError:
        return None
    return njit(_score_poses)


def _score_poses(field, origin, resolution, points_b, poses, scores):
    """The definition of the score, pose by pose and beam by beam."""
    height, width = field.shape
    for p in range(poses.shape[0]):
        c, s = np.cos(poses[p, 2]), np.sin(poses[p, 2])
        total = 0.0
        for i in range(points_b.shape[0]):
            x = poses[p, 0] + c * points_b[i, 0] - s * points_b[i, 1]
            y = poses[p, 1] + s * points_b[i, 0] + c * points_b[i, 1]
            ix = int(np.floor((x - origin[0]) / resolution))
            iy = int(np.floor((y - origin[1]) / resolution))
            if 0 <= ix < width and 0 <= iy < height:
                total += field[iy, ix]
        scores[p] = total
