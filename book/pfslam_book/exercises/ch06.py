"""Checks of the exercises of chapter 06: each takes the reader's function and says what is wrong in words."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from pfslam_book.show.checks import Check, compare

from pfslam.sensors import RgbdModel
from pfslam.texture import back_project, depth_from_disparity

CAMERA = RgbdModel()

# ---- 1: a pixel becomes a point

PIXELS_IN = [
    (310, 413, 566),
    (41, 387, 803),
    *[
        tuple(row)
        for row in np.random.default_rng(2).integers((10, 10, 450), (630, 470, 1040), (2, 3)).tolist()
    ],
]


def point_of(u: float, v: float, d: float) -> np.ndarray:
    """Give the optical point ``(3,)`` (m) of a pixel and its raw disparity."""
    return back_project(u, v, depth_from_disparity(d, CAMERA), CAMERA.K)[0]


def _ray(u: float, v: float, d: float) -> np.ndarray:
    return point_of(u, v, d) / depth_from_disparity(d, CAMERA)


def _printed_K(u: float, v: float, d: float) -> np.ndarray:
    K = CAMERA.K.copy()
    K[0, 2], K[1, 2] = CAMERA.centre_v, CAMERA.centre_u
    return back_project(u, v, depth_from_disparity(d, CAMERA), K)[0]


POINT_MISTAKES = [
    (_printed_K, "You used K as it is printed. u counts columns, so 315.84 belongs into the first row: an image of 640 "
     "columns has its centre near column 320."),
    (lambda u, v, d: point_of(u, v, d) / np.linalg.norm(_ray(u, v, d)), "You took the depth for the length of the ray. "
     "Z is measured along the optical axis: do not normalise K^-1 (u, v, 1)."),
    (lambda u, v, d: _ray(u, v, d) * 1.03 * (3.31 - 0.00304 * d), "You multiplied by dd. dd is an inverse depth: "
     "Z = 1.03 / dd."),
    (lambda u, v, d: point_of(v, u, d), "Row and column are exchanged: (u, v) is (column, row)."),
    (_ray, "That is the ray, for one metre of depth. Multiply it by the depth."),
    (lambda u, v, d: point_of(u, v, d) * (1, -1, 1), "Y has the wrong sign. In the optical frame y points down, as "
     "rows are counted."),
    (lambda u, v, d: point_of(u, v, d) * (-1, 1, 1), "X has the wrong sign. In the optical frame x points right, as "
     "columns are counted."),
    (lambda u, v, d: point_of(u, v, d)[[2, 0, 1]] * (1, -1, -1), "Your numbers are right, in the axes of the robot: "
     "ahead, left, up. The optical frame has right, down, forward; step 4 changes the axes."),
    (lambda u, v, d: point_of(u, v, d)[[1, 0, 2]], "X and Y are exchanged."),
    (lambda u, v, d: point_of(u + CAMERA.centre_u, v + CAMERA.centre_v, d), "You did not subtract the centre: the axis "
     "goes through pixel (315.84, 242.94), not (0, 0)."),
    (lambda u, v, d: point_of(u, v, d) * (-1, -1, 1), "X and Y have the wrong sign. A column to the right of the "
     "centre is a point to the right of the axis."),
    (lambda u, v, d: np.append(_ray(u, v, d)[:2], point_of(u, v, d)[2]), "X and Y are those of one metre of depth. "
     "Multiply them by Z as well."),
    (lambda u, v, d: point_of(u - 320 + CAMERA.centre_u, v - 240 + CAMERA.centre_v, d), "You took the middle of the "
     "image for the centre. The axis goes through pixel (315.84, 242.94)."),
    (lambda u, v, d: point_of(u, v - CAMERA.centre_u + CAMERA.centre_v, d), "You subtracted c_u from both. Rows have a "
     "centre of their own, 242.94."),
    (lambda u, v, d: _ray(u, v, d) / (3.31 - 0.00304 * d), "Z = 1.03 / dd: the 1.03 is missing."),
    (lambda u, v, d: _ray(u, v, d) * 1.03 / (3.31 + 0.00304 * d), "dd = -0.00304 d + 3.31: the disparity counts with "
     "a minus."),
    (lambda u, v, d: point_of(u, v, d) * (CAMERA.focal_u / 526.37, CAMERA.focal_v / 526.37, 1), "526.37 is the focal "
     "length of the colour camera. The depth camera has 585.05."),
    (lambda u, v, d: point_of(u, v, d) * (CAMERA.focal_u, CAMERA.focal_v, 1), "X and Y are still in pixel metres: "
     "divide by the focal length."),
]  # fmt: skip


def check_optical_point(optical_point: Callable) -> Check:
    """Check that ``optical_point(u, v, d)`` returns (X, Y, Z) in metres."""
    x, y, z = point_of(*PIXELS_IN[0])
    praise = f"The pixel of the table lies at ({x:.3f}, {y:.3f}, {z:.3f}) m: just left of the axis, below it."
    theirs = _as_a_row(optical_point)
    return compare(theirs, point_of, PIXELS_IN, mistakes=POINT_MISTAKES, praise=praise)


def _as_a_row(function: Callable) -> Callable:
    """The same function; a column ``(3, 1)``, as a matrix product gives it, is as good as a row."""

    def flat(*arguments):
        answer = function(*arguments)
        return np.ravel(answer) if np.shape(answer) in ((3, 1), (1, 3)) else answer

    return flat


# ---- 2: a camera is calibrated


def _crosses(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Where crosses on a wall stand, X / Z ``(N,)``, and the columns ``(N,)`` in which somebody clicked them."""
    rng = np.random.default_rng(seed)
    focal, centre = rng.uniform(400, 900), rng.uniform(250, 400)
    x_over_z = rng.uniform(-0.3, 0.5, 9)
    return x_over_z, focal * x_over_z + centre + 0.6 * rng.standard_normal(9)


CROSSES = [_crosses(seed) for seed in (3, 4, 5)]


def calibrated(x_over_z: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Give focal length and centre (px) of the line that fits best."""
    return np.polyfit(x_over_z, u, 1)


def _through_320(x_over_z, u):
    return x_over_z @ (u - 320) / (x_over_z @ x_over_z), 320.0


CALIBRATION_MISTAKES = [
    (lambda x, u: calibrated(x, u)[::-1], "The right numbers in the other order: the focal length comes first."),
    (_through_320, "You took the centre for granted. The axis need not hit the middle of the image, column 320; the "
     "data say where it does."),
    (lambda x, u: (x @ u / (x @ x), 0.0), "You fitted a line through the origin. u = f X / Z + c has a c."),
    (lambda x, u: (np.mean(u / x), 0.0), "You averaged u / (X / Z). That ignores the centre, and where X is near 0 a "
     "ratio says nothing."),
    (lambda x, u: ((u[-1] - u[0]) / (x[-1] - x[0]), u[0] - x[0] * (u[-1] - u[0]) / (x[-1] - x[0])),
     "You used two of the crosses. Each click is off by half a pixel or so: fit all of them."),
    (lambda x, u: np.polyfit(x[:2], u[:2], 1), "You used two of the crosses. Each click is off by half a pixel or so: "
     "fit all of them."),
    (lambda x, u: np.polyfit(x[[x.argmin(), x.argmax()]], u[[x.argmin(), x.argmax()]], 1), "You used the two outermost "
     "crosses. Each click is off by half a pixel or so: fit all of them."),
    (lambda x, u: calibrated(x, u) * (1, -1), "The centre has the wrong sign: u = f X / Z + c, with a plus."),
    (lambda x, u: calibrated(x, u) / (1, calibrated(x, u)[0]), "The centre is asked for in pixels; yours is divided by "
     "the focal length."),
    (lambda x, u: np.polyfit(u, x, 1), "You fitted X / Z against u. The focal length is the slope of u over X / Z."),
    (lambda x, u: (1 / np.polyfit(u, x, 1)[0], -np.polyfit(u, x, 1)[1] / np.polyfit(u, x, 1)[0]),
     "You fitted X / Z against u and turned the line round. The errors are in u, so fit u against X / Z."),
    (lambda x, u: (calibrated(x, u)[0], np.median(u)), "The slope is right. The centre is the column of X = 0, not the "
     "middle one of the columns."),
    (lambda x, u: (calibrated(x, u)[0], u.mean()), "The slope is right. The centre is the column of X = 0, not the "
     "mean of the columns."),
]  # fmt: skip


def check_calibrate(calibrate: Callable) -> Check:
    """Check that ``calibrate(x_over_z, u)`` returns focal length and centre of the best line."""
    praise = "Nine crosses give the focal length to a few pixels. A real calibration uses hundreds, all over the image."
    return compare(
        calibrate,
        calibrated,
        CROSSES,
        mistakes=CALIBRATION_MISTAKES,
        praise=praise,
        same=_near_two_pixel_digits,
    )


def _near_two_pixel_digits(found, expected) -> bool:
    found = np.asarray(found, dtype=float)
    return found.shape == (2,) and bool(np.allclose(found, expected, rtol=3e-4))


# ---- 3: the change of axes

AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def _nose_down(pitch: float) -> np.ndarray:
    c, s = np.cos(pitch), np.sin(pitch)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _turned(yaw: float) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def in_body(points_o: np.ndarray, position_b: np.ndarray, pitch: float) -> np.ndarray:
    """Give points ``(M, 3)`` of the optical frame in the body frame."""
    return np.asarray(points_o) @ (_nose_down(pitch) @ AXES).T + position_b


def _mountings() -> list[tuple]:
    rng = np.random.default_rng(8)
    cases = [(np.array([[0.1, 0.2, 1.3], [-0.4, 0.3, 2.2]]), np.array([0.17, 0.02, 0.38]), 0.31)]
    for _ in range(2):
        cases.append((rng.uniform(-1, 2, (4, 3)), rng.uniform(0.05, 0.6, 3), float(rng.uniform(0.1, 0.7))))
    return cases


MOUNTINGS = _mountings()
BODY_MISTAKES = [
    (lambda p, t, a: in_body(p, t, -a), "The camera looks up. A pitch downwards takes the view (1, 0, 0) of frame c to "
     "(cos, 0, -sin) in b."),
    (lambda p, t, a: in_body(p, 0 * t, a), "Turned right, but you did not add the place of the camera on the robot."),
    (lambda p, t, a: in_body(p, 0 * t, a) - t, "You subtracted the place of the camera. Coordinates go from the camera "
     "to the body: add it."),
    (lambda p, t, a: in_body(p, t, 0.0), "The pitch is missing."),
    (lambda p, t, a: p @ _nose_down(a).T + t, "You did not change the axes: forward is z in the optical frame and x in "
     "the others. T_co comes first."),
    (lambda p, t, a: p @ (AXES @ _nose_down(a)).T + t, "The right matrices in the wrong order. T_co stands next to the "
     "point: T_bc T_co p."),
    (lambda p, t, a: p @ (_nose_down(a) @ AXES) + t, "You multiplied by the transposed matrix: that goes from body to "
     "camera. For points in rows it is p @ R.T."),
    (lambda p, t, a: p @ (_nose_down(a) @ AXES.T).T + t, "Your T_co is transposed: it goes from c to o."),
    (lambda p, t, a: p @ (_nose_down(a) @ (AXES * [[1], [-1], [1]])).T + t, "Left and right are exchanged: x of the "
     "optical frame points right, y of the body left."),
    (lambda p, t, a: p @ (_nose_down(a) @ (AXES * [[1], [1], [-1]])).T + t, "Up and down are exchanged: y of the "
     "optical frame points down, z of the body up."),
    (lambda p, t, a: (p @ AXES.T + t) @ _nose_down(a).T, "You moved the points and turned them then, about the robot's "
     "centre. The camera tilts about itself: turn first."),
    (lambda p, t, a: in_body(p, t, np.deg2rad(a)), "The pitch is in radians already."),
    (lambda p, t, a: in_body(p, t, np.rad2deg(a)), "You turned the pitch into degrees. cos and sin take radians."),
    (lambda p, t, a: in_body(p, t, np.pi / 2 - a), "cos and sin of the pitch are exchanged."),
    (lambda p, t, a: in_body(p, 0 * t, a) + (0, 0, t[2]), "You added the height of the camera only. It also stands "
     "ahead of the centre."),
    (lambda p, t, a: in_body(p + t, 0 * t, a), "You added the place of the camera before the axes were changed. It is "
     "given in the body frame: turn first."),
    (lambda p, t, a: (p - t) @ _nose_down(a) @ AXES, "That leads from the body to the camera: the inverse."),
    (lambda p, t, a: p @ (_nose_down(a) @ np.abs(AXES)).T + t, "The minus signs of T_co are missing: right is -y, down "
     "is -z."),
    (lambda p, t, a: p @ (_turned(a) @ AXES).T + t, "You turned about z, which is a yaw. A pitch turns about y."),
    (lambda p, t, a: p @ (_turned(a)[[2, 0, 1]][:, [2, 0, 1]] @ AXES).T + t, "You turned about x, which is a roll. A "
     "pitch turns about y."),
]  # fmt: skip


def check_to_body(to_body: Callable) -> Check:
    """Check that ``to_body(points_o, position_b, pitch)`` is T_bc T_co."""
    praise = "T_co changes the names of the axes, T_bc tilts and then moves."
    return compare(to_body, in_body, MOUNTINGS, mistakes=BODY_MISTAKES, praise=praise)


# ---- 4: the blind ring


def ring(height, ahead, pitch, rows, centre_v, focal) -> float:
    """Give the radius (m) of the blind ring around a robot that turns on the spot."""
    return ahead + height / np.tan(pitch + np.arctan((rows - 0.5 - centre_v) / focal))


RINGS = [
    (
        CAMERA.position_b[2],
        CAMERA.position_b[0],
        CAMERA.pitch,
        CAMERA.height,
        CAMERA.centre_v,
        CAMERA.focal_v,
    ),
    (0.71, 0.23, 0.4, 720, 301.0, 640.0),
    (0.9, 0.11, 0.35, 480, 262.0, 420.0),
]
RING_MISTAKES = [
    (lambda h, a, p, r, c, f: ring(h, 0, p, r, c, f), "That is the distance from the camera. The robot turns about its "
     "own centre, and the camera stands `ahead` of it."),
    (lambda h, a, p, r, c, f: ring(h, -a, p, r, c, f), "The camera stands ahead of the turning point: add `ahead`."),
    (lambda h, a, p, r, c, f: ring(h, a, p, r, r / 2, f), "You measured from the middle of the image. The axis goes "
     "through row `centre_v`."),
    (lambda h, a, p, r, c, f: ring(h, a, p, r, (r - 1) / 2, f), "You measured from the middle of the image. The axis "
     "goes through row `centre_v`."),
    (lambda h, a, p, r, c, f: a + h / np.tan(p), "That is where the optical axis meets the floor. The lowest row looks "
     "down more steeply."),
    (lambda h, a, p, r, c, f: ring(h, a, 0, r, c, f), "You forgot the pitch: the camera already looks down before the "
     "field of view counts."),
    (lambda h, a, p, r, c, f: a + h / np.tan(p - np.arctan((r - 0.5 - c) / f)), "You went up from the axis. The lowest "
     "row looks down by pitch plus half the field of view."),
    (lambda h, a, p, r, c, f: a + h * np.tan(p + np.arctan((r - 0.5 - c) / f)), "Turn the triangle round: the angle is "
     "at the floor, so the height is divided by the tangent."),
    (lambda h, a, p, r, c, f: a + h / np.sin(p + np.arctan((r - 0.5 - c) / f)), "You added the length of the ray. Its "
     "shadow on the floor is asked for."),
    (lambda h, a, p, r, c, f: ring(h, a, np.deg2rad(p), r, c, f), "The pitch is in radians already."),
    (lambda h, a, p, r, c, f: a + h / np.tan(p + (r - 0.5 - c) / f), "Nearly: rows over focal length is a tangent, not "
     "an angle. Take its arctan."),
    (lambda h, a, p, r, c, f: ring(h, a, np.rad2deg(p), r, c, f), "You turned the pitch into degrees. Tangents take "
     "radians."),
    (lambda h, a, p, r, c, f: a + h / (np.tan(p) + (r - 0.5 - c) / f), "You added two tangents. Add the angles, then "
     "take the tangent."),
    (lambda h, a, p, r, c, f: a + h / np.tan(p + 2 * np.arctan((r - 0.5 - c) / f)), "You took the whole field of view. "
     "From the axis to the lowest row it is one half."),
    (lambda h, a, p, r, c, f: a + h / np.tan(p + np.arctan(c / f)), "You went from the axis to the *first* row. The "
     "last one looks at the nearest floor."),
    (lambda h, a, p, r, c, f: a + h / np.tan(p + np.arctan(f / (r - 0.5 - c))), "The tangent of the half view is rows "
     "over focal length, not the other way round."),
    (lambda h, a, p, r, c, f: np.hypot(a, ring(h, 0, p, r, c, f)), "Both distances lie along one line, ahead of the "
     "robot: add them."),
    (lambda h, a, p, r, c, f: a + h / np.cos(p + np.arctan((r - 0.5 - c) / f)), "Height over distance is a tangent, "
     "not a cosine."),
    (lambda h, a, p, r, c, f: ring(h, a, p, r, -0.5, f), "You took all rows for half of the image: count from "
     "`centre_v` down."),
]  # fmt: skip


def check_blind_ring(blind_ring: Callable) -> Check:
    """Check that ``blind_ring(height, ahead, pitch, rows, centre_v, focal)`` is the ring's radius (m)."""
    praise = f"{ring(*RINGS[0]):.2f} m around the turning point of this robot."
    return compare(blind_ring, ring, RINGS, mistakes=RING_MISTAKES, praise=praise, same=_to_a_millimetre)


def _to_a_millimetre(found, expected) -> bool:
    """Half a row or a whole one more makes two millimetres: that is not what the exercise is about."""
    return bool(np.abs(np.asarray(found, dtype=float) - expected) < 0.0035)


# ---- 5: which view is kept


def _looks(seed: int) -> tuple:
    """Pixels of several images in the order of time: cells, depths, places in the cell and colours ``(M,)``; n."""
    rng = np.random.default_rng(seed)
    cells = np.concatenate([[0, 2, 2, 1, 0, 2, 4, 1], rng.choice([0, 1, 2, 4, 5], 30)])
    depths = np.round(rng.integers(6, 30, len(cells)) / 10 + rng.uniform(0.005, 0.095, len(cells)), 3)
    depths[cells == 2] = 0.8 + rng.uniform(
        0.005, 0.095, np.count_nonzero(cells == 2)
    )  # the nearest decide by place
    off_centre = rng.uniform(0.0, 0.035, len(cells))
    return cells, depths, off_centre, rng.integers(0, 256, len(cells)).astype(np.uint8), 6


LOOKS = [_looks(seed) for seed in (11, 12, 13)]


def kept(rank: Callable) -> Callable:
    """A painter that keeps in each cell the view with the smallest ``rank(depths, off_centre, colours)``."""

    def paint(cells, depths, off_centre, colours, n):
        canvas = np.full(n, -1.0)
        ranks = rank(depths, off_centre, colours)
        for k in sorted(range(len(cells)), key=lambda k: ranks[k], reverse=True):
            canvas[cells[k]] = colours[k]
        return canvas

    return paint


def _steps_then_place(depths, off_centre, colours):
    return list(zip(np.floor(10 * depths), off_centre, strict=True))


best = kept(_steps_then_place)


def _average(cells, depths, off_centre, colours, n):
    seen = np.bincount(cells, minlength=n)
    return np.where(seen > 0, np.bincount(cells, colours, n) / np.maximum(seen, 1), -1)


VIEW_MISTAKES = [
    (kept(lambda z, r, c: -np.arange(len(z))), "The last view wins: a late look from far away erases a sharp one."),
    (kept(lambda z, r, c: np.arange(len(z))), "The first view wins. It was taken from as far away as chance had it."),
    (kept(lambda z, r, c: z), "You go by the depth alone. Within the same tenth of a metre the view nearest to the "
     "cell's centre is asked for."),
    (kept(lambda z, r, c: r), "You go by the place in the cell alone. The depth comes first."),
    (kept(lambda z, r, c: list(zip(r, z, strict=True))), "You go by the place in the cell first. The depth "
     "comes first."),
    (kept(lambda z, r, c: list(zip(-np.floor(10 * z), r, strict=True))), "The farthest view wins: sort the other way "
     "round."),
    (kept(lambda z, r, c: list(zip(np.floor(10 * z), -r, strict=True))), "Within a tenth of a metre you keep the pixel "
     "farthest from the cell's centre."),
    (kept(lambda z, r, c: list(zip(np.rint(10 * z), r, strict=True))), "You round to the nearest tenth. A step of "
     "depth begins at its lower end: np.floor(10 * depths)."),
    (kept(lambda z, r, c: list(zip(np.floor(10 * z), -np.arange(len(z)), strict=True))), "Within a tenth of a metre "
     "you keep the last view. The one nearest to the cell's centre is asked for."),
    (kept(lambda z, r, c: list(zip(np.floor(10 * z), np.arange(len(z)), strict=True))), "Within a tenth of a metre you "
     "keep the first view. The one nearest to the cell's centre is asked for."),
    (kept(lambda z, r, c: list(zip(np.floor(10 * z), -c.astype(int), strict=True))), "Within a tenth of a metre you "
     "keep the brightest view. The one nearest to the cell's centre is asked for."),
    (kept(lambda z, r, c: list(zip(np.floor(z), r, strict=True))), "Your steps of depth are whole metres; tenths are "
     "asked for."),
    (kept(lambda z, r, c: list(zip(np.rint(z), r, strict=True))), "Your steps of depth are whole metres; tenths are "
     "asked for."),
    (kept(lambda z, r, c: -c.astype(int)), "The brightest colour wins. Brightness says nothing about how good a view "
     "is."),
    (kept(lambda z, r, c: c), "The darkest colour wins. Brightness says nothing about how good a view is."),
    (_average, "That is the average of all views: the blurred ones are mixed into the sharp ones."),
    (lambda cells, z, r, c, n: best(cells, z, r, z, n), "Those are depths. The colour of the best view is asked for."),
    (lambda cells, z, r, c, n: best(cells, z, r, np.arange(len(z)), n), "Those are the numbers of the best views. "
     "Their colours are asked for."),
    (lambda *given: np.where(best(*given) < 0, 255, best(*given)), "The colours are bytes, in which -1 becomes 255: "
     "white. Make the canvas of whole numbers."),
    (lambda *given: np.where(best(*given) < 0, np.nan, best(*given)), "Nobody saw cell 3, so it should be -1, not "
     "NaN."),
    (lambda *given: np.maximum(best(*given), 0), "Nobody saw cell 3, so it should be -1. Unseen is not black."),
    (OverflowError, "The colours are bytes, which cannot hold -1. Make the canvas of whole numbers: np.full(n, -1)."),
]  # fmt: skip


def check_best_view(best_view: Callable) -> Check:
    """Check that ``best_view(cells, depths, off_centre, colours, n)`` keeps the right view of each cell."""
    praise = "Each cell shows what was seen from nearest, and of equals what was seen at its centre."
    return compare(best_view, best, LOOKS, mistakes=VIEW_MISTAKES, praise=praise)
