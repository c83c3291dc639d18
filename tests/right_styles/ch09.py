"""Right answers to the exercises of chapter 09, in the ways that people write them: each must pass its check."""

import math

import numpy as np


def top_of_polyfit(left, middle, right):
    a, b, _ = np.polyfit([-1, 0, 1], [left, middle, right], 2)
    return -b / (2 * a)


SUB_CELL = [
    top_of_polyfit,
    lambda a, b, c: np.float32((a - c) / (a - 2 * b + c) / 2),
    lambda a, b, c: round((a - c) / (2 * (a - 2 * b + c)), 4),
    lambda a, b, c: np.array([(a - c) / (2 * (a - 2 * b + c))]),
    lambda a, b, c: -((c - a) / 2) / ((c - b) - (b - a)),
    lambda a, b, c: np.roots(np.polyder(np.polyfit([-1, 0, 1], [a, b, c], 2)))[0],
]


def by_complex_numbers(poses, true_poses):
    z, w = poses[:, 0] + 1j * poses[:, 1], true_poses[:, 0] + 1j * true_poses[:, 1]
    away = (z - z[0]) * np.exp(1j * (true_poses[0, 2] - poses[0, 2])) - (w - w[0])
    return np.sqrt(np.mean(np.abs(away) ** 2))


def by_a_loop(poses, true_poses):
    turn, total = true_poses[0][2] - poses[0][2], 0.0
    for p, q in zip(poses, true_poses, strict=True):
        dx, dy = p[0] - poses[0][0], p[1] - poses[0][1]
        x = true_poses[0][0] + math.cos(turn) * dx - math.sin(turn) * dy
        y = true_poses[0][1] + math.sin(turn) * dx + math.cos(turn) * dy
        total += (x - q[0]) ** 2 + (y - q[1]) ** 2
    return math.sqrt(total / len(poses))


def by_matrices(poses, true_poses):
    def matrix(pose):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        return np.array([[c, -s, pose[0]], [s, c, pose[1]], [0, 0, 1]])

    moved = matrix(true_poses[0]) @ np.linalg.inv(matrix(poses[0]))
    points = np.column_stack([poses[:, :2], np.ones(len(poses))]) @ moved.T
    return np.linalg.norm(points[:, :2] - true_poses[:, :2]) / np.sqrt(len(poses))


FIRST_POSE = [
    by_complex_numbers,
    by_a_loop,
    by_matrices,
    lambda p, q: np.float32(by_complex_numbers(p, q)),
    lambda p, q: [by_complex_numbers(p, q)],
    lambda p, q: float(f"{by_complex_numbers(p, q):.4g}"),
]


def by_lstsq(arms, position, centres, normals):
    residual = np.einsum("ij,ij->i", normals, arms + position - centres)
    turning = normals[:, 1] * arms[:, 0] - normals[:, 0] * arms[:, 1]
    return np.linalg.lstsq(np.column_stack([normals, turning]), -residual, rcond=None)[0]


def by_complex_lines(arms, position, centres, normals):
    a, d, n = (v @ [1, 1j] for v in (arms, arms + position - centres, normals))
    columns = np.column_stack([n.real, n.imag, (n.conj() * 1j * a).real])
    return np.linalg.lstsq(columns, -(n.conj() * d).real, rcond=None)[0]


def by_sums(arms, position, centres, normals):
    H, g = np.zeros((3, 3)), np.zeros(3)
    for a, c, n in zip(arms, centres, normals, strict=True):
        J = np.array([n[0], n[1], n[1] * a[0] - n[0] * a[1]])
        H += np.outer(J, J)
        g += J * (n @ (position + a - c))
    return np.linalg.solve(H, -g)


LINE_STEP = [
    by_lstsq,
    by_complex_lines,
    by_sums,
    lambda *case: by_sums(*case).tolist(),
    lambda *case: tuple(by_lstsq(*case)),
    lambda *case: by_lstsq(*case).astype(np.float32),
    lambda *case: np.round(by_lstsq(*case), 6),
    lambda a, p, c, n: (
        -np.linalg.pinv(np.column_stack([n, n[:, 1] * a[:, 0] - n[:, 0] * a[:, 1]]))
        @ ((a + p - c) * n).sum(axis=1)
    ),
]


def by_steps(occupied, cells):
    found = False
    for ix, iy in cells.tolist()[:-3]:
        found |= bool(occupied[iy][ix])
    return found


BLOCKED = [
    by_steps,
    lambda o, c: any(o[iy, ix] for ix, iy in c[: len(c) - 3]),
    lambda o, c: o[tuple(c[:-3].T[::-1])].any(),
    lambda o, c: int(o[c[:-3, 1], c[:-3, 0]].sum() > 0),
    lambda o, c: np.array(o.T[c[:-3, 0], c[:-3, 1]].max()),
    lambda o, c: bool(np.count_nonzero([o[iy, ix] for ix, iy in c[:-3]])),
]
STYLES = {
    "check_sub_cell": SUB_CELL,
    "check_first_pose_error": FIRST_POSE,
    "check_line_step": LINE_STEP,
    "check_blocked": BLOCKED,
}
