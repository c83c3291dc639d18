"""Chapter 09: where particles are drawn from, in one dimension: the motion alone, or the motion and the scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.particles import effective_sample_size
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, new_figure

X = np.linspace(-0.4, 0.4, 801)
"""Places along a corridor (m)."""


def gaussian(x: np.ndarray, mean: float, sigma: float) -> np.ndarray:
    """Return the normal density."""
    return np.exp(-0.5 * ((x - mean) / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))


@dataclass(frozen=True)
class Proposals:
    """A particle's prediction with the spread of its odometry, and the place that a scan names much more sharply."""

    predicted: float = 0.0
    sigma_motion: float = 0.1
    seen: float = 0.12
    sigma_scan: float = 0.02
    n: int = 30

    @property
    def prior(self) -> np.ndarray:
        """Return p(x | x', u) at every place of ``X``."""
        return gaussian(X, self.predicted, self.sigma_motion)

    @property
    def likelihood(self) -> np.ndarray:
        """Return p(z | x, m) at every place of ``X``, up to a factor."""
        return gaussian(X, self.seen, self.sigma_scan)

    @property
    def improved(self) -> np.ndarray:
        """Return the product of the two, normalised: the improved proposal."""
        product = self.prior * self.likelihood
        return product / (product.sum() * (X[1] - X[0]))

    def drawn(self, improved: bool, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Return places ``(n,)`` drawn from the motion or from the improved proposal, and their weights ``(n,)``."""
        rng = np.random.default_rng(seed)
        if improved:
            cumulative = np.cumsum(self.improved)
            places = np.interp(
                (np.arange(self.n) + rng.random(self.n)) / self.n, cumulative / cumulative[-1], X
            )
            return places, np.full(self.n, 1 / self.n)
        places = self.predicted + self.sigma_motion * rng.standard_normal(self.n)
        weights = gaussian(places, self.seen, self.sigma_scan)
        return places, weights / weights.sum()

    def n_eff(self, improved: bool) -> float:
        """Return the effective number of particles."""
        return effective_sample_size(self.drawn(improved)[1])


def proposals_picture(case: Proposals) -> Picture:
    """Draw the three densities, and thirty particles drawn from either proposal with the size of their weights."""
    figure, (top, bottom) = new_figure(6.2, 4.6, rows=2, height_ratios=[1.7, 1], sharex=True)
    top.plot(
        X,
        case.prior,
        color=COLOURS["odometry"],
        linestyle="--",
        label=r"motion  $p(\mathbf{x}_t | \mathbf{x}_{t-1}, \mathbf{u}_t)$",
    )
    top.plot(
        X, case.likelihood, color=COLOURS["hits"], label=r"scan  $p(\mathbf{z}_t | \mathbf{x}_t, \mathbf{m})$"
    )
    top.plot(X, case.improved, color=COLOURS["estimate"], linewidth=3, alpha=0.6, label="their product")
    top.set(yticks=[], ylim=(0, None))
    top.legend(loc="upper left", fontsize=10)
    for row, improved in enumerate((False, True)):
        places, weights = case.drawn(improved)
        colour = COLOURS["estimate" if improved else "odometry"]
        bottom.scatter(
            places, np.full(case.n, -row), s=12 + 900 * weights, color=colour, alpha=0.5, linewidths=0
        )
    bottom.set_yticks([0, -1], ["from the motion", "from the product"])
    bottom.set(ylim=(-1.6, 0.6), xlabel="place along the corridor [m]", xlim=(-0.3, 0.3))
    alt = f"""Above: a wide density from the motion, a narrow one from the scan beside its middle, and their product.
    Below: {case.n} particles drawn from the motion, of which {case.n_eff(False):.1f} count (N_eff), and {case.n} drawn
    from the product, which all count."""
    return Picture(figure, alt)
