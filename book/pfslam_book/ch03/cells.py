"""Chapter 03, the corridor with particles: predict, weigh and resample beside the exact histogram."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pfslam.particles import effective_sample_size, systematic_resample
from pfslam_book.ch03.corridor import (
    CELLS,
    DOORS,
    MOVES,
    STEP,
    TRUE_START,
    door_likelihood,
    predict_belief,
    update_belief,
)
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, new_figure

PARTICLES = 30


def predict_cells(cells: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Every particle moves by a step of its own, drawn from what a move may do."""
    return (cells + rng.choice(list(STEP), size=len(cells), p=list(STEP.values()))) % CELLS


def weigh_cells(weights: np.ndarray, cells: np.ndarray, sees_door: bool) -> np.ndarray:
    """Every weight times the likelihood of the look from the particle's cell, normalised."""
    weights = weights * door_likelihood(sees_door)[cells]
    return weights / weights.sum()


@dataclass(frozen=True, eq=False)
class Act:
    """One moment of the walk: the cloud with its weights, the exact belief, and the true cell."""

    what: str
    cells: np.ndarray
    weights: np.ndarray
    belief: np.ndarray
    true_cell: int

    @property
    def histogram(self) -> np.ndarray:
        """The belief that the weighted particles stand for, cell by cell."""
        return np.bincount(self.cells, self.weights, CELLS)

    @property
    def n_eff(self) -> float:
        """The number of particles that still count."""
        return effective_sample_size(self.weights)


@lru_cache(maxsize=64)
def particle_walk(resampling: bool = True, n: int = PARTICLES, seed: int = 3) -> tuple[Act, ...]:
    """The walk of the histogram with ``n`` particles: weigh, resample if asked to, move, and so on."""
    rng, cell, belief = np.random.default_rng(seed), TRUE_START, np.full(CELLS, 1 / CELLS)
    cells, weights = np.arange(n) % CELLS, np.full(n, 1 / n)
    acts = [Act("wakes up", cells, weights, belief, cell)]
    for move in range(MOVES + 1):
        if move:
            cell, belief = cell + 1, predict_belief(belief, STEP)
            cells = predict_cells(cells, rng)
            acts.append(Act("predict", cells, weights, belief, cell))
        sees = cell in DOORS
        belief, weights = update_belief(belief, door_likelihood(sees)), weigh_cells(weights, cells, sees)
        acts.append(Act("weigh: a door" if sees else "weigh: no door", cells, weights, belief, cell))
        if resampling:
            cells, weights = cells[systematic_resample(weights, rng)], np.full(n, 1 / n)
            acts.append(Act("resample", cells, weights, belief, cell))
    return tuple(acts)


def fates(n: int, runs: int = 200) -> dict[str, float]:
    """Mean N_eff after ten looks without resampling; with it, the share of runs that lost the true cell."""
    alone = [particle_walk(False, n, seed)[-1] for seed in range(runs)]
    drawn = [particle_walk(True, n, seed)[-2] for seed in range(runs)]
    return {
        "n_eff": float(np.mean([act.n_eff for act in alone])),
        "died out": float(np.mean([act.true_cell not in act.cells for act in drawn])),
    }


# ---- importance sampling


def importance_picture(n: int = 150, seed: int = 1) -> Picture:
    """A target belief, and draws from two proposals that weights turn into it."""
    before, act = particle_walk(True)[9:11]
    target, figure_words = act.belief, []
    figure, rows = new_figure(5.1, 5.4, rows=2, sharex=True)
    for axes, proposal, name in zip(
        rows, (before.belief, np.full(CELLS, 1 / CELLS)), ("the prediction", "all cells alike"), strict=True
    ):
        drawn = np.random.default_rng(seed).choice(CELLS, n, p=proposal)
        weights = target[drawn] / proposal[drawn]
        weights /= weights.sum()
        n_eff, weighted = effective_sample_size(weights), np.bincount(drawn, weights, CELLS)
        axes.bar(np.arange(CELLS), target, color=COLOURS["unknown"], width=0.8, label="target")
        counts = np.bincount(drawn, minlength=CELLS) / n
        axes.plot(
            np.arange(CELLS), counts, "o", markersize=8, mfc="none", color=COLOURS["particles"], label="drawn"
        )
        axes.plot(
            np.arange(CELLS),
            weighted,
            "x",
            markersize=9,
            mew=2.2,
            color=COLOURS["estimate"],
            label="weighted",
        )
        axes.set(ylim=(0, 0.7), yticks=(0, 0.3, 0.6), xlim=(-0.6, CELLS - 0.4), xticks=range(0, CELLS, 2))
        axes.set_title(rf"from {name}: $N_\mathrm{{eff}}$ = {n_eff:.0f} of {n}", loc="left", fontsize=12)
        miss = np.abs(weighted - target).max()
        figure_words.append(f"from {name}, N_eff {n_eff:.0f} of {n}, greatest miss {miss:.2f}")
    rows[0].legend(loc="upper right")
    rows[1].set_xlabel("cell")
    alt = f"""A target belief over fifteen cells as bars, and {n} draws. Weighted by target over proposal, the draws
    come to lie on the bars: {"; ".join(figure_words)}."""
    return Picture(figure, alt)
