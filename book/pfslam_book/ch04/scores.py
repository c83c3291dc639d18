"""Chapter 04: one scan, one map, and the score of every pose around the true one."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from pfslam.correlation import score_field
from pfslam.refined.search.lattice import Lattice
from pfslam.refined.search.volume import score_volume
from pfslam_book.show.drives import Place
from pfslam_book.show.figures import draw_map
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, new_figure

LATTICE = Lattice(step_xy=0.05, step_yaw=0.005)
"""The report's steps: one cell of 5 cm in x and y, 0.005 rad in heading."""


def on_walls(place: Place, points_w: np.ndarray) -> np.ndarray:
    """Which of the points ``(M, 2)`` lie in occupied cells (bool ``(M,)``): the indicator of Eq. 9."""
    cells, spec = place.grid.spec.world_to_cell(points_w), place.grid.spec
    inside = spec.contains(cells)
    ix, iy = np.where(inside[:, None], cells, 0).T
    return inside & place.grid.occupied[iy, ix]


def surface(place: Place, dtheta: float = 0.0, reach: int = 8, kind: str = "occupied") -> np.ndarray:
    """Scores ``(2 reach + 1, 2 reach + 1)`` of the poses up to ``reach`` cells away, turned by ``dtheta`` rad."""
    field = score_field(place.grid.occupied, kind)
    low, high = np.array([-reach, -reach, 0]), np.array([reach, reach, 0])
    return score_volume(field, place.grid.spec, place.moved(dtheta=dtheta), LATTICE, low, high)[0]


# ---- pictures


def draw_fit(axes: Axes, place: Place, points_w: np.ndarray, reach: float = 4.0, size: float = 5.0) -> None:
    """The map around the robot with the scan on it; end points that fall on walls light up."""
    draw_map(axes, place.grid)
    good = on_walls(place, points_w)
    for mask, colour, label in ((~good, "hits", "beside a wall"), (good, "highlight", "on a wall")):
        x, y = points_w[mask].T
        axes.scatter(x, y, s=size, color=COLOURS[colour], linewidths=0, label=label, zorder=3)
    x, y, _ = place.pose
    axes.set(xlim=(x - reach, x + reach), ylim=(y - reach, y + reach))


def question_picture(place: Place, wrong: tuple[float, float, float]) -> Picture:
    """The same scan from the true pose and from a wrong one."""
    figure, axes = new_figure(5.1, 4.2, columns=2, sharey=True)
    counts = []
    for ax, offset, name in zip(axes, ((0.0, 0.0, 0.0), wrong), ("A", "B"), strict=True):
        points = place.moved(*offset)
        draw_fit(ax, place, points)
        counts.append(int(on_walls(place, points).sum()))
        ax.set_title(f"pose {name}")
    axes[1].set_ylabel("")
    labels = axes[1].get_legend_handles_labels()
    figure.legend(*labels, loc="outside lower center", ncols=2, markerscale=3)
    dx, dy, dtheta = wrong
    alt = f"""Two maps of the same corner with the same scan of {len(place.points_b)} end points on each. Pose A is
    the true one: {counts[0]} points lie on walls. Pose B is off by {np.hypot(dx, dy):.2f} m and
    {np.rad2deg(dtheta):.0f} degrees: {counts[1]} points lie on walls, the others beside them."""
    return Picture(figure, alt)


def draw_surface(axes: Axes, scores: np.ndarray, top: float, mark: tuple[float, float] | None = None):
    """A score surface over dx and dy in metres; a cross at ``mark``."""
    half = (len(scores) - 1) / 2 * LATTICE.step_xy
    edge = half + LATTICE.step_xy / 2
    image = axes.imshow(scores, origin="lower", extent=(-edge, edge, -edge, edge), vmin=0, vmax=top)
    if mark is not None:
        axes.plot(*mark, marker="+", markersize=16, markeredgewidth=3, color=COLOURS["highlight"])
    axes.set(xlabel="dx [m]", ylabel="dy [m]", xticks=(-0.3, 0, 0.3), yticks=(-0.3, 0, 0.3))
    axes.grid(False)
    return image


def surfaces_picture(corner: Place, corridor: Place) -> Picture:
    """Two score surfaces at the true heading: one with a peak, one with a ridge."""
    figure, axes = new_figure(5.1, 3.2, columns=2, sharey=True)
    words = []
    for ax, place, name in zip(axes, (corner, corridor), ("corner", "corridor"), strict=True):
        share = surface(place) / len(place.points_b)
        image = draw_surface(ax, share, 1.0)
        ax.set_title(name)
        words.append(f"{name}: best {share.max():.2f}, lowest {share.min():.2f}")
    axes[1].set_ylabel("")
    figure.colorbar(image, ax=axes, label="share of end points on walls", ticks=(0, 0.5, 1))
    alt = f"""Share of end points on walls for displacements of up to 0.4 m in x and y. {"; ".join(words)}.
    At the corner the score has one small bright peak at the true pose; in the corridor a bright ridge runs
    along it."""
    return Picture(figure, alt)


def heading_picture(place: Place) -> Picture:
    """Score against heading error at the true position."""
    degrees = np.arange(-6.0, 6.01, 0.25)
    share = [np.mean(on_walls(place, place.moved(dtheta=np.deg2rad(d)))) for d in degrees]
    figure, axes = new_figure(5.1, 2.9)
    axes.plot(degrees, share, color=COLOURS["estimate"], marker="o", markersize=3)
    axes.axvline(0.0, color=COLOURS["truth"], linestyle=":")
    axes.set(xlabel="heading error [deg]", ylabel="share on walls", ylim=(0, 1), xticks=range(-6, 7, 2))
    at = dict(zip(degrees.tolist(), share, strict=True))
    alt = f"""Share of end points on walls against heading error: {at[0.0]:.2f} at the true heading, {at[1.0]:.2f} at
    1 degree, {at[4.0]:.2f} at 4 degrees. A dotted line marks the truth."""
    return Picture(figure, alt)


# ---- patches, and the likelihood field


def patches(place: Place, chosen: list[int], reach: int = 4) -> tuple[list[np.ndarray], np.ndarray]:
    """The piece of the map ``(9, 9)`` around the cells of some end points, and the sum over all end points."""
    occupied, spec = place.grid.occupied, place.grid.spec
    cells = spec.world_to_cell(place.moved())
    around = [
        occupied[iy - reach : iy + reach + 1, ix - reach : ix + reach + 1].astype(int)
        for ix, iy in cells
        if min(ix, iy) >= reach and ix + reach < spec.shape[1] and iy + reach < spec.shape[0]
    ]
    return [around[k] for k in chosen], np.sum(around, axis=0)


def patches_picture(place: Place, chosen: tuple[int, ...] = (150, 300, 900)) -> Picture:
    """Three patches of the map and the sum over all: the scores of the 81 shifts at one heading."""
    some, total = patches(place, list(chosen))
    figure, row = new_figure(5.1, 2.4, columns=4, width_ratios=[1, 1, 1, 1.25])
    for axes, patch, name in zip(
        row, [*some, total], (*(f"point {k}" for k in chosen), "sum of all"), strict=True
    ):
        axes.imshow(patch, origin="lower", cmap="Greys" if patch is not total else "cividis", vmin=0)
        axes.set(xticks=(), yticks=(), title=name)
        axes.plot(4, 4, "+", color=COLOURS["highlight"], markersize=9, markeredgewidth=2)
        axes.spines[:].set_visible(True)
        axes.grid(False)
    row[0].set_ylabel("9 × 9 cells")
    iy, ix = np.unravel_index(int(np.argmax(total)), total.shape)
    alt = f"""The map around three of the end points, 9 by 9 cells each, and the sum over all {len(place.points_b)} end
    points. The sum is greatest, {total.max()}, at the shift of {ix - 4} cells in x and {iy - 4} in y."""
    return Picture(figure, alt)


def field_picture(place: Place, reach: float = 1.0) -> Picture:
    """A corner of the map, and its likelihood field."""
    grid = place.grid
    iy, ix = np.nonzero(grid.occupied)
    centres = grid.spec.cell_to_world(np.column_stack([ix, iy]))
    middle = centres[np.argmin(np.hypot(*(centres - place.pose[:2]).T))]
    values = score_field(grid.occupied, "distance").values / score_field(grid.occupied, "distance").top
    figure, row = new_figure(5.1, 2.9, columns=2, sharey=True)
    for axes, image, name in zip(
        row, (grid.occupied, values), ("occupied cells", "likelihood field"), strict=True
    ):
        shown = axes.imshow(image, origin="lower", extent=grid.spec.extent, vmin=0, vmax=1)
        axes.set(
            xlim=(middle[0] - reach, middle[0] + reach),
            ylim=(middle[1] - reach, middle[1] + reach),
            title=name,
        )
        axes.set(xlabel="x [m]")
        axes.grid(False)
    row[0].set_ylabel("y [m]")
    figure.colorbar(shown, ax=row, label="credit of a point", ticks=(0, 0.5, 1), shrink=0.8)
    share = [float(np.mean(image > 0.1)) for image in (grid.occupied, values)]
    alt = f"""A piece of wall, 2 m wide, as occupied cells and as likelihood field: credit falls off smoothly within two
    cells of the wall. In the whole map {100 * share[0]:.1f} % of the cells are occupied, and {100 * share[1]:.1f} %
    give some credit."""
    return Picture(figure, alt)
