"""Chapter 05, from scores to weights: how sharp a likelihood may be, and how many copies resampling makes."""

from __future__ import annotations

from functools import cache

import numpy as np
from matplotlib.figure import Figure

from pfslam.particles import RESAMPLERS, effective_sample_size, systematic_resample
from pfslam.teaching.show.pictures import steady
from pfslam.teaching.show.style import COLOURS, new_figure
from pfslam.teaching.show.widgets import Explorer, Slider

SHARPNESS = (0.0, 0.002, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
PARTICLES = 200


def counts_of_a_scan(seed: int = 0) -> np.ndarray:
    """Counts ``(N,)`` that the particles of a compact cloud get from one scan of a thousand beams."""
    return np.sort(np.random.default_rng(seed).normal(500.0, 15.0, PARTICLES))


def weights_from(counts: np.ndarray, sharpness: float) -> np.ndarray:
    """Weights ``(N,)`` proportional to exp(sharpness * count), summing to 1."""
    likelihood = np.exp(sharpness * (counts - counts.max()))
    return likelihood / likelihood.sum()


def raw_count_weights(counts: np.ndarray) -> np.ndarray:
    """Weights ``(N,)`` proportional to the count itself, as in Eq. 12."""
    return counts / counts.sum()


def sharpness_explorer() -> Explorer:
    """The same counts, ever sharper likelihoods: the weights, and the copies that resampling makes of them."""
    counts = counts_of_a_scan()

    @cache
    def outcome(sharpness: float) -> tuple[np.ndarray, np.ndarray, float]:
        weights = weights_from(counts, sharpness)
        ancestors = systematic_resample(weights, np.random.default_rng(1))
        return weights, np.bincount(ancestors, minlength=PARTICLES), effective_sample_size(weights)

    def draw(sharpness: float) -> Figure:
        weights, copies, n_eff = outcome(sharpness)
        figure, (above, below) = new_figure(6.2, 4.6, rows=2, sharex=True)
        above.scatter(
            counts, PARTICLES * raw_count_weights(counts), s=8, color=COLOURS["odometry"], label="count"
        )
        above.scatter(counts, PARTICLES * weights, s=14, color=COLOURS["particles"], label="exp(b count)")
        above.set(ylabel="weight × $N_p$", yscale="symlog", ylim=(0, 300), yticks=(0, 1, 10, 100))
        above.set_yticklabels(("0", "1", "10", "100"))
        above.set_title(
            f"$N_\\mathrm{{eff}}$ = {n_eff:.0f} of {PARTICLES}, {np.count_nonzero(copies)} survive"
        )
        above.legend(loc="upper left")
        below.vlines(counts, 0, copies, color=COLOURS["estimate"], linewidth=1.6)
        below.set(xlabel="end points on occupied cells", ylabel="copies", yscale="symlog", ylim=(0, 300))
        below.set_yticks((0, 1, 10, 100), ("0", "1", "10", "100"))
        return figure

    def alt(sharpness: float) -> str:
        weights, copies, n_eff = outcome(sharpness)
        return f"""Weights exp({sharpness:g} x count) of {PARTICLES} particles with counts of 500 give or take 15: the
        heaviest has {weights.max():.3f} of all, N_eff is {n_eff:.0f}, and {np.count_nonzero(copies)} particles survive
        resampling, the luckiest with {copies.max()} copies."""

    slider = Slider("sharpness", SHARPNESS, 3, "Sharpness b", live=(0.0, 1.0, 0.005))
    return Explorer(steady(draw), [slider], alt=alt, title="How sharp may a likelihood be?")


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
