"""Chapter 04, second half: the search that all particles share, ties, and the distance field."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.patches import Rectangle

from pfslam.correlation import ScoreField, map_correlation, renew_field, score_field
from pfslam.grid import GridSpec, MapConfig, OccupancyGrid, integrate_scan
from pfslam.poses import transform_points
from pfslam.recording import Recording
from pfslam.refined.search.lattice import Window
from pfslam.refined.search.volume import score_volume, search
from pfslam.sensors import scan_points
from pfslam_book.ch04.scores import LATTICE
from pfslam_book.show.drives import Place
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, new_figure

WINDOW = Window(cells=4, yaws=4)
"""The report's 9 x 9 x 9 perturbations."""


def block_by_definition(place: Place, node: np.ndarray) -> np.ndarray:
    """The 729 counts ``(9, 9, 9)`` around a lattice node ``(3,)``, each pose by itself: Eq. 8, word for word."""
    poses = LATTICE.pose(node + WINDOW.steps())
    grid = place.grid
    counts = [map_correlation(grid.occupied, grid.spec, transform_points(p, place.points_b)) for p in poses]
    return np.array(counts).reshape(WINDOW.shape)


def block_from_volume(place: Place, node: np.ndarray) -> np.ndarray:
    """The same 729 counts from one score volume."""
    field = score_field(place.grid.occupied, "occupied")
    reach = np.array([WINDOW.cells, WINDOW.cells, WINDOW.yaws])
    return score_volume(field, place.grid.spec, place.points_b, LATTICE, node - reach, node + reach)


def lattice_picture(particles: int = 9, seed: int = 5) -> Picture:
    """Particles, the lattice nodes nearest to them, and the windows of two of them, all at one heading."""
    cloud = np.random.default_rng(seed).normal(scale=0.05, size=(particles, 2))
    step, side = LATTICE.step_xy, (2 * WINDOW.cells + 1) * LATTICE.step_xy
    nodes = step * np.rint(cloud / step)
    figure, axes = new_figure(5.1, 4.4)
    axes.scatter(
        *np.meshgrid(step * np.arange(-9, 10), step * np.arange(-9, 10)), s=7, color=COLOURS["unknown"]
    )
    for pair in zip(cloud, nodes, strict=True):
        axes.plot(*np.array(pair).T, color=COLOURS["particles"], linewidth=1.2)
    axes.scatter(*nodes.T, s=45, facecolors="none", edgecolors=COLOURS["highlight"], label="nearest node")
    axes.scatter(*cloud.T, s=16, color=COLOURS["particles"], label="particle", zorder=3)
    ends = nodes[[np.argmin(nodes.sum(axis=1)), np.argmax(nodes.sum(axis=1))]]
    for node, style in zip(ends, ("-", "--"), strict=True):
        frame = Rectangle(node - side / 2, side, side, fill=False, linestyle=style, linewidth=1.5)
        frame.set_edgecolor(COLOURS["highlight"])
        axes.add_patch(frame)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", xlim=(-0.36, 0.36), ylim=(-0.36, 0.36))
    axes.set(xticks=(-0.2, 0, 0.2), yticks=(-0.2, 0, 0.2))
    axes.grid(False)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    shared = np.prod(side - np.abs(ends[1] - ends[0])) / side**2
    alt = f"""Lattice nodes 5 cm apart, {particles} particles between them, each joined to its nearest node, and for the
    two outermost particles a square that holds the 9 by 9 nodes of their window. The squares share
    {100 * shared:.0f} % of their nodes."""
    return Picture(figure, alt)


# ---- an empty map


def first_index_walk(scans: int) -> np.ndarray:
    """Where a particle ends up, scan after scan ``(scans + 1, 3)``, if all scores are 0 and argmax picks the first."""
    step = LATTICE.pose(WINDOW.steps()[np.argmax(np.zeros(len(WINDOW.steps())))])
    return np.arange(scans + 1)[:, None] * step


# ---- count against distance field


@dataclass(frozen=True, eq=False)
class Trials:
    """Searches around true poses: ``tied (K,)`` poses share the best score, ``miss (K,)`` m away on average."""

    tied: np.ndarray
    miss: np.ndarray


def trials(recording: Recording, kind: str, every: int = 20, moving_after: float = 10.0) -> Trials:
    """Search the report's window around the truth for every scan, in the map of the scans before it.

    The map is drawn from true poses, so that a miss is the score's own fault. The centre is the lattice pose nearest
    to the truth: half a cell in x and y cannot be told apart.
    """
    scans, lidar, truth = recording.scans(), recording.robot.lidar, recording.true_path()
    stamps = scans.t
    grid = OccupancyGrid.empty(GridSpec.around(truth.poses[:1, :2], MapConfig().resolution))
    field, tied, miss = score_field(grid.occupied, kind), [], []
    for i in range(0, len(stamps), every):
        points, pose = scan_points(scans.ranges[i], lidar), truth.at(stamps[i])
        if stamps[i] - stamps[0] > moving_after:
            box = next(search(field, grid.spec, points, pose[None], LATTICE, WINDOW))
            best = np.flatnonzero(box.scores[0] == box.scores[0].max())
            found = LATTICE.pose(box.nodes[0] + WINDOW.steps()[best])
            tied.append(len(best))
            miss.append(np.hypot(*(found - pose)[:, :2].T).mean())
        grid, field = _drawn(grid, field, pose, points, np.flatnonzero(lidar.valid(scans.ranges[i])), lidar)
    return Trials(np.array(tied), np.array(miss))


def _drawn(grid: OccupancyGrid, field, pose, points_b, beams, lidar) -> tuple[OccupancyGrid, ScoreField]:
    """Map and score field after one more scan."""
    points = transform_points(pose, points_b)
    sensor = transform_points(pose, np.array([lidar.position_b[:2]]))
    larger = grid.covering(np.concatenate([points, sensor]))
    part = integrate_scan(larger, points, beams, sensor[0], MapConfig())
    if larger is not grid:
        return larger, score_field(larger.occupied, field.kind)
    renew_field(field, larger.log_odds, part)
    return larger, field


def fine_scores(place: Place, dx: np.ndarray, kind: str) -> np.ndarray:
    """Mean score per beam, from 0 to 1, for displacements ``dx`` (m) finer than a cell."""
    field, spec = score_field(place.grid.occupied, kind), place.grid.spec
    scores = []
    for d in dx:
        cells = spec.world_to_cell(place.moved(dx=d))
        ix, iy = cells[spec.contains(cells)].T
        scores.append(field.values[iy, ix].sum() / field.top / len(place.points_b))
    return np.array(scores)


def fine_scores_picture(place: Place) -> Picture:
    """Both scores along x, every 5 mm."""
    dx = np.arange(-60, 61) * 0.005
    figure, axes = new_figure(5.1, 3.2)
    words = []
    for kind, name, colour in (("occupied", "count", "hits"), ("distance", "likelihood field", "estimate")):
        scores = fine_scores(place, dx, kind)
        axes.plot(
            dx, scores, color=COLOURS[colour], label=name, linestyle="--" if kind == "occupied" else "-"
        )
        words.append(
            f"{name}: {scores[60]:.2f} at the truth, {scores[80]:.2f} at 0.1 m, {scores[100]:.2f} at 0.2 m"
        )
    axes.axvline(0.0, color=COLOURS["truth"], linestyle=":")
    axes.set(xlabel="dx [m]", ylabel="mean score per beam", ylim=(0, 1), xticks=(-0.3, -0.15, 0, 0.15, 0.3))
    axes.legend(loc="upper right")
    return Picture(figure, f"Mean score per beam while the scan slides along x. {'; '.join(words)}.")
