"""Exercises of chapter 06: the way back, a calibration, the mounting, the blind ring."""

from __future__ import annotations

import numpy as np
from pfslam_book.show.exercise import Exercise

rngs = [np.random.default_rng(seed) for seed in range(2, 9)]
F, CU, CV = 585.051, 315.838, 242.941


def numbers_within(apart):
    """Two answers agree if no number is further off than this, or than its own limit in a list."""
    return lambda found, expected: bool(
        np.shape(found) == np.shape(expected)
        and np.all(
            np.abs(np.asarray(found, dtype=float) - np.asarray(expected, dtype=float)) <= np.asarray(apart)
        )
    )


# ---- 1: where would the camera see a point?


def seen_at(X, Y, Z):
    """The depth pixel (u, v) of an optical point (m), and its raw disparity."""
    return F * X / Z + CU, F * Y / Z + CV, (3.31 - 1.03 / Z) / 0.00304


check_seen_at = Exercise(
    right=seen_at,
    cases=[(-0.0065, 0.1884, 0.6481), (1.13, 0.42, 2.7), (-0.87, -0.51, 4.3)],
    mistakes={
        "You used K as it is printed. u counts columns, so 315.84 belongs into the first row: an image of 640 columns "
        "has its centre near column 320.": lambda X, Y, Z: (
            F * X / Z + CV,
            F * Y / Z + CU,
            seen_at(X, Y, Z)[2],
        ),
        "You took the length of the ray for the depth. Z alone is measured along the optical axis.": (
            lambda X, Y, Z: (*seen_at(X, Y, Z)[:2], (3.31 - 1.03 / np.hypot(np.hypot(X, Y), Z)) / 0.00304)
        ),
        "Row and column are exchanged: first u, the column, which grows with X.": (
            lambda X, Y, Z: (F * Y / Z + CV, F * X / Z + CU, seen_at(X, Y, Z)[2])
        ),
        "You did not add the centre: the axis goes through pixel (315.84, 242.94), not (0, 0).": (
            lambda X, Y, Z: (F * X / Z, F * Y / Z, seen_at(X, Y, Z)[2])
        ),
        "The third number is dd, an inverse depth. Solve dd = -0.00304 d + 3.31 for d.": (
            lambda X, Y, Z: (*seen_at(X, Y, Z)[:2], 1.03 / Z)
        ),
        "Your law is right, but a baseline of 72 mm is rounded, and d is up to three steps off. Take the product of "
        "focal length and baseline, 42.35 px m.": (
            lambda X, Y, Z: (*seen_at(X, Y, Z)[:2], 1089 - 8 * 585.05 * 0.072 / Z)
        ),
    },
    praise="The first point is seen at (310, 413) with d = 566: the pixel of the table, there and back.",
    same=numbers_within([0.01, 0.01, 0.25]),  # 0.2 is what d = 1089 - 8 * 42.35 / Z is off
)

# ---- 2: a camera is calibrated


def crosses(rng) -> tuple[np.ndarray, np.ndarray]:
    """Where crosses on a wall stand, X / Z ``(N,)``, and the columns ``(N,)`` in which somebody clicked them."""
    focal, centre = rng.uniform(400, 900), rng.uniform(250, 400)
    x_over_z = rng.uniform(-0.3, 0.5, 9)
    return x_over_z, focal * x_over_z + centre + 4.0 * rng.standard_normal(9)


def line(x, u):
    """Slope and offset of the line through all of them."""
    return np.polyfit(x, u, 1)


def turned_round(x, u):
    """The line fitted to x over u, solved for u."""
    slope, offset = np.polyfit(u, x, 1)
    return 1 / slope, -offset / slope


check_calibrate = Exercise(
    right=line,
    cases=[crosses(rng) for rng in rngs[1:4]],
    mistakes={
        "The right numbers in the other order: the focal length comes first.": lambda x, u: line(x, u)[::-1],
        "You took the centre for granted. The axis need not hit the middle of the image, column 320; the data say "
        "where it does.": lambda x, u: (x @ (u - 320) / (x @ x), 320.0),
        "You fitted a line through the origin. u = f X / Z + c has a c.": lambda x, u: (x @ u / (x @ x), 0.0),
        "You used two of the crosses. Each click is off by some pixels: fit all of them.": (
            lambda x, u: np.polyfit(x[[0, -1]], u[[0, -1]], 1)
        ),
        "You fitted X / Z against u and turned the line round. The errors are in u, so fit u against X / Z.": (
            turned_round
        ),
    },
    praise="Nine crosses give the focal length to some pixels. A real calibration uses hundreds, all over the image.",
    same=numbers_within(0.006),
)

# ---- 3: step 4 as far as the body

AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def nose_down(pitch):
    """R_bc: a camera that looks down by ``pitch``."""
    c, s = np.cos(pitch), np.sin(pitch)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def in_body(points_o, position_b, pitch):
    """T_bc T_co of points in rows."""
    return np.asarray(points_o) @ (nose_down(pitch) @ AXES).T + position_b


check_to_body = Exercise(
    right=in_body,
    cases=[
        (np.array([[0.1, 0.2, 1.3], [-0.4, 0.3, 2.2]]), np.array([0.17, 0.02, 0.38]), 0.31),
        (rngs[5].uniform(-1, 2, (4, 3)), rngs[5].uniform(0.05, 0.6, 3), 0.53),
    ],
    mistakes={
        "The camera looks up. A pitch downwards takes the view (1, 0, 0) of frame c to (cos, 0, -sin) in b.": (
            lambda p, t, a: in_body(p, t, -a)
        ),
        "Turned right, but you did not add the place of the camera on the robot.": lambda p, t, a: in_body(
            p, 0, a
        ),
        "You did not change the axes: forward is z in the optical frame and x in the others. T_co comes first.": (
            lambda p, t, a: p @ nose_down(a).T + t
        ),
        "You multiplied by the transposed matrix: that goes from body to camera. For points in rows it is p @ R.T.": (
            lambda p, t, a: p @ (nose_down(a) @ AXES) + t
        ),
        "You moved the points and turned them then, about the robot's centre. The camera tilts about itself: turn "
        "first.": lambda p, t, a: (p @ AXES.T + t) @ nose_down(a).T,
    },
    praise="T_co changes the names of the axes, T_bc tilts and then moves.",
)

# ---- 4: the blind ring


def ring(height, ahead, pitch, rows, centre_v, focal, edge=0.5):
    """The radius (m) of the blind ring, up to the line so many rows above the end of the image."""
    return ahead + height / np.tan(pitch + np.arctan((rows - edge - centre_v) / focal))


check_blind_ring = Exercise(
    right=ring,
    cases=[
        (0.38001, 0.16766, float(np.deg2rad(18)), 480, CV, F),
        (0.71, 0.23, 0.4, 720, 301.0, 640.0),
        (0.9, 0.11, 0.35, 480, 262.0, 420.0),
    ],
    mistakes={
        "That is the distance from the camera. The robot turns about its own centre, and the camera stands `ahead` of "
        "it.": lambda h, a, p, r, c, f: ring(h, 0, p, r, c, f),
        "You went down to v = rows. Rows are counted from 0 at their centres, so the image ends at rows - 0.5.": (
            lambda h, a, p, r, c, f: ring(h, a, p, r, c, f, edge=0.0)
        ),
        "You measured from the middle of the image. The axis goes through row `centre_v`.": (
            lambda h, a, p, r, c, f: ring(h, a, p, r, r / 2, f, edge=0.0)
        ),
        "That is where the optical axis meets the floor. The lowest row looks down more steeply.": (
            lambda h, a, p, r, c, f: a + h / np.tan(p)
        ),
        "Nearly: rows over focal length is a tangent, not an angle. Take its arctan.": (
            lambda h, a, p, r, c, f: a + h / np.tan(p + (r - 0.5 - c) / f)
        ),
        "You subtract one angle from the other. The lowest row looks down more steeply than the optical axis, so its "
        "angle adds to the pitch.": (
            lambda h, a, p, r, c, f: a + h / np.tan(p - np.arctan((r - 0.5 - c) / f)),
            lambda h, a, p, r, c, f: a + h / np.tan(np.arctan((r - 0.5 - c) / f) - p),
        ),
        "You take `ahead` off. The camera stands ahead of the turning point and looks ahead, so the two distances add "
        "up.": lambda h, a, p, r, c, f: ring(h, -a, p, r, c, f),
    },
    praise="0.62 m around the turning point of this robot.",
    same=lambda found, expected: np.size(found) == 1 and numbers_within(0.0006)(np.ravel(found)[0], expected),
)
