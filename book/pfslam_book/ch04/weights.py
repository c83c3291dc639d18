"""Chapter 04, from scores to weights, and three scores that are wrong: borrowed, shifted, and blind behind the wall."""

from __future__ import annotations

from functools import partial

import numpy as np
from matplotlib.figure import Figure

from pfslam.correlation import map_correlation, score_field
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.particles import effective_sample_size
from pfslam.poses import transform_points
from pfslam.refined.search.volume import search
from pfslam.sensors import LidarModel, scan_points
from pfslam_book.ch04.scores import LATTICE
from pfslam_book.ch04.search import WINDOW, fine_scores
from pfslam_book.show.drives import Place
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, new_figure
from pfslam_book.show.widgets import Explorer, Slider

CLOUD = (0.02, 0.02, 0.004)
"""Standard deviations (m, m, rad) of the particles around the true pose."""


def cloud(place: Place, n: int = 200, seed: int = 0) -> np.ndarray:
    """Poses ``(n, 3)`` of particles around the place's pose."""
    return place.pose + np.random.default_rng(seed).standard_normal((n, 3)) * CLOUD


def counts_where_they_stand(place: Place, poses: np.ndarray) -> np.ndarray:
    """Count of end points on walls for each of ``poses (n, 3)``: Eq. 8, pose by pose."""
    grid = place.grid
    scans = (transform_points(pose, place.points_b) for pose in poses)
    return np.array([map_correlation(grid.occupied, grid.spec, points) for points in scans])


def counts_of_the_window(place: Place, poses: np.ndarray) -> np.ndarray:
    """The best count among the 729 perturbations around each of ``poses (n, 3)``."""
    best = np.zeros(len(poses))
    field = score_field(place.grid.occupied, "occupied")
    for box in search(field, place.grid.spec, place.points_b, poses, LATTICE, WINDOW):
        best[box.members] = box.scores.max(axis=1)[box.node_of]
    return best


def n_eff(weights: np.ndarray) -> float:
    """Effective number of particles of weights ``(n,)`` that need not sum to 1 yet."""
    return effective_sample_size(weights / weights.sum())


def sharpened(counts: np.ndarray, beta: float) -> np.ndarray:
    """Weights ``(n,)`` proportional to exp(beta count); the greatest is taken out first, so that nothing overflows."""
    weights = np.exp(beta * (counts - counts.max()))
    return weights / weights.sum()


def draw_weights(poses: np.ndarray, counts: np.ndarray, beta: float) -> Figure:
    """The cloud, each particle as large as its weight; and the weights in order."""
    weights = sharpened(counts, beta)
    figure, (left, right) = new_figure(5.1, 3.4, columns=2)
    x, y = 100.0 * (poses[:, :2] - poses[:, :2].mean(axis=0)).T
    left.scatter(x, y, s=4.0, color=COLOURS["unknown"], linewidths=0)
    left.scatter(
        x, y, s=np.minimum(3000.0 * weights, 900.0), color=COLOURS["particles"], alpha=0.6, linewidths=0
    )
    left.set(
        xlabel="x [cm]", ylabel="y [cm]", xlim=(-8, 8), ylim=(-8, 8), xticks=(-5, 0, 5), yticks=(-5, 0, 5)
    )
    left.set_title(rf"$N_\mathrm{{eff}}$ = {n_eff(weights):.1f} of {len(weights)}")
    right.fill_between(
        np.arange(len(weights)), np.sort(weights)[::-1], color=COLOURS["particles"], step="mid"
    )
    right.set(
        xlabel="particle, heaviest first", ylabel="weight", yscale="log", ylim=(1e-5, 1.5), xlim=(0, len(x))
    )
    right.set_yticks([1e-4, 1e-2, 1.0], ["0.0001", "0.01", "1"])
    right.minorticks_off()
    right.set_title(f"heaviest: {weights.max():.2f}")
    return figure


def describe_weights(poses: np.ndarray, counts: np.ndarray, beta: float) -> str:
    """The same in words."""
    weights = sharpened(counts, beta)
    return f"""Weights exp({beta:g} times count) of {len(poses)} particles: N_eff = {n_eff(weights):.1f}, the heaviest
    particle has {weights.max():.3f} of all weight."""


def sharpness_explorer(place: Place) -> Explorer:
    """One slider: how much one more end point on a wall is worth."""
    poses = cloud(place)
    counts = counts_where_they_stand(place, poses)
    return Explorer(
        partial(draw_weights, poses, counts),
        [
            Slider(
                "beta",
                (0.0, 0.001, 0.003, 0.01, 0.03, 0.05, 0.1, 0.3, 1.0),
                5,
                "Sharpness beta per beam",
                "",
                "g",
                (0.0, 1.0, 0.001),
            )
        ],
        alt=partial(describe_weights, poses, counts),
        title="How sharp should the likelihood be?",
    )


def best_shift(place: Place, rounding=np.floor, reach: float = 0.1, step: float = 0.01) -> np.ndarray:
    """Where (x, y) in metres the peak of the count lies if the score turns points into cells by ``rounding``.

    The peak is a plateau of about a cell: the mean of all shifts that score within 10 % of the best.
    """
    grid, spec = place.grid, place.grid.spec
    offsets = np.arange(-reach, reach + step / 2, step)
    shifts = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    points = place.moved()
    scores = []
    for shift in shifts:
        cells = rounding((points + shift - spec.origin) / spec.resolution).astype(int)
        ix, iy = cells[spec.contains(cells)].T
        scores.append(np.count_nonzero(grid.occupied[iy, ix]))
    return shifts[np.array(scores) >= 0.9 * max(scores)].mean(axis=0)


# ---- a wall one metre thick

WALL = 3.0
"""Distance (m) from the true pose to the front of the wall."""
SIGMA_BEAM = 0.05
"""Width (m) of the beam score."""


def wall_place(thickness: float) -> Place:
    """A robot at the origin that looks at a long wall, whose map is filled to ``thickness`` metres."""
    spec = GridSpec((-1.0, -8.0), 0.05, (320, 160))
    x = spec.cell_to_world(np.column_stack([np.arange(160), np.zeros(160, dtype=int)]))[:, 0]
    column = np.where((x > WALL) & (x < WALL + thickness), 1.0, -1.0).astype(np.float32)
    lidar = LidarModel(-np.pi / 3, np.pi / 3, 241, position_b=(0.0, 0.0, 0.0))
    points = scan_points((WALL + 0.025) / np.cos(lidar.angles), lidar)
    return Place(OccupancyGrid(spec, np.tile(column, (320, 1))), points, np.zeros(3))


def beam_scores(dx: np.ndarray) -> np.ndarray:
    """Mean score per beam if each measured range is compared with the range to the front of the wall from ``dx``."""
    angles = LidarModel(-np.pi / 3, np.pi / 3, 241).angles
    missing = np.minimum(dx, WALL)[:, None] / np.cos(
        angles
    )  # by how much the range should be shorter from there
    return np.exp(-0.5 * (missing / SIGMA_BEAM) ** 2).mean(axis=1)


def walls_picture() -> Picture:
    """End-point score and beam score while the robot is thought nearer and nearer to a thin and to a thick wall."""
    dx = np.arange(-0.5, 1.301, 0.025)
    figure, axes = new_figure(5.1, 3.1, columns=2, sharey=True)
    words = []
    for ax, thickness, name in zip(axes, (0.05, 1.0), ("thin wall", "wall filled to 1 m"), strict=True):
        ends = fine_scores(wall_place(thickness), dx, "distance")
        ax.plot(dx, ends, color=COLOURS["estimate"], label="end points")
        ax.plot(dx, beam_scores(dx), color=COLOURS["odometry"], linestyle="--", label="whole beams")
        ax.axvline(0.0, color=COLOURS["truth"], linestyle=":")
        ax.set(xlabel="too near by [m]", title=name, xticks=(-0.5, 0, 0.5, 1), ylim=(0, 1.05))
        words.append(
            f"{name}: end points {np.interp(0.5, dx, ends):.2f}, whole beams {beam_scores(np.array([0.5]))[0]:.2f}"
        )
    axes[0].set_ylabel("mean score per beam")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    alt = f"""Score of a pose against how much too near to the wall it is. Both scores are highest at the truth, where a
    dotted line stands. At 0.5 m too near, {"; ".join(words)}."""
    return Picture(figure, alt)


def turned_only(pose: np.ndarray, points_b: np.ndarray) -> np.ndarray:
    """A faulty ``transform_points``: its homogeneous coordinate is 0 instead of 1, so the translation is lost."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    T_wb = np.array([[c, -s, pose[0]], [s, c, pose[1]], [0.0, 0.0, 1.0]])
    homogeneous = np.column_stack([points_b, np.zeros(len(points_b))])
    return (homogeneous @ T_wb.T)[:, :2]
