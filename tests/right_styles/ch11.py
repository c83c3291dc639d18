"""Right answers to the exercises of chapter 11, in the ways that people write them: each must pass its check."""

import cmath
import math

import numpy as np

from pfslam.beyond.loops.graph import robust_weights
from pfslam.poses import between, rotation_matrix, wrap_angle


def error(a, b, z):
    e = between(a, b) - z
    e[2] = wrap_angle(e[2])
    return e


def by_complex(a, b, z):
    d = complex(b[0] - a[0], b[1] - a[1]) * cmath.exp(-1j * a[2]) - complex(z[0], z[1])
    return [d.real, d.imag, cmath.phase(cmath.exp(1j * (b[2] - a[2] - z[2])))]


def by_polar(a, b, z):
    way, bearing = math.hypot(b[0] - a[0], b[1] - a[1]), math.atan2(b[1] - a[1], b[0] - a[0]) - a[2]
    turn = math.remainder(b[2] - a[2] - z[2], 2 * math.pi)
    return way * math.cos(bearing) - z[0], way * math.sin(bearing) - z[1], turn


def by_blocks(pose, landmark):
    R = rotation_matrix(yaw=pose[2])[:2, :2]
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
    arm = R.T @ (np.asarray(landmark) - pose[:2])
    return np.hstack([-R.T, (turn @ arm)[:, None], R.T])


def by_rows(pose, landmark):
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = landmark[0] - pose[0], landmark[1] - pose[1]
    return [[-c, -s, -s * dx + c * dy, c, s], [s, -c, -c * dx - s * dy, -s, c]]


def by_differences(pose, landmark):
    def seen(v):
        return rotation_matrix(yaw=v[2])[:2, :2].T @ (v[3:] - v[:2])

    v, steps = np.concatenate([pose, landmark]), 1e-5 * np.eye(5)
    return np.column_stack([(seen(v + d) - seen(v - d)) / 2e-5 for d in steps])


STYLES = {
    "check_edge_error": [
        error,
        by_complex,
        by_polar,
        lambda a, b, z: tuple(error(a, b, z)),
        lambda a, b, z: np.float32(error(a, b, z)),
    ],
    "check_landmark_jacobian": [by_blocks, by_rows, by_differences],
    "check_robust_weight": [
        robust_weights,
        lambda c, k: [(k * k / (k * k + x)) ** 2 for x in c],
    ],
}
