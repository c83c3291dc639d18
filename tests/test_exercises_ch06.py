"""Exercises of chapter 06: right answers in many styles, wrong ones and the words for each."""

import numpy as np
import pytest
from pfslam_book import ch06

from pfslam.sensors import RgbdModel
from pfslam.texture import back_project, depth_from_disparity, to_world

FOCAL, U0, V0 = 585.051, 315.838, 242.941


# ---- right answers: loops, lists, float32, matrices, the package, other containers


def depth(d):
    return 1.03 / (3.31 - 0.00304 * d)


def point(u, v, z):
    return np.array([(u - U0) / FOCAL * z, (v - V0) / FOCAL * z, z])


def point_by_matrix(u, v, d):
    K = np.array([[FOCAL, 0, U0], [0, FOCAL, V0], [0, 0, 1]])
    return np.linalg.inv(K) @ [[u], [v], [1]] * depth(d)


def point_by_package(u, v, d):
    camera = RgbdModel()
    return back_project(u, v, depth_from_disparity(d, camera), camera.K)


def point_complex(u, v, d):
    sideways = (u - U0 + 1j * (v - V0)) / FOCAL * depth(d)
    return sideways.real, sideways.imag, depth(d)


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


def body_complex(points_o, position_b, pitch):
    x, y, z = points_o.T
    side = (z - 1j * y) * np.exp(-1j * pitch)  # ahead and up as one number
    return np.column_stack([side.real, -x, side.imag]) + position_b


def ring_by_triangle(height, ahead, pitch, rows, centre_v, focal):
    t, b = np.tan(pitch), (rows - 0.5 - centre_v) / focal
    return [ahead + height * (1 - t * b) / (t + b)]


def views_by_buffer(cells, depths, off_centre, colours, n):
    canvas, kept = [-1] * n, [(np.inf, np.inf)] * n
    for cell, z, r, colour in zip(cells, depths, off_centre, colours.tolist(), strict=True):
        if (np.floor(10 * z), r) < kept[cell]:
            kept[cell], canvas[cell] = (np.floor(10 * z), r), colour
    return canvas


def views_by_code(cells, depths, off_centre, colours, n):
    code = np.floor(10 * depths) + off_centre / 0.036
    best = {c: min(np.flatnonzero(cells == c), key=lambda k: code[k]) for c in set(cells.tolist())}
    return tuple(float(colours[best[c]]) if c in best else -1.0 for c in range(n))


RIGHT = [
    (ch06.check_optical_point, lambda u, v, d: point(u, v, depth(d)).tolist()),
    (ch06.check_optical_point, lambda u, v, d: tuple(np.float32(point(u, v, depth(d))))),
    (ch06.check_optical_point, lambda u, v, d: np.round(point(u, v, depth(d)), 4)),
    (ch06.check_optical_point, point_by_matrix),
    (ch06.check_optical_point, point_by_package),
    (ch06.check_optical_point, point_complex),
    (ch06.check_optical_point, lambda u, v, d: point(*(np.float64(x) for x in (u, v)), depth(float(d)))),
    (ch06.check_calibrate, line_by_sums),
    (ch06.check_calibrate, line_by_least_squares),
    (ch06.check_calibrate, lambda x, u: np.float32(line_by_sums(x, u))),
    (ch06.check_calibrate, lambda x, u: tuple(np.round(line_by_sums(x, u), 2))),
    (ch06.check_calibrate, lambda x, u: np.polynomial.Polynomial.fit(x, u, 1).convert().coef[::-1]),
    (
        ch06.check_calibrate,
        lambda x, u: np.cov(x, u)[0] @ [[0, 0], [1, -x.mean()]] / x.var(ddof=1) + [0, u.mean()],
    ),
    (ch06.check_to_body, body_in_a_loop),
    (ch06.check_to_body, body_by_package),
    (ch06.check_to_body, body_complex),
    (ch06.check_to_body, lambda p, t, a: np.float32(body_in_a_loop(p, t, a))),
    (ch06.check_to_body, lambda p, t, a: np.round(body_in_a_loop(p, t, a), 4)),
    (ch06.check_to_body, lambda p, t, a: [tuple(row) for row in body_in_a_loop(p, t, a)]),
    (ch06.check_blind_ring, ring_by_triangle),
    (ch06.check_blind_ring, lambda h, a, p, r, c, f: a + h / np.tan(p + np.arctan((r - c) / f))),
    (ch06.check_blind_ring, lambda h, a, p, r, c, f: a + h / np.tan(p + np.arctan2(r - 1 - c, f))),
    (ch06.check_blind_ring, lambda *given: np.float32(ring_by_triangle(*given)[0])),
    (ch06.check_blind_ring, lambda *given: round(ring_by_triangle(*given)[0], 3)),
    (ch06.check_blind_ring, lambda *given: np.array(ring_by_triangle(*given))),
    (ch06.check_best_view, views_by_buffer),
    (ch06.check_best_view, views_by_code),
    (ch06.check_best_view, lambda *given: np.array(views_by_buffer(*given), dtype=np.float32)),
    (ch06.check_best_view, lambda *given: np.array(views_by_buffer(*given), dtype=np.int16)),
    (ch06.check_best_view, lambda *given: tuple(views_by_buffer(*given))),
    (ch06.check_best_view, lambda *given: [float(x) for x in views_by_buffer(*given)]),
]


@pytest.mark.parametrize(("check", "answer"), RIGHT)
def test_the_same_in_another_style_is_right_too(check, answer):
    assert check(answer), check(answer)


# ---- wrong answers


def mixed(order, signs):
    return lambda u, v, d: point(u, v, depth(d))[order] * signs


WRONG_POINTS = [
    (lambda u, v, d: point(u + U0 - V0, v + V0 - U0, depth(d)), "as it is printed"),
    (lambda u, v, d: point(u, v, 1.0) * depth(d) / np.linalg.norm(point(u, v, 1.0)), "length of the ray"),
    (lambda u, v, d: point(u, v, 1.03 * (3.31 - 0.00304 * d)), "inverse depth"),
    (lambda u, v, d: point(v, u, depth(d)), "(column, row)"),
    (lambda u, v, d: point(u, v, 1.0), "one metre"),
    (mixed([0, 1, 2], (1, -1, 1)), "y points down"),
    (mixed([0, 1, 2], (-1, 1, 1)), "x points right"),
    (mixed([2, 0, 1], (1, -1, -1)), "ahead, left, up"),
    (mixed([1, 0, 2], (1, 1, 1)), "exchanged"),
    (lambda u, v, d: point(u + U0, v + V0, depth(d)), "subtract the centre"),
    (lambda u, v, d: point(u, v, depth(d)) * (FOCAL, FOCAL, 1), "focal length"),
    (lambda u, v, d: 1000 * point(u, v, depth(d)), "millimetres"),
    (lambda u, v, d: depth(d), "(3,)"),
    (lambda u, v, d: {}[u], "KeyError"),
    (mixed([0, 1, 2], (-1, -1, 1)), "X and Y have the wrong sign"),
    (lambda u, v, d: np.append(point(u, v, 1.0)[:2], depth(d)), "one metre of depth"),
    (lambda u, v, d: point(u - 320 + U0, v - 240 + V0, depth(d)), "middle of the image"),
    (lambda u, v, d: point(u, v, 1 / (3.31 - 0.00304 * d)), "1.03 is missing"),
    (lambda u, v, d: point(u, v, depth(d)) * (FOCAL / 526.37, FOCAL / 526.37, 1), "colour camera"),
]
WRONG_LINES = [
    (lambda x, u: line_by_sums(x, u)[::-1], "other order"),
    (lambda x, u: (x @ (u - 320) / (x @ x), 320.0), "for granted"),
    (lambda x, u: (x @ u / (x @ x), 0.0), "through the origin"),
    (lambda x, u: (np.mean(u / x), 0.0), "averaged"),
    (lambda x, u: np.polyfit(x[[0, -1]], u[[0, -1]], 1), "two of the crosses"),
    (lambda x, u: np.polyfit(u, x, 1), "X / Z against u"),
    (lambda x, u: (line_by_sums(x, u)[0], np.mean(u)), "column of X = 0"),
    (lambda x, u: line_by_sums(x, u)[0], "shape"),
    (lambda x, u: None, "returns nothing"),
    (lambda x, u: np.polyfit(x[:2], u[:2], 1), "two of the crosses"),
    (lambda x, u: np.polyfit(x[[x.argmin(), x.argmax()]], u[[x.argmin(), x.argmax()]], 1), "outermost"),
    (lambda x, u: np.array(line_by_sums(x, u)) * (1, -1), "with a plus"),
    (lambda x, u: (line_by_sums(x, u)[0], np.median(u)), "middle one"),
    (lambda x, u: str(line_by_sums(x, u)), "asked for"),
]
WRONG_BODIES = [
    (lambda p, t, a: body_in_a_loop(p, t, -a), "looks up"),
    (lambda p, t, a: body_in_a_loop(p, 0 * t, a), "did not add the place"),
    (lambda p, t, a: body_in_a_loop(p, -t, a), "subtracted the place"),
    (lambda p, t, a: body_in_a_loop(p, t, 0.0), "pitch is missing"),
    (lambda p, t, a: body_in_a_loop(p, t, np.deg2rad(a)), "radians already"),
    (lambda p, t, a: p @ ch06_tilt(a).T + t, "did not change the axes"),
    (lambda p, t, a: p @ (AXES @ ch06_tilt(a)).T + t, "wrong order"),
    (lambda p, t, a: p @ (ch06_tilt(a) @ AXES) + t, "p @ R.T"),
    (lambda p, t, a: p @ (ch06_tilt(a) @ AXES.T).T + t, "T_co is transposed"),
    (lambda p, t, a: (p @ AXES.T + t) @ ch06_tilt(a).T, "turn first"),
    (lambda p, t, a: np.array(body_in_a_loop(p * (-1, 1, 1), t, a)), "Left and right"),
    (lambda p, t, a: np.array(body_in_a_loop(p, t, a)).T, "shape"),
    (lambda p, t, a: body_in_a_loop(p, t, np.rad2deg(a)), "into degrees"),
    (lambda p, t, a: body_in_a_loop(p, t, np.pi / 2 - a), "exchanged"),
    (lambda p, t, a: body_in_a_loop(p, (0, 0, t[2]), a), "height of the camera only"),
    (lambda p, t, a: body_in_a_loop(p + t, 0 * t, a), "before the axes"),
    (lambda p, t, a: (p - t) @ (ch06_tilt(a) @ AXES), "the inverse"),
    (lambda p, t, a: p[:, [2, 0, 1]] @ ch06_tilt(a).T + t, "minus signs"),
]
AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def ch06_tilt(pitch):
    return np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])


def ringed(angle, length=lambda h, angle: h / np.tan(angle), add=1.0):
    return lambda h, a, p, r, c, f: add * a + length(h, angle(p, r, c, f))


def right_angle(p, r, c, f):
    return p + np.arctan((r - 0.5 - c) / f)


WRONG_RINGS = [
    (ringed(right_angle, add=0.0), "from the camera"),
    (ringed(right_angle, add=-1.0), "add `ahead`"),
    (ringed(lambda p, r, c, f: p + np.arctan(r / 2 / f)), "middle of the image"),
    (ringed(lambda p, r, c, f: p), "optical axis meets"),
    (ringed(lambda p, r, c, f: np.arctan((r - 0.5 - c) / f)), "forgot the pitch"),
    (ringed(lambda p, r, c, f: p - np.arctan((r - 0.5 - c) / f)), "went up"),
    (ringed(right_angle, lambda h, angle: h * np.tan(angle)), "triangle round"),
    (ringed(right_angle, lambda h, angle: h / np.sin(angle)), "length of the ray"),
    (ringed(lambda p, r, c, f: np.deg2rad(p) + np.arctan((r - 0.5 - c) / f)), "radians already"),
    (ringed(lambda p, r, c, f: p + (r - 0.5 - c) / f), "arctan"),
    (ringed(lambda p, r, c, f: p + np.arctan(r / f)), "half of the image"),
    (ringed(lambda p, r, c, f: np.rad2deg(p) + np.arctan((r - 0.5 - c) / f)), "into degrees"),
    (ringed(lambda p, r, c, f: np.arctan(np.tan(p) + (r - 0.5 - c) / f)), "added two tangents"),
    (ringed(lambda p, r, c, f: p + 2 * np.arctan((r - 0.5 - c) / f)), "whole field"),
    (ringed(lambda p, r, c, f: p + np.arctan(c / f)), "*first* row"),
    (ringed(lambda p, r, c, f: p + np.arctan2(f, r - 0.5 - c)), "other way round"),
    (ringed(right_angle, lambda h, angle: h / np.cos(angle)), "not a cosine"),
]


def painted(order, start=-1):
    def paint(cells, depths, off_centre, colours, n):
        canvas = np.full(n, start)
        for k in order(depths, off_centre, colours):
            canvas[cells[k]] = colours[k]
        return canvas

    return paint


def average(cells, depths, off_centre, colours, n):
    seen = np.bincount(cells, minlength=n)
    return np.where(seen > 0, np.bincount(cells, colours, n) / np.maximum(seen, 1), -1)


def in_bytes(cells, depths, off_centre, colours, n):
    canvas = np.zeros(n, dtype=np.uint8)
    canvas[0] = int("-1")
    return canvas


def keyed(*keys):
    """Worst first by the last key, then the one before."""
    return lambda z, r, c: np.lexsort([key(z, r, c) for key in keys])[::-1]


WRONG_VIEWS = [
    (painted(lambda z, r, c: range(len(z))), "last view wins"),
    (painted(lambda z, r, c: range(len(z))[::-1]), "first view wins"),
    (painted(keyed(lambda z, r, c: z)), "depth alone"),
    (painted(keyed(lambda z, r, c: r)), "place in the cell alone"),
    (painted(keyed(lambda z, r, c: r, lambda z, r, c: -np.floor(10 * z))), "farthest view"),
    (painted(keyed(lambda z, r, c: -r, lambda z, r, c: np.floor(10 * z))), "farthest from the cell"),
    (painted(keyed(lambda z, r, c: -c.astype(int))), "brightest"),
    (painted(keyed(lambda z, r, c: c)), "darkest"),
    (average, "average"),
    (lambda *given: np.maximum(views_by_buffer(*given), 0), "Unseen is not black"),
    (in_bytes, "cannot hold -1"),
    (lambda cells, z, r, colours, n: colours, "shape"),
    (painted(keyed(lambda z, r, c: r, lambda z, r, c: np.rint(10 * z))), "nearest tenth"),
    (painted(keyed(lambda z, r, c: -np.arange(len(z)), lambda z, r, c: np.floor(10 * z))), "keep the last"),
    (painted(keyed(lambda z, r, c: r, lambda z, r, c: np.floor(z))), "whole metres"),
    (lambda cells, z, r, c, n: np.array(views_by_buffer(cells, z, r, z, n)), "Those are depths"),
    (
        lambda cells, z, r, c, n: views_by_buffer(cells, z, r, np.arange(len(z)), n),
        "numbers of the best views",
    ),
    (lambda *given: np.array(views_by_buffer(*given)).astype(np.uint8), "becomes 255"),
]
WRONG = [
    *((ch06.check_optical_point, *pair) for pair in WRONG_POINTS),
    *((ch06.check_calibrate, *pair) for pair in WRONG_LINES),
    *((ch06.check_to_body, *pair) for pair in WRONG_BODIES),
    *((ch06.check_blind_ring, *pair) for pair in WRONG_RINGS),
    *((ch06.check_best_view, *pair) for pair in WRONG_VIEWS),
]


@pytest.mark.parametrize(("check", "answer", "words"), WRONG)
def test_a_wrong_answer_is_refused_by_name(check, answer, words):
    verdict = check(answer)
    assert verdict.verdict == "wrong"
    assert words in verdict.message
