"""Chapter 12: a graph of six poses small enough to solve on the page, and what one false edge does to a larger one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from pfslam.beyond.loops.graph import Edges, relax
from pfslam.poses import between, compose
from pfslam_book.show.lab import Laboratory, show_lab
from pfslam_book.show.style import COLOURS, metric_axes, sheet
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


def two_rounds(
    false: float, turn: float = 0.02, doubtful: bool = True
) -> tuple[Edges, np.ndarray, np.ndarray]:
    """Return edges, start and truth of two rounds of a square: three true loops and one off by ``false`` (m).

    The false one is off by as much ahead, half as much to the right, and 0.1 rad for every metre.
    """
    start, chain = driven(16, turn)
    truth = true_path(16)
    ends = [(0, 8), (2, 10), (7, 15), (3, 11)]
    measured = between(truth[[i for i, _ in ends]], truth[[j for _, j in ends]])
    measured[3] += [false, -0.5 * false, 0.1 * false]
    return chain.joined(edges_of(ends, measured, doubtful)), start, truth


def outlier_case(false: float, kernel: str) -> tuple[Edges, np.ndarray, np.ndarray, float]:
    """Relax two rounds of a square; returns edges, poses, weights, and the error (m, root mean square)."""
    edges, start, truth = two_rounds(false, doubtful=kernel == "with")
    poses, _, weights = relax(edges, start)
    return edges, poses, weights, float(np.sqrt(np.mean(np.sum((poses - truth)[:, :2] ** 2, axis=1))))


def outlier_explorer() -> Explorer:
    """Return the widget in which one of four loops is false by a chosen length, with a kernel or without."""
    controls = [
        Slider("false", (0.0, 0.2, 0.4, 0.7, 1.0, 1.5, 2.0, 3.0), 6, "One loop is off ahead by", "m"),
        Slider("kernel", ("without", "with"), 0, "Robust kernel"),
    ]
    return Explorer(_frame, controls, title="One false loop among four", alt=_alt)


def _frame(false: float, kernel: str) -> Figure:
    edges, poses, weights, error = outlier_case(false, kernel)
    figure, axes = sheet(3.8, columns=2, width_ratios=[1.2, 1])
    truth = true_path(len(poses))
    axes[0].plot(*truth[:, :2].T, color=COLOURS["truth"], linewidth=3, alpha=0.3)
    edges = replace(edges, doubtful=np.arange(len(edges)) > 14)
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
    return f"""Two rounds of a square, {kernel} the robust kernel; one of four loops is off by {false:g} m ahead, half
    of that to the right and 0.1 rad a metre. The path is {100 * error:.0f} cm from the truth; the false loop keeps
    a weight of {weights[-1]:.2f}, the true ones at least {weights[-4:-1].min():.2f}."""


def springs_lab() -> Laboratory:
    """Return the laboratory in which a graph of springs is pulled at, with a true loop and a false one."""
    alt = """A path of poses round a square, joined by springs, and the true path dashed. A true and a false loop can
    be closed, with a robust kernel or without; bars show how far each spring is strained."""
    return show_lab("springs", "Pull at a graph of springs", alt)
