"""Chapter 05, one scan in slow motion: a single update of the textbook filter, picture by picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.io.datasets import load
from pfslam_book.ch05.your_filter import BOOK, Filter, Settings, my_filter, scans_and_controls, step
from pfslam_book.show.figures import draw_map
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, INK, PAPER, metric_axes, new_figure
from pfslam_book.show.widgets import Explorer, Slider

PARTICLES, EVERY, BLIND = 24, 20, 6
"""Few particles, so that each can be seen; ``BLIND`` used scans are left out before the one that is shown."""
SECONDS = 32.0
"""When the scan is taken, after the first: at the end of a corridor."""
SETTINGS = Settings(sigma_v=0.3, sigma_omega=0.14, sharpness=0.02)
ZOOM = 0.22
"""Half the width (m) of the pictures of the cloud."""
NAMES, LOOKS = "ABC", ("particle A", "particle B", "particle C")


@dataclass(frozen=True, eq=False)
class Update:
    """All that one update computes, in order; ``chosen`` are a good, a middling and a bad particle."""

    points_b: np.ndarray
    before: np.ndarray
    predicted: np.ndarray
    counts: np.ndarray
    weights: np.ndarray
    offset: float
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
    def after(self) -> np.ndarray:
        """The cloud after resampling, moved apart a little by the next prediction's noise."""
        return self.predicted[self.ancestors]

    @property
    def colours(self) -> np.ndarray:
        """The colour of every old particle: A, B and C have one each, which their descendants keep."""
        colours = np.full(PARTICLES, COLOURS["particles"])
        colours[self.chosen] = [COLOURS[look] for look in LOOKS]
        return colours


@lru_cache(maxsize=1)
def one_update() -> Update:
    """A filter driven through ``hall`` up to ``SECONDS``, then left blind for a while, then shown one scan."""
    hall, f, s, rng = load("hall"), my_filter(file="none"), SETTINGS, np.random.default_rng(4)
    poses, weights = np.zeros((PARTICLES, 3)), np.full(PARTICLES, 1 / PARTICLES)
    log_odds, waiting = np.zeros(s.shape), []
    scans = list(scans_and_controls(f, s, hall, EVERY, SECONDS))
    truth = hall.true_path()
    for k, (_, points_b, inputs) in enumerate(scans):
        if k < len(scans) - BLIND:  # the map of the past is drawn by the filter itself
            state = step(f, s, poses, weights, log_odds, points_b, inputs, rng)
            poses, weights, log_odds, _ = state
        else:
            waiting += inputs
    poses, _ = BOOK["resample"](poses, weights, rng)
    return _shown(f, s, poses, waiting, points_b, log_odds, truth.at(scans[-1][0]), rng)


def _shown(f: Filter, s: Settings, before, inputs, points_b, log_odds, true_pose, rng) -> Update:
    predicted = before
    for v, omega, dt in inputs:
        predicted = f.move(predicted, v, omega, dt, s.sigma_v, s.sigma_omega * (v != 0), rng)
    walls = log_odds > 0
    scans = [f.to_world(pose, points_b) for pose in predicted]
    counts = np.array([f.count_on_walls(points, walls, s.origin, s.resolution) for points in scans])
    weights = f.update(np.full(PARTICLES, 1 / PARTICLES), np.exp(s.sharpness * (counts - counts.max())))
    estimate, offset = f.mean_pose(predicted, weights), 0.4
    teeth = (np.arange(PARTICLES) + offset) / PARTICLES
    ancestors = np.searchsorted(np.cumsum(weights), teeth, side="right")
    hits = f.cell_of(f.to_world(estimate, points_b), s.origin, s.resolution)
    nothing = np.zeros((0, 2), dtype=int)
    drawn = f.update_log_odds(log_odds, hits, nothing, s.hit, s.free, s.clamp)
    return Update(
        points_b, before, predicted, counts, weights, offset, ancestors, log_odds, drawn, estimate, true_pose
    )


# ---- the pictures


def _map(axes: Axes, log_odds: np.ndarray, middle: np.ndarray, reach: float) -> None:
    grid = OccupancyGrid(
        GridSpec(SETTINGS.origin, SETTINGS.resolution, SETTINGS.shape), log_odds.astype(np.float32)
    )
    draw_map(axes, grid)
    axes.set(xlim=(middle[0] - reach, middle[0] + reach), ylim=(middle[1] - reach, middle[1] + reach))
    axes.set(xticks=(), yticks=(), xlabel=f"{2 * reach:.0f} m wide", ylabel="")
    axes.set_facecolor(COLOURS["unknown"])


def _cloud(axes: Axes, poses: np.ndarray, colours, sizes=30.0, length: float = 0.12) -> None:
    """Particles as dots with a line along their heading, in one colour or a colour for each."""
    x, y, theta = poses.T
    colours, sizes = (np.broadcast_to(values, len(poses)) for values in (colours, sizes))
    for k in range(len(poses)):
        ends = [x[k], x[k] + length * np.cos(theta[k])], [y[k], y[k] + length * np.sin(theta[k])]
        axes.plot(*ends, color=colours[k], linewidth=0.8)
    axes.scatter(x, y, s=sizes, c=list(colours), linewidths=0, alpha=0.85, zorder=3)


def _letters(axes: Axes, u: Update, x: np.ndarray, y: np.ndarray, **look) -> None:
    for k, name, colour in zip(u.chosen, NAMES, LOOKS, strict=True):
        axes.annotate(
            name, (x[k], y[k]), color=COLOURS[colour], fontweight="bold", fontsize=13, zorder=5, **look
        )


def _scan_of(k: int) -> Callable[[Axes, Axes, Update], str]:
    """The scan laid on the map from the k-th chosen particle."""

    def draw(left: Axes, right: Axes, u: Update) -> str:
        particle = u.chosen[k]
        _map(left, u.log_odds, u.true_pose, 6.0)
        x, y = BOOK["to_world"](u.predicted[particle], u.points_b).T
        left.scatter(x, y, s=3, color=COLOURS[LOOKS[k]], zorder=3)
        bars = u.counts[u.chosen[: k + 1]]
        right.bar(list(NAMES[: k + 1]), bars, color=[COLOURS[c] for c in LOOKS[: k + 1]], width=0.6)
        right.set(ylabel="points on walls", ylim=(0, 1.15 * u.counts.max()), xlim=(-0.6, 2.6))
        return f"score {NAMES[k]}: {u.counts[particle]} of {len(u.points_b)} points on walls"

    return draw


def _before(left: Axes, right: Axes, u: Update) -> str:
    _map(left, u.log_odds, u.true_pose, 6.0)
    _cloud(left, u.before, COLOURS["particles"], 8.0)
    _zoom(right, u, u.before, COLOURS["particles"], 30.0, u.before[:, :2].mean(axis=0))
    return "before: map and cloud of the last scan"


def _predicted(left: Axes, right: Axes, u: Update) -> str:
    _map(left, u.log_odds, u.true_pose, 6.0)
    for a, b, colour in zip(u.before, u.predicted, u.colours, strict=True):
        left.plot(*np.stack([a, b])[:, :2].T, color=colour, linewidth=0.6)
    _cloud(left, u.predicted, u.colours, 8.0)
    _zoom(right, u, u.predicted, u.colours, 30.0, u.true_pose, letters=True)
    return "predict: each drives by its own noise"


def _zoom(axes: Axes, u: Update, poses, colours, sizes, middle, letters: bool = False) -> None:
    _cloud(axes, poses, colours, sizes, 0.05)
    axes.plot(*u.true_pose[:2], "x", color=COLOURS["truth"], markersize=9, markeredgewidth=2.5, zorder=6)
    if letters:
        _letters(axes, u, *u.predicted[:, :2].T, xytext=(4, 4), textcoords="offset points")
    metric_axes(axes)
    axes.set(
        xlim=(middle[0] - ZOOM, middle[0] + ZOOM),
        ylim=(middle[1] - ZOOM, middle[1] + ZOOM),
        xticks=(),
        yticks=(),
    )
    axes.set(xlabel=f"{2 * ZOOM:g} m; cross: truth", ylabel="")


def _weights(left: Axes, right: Axes, u: Update) -> str:
    _zoom(left, u, u.predicted, u.colours, 30 * PARTICLES * u.weights, u.true_pose, letters=True)
    right.bar(np.arange(PARTICLES), u.weights, color=list(u.colours))
    _letters(right, u, np.arange(PARTICLES), u.weights, ha="center", va="bottom")
    right.set(xlabel="particle", ylabel="weight", ylim=(0, 1.25 * u.weights.max()))
    return "weigh: exp(sharpness × count)"


def _comb(left: Axes, right: Axes, u: Update) -> str:
    draw_comb(left, u.weights, u.offset, u.colours)
    rows, inherited = np.arange(PARTICLES), u.colours[u.ancestors]
    for column, colours in ((0, u.colours), (1, inherited)):
        right.scatter(np.full(PARTICLES, column), rows, s=14, c=list(colours), zorder=3)
    for new, old in enumerate(u.ancestors):
        right.plot([0, 1], [old, new], color=inherited[new], linewidth=0.8)
    right.set(xticks=(0, 1), xlim=(-0.2, 1.2), yticks=())
    right.set_xticklabels(("old", "new"))
    right.grid(False)
    return f"resample: {len(np.unique(u.ancestors))} of {PARTICLES} have descendants"


def _after(left: Axes, right: Axes, u: Update) -> str:
    spread = 0.004 * np.random.default_rng(0).standard_normal((PARTICLES, 3))
    _zoom(left, u, u.predicted, u.colours, 30.0, u.true_pose)
    _zoom(right, u, u.after + spread, u.colours[u.ancestors], 30.0, u.true_pose)
    left.set_title("cloud before")
    right.set_title("cloud after")
    return "after: copies lie on one another"


def _drawn(left: Axes, right: Axes, u: Update) -> str:
    for axes, log_odds in ((left, u.log_odds), (right, u.drawn)):
        _map(axes, log_odds, u.true_pose, 6.0)
    left.set_title("map before")
    right.set_title("map after")
    return "draw: the scan goes into the map"


STEPS: tuple[Callable[[Axes, Axes, Update], str], ...] = (
    _before, _predicted, _scan_of(0), _scan_of(1), _scan_of(2), _weights, _comb, _after, _drawn
)  # fmt: skip


def draw_step(k: int) -> Figure:
    """One picture of the update."""
    figure, (left, right) = new_figure(5.1, 3.5, columns=2, width_ratios=[1.25, 1])
    figure.suptitle(f"{k}. {STEPS[k - 1](left, right, one_update())}", fontsize=12)
    figure.set_layout_engine("none")  # every picture of the update has its axes in the same places
    if k > 7:  # before and after, side by side at one scale
        left.set_position((0.04, 0.1, 0.44, 0.67))
        right.set_position((0.54, 0.1, 0.44, 0.67))
    else:
        left.set_position((0.13, 0.16, 0.45, 0.67))
        right.set_position((0.745, 0.16, 0.235, 0.67) if k in (3, 4, 5, 6) else (0.64, 0.16, 0.34, 0.67))
    return figure


def describe_step(k: int) -> str:
    """The same in words, with the numbers of the update."""
    u = one_update()
    counts = ", ".join(f"{name} {u.counts[i]}" for name, i in zip(NAMES, u.chosen, strict=True))
    miss = np.hypot(*(u.estimate - u.true_pose)[:2])
    words = (
        f"The cloud of {PARTICLES} particles after the last scan, on the map so far.",
        f"The predicted cloud is {np.hypot(*u.predicted[:, :2].std(axis=0)):.2f} m wide.",
        *(f"The scan on the map from particle {name}. Points on walls: {counts}." for name in NAMES),
        f"Weights as bars; the heaviest is {u.weights.max():.2f}.",
        f"The comb over the cumulative weights, and lines from old to new particles: {len(np.unique(u.ancestors))} "
        "have descendants.",
        f"The cloud after resampling is {np.hypot(*u.after[:, :2].std(axis=0)):.2f} m wide.",
        f"The map before and after the scan was drawn from the mean, which is {miss:.2f} m from the truth.",
    )
    return f"Step {k} of {len(STEPS)}. {words[k - 1]}"


def slow_motion_explorer() -> Explorer:
    """The update, step by step."""
    return Explorer(
        draw_step,
        [Slider("k", tuple(range(1, len(STEPS) + 1)), 0, "Step")],
        alt=describe_step,
        title="One scan in slow motion",
        play="k",
        pause=2500,
    )


# ---- the comb


def draw_comb(axes: Axes, weights: np.ndarray, offset: float, colours: np.ndarray) -> None:
    """The cumulative weights as stairs, and the teeth of the comb from the left to the particles that they pick."""
    n, edges = len(weights), np.concatenate([[0.0], np.cumsum(weights)])
    axes.stairs(edges[1:], np.arange(n + 1), baseline=None, color=COLOURS["particles"], linewidth=1.6)
    for tooth in (np.arange(n) + offset) / n:
        at = int(np.searchsorted(edges[1:], tooth, side="right"))
        axes.plot([0, at], [tooth, tooth], color=INK, linewidth=0.7)
        axes.plot([at, at], [edges[at], edges[at + 1]], color=colours[at], linewidth=3.0)
    axes.set(xlim=(0, n), ylim=(0, 1), xlabel="particle", ylabel="cumulative weight")


def comb_picture(weights=(0.6, 0.25, 0.15), offset: float = 0.637) -> Picture:
    """Three particles and a comb of three teeth: what one does by hand."""
    weights = np.asarray(weights)
    edges, n = np.concatenate([[0.0], np.cumsum(weights)]), len(weights)
    figure, axes = new_figure(5.1, 2.2)
    axes.barh(
        np.zeros(n),
        weights,
        left=edges[:-1],
        color=COLOURS["particles"],
        edgecolor=PAPER,
        linewidth=3,
        height=0.6,
    )
    for k in range(n):
        axes.text(edges[k] + weights[k] / 2, 0, f"{k}", ha="center", va="center", fontsize=14)
    teeth = (np.arange(n) + offset) / n
    for tooth in teeth:
        axes.annotate("", (tooth, 0.3), (tooth, 0.85), arrowprops={"arrowstyle": "-|>", "linewidth": 2.0})
        axes.text(tooth, 0.9, f"{tooth:.3f}", ha="center", va="bottom")
    axes.plot(teeth[[0, -1]], [0.85, 0.85], color=INK, linewidth=2.0)
    axes.set(xlim=(0, 1), ylim=(-0.4, 1.3), yticks=(), xticks=edges.round(2), xlabel="cumulative weight")
    axes.grid(False)
    ancestors = np.searchsorted(edges[1:], teeth, side="right").tolist()
    alt = f"""A bar from 0 to 1 with the shares of three particles, {", ".join(f"{w:g}" for w in weights)}. A comb with
    teeth at {", ".join(f"{t:.3f}" for t in teeth)} points at the particles {ancestors}."""
    return Picture(figure, alt)
