"""Chapter 11: a belief as ellipses and as a matrix, one picture for each moment of a drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from pfslam_book.ch11.drives import STEP, Drive
from pfslam_book.show.style import COLOURS, metric_axes, sheet
from pfslam_book.show.widgets import Explorer, Slider

IN_95_PERCENT = 5.99
"""Square of the size of an ellipse that holds 95 % of a normal distribution of two numbers."""
Belief = tuple[np.ndarray, np.ndarray]


def ellipse(axes: Axes, mean: np.ndarray, covariance: np.ndarray, kind: str = "estimate") -> None:
    """Draw the ellipse that holds 95 % of a normal distribution of two coordinates (m)."""
    variances, directions = np.linalg.eigh(covariance)
    width, height = 2.0 * np.sqrt(IN_95_PERCENT * np.maximum(variances, 0.0))
    angle = np.rad2deg(np.arctan2(directions[1, 0], directions[0, 0]))
    axes.add_patch(
        Ellipse((mean[0], mean[1]), width, height, angle=angle, facecolor=COLOURS[kind], alpha=0.25, lw=0)
    )
    axes.plot(*mean, ".", ms=5, color=COLOURS[kind])


def correlations(P: np.ndarray) -> np.ndarray:
    """Return the correlations that belong to a covariance; a number that is certain has none."""
    sigma = np.sqrt(np.diag(P))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(P / np.outer(sigma, sigma))


def draw_belief(row: Sequence[Axes], drive: Drive, t: int, belief: Belief, title: str = "") -> None:
    """Draw a belief after step ``t``: robot and posts as ellipses on the left, all correlations on the right."""
    (x, P), numbers = belief, 3 + 2 * len(drive.posts)
    row[0].plot(*drive.path[: t + 1, :2].T, color=COLOURS["truth"], ls=":", lw=1.2)
    row[0].plot(*drive.posts.T, "k+", ms=6, mew=1.2)
    for i in range(3, len(x), 2):
        ellipse(row[0], x[i : i + 2], P[i : i + 2, i : i + 2])
    ellipse(row[0], x[:2], P[:2, :2], "odometry")
    metric_axes(row[0], title).set(xlim=(-4, 26), ylim=(-5, 25))
    whole = np.full((numbers, numbers), np.nan)
    whole[: len(x), : len(x)] = correlations(P)
    order = np.r_[0:3, 3:numbers:2, 4:numbers:2]  # x before y: side by side they look like a chessboard
    row[1].imshow(whole[np.ix_(order, order)], vmin=-1.0, vmax=1.0, cmap="RdBu")
    row[1].grid(False)
    ticks = [1, 3 + len(drive.posts) // 2, 3 + 3 * len(drive.posts) // 2]
    row[1].set_xticks(ticks[1:], ["x of posts", "y of posts"])
    row[1].set_yticks(ticks, ["robot", "x", "y"])
    row[1].set_title(f"{len(x)} numbers")


def slam_explorer(runs: Mapping[float, tuple[Drive, Sequence[Belief]]]) -> Explorer:
    """Return the widget that shows the beliefs of EKF-SLAM over a drive, for each noise of the turns (degrees)."""
    seconds = (1, 12, 20, 28, 38, 46, 56, 64, 76, 90, 95, 104)

    def moment(time: float, noise: float) -> tuple[Drive, int, Belief]:
        drive, beliefs = runs[noise]
        t = round(time / STEP)
        return drive, t, beliefs[t]

    def draw(time: float, noise: float) -> Figure:
        figure, row = sheet(3.9, columns=2, width_ratios=[1.1, 1])
        draw_belief(row, *moment(time, noise), title=f"after {time:g} s")
        return figure

    def alt(time: float, noise: float) -> str:
        drive, t, (x, P) = moment(time, noise)
        off = np.hypot(*(x[:2] - drive.path[t, :2]))
        return f"""After {time:g} s, turns wrong by {noise:g} degrees a step: {len(x) // 2 - 1} posts in the state. The
        robot's ellipse has a standard deviation of {100 * np.sqrt(P[0, 0] + P[1, 1]):.0f} cm, its error is
        {100 * off:.0f} cm."""

    controls = [
        Slider("time", seconds, 6, "Time", "s"),
        Slider("noise", tuple(runs), 0, "Turns are wrong by", "degrees a step"),
    ]
    return Explorer(draw, controls, title="Robot, posts and what ties them", alt=alt, play="time")
