"""Chapter 05, one scan in slow motion: a single step of the printed filter, picture by picture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.io.datasets import load
from pfslam_book.ch05.your_filter import Settings, moments, my_filter, step
from pfslam_book.show.artists import COLOURS, draw_map, plan, sheet
from pfslam_book.show.style import INK
from pfslam_book.show.widgets import Explorer, Slider

PARTICLES, EVERY, BLIND = 24, 20, 6
"""Few particles, so that each can be seen; ``BLIND`` used scans are left out before the one that is shown."""
SECONDS = 32.0
"""When the scan is taken, after the first: at the end of a corridor."""
SETTINGS = Settings(sigma_v=0.3, sigma_omega=0.14, sharpness=21.0)
NEAR, FAR = 0.22, 6.0
"""Half the width (m) of the pictures of the cloud, and of the map."""
LOOKS = {"A": "particle A", "B": "particle B", "C": "particle C"}


@dataclass(frozen=True, eq=False)
class Update:
    """All that one step computes, in order; ``chosen`` are a good, a middling and a bad particle."""

    points_b: np.ndarray
    before: np.ndarray
    predicted: np.ndarray
    counts: np.ndarray
    weights: np.ndarray
    ancestors: np.ndarray
    log_odds: np.ndarray
    drawn: np.ndarray
    estimate: np.ndarray
    true_pose: np.ndarray

    @property
    def chosen(self) -> np.ndarray:
        order = np.argsort(-self.counts, kind="stable")
        return order[[0, PARTICLES // 3, -1]]

    @property
    def colours(self) -> np.ndarray:
        """The colour of every old particle: A, B and C have one each, which their descendants keep."""
        colours = np.full(PARTICLES, COLOURS["particles"])
        colours[self.chosen] = [COLOURS[look] for look in LOOKS.values()]
        return colours


@lru_cache(maxsize=1)
def one_update() -> Update:
    """A filter driven through ``hall`` up to ``SECONDS``, then left blind for a while, then shown one scan."""
    hall, f, s, rng = load("hall"), my_filter(file="none"), SETTINGS, np.random.default_rng(4)
    poses, weights = np.zeros((PARTICLES, 3)), np.full(PARTICLES, 1 / PARTICLES)
    log_odds, waiting = np.zeros(s.shape), []
    *past, (t, points_b, inputs) = moments(f, hall, EVERY, SECONDS)
    for _, points, driven in past[: 1 - BLIND]:  # the map of the past is drawn by the filter itself
        poses, weights, log_odds, _ = step(f, s, poses, weights, log_odds, points, driven, rng)
    for _, _, driven in past[1 - BLIND :]:
        waiting += driven
    before, _ = f.resample(poses, weights, rng)
    predicted = before
    for v, omega, dt in waiting + inputs:
        predicted = f.move(predicted, v, omega, dt, s.sigma_v, s.sigma_omega, rng)
    scans = [f.to_world(pose, points_b) for pose in predicted]
    counts = np.array([f.count_on_walls(p, log_odds > 0, s.origin, s.resolution) for p in scans])
    likelihood = np.exp(s.sharpness * (counts - counts.max()) / len(points_b))
    weights = f.update(np.full(PARTICLES, 1 / PARTICLES), likelihood)
    estimate = f.mean_pose(predicted, weights)
    ancestors = np.searchsorted(np.cumsum(weights), (np.arange(PARTICLES) + 0.4) / PARTICLES, side="right")
    hits = f.cell_of(f.to_world(estimate, points_b), s.origin, s.resolution)
    drawn = f.update_log_odds(log_odds, hits, np.zeros((0, 2), dtype=int), s.hit, s.free, s.clamp)
    true_pose = hall.true_path().at(t)
    return Update(
        points_b, before, predicted, counts, weights, ancestors, log_odds, drawn, estimate, true_pose
    )


# ---- what the pictures are made of


def show_map(axes: Axes, log_odds: np.ndarray, u: Update) -> None:
    spec = GridSpec(SETTINGS.origin, SETTINGS.resolution, SETTINGS.shape)
    draw_map(axes, OccupancyGrid(spec, log_odds.astype(np.float32)))
    frame(axes, u.true_pose, FAR, f"{2 * FAR:.0f} m wide")
    axes.set_facecolor(COLOURS["unknown"])


def frame(axes: Axes, middle: np.ndarray, reach: float, words: str) -> None:
    x, y = middle[:2]
    axes.set(
        xlim=(x - reach, x + reach),
        ylim=(y - reach, y + reach),
        xticks=(),
        yticks=(),
        xlabel=words,
        ylabel="",
    )


def show_cloud(axes: Axes, poses: np.ndarray, colours, sizes=40.0, length: float = 0.05) -> None:
    """Particles as dots with a line along their heading."""
    x, y, theta = poses.T
    axes.quiver(x, y, np.cos(theta), np.sin(theta), color=colours, angles="xy", scale_units="xy", scale=1 / length,
                width=0.004, headwidth=1, headlength=0)  # fmt: skip
    axes.scatter(x, y, s=sizes, c=colours, linewidths=0, alpha=0.85, zorder=3)


def show_near(axes: Axes, u: Update, poses: np.ndarray, colours, sizes=40.0, middle=None) -> None:
    """The cloud from near, with the truth."""
    show_cloud(plan(axes), poses, colours, sizes)
    axes.plot(*u.true_pose[:2], "x", color=COLOURS["truth"], markersize=11, markeredgewidth=3, zorder=6)
    frame(axes, u.true_pose if middle is None else middle, NEAR, f"{200 * NEAR:.0f} cm wide; cross: truth")


def name_them(axes: Axes, u: Update, points) -> None:
    for (name, look), k in zip(LOOKS.items(), u.chosen, strict=True):
        axes.annotate(name, points[k], xytext=(4, 4), textcoords="offset points", color=COLOURS[look],
                      fontweight="bold", zorder=7)  # fmt: skip


# ---- the pictures: each draws left and right, and gives its title and its words


def show_before(left, right, u):
    show_map(left, u.log_odds, u)
    show_cloud(left, u.before, COLOURS["particles"], 10.0, 0.12)
    show_near(right, u, u.before, COLOURS["particles"], middle=u.before.mean(axis=0))
    return "before", f"The cloud of {PARTICLES} particles after the last scan, on the map so far."


def show_predict(left, right, u):
    show_map(left, u.log_odds, u)
    for k, colour in enumerate(u.colours):
        left.plot(*np.stack([u.before[k], u.predicted[k]])[:, :2].T, color=colour, lw=0.8)
    show_near(right, u, u.predicted, u.colours)
    name_them(right, u, u.predicted[:, :2])
    wide = np.hypot(*u.predicted[:, :2].std(axis=0))
    return "predict: each drives by its own noise", f"The predicted cloud is {wide:.2f} m wide."


def show_score(name, left, right, u):
    k, among = u.chosen["ABC".index(name)], "ABC"[: "ABC".index(name) + 1]
    show_map(left, u.log_odds, u)
    points = my_filter("none").to_world(u.predicted[k], u.points_b)
    left.scatter(*points.T, s=4, color=COLOURS[LOOKS[name]], zorder=3)
    right.bar(
        list(among), u.counts[u.chosen[: len(among)]], color=[COLOURS[LOOKS[n]] for n in among], width=0.6
    )
    right.set(ylabel="points on walls", ylim=(0, 1.15 * u.counts.max()), xlim=(-0.6, 2.6))
    words = f"{u.counts[k]} of {len(u.points_b)} points on walls"
    return f"score {name}: {words}", f"The scan laid on the map from particle {name}: {words}."


def show_weights(left, right, u):
    show_near(left, u, u.predicted, u.colours, 40 * PARTICLES * u.weights)
    name_them(left, u, u.predicted[:, :2])
    right.bar(np.arange(PARTICLES), u.weights, color=list(u.colours))
    name_them(right, u, list(enumerate(u.weights)))
    right.set(xlabel="particle", ylabel="weight", ylim=(0, 1.25 * u.weights.max()))
    return "weigh: exp(sharpness × share)", f"Weights as bars; the heaviest is {u.weights.max():.2f}."


def show_comb(left, right, u):
    edges, inherited = np.concatenate([[0.0], np.cumsum(u.weights)]), u.colours[u.ancestors]
    left.stairs(edges[1:], np.arange(PARTICLES + 1), baseline=None, color=COLOURS["particles"], lw=1.6)
    for new, old in enumerate(u.ancestors):
        left.plot([0, old], 2 * [(new + 0.4) / PARTICLES], color=INK, lw=0.7)
        left.plot([old, old], edges[old : old + 2], color=u.colours[old], lw=3.0)
        right.plot([0, 1], [old, new], color=inherited[new], lw=0.9)
    left.set(xlim=(0, PARTICLES), ylim=(0, 1), xlabel="particle", ylabel="cumulative weight")
    for column, colours in enumerate((u.colours, inherited)):
        right.scatter(np.full(PARTICLES, column), np.arange(PARTICLES), s=18, c=list(colours), zorder=3)
    right.set(xlim=(-0.2, 1.2), yticks=())
    right.set_xticks((0, 1), ("old", "new"))
    words = f"{len(np.unique(u.ancestors))} of {PARTICLES} have descendants"
    return f"resample: {words}", f"The comb over the cumulative weights, and lines from old to new: {words}."


def show_after(left, right, u):
    apart = 0.004 * np.random.default_rng(0).standard_normal((PARTICLES, 3))
    after = u.predicted[u.ancestors]
    show_near(left, u, u.predicted, u.colours)
    show_near(right, u, after + apart, u.colours[u.ancestors])
    wide = np.hypot(*after[:, :2].std(axis=0))
    return "before and after: copies lie on one another", f"After resampling the cloud is {wide:.2f} m wide."


def show_drawn(left, right, u):
    show_map(left, u.log_odds, u)
    show_map(right, u.drawn, u)
    miss = np.hypot(*(u.estimate - u.true_pose)[:2])
    return "draw: the map before and after", f"The scan is drawn from the mean, {miss:.2f} m from the truth."


def show_score_of(name):
    return lambda *drawing: show_score(name, *drawing)


STEPS = (
    show_before,
    show_predict,
    *map(show_score_of, "ABC"),
    show_weights,
    show_comb,
    show_after,
    show_drawn,
)


def draw_step(k: int) -> tuple[Figure, str]:
    """One picture of the step, and its words."""
    figure, (left, right) = sheet(4.4, 1, 2, width_ratios=[1.25, 1] if k < 8 else [1, 1])
    title, words = STEPS[k - 1](left, right, one_update())
    figure.suptitle(f"{k}. {title}", fontsize=15)
    figure.set_layout_engine("none")  # every picture has its axes in the same places
    high, low = 0.66, 0.17
    left.set_position((0.1, low, 0.46, high) if k < 8 else (0.03, low, 0.46, high))
    right.set_position(
        (0.7, low, 0.28, high)
        if k in (3, 4, 5, 6)
        else (0.6, low, 0.37, high)
        if k < 8
        else (0.52, low, 0.46, high)
    )
    return figure, f"Step {k} of {len(STEPS)}. {words}"


def slow_motion_explorer() -> Explorer:
    """The step, picture by picture."""
    return Explorer(
        lambda k: draw_step(k)[0],
        [Slider("k", tuple(range(1, len(STEPS) + 1)), 0, "Step")],
        alt=lambda k: draw_step(k)[1],
        title="One scan in slow motion",
        play="k",
        pause=2500,
    )
