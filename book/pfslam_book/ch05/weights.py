"""Chapter 05, resampling: how many copies each scheme makes of a particle."""

from __future__ import annotations

import numpy as np

from pfslam.particles import RESAMPLERS


def copies_table(weight: float = 0.3, n: int = 10, trials: int = 2000) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of the copies of one particle of that weight, for every resampling scheme."""
    weights = np.full(n, (1.0 - weight) / (n - 1))
    weights[n // 2] = weight
    table = {}
    for name, resampler in RESAMPLERS.items():
        rng = np.random.default_rng(0)
        copies = [np.count_nonzero(resampler(weights, rng) == n // 2) for _ in range(trials)]
        table[name] = (float(np.mean(copies)), float(np.std(copies)))
    return table
