"""Right answers to the exercises of chapter 06, in the ways that people write them: each must pass its check."""

import numpy as np

from pfslam.sensors import RgbdModel
from pfslam.texture import disparity_from_depth, to_world

FOCAL, U0, V0 = 585.051, 315.838, 242.941


def seen_by_numbers(X, Y, Z):
    return [FOCAL * X / Z + U0, FOCAL * Y / Z + V0, (3.31 - 1.03 / Z) / 0.00304]


def seen_by_matrix(X, Y, Z):
    K = np.array([[FOCAL, 0, U0], [0, FOCAL, V0], [0, 0, 1]])
    u, v, _ = K @ [X, Y, Z] / Z
    return np.array([u, v, 3.31 / 0.00304 - 8 * (1.03 / 0.00304 / 8) / Z])


def seen_by_package(X, Y, Z):
    camera = RgbdModel()
    pixel = camera.K @ [[X], [Y], [Z]] / Z
    return *pixel[:2].ravel(), disparity_from_depth(Z, camera)


def seen_complex(X, Y, Z):
    pixel = FOCAL * complex(X, Y) / Z + complex(U0, V0)
    return pixel.real, pixel.imag, (1.03 / Z - 3.31) / -0.00304


def line_by_sums(x, u):
    mx, mu = sum(x) / len(x), sum(u) / len(u)
    slope = sum((a - mx) * (b - mu) for a, b in zip(x, u, strict=True)) / sum((a - mx) ** 2 for a in x)
    return [slope, mu - slope * mx]


def line_by_least_squares(x, u):
    return np.linalg.lstsq(np.column_stack([x, np.ones(len(x))]), u, rcond=None)[0]


def body_in_a_loop(points_o, position_b, pitch):
    c, s = np.cos(pitch), np.sin(pitch)
    return [
        [c * z - s * y + position_b[0], -x + position_b[1], -s * z - c * y + position_b[2]]
        for x, y, z in points_o.tolist()
    ]


def body_by_package(points_o, position_b, pitch):
    camera = RgbdModel(position_b=tuple(float(x) for x in position_b), pitch=float(pitch))
    return to_world(points_o, np.zeros(3), camera)


def ring_by_triangle(height, ahead, pitch, rows, centre_v, focal):
    t, b = np.tan(pitch), (rows - 0.5 - centre_v) / focal
    return [ahead + height * (1 - t * b) / (t + b)]


STYLES = {
    "check_seen_at": [
        seen_by_numbers,
        seen_by_matrix,
        seen_by_package,
        seen_complex,
        lambda X, Y, Z: np.round(seen_by_numbers(X, Y, Z), 2),
        lambda X, Y, Z: tuple(np.float32(seen_by_numbers(X, Y, Z))),
    ],
    "check_calibrate": [
        line_by_sums,
        line_by_least_squares,
        lambda x, u: np.float32(line_by_sums(x, u)),
        lambda x, u: tuple(np.round(line_by_sums(x, u), 2)),
    ],
    "check_to_body": [
        body_in_a_loop,
        body_by_package,
        lambda p, t, a: np.float32(body_in_a_loop(p, t, a)),
        lambda p, t, a: np.round(body_in_a_loop(p, t, a), 4),
        lambda p, t, a: [tuple(row) for row in body_in_a_loop(p, t, a)],
    ],
    "check_blind_ring": [
        ring_by_triangle,
        lambda h, a, p, r, c, f: a + h / np.tan(p + np.arctan2(r - 0.5 - c, f)),
        lambda *given: np.float32(ring_by_triangle(*given)[0]),
        lambda *given: round(ring_by_triangle(*given)[0], 3),
        lambda *given: np.array(ring_by_triangle(*given)),
    ],
}
