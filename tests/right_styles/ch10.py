"""Right answers to the exercises of chapter 10, in the ways that people write them: each must pass its check."""

import math
from statistics import NormalDist

import numpy as np

from pfslam.beyond.localization import kld_bound


def bound(b, e, z):
    a = 2 / (9 * (b - 1))
    return (b - 1) / (2 * e) * (1 - a + a**0.5 * z) ** 3


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


STYLES = {
    "check_particles_needed": [
        bound,
        quantile_first,
        lambda b, e, z: kld_bound(b, e, NormalDist().cdf(-z)),
        lambda b, e, z: np.float32(bound(b, e, z)),
        lambda b, e, z: [bound(b, e, z)],
        lambda b, e, z: float(f"{bound(b, e, z):.5g}"),
        lambda b, e, z: np.power(1 - 2 / 9 / (b - 1) + np.sqrt(2 / 9 / (b - 1)) * z, 3) * (b - 1) / 2 / e,
    ],
    "check_inject": [
        step,
        with_if,
        lambda *given: list(step(*given)),
        lambda *given: np.array(step(*given), dtype=np.float32),
        lambda *given: np.clip(np.round(step(*given), 6), 0.0, 1.0),
    ],
}
