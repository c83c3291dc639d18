"""Chapter 05, the report's central step: 729 poses around one particle, and the jump to the best of them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pfslam_book.ch05.slow_motion import LOOKS, SETTINGS, one_update
from pfslam_book.ch05.your_filter import BOOK
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, PAPER, new_figure

CELLS, YAWS, STEP_XY, STEP_YAW = 4, 4, 0.05, 0.005
"""The report's window: so many steps each way, in m and rad."""


@lru_cache(maxsize=4)
def window_scores(particle: int) -> np.ndarray:
    """Counts ``(9, 9, 9)`` (yaw, y, x) of the poses around one predicted particle of the scan in slow motion."""
    u, s = one_update(), SETTINGS
    pose, walls = u.predicted[particle], u.log_odds > 0
    steps = np.arange(-CELLS, CELLS + 1)
    scores = np.empty((2 * YAWS + 1, len(steps), len(steps)), dtype=int)
    for i, yaw in enumerate(np.arange(-YAWS, YAWS + 1)):
        turned = BOOK["to_world"](pose + [0, 0, yaw * STEP_YAW], u.points_b)
        for j, dy in enumerate(steps):
            for k, dx in enumerate(steps):
                moved = turned + STEP_XY * np.array([dx, dy])
                scores[i, j, k] = BOOK["count_on_walls"](moved, walls, s.origin, s.resolution)
    return scores


def best_step(particle: int) -> tuple[np.ndarray, int]:
    """The step (m, m, rad) to the best pose of the window, and its count."""
    scores = window_scores(particle)
    i, j, k = np.unravel_index(int(np.argmax(scores)), scores.shape)
    return np.array([(k - CELLS) * STEP_XY, (j - CELLS) * STEP_XY, (i - YAWS) * STEP_YAW]), int(scores.max())


def window_picture() -> Picture:
    """The window of a particle at three of its nine headings, and where the best of the 729 poses lies."""
    particle = int(one_update().chosen[1])
    scores, (step, best) = window_scores(particle), best_step(particle)
    at = round(step[2] / STEP_YAW) + YAWS
    shown = sorted({0, YAWS, at} | ({2 * YAWS} if at in (0, YAWS) else set()))
    figure, row = new_figure(5.1, 2.7, columns=len(shown), sharey=True)
    edge = (CELLS + 0.5) * STEP_XY
    for axes, i in zip(row, shown, strict=True):
        image = axes.imshow(scores[i], origin="lower", extent=(-edge, edge, -edge, edge), vmin=0, vmax=best)
        for colour, wider in ((PAPER, 3.0), (COLOURS[LOOKS[1]], 0.0)):  # with a light rim, on any count
            axes.plot(0, 0, "+", color=colour, markersize=12 + wider, markeredgewidth=2.5 + wider)
            if i == at:
                axes.plot(*step[:2], "o", color=colour, markersize=9, mfc="none", mew=2.5 + wider)
        axes.set(
            xticks=(-0.2, 0, 0.2), yticks=(-0.2, 0, 0.2), title=f"{np.rad2deg((i - YAWS) * STEP_YAW):+.1f}°"
        )
        axes.grid(False)
    row[0].set_ylabel("dy [m]")
    row[len(shown) // 2].set_xlabel("dx [m]")
    figure.colorbar(image, ax=row, label="count", shrink=0.7)
    before = scores[YAWS, CELLS, CELLS]
    alt = f"""Scores of the poses around one particle at three headings. Where it stands (plus) it scores {before}; the
    best of 729 poses, {np.hypot(*step[:2]):.2f} m and {np.rad2deg(step[2]):.1f}° away (circle), scores {best}."""
    return Picture(figure, alt)


def moved_to_best() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For every particle of the scan: its count where it stands, the best of its window, and where it jumps to."""
    u = one_update()
    steps, best = zip(*(best_step(particle) for particle in range(len(u.predicted))), strict=True)
    return u.counts, np.array(best), u.predicted + np.array(steps)
