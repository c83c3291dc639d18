"""Exercises of chapter 11: right answers in many styles, and the words for each wrong one."""

import math

import numpy as np
import pytest
from pfslam_book import ch11

from pfslam.beyond.localization import kld_bound


def bound(b, e, z):
    a = 2 / (9 * (b - 1))
    return (b - 1) / (2 * e) * (1 - a + a**0.5 * z) ** 3


def loud(k, e, z, a=None, power=3):
    """The bound with k degrees of freedom, and what else may be wrong."""
    a = 2 / (9 * k) if a is None else a
    return k / (2 * e) * (1 - a + a**0.5 * z) ** power


def quantile_first(b, e, z):
    k = b - 1
    chi_square = k * (1 - 2 / (9 * k) + z * math.sqrt(2 / (9 * k))) ** 3
    return 0.5 * chi_square / e


def step(slow, fast, fit, a, b):
    slow, fast = (1 - a) * slow + a * fit, (1 - b) * fast + b * fit
    return slow, fast, max(0.0, 1 - fast / slow)


def with_if(slow, fast, fit, a, b):
    slow += a * (fit - slow)
    fast += b * (fit - fast)
    if fast >= slow:
        return [slow, fast, 0]
    return [slow, fast, (slow - fast) / slow]


RIGHT = {
    "particles_needed": [
        bound,
        quantile_first,
        lambda b, e, z: np.float32(bound(b, e, z)),
        lambda b, e, z: [bound(b, e, z)],
        lambda b, e, z: float(f"{bound(b, e, z):.5g}"),
        lambda b, e, z: np.power(1 - 2 / 9 / (b - 1) + np.sqrt(2 / 9 / (b - 1)) * z, 3) * (b - 1) / 2 / e,
    ],
    "inject": [
        step,
        with_if,
        lambda *given: np.array(step(*given)),
        lambda *given: list(step(*given)),
        lambda *given: np.array(step(*given), dtype=np.float32),
        lambda *given: np.clip(np.round(step(*given), 6), 0.0, 1.0),
    ],
}


@pytest.mark.parametrize(
    ("name", "style"), [(n, k) for n, styles in RIGHT.items() for k in range(len(styles))]
)
def test_a_right_answer_passes_in_any_style(name, style):
    verdict = getattr(ch11, f"check_{name}")(RIGHT[name][style])
    assert verdict, verdict.message


def shared(change):
    """A step whose share is wrong: ``change`` takes the averages before, the fit, and the averages after."""

    def wrong(slow, fast, fit, a, b):
        s, f, _ = step(slow, fast, fit, a, b)
        return s, f, change(slow, fast, fit, s, f)

    return wrong


WRONG = {
    "particles_needed": {
        "degrees of freedom, wherever": lambda b, e, z: loud(b, e, z),
        "Under the 9": lambda b, e, z: loud(b - 1, e, z, a=2 / (9 * b)),
        "In front stands k": lambda b, e, z: b / (b - 1) * bound(b, e, z),
        "*root* of a chi-square": lambda b, e, z: loud(b - 1, e, z, power=1),
        "not squared": lambda b, e, z: loud(b - 1, e, z, power=2),
        "mean of the chi-square": lambda b, e, z: (b - 1) / (2 * e),
        "divisor is 2 epsilon": lambda b, e, z: (b - 1) / e * bound(b, e, z) * 2 * e / (b - 1),
        "quantile itself": lambda b, e, z: 2 * e * bound(b, e, z),
        "surer takes more": lambda b, e, z: loud(b - 1, e, -z),
        "have changed places": lambda b, e, z: bound(b, z, e),
        "shape": lambda b, e, z: np.ones(b) * bound(b, e, z),
    },
    "inject": {
        "share is negative": shared(lambda s, f, z, s1, f1: 1 - f1 / s1),
        "one scan late": shared(lambda s, f, z, s1, f1: max(0.0, 1 - f / s)),
        "fit better than usual": shared(lambda s, f, z, s1, f1: max(0.0, 1 - s1 / f1)),
        "share to keep": shared(lambda s, f, z, s1, f1: min(1.0, f1 / s1)),
        "one person": shared(lambda s, f, z, s1, f1: max(0.0, 1 - z / s1)),
        "difference": shared(lambda s, f, z, s1, f1: max(0.0, s1 - f1)),
        "two rates": lambda s, f, z, a, b: step(s, f, z, b, a),
        "of the *new* value": lambda s, f, z, a, b: step(s, f, z, 1 - a, 1 - b),
        "not taken in": lambda s, f, z, a, b: (s, f, max(0.0, 1 - f / s)),
        "shape": lambda *given: step(*given)[2],
        "returns nothing": lambda *given: None,
    },
}


@pytest.mark.parametrize(("name", "words"), [(n, w) for n, cases in WRONG.items() for w in cases])
def test_a_wrong_answer_is_named(name, words):
    verdict = getattr(ch11, f"check_{name}")(WRONG[name][words])
    assert verdict.verdict == "wrong"
    assert words in verdict.message


def test_the_exercise_asks_for_what_the_package_computes():
    for bins in (2, 40, 5000):
        assert bound(bins, 0.05, 2.3263478740408408) == pytest.approx(kld_bound(bins, 0.05, 0.01))
