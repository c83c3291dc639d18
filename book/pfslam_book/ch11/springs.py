"""Chapter 11: a graph of six poses small enough to solve on the page, and what one false edge does to a larger one."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pfslam.beyond.loops.graph import Edges, relax, robust_weights
from pfslam.poses import between, compose
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, metric_axes, new_figure
from pfslam_book.show.widgets import Explorer, Slider

SIDE = 2.0
SIGMAS = np.array([0.1, 0.1, 0.05])
"""Standard deviations (m, m, rad) of every motion of the small graphs."""


def edges_of(ends: list[tuple[int, int]], poses: np.ndarray, doubtful: bool) -> Edges:
    """Make edges of equal trust between pairs of poses."""
    n, (i, j) = len(ends), np.array(ends).T
    information = np.tile(np.diag(SIGMAS**-2), (n, 1, 1))
    return Edges(i, j, poses, information, np.zeros(n), np.full(n, doubtful))


def true_path(n: int) -> np.ndarray:
    """Return true poses ``(n, 3)`` round a square: two steps a side, then a left turn."""
    poses = [np.zeros(3)]
    for k in range(1, n):
        poses.append(compose(poses[-1], [SIDE, 0.0, 0.5 * np.pi if k % 2 == 0 else 0.0]))
    return np.array(poses)


def driven(n: int, turn: float = 0.06) -> tuple[np.ndarray, Edges]:
    """Return the poses that a robot believes in whose every motion turns too far by ``turn`` (rad), and the motions."""
    truth = true_path(n)
    motions = between(truth[:-1], truth[1:]) + [0.03, 0.0, turn]
    poses = [np.zeros(3)]
    for motion in motions:
        poses.append(compose(poses[-1], motion))
    return np.array(poses), edges_of([(k, k + 1) for k in range(n - 1)], motions, False)


def six_poses() -> tuple[np.ndarray, Edges]:
    """Return six poses as dead reckoning has them, and six edges: the five motions, and one loop from first to last."""
    poses, chain = driven(6)
    truth = true_path(6)
    return poses, chain.joined(edges_of([(0, 5)], between(truth[:1], truth[5:]), True))


def springs_picture(edges: Edges, before: np.ndarray, after: np.ndarray) -> Picture:
    """Draw a graph before and after it is relaxed; the loop says where the last pose should be, seen from the first."""
    figure, axes = new_figure(6.8, 3.8, columns=2, sharex=True, sharey=True)
    for ax, poses, title in zip(axes, (before, after), ("as driven", "relaxed"), strict=True):
        draw_graph(ax, edges, poses)
        metric_axes(ax, title)
    gap = np.hypot(*(compose(before[0], edges.pose[-1]) - before[-1])[:2])
    left = np.hypot(*(compose(after[edges.i[-1]], edges.pose[-1]) - after[edges.j[-1]])[:2])
    alt = f"""Six poses on three sides of a square, joined by five motions, and a loop from the first to the last. As
    driven, the last pose is {gap:.2f} m from where the loop says it is. Relaxed, {left:.2f} m are left of it, and all
    poses but the first have moved."""
    return Picture(figure, alt)


def draw_graph(ax, edges: Edges, poses: np.ndarray, weights: np.ndarray | None = None) -> None:
    """Draw poses as arrows, motions as lines, and what each loop claims as a dashed line from its measured end."""
    for e, (i, j) in enumerate(zip(edges.i, edges.j, strict=True)):
        if edges.doubtful[e]:
            claimed = compose(poses[i], edges.pose[e])
            alpha = 1.0 if weights is None else 0.25 + 0.75 * float(weights[e])
            ends = np.array([poses[j], claimed])
            ax.plot(*poses[[i, j], :2].T, color=COLOURS["highlight"], linewidth=1.0, alpha=alpha)
            ax.plot(*ends[:, :2].T, color=COLOURS["hits"], linewidth=2.5, linestyle=":", alpha=alpha)
        else:
            ax.plot(*poses[[i, j], :2].T, color=COLOURS["estimate"], linewidth=1.4)
    arrows = 0.5 * np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    ax.quiver(*poses[:, :2].T, *arrows.T, color=COLOURS["estimate"], angles="xy", scale_units="xy", scale=1)
    ax.scatter(*poses[:, :2].T, s=18, color=COLOURS["estimate"], zorder=3)


def outlier_case(false: float, kernel: str) -> tuple[Edges, np.ndarray, np.ndarray, float]:
    """Relax two rounds of a square with three true loops and one that is off by ``false`` (m).

    Returns edges, poses, weights, and the error (m, root mean square).
    """
    n = 16
    start, chain = driven(n, turn=0.02)
    truth = true_path(n)
    ends = [(0, 8), (2, 10), (7, 15), (3, 11)]
    measured = between(truth[[i for i, _ in ends]], truth[[j for _, j in ends]])
    measured[3] += [false, -0.5 * false, 0.1 * false]
    edges = chain.joined(edges_of(ends, measured, kernel == "with"))
    poses, _, weights = relax(edges, start)
    return edges, poses, weights, float(np.sqrt(np.mean(np.sum((poses - truth)[:, :2] ** 2, axis=1))))


def outlier_explorer() -> Explorer:
    """Return the widget in which one of four loops is false by a chosen length, with a kernel or without."""
    controls = [
        Slider("false", (0.0, 0.2, 0.4, 0.7, 1.0, 1.5, 2.0, 3.0), 6, "One loop is off by", "m"),
        Slider("kernel", ("without", "with"), 0, "Robust kernel"),
    ]
    return Explorer(_frame, controls, title="One false loop among four", alt=_alt)


def _frame(false: float, kernel: str) -> Figure:
    edges, poses, weights, error = outlier_case(false, kernel)
    figure, axes = new_figure(6.8, 3.8, columns=2, width_ratios=[1.2, 1])
    truth = true_path(len(poses))
    axes[0].plot(*truth[:, :2].T, color=COLOURS["truth"], linewidth=3, alpha=0.3)
    edges = Edges(
        *[
            *(getattr(edges, n) for n in ("i", "j", "pose", "information", "wheels")),
            np.arange(len(edges)) > 14,
        ]
    )
    draw_graph(axes[0], edges, poses, weights)
    metric_axes(axes[0], f"{100 * error:.0f} cm off")
    axes[0].set(xlim=(-2.5, 6.5), ylim=(-2.5, 6.5))
    names = ["true", "true", "true", "false"]
    axes[1].bar(range(4), weights[-4:], color=[COLOURS["estimate"]] * 3 + [COLOURS["hits"]])
    axes[1].set_xticks(range(4), names)
    axes[1].set(ylim=(0, 1.05), title="weight of each loop")
    return figure


def _alt(false: float, kernel: str) -> str:
    _, _, weights, error = outlier_case(false, kernel)
    return f"""Two rounds of a square, {kernel} the robust kernel; one of four loops is off by {false:g} m. The path is
    {100 * error:.0f} cm from the truth; the false loop keeps a weight of {weights[-1]:.2f}, the true ones at least
    {weights[-4:-1].min():.2f}."""


def kernel_picture() -> Picture:
    """Draw the cost of an error and the weight that it gets, squared and under the kernel at three widths."""
    figure, axes = new_figure(6.8, 3.2, columns=2)
    chi = np.linspace(0.0, 12.0, 200)
    axes[0].plot(chi, chi**2, color=COLOURS["truth"], label="square")
    axes[1].plot(chi, np.ones_like(chi), color=COLOURS["truth"], label="square")
    for width, name in ((3.0, "highlight"), (5.0, "free"), (10.0, "estimate")):
        axes[0].plot(
            chi, width**2 * chi**2 / (width**2 + chi**2), color=COLOURS[name], label=f"k = {width:.0f}"
        )
        axes[1].plot(chi, robust_weights(chi**2, width), color=COLOURS[name])
    axes[0].set(xlabel=r"error $\chi$ [std]", ylabel="cost", ylim=(0, 60))
    axes[1].set(xlabel=r"error $\chi$ [std]", ylabel="weight", ylim=(0, 1.05))
    axes[0].legend(loc="upper left")
    alt = """Left, cost against error: the square grows without end, the kernel's levels off at its width squared.
    Right, the weight: one for the square, and for the kernel it falls to a quarter at its width and towards zero."""
    return Picture(figure, alt)
