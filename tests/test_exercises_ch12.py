"""Exercises of chapter 12: right answers in many styles, and the words for each wrong one."""

import cmath
import math

import numpy as np
import pytest
from pfslam_book import ch12

from pfslam.beyond.loops.graph import robust_weights
from pfslam.poses import between, compose, invert, rotation_matrix, wrap_angle


def error(a, b, z):
    e = between(a, b) - z
    e[2] = wrap_angle(e[2])
    return e


def by_matrix(a, b, z):
    e = np.zeros(3)
    e[:2] = rotation_matrix(yaw=a[2])[:2, :2].T @ (b - a)[:2] - z[:2]
    e[2] = (b[2] - a[2] - z[2] + np.pi) % (2 * np.pi) - np.pi
    return e


def by_complex(a, b, z):
    d = complex(b[0] - a[0], b[1] - a[1]) * cmath.exp(-1j * a[2]) - complex(z[0], z[1])
    return [d.real, d.imag, cmath.phase(cmath.exp(1j * (b[2] - a[2] - z[2])))]


def by_polar(a, b, z):
    way, bearing = math.hypot(b[0] - a[0], b[1] - a[1]), math.atan2(b[1] - a[1], b[0] - a[0]) - a[2]
    turn = math.remainder(b[2] - a[2] - z[2], 2 * math.pi)
    return way * math.cos(bearing) - z[0], way * math.sin(bearing) - z[1], turn


def unwrapped(a, b, z):
    c, s = np.cos(a[2]), np.sin(a[2])
    dx, dy, turn = b - a
    return np.array([c * dx + s * dy - z[0], c * dy - s * dx - z[1], turn - z[2]])


def turned_back(a, b, z):
    c, s = np.cos(a[2]), np.sin(a[2])
    dx, dy, turn = b - a
    return np.array([c * dx - s * dy - z[0], c * dy + s * dx - z[1], wrap_angle(turn - z[2])])


def in_the_world(a, b, z):
    return np.append((b - a)[:2] - z[:2], wrap_angle(b[2] - a[2] - z[2]))


RIGHT = {
    "edge_error": [
        error,
        by_matrix,
        by_complex,
        by_polar,
        lambda a, b, z: tuple(error(a, b, z)),
        lambda a, b, z: np.float32(error(a, b, z)),
        lambda a, b, z: (
            np.round(compose(invert(a), b) - z, 9)
            + [0, 0, error(a, b, z)[2] - (compose(invert(a), b) - z)[2]]
        ),
    ],
    "robust_weight": [
        robust_weights,
        lambda c, k: (1.0 + c / k**2) ** -2.0,
        lambda c, k: [(k * k / (k * k + x)) ** 2 for x in c],
        lambda c, k: np.square(np.divide(k**2, np.add(k**2, c))),
        lambda c, k: k**4 / (k**2 + c) ** 2,
        lambda c, k: np.exp(-2.0 * np.log1p(c / k**2)),
        lambda c, k: (1.0 - c / (k**2 + c)) ** 2,
    ],
}


@pytest.mark.parametrize(
    ("name", "style"), [(n, k) for n, styles in RIGHT.items() for k in range(len(styles))]
)
def test_a_right_answer_passes_in_any_style(name, style):
    verdict = getattr(ch12, f"check_{name}")(RIGHT[name][style])
    assert verdict, verdict.message


WRONG = {
    "edge_error": {
        "The sign": lambda a, b, z: -error(a, b, z),
        "in the world": in_the_world,
        "the transpose": turned_back,
        "must be wrapped": unwrapped,
        "must be taken away": lambda a, b, z: between(a, b),
        "shape (2,)": lambda a, b, z: error(a, b, z)[:2],
        "seen from pose j": lambda a, b, z: error(b, a, z),
        "Here the two are subtracted": lambda a, b, z: between(z, between(a, b)),
        "from the heading, too": lambda a, b, z: error(a, b, z * [1, 1, 0]),
        "returns nothing": lambda a, b, z: None,
    },
    "robust_weight": {
        "must be squared": lambda c, k: k**2 / (k**2 + c),
        "the cost": lambda c, k: k**2 * c / (k**2 + c),
        "width enters squared": lambda c, k: (k / (k + c)) ** 2,
        "squared already": lambda c, k: (k**2 / (k**2 + c**2)) ** 2,
        "Turned round": lambda c, k: (c / (k**2 + c)) ** 2,
        "hard threshold": lambda c, k: 1.0 * (c < k * k),
        "no kernel at all": lambda c, k: np.ones(len(c)),
        "Huber": lambda c, k: np.where(c <= k * k, 1.0, k / np.sqrt(c + (c == 0))),
        "Welsch": lambda c, k: np.exp(-0.5 * c / k**2),
    },
}


@pytest.mark.parametrize(("name", "words"), [(n, w) for n, cases in WRONG.items() for w in cases])
def test_a_wrong_answer_is_named(name, words):
    verdict = getattr(ch12, f"check_{name}")(WRONG[name][words])
    assert verdict.verdict == "wrong"
    assert words in verdict.message
