"""Chapter 02, many scans: a map that grows, walls that wear off, a door that opens, and maps from dead reckoning."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pfslam.grid import LOG_4, GridSpec, MapConfig, OccupancyGrid, integrate_scan
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.teaching.ch02.one_scan import CELL, Placed, draw_log_odds, placed
from pfslam.teaching.show.figures import draw_map, draw_robot, draw_trajectory, map_along
from pfslam.teaching.show.pictures import Picture
from pfslam.teaching.show.style import COLOURS, new_figure
from pfslam.teaching.show.widgets import Explorer, Slider


def scans_between(recording: Recording, first: float, last: float, every: int) -> list[Placed]:
    """Return every ``every``-th scan between two times (s after the first scan), drawn from true poses."""
    t, truth = recording.scans().t, recording.true_path()
    low, high = np.searchsorted(t, t[0] + np.array([first, last]))
    return [placed(recording, truth, int(i)) for i in range(low, high, every)]


def spec_of(scans: list[Placed], resolution: float = CELL) -> GridSpec:
    """Return a grid that holds all the scans."""
    ends = [end for s in scans for end in (s.points.min(axis=0), s.points.max(axis=0), s.sensor)]
    return GridSpec.around(np.array(ends), resolution, margin=0.3)


def drawn(scans: list[Placed], config: MapConfig | None = None) -> Iterator[OccupancyGrid]:
    """Return the map after each of the scans."""
    grid = OccupancyGrid.empty(spec_of(scans))
    for scan in scans:
        grid, _ = integrate_scan(grid, scan.points, scan.beams, scan.sensor, config or MapConfig())
        yield grid


def hit_counts(scans: list[Placed], spec: GridSpec) -> np.ndarray:
    """Return how many of the scans hit each cell ``(H, W)``."""
    count = np.zeros(spec.shape, dtype=int)
    for scan in scans:
        cells = np.unique(spec.world_to_cell(scan.points), axis=0)
        count[cells[:, 1], cells[:, 0]] += 1
    return count


# ---- add scans one by one

COUNTS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 75, 90, 105, 120)
SHOWN = (-2.5, 11.0)  # the part of the map that is shown, in x (m)
SIDES = (3.0, 13.0)  # where the corridor has its side walls, in y (m): two of the cells are taken from there
DIARIES = {"wall": "hits", "grazed wall": "highlight", "floor": "free"}


@dataclass(frozen=True, eq=False)
class Growth:
    """A map after each of ``COUNTS`` scans, and the log-odds of three of its cells after every scan."""

    scans: list[Placed]
    maps: list[OccupancyGrid]
    cells: dict[str, tuple[int, int]]
    diary: dict[str, np.ndarray]


def growth(recording: Recording, first: float = 14.0, every: int = 8) -> Growth:
    """Return the drive round the first corner and up the corridor, from true poses, with the report's map."""
    t = recording.scans().t
    scans = scans_between(recording, first, float(t[-1] - t[0]), every)[: COUNTS[-1]]
    maps = [grid for n, grid in enumerate(drawn(scans), start=1) if n in COUNTS]
    cells = _three_cells(scans)
    diary = np.array([[grid.log_odds[cell] for cell in cells.values()] for grid in drawn(scans)])
    return Growth(scans, maps, cells, dict(zip(cells, diary.T, strict=True)))


def _three_cells(scans: list[Placed]) -> dict[str, tuple[int, int]]:
    """Find three cells ``(iy, ix)``: a wall that never fell, the one that went up and down most, and a floor."""
    spec = spec_of(scans)
    rose, fell, before = np.zeros(spec.shape, int), np.zeros(spec.shape, int), np.zeros(spec.shape)
    for grid in drawn(scans):
        rose += grid.log_odds > before
        fell += grid.log_odds < before
        before = grid.log_odds
    wanted = {"wall": np.where(fell == 0, hit_counts(scans, spec), 0), "grazed wall": np.minimum(rose, fell)}
    first, last = spec.world_to_cell([[0.0, y] for y in SIDES])[:, 1]
    cells = {}
    for name, w in wanted.items():
        iy, ix = divmod(int(w[first:last].argmax()), spec.shape[1])
        cells[name] = (int(first) + iy, ix)
    ix, iy = spec.world_to_cell(scans[len(scans) // 2].sensor)
    return {**cells, "floor": (int(iy), int(ix))}


def draw_growth(story: Growth, scans: int) -> Figure:
    """Draw the map after so many scans, and the diaries of three cells."""
    figure, axes = new_figure(5.0, 4.2, 1, 2)
    figure.set_layout_engine("none")
    for ax, place in zip(axes, ((0.11, 0.13, 0.38, 0.79), (0.63, 0.13, 0.33, 0.79)), strict=True):
        ax.set_position(place)
    grid, spec = story.maps[COUNTS.index(scans)], story.maps[0].spec
    left, right = np.clip(spec.world_to_cell([[x, 0.0] for x in SHOWN])[:, 0], 0, spec.shape[1]).tolist()
    part = spec.grown(-left, right - spec.shape[1], 0, 0)
    draw_log_odds(axes[0], grid.log_odds[:, left:right], part)
    draw_robot(axes[0], story.scans[scans - 1].pose, length=1.5)
    _draw_diaries(axes[1], story, scans)
    for name, (iy, ix) in story.cells.items():
        centre = spec.cell_to_world([ix, iy])
        look = {
            "marker": "o",
            "markersize": 9,
            "fillstyle": "none",
            "mew": 2,
            "color": COLOURS[DIARIES[name]],
        }
        axes[0].plot(*centre, **look)
    axes[0].set(title=f"{scans} scan{'s' if scans > 1 else ''}", xlim=SHOWN)
    return figure


def _draw_diaries(axes: Axes, story: Growth, scans: int) -> None:
    n = np.arange(scans + 1)
    for shift, (name, colour) in zip((0.06, 0.0, -0.06), DIARIES.items(), strict=True):
        levels = np.concatenate([[0.0], story.diary[name][:scans]]) / LOG_4
        axes.step(n, levels + shift, where="post", color=COLOURS[colour], label=name)
    axes.set(ylim=(-2.4, 4.4), yticks=range(-2, 3), xlabel="scans", ylabel=r"$\lambda$ in units of log 4")
    axes.set(xlim=(0, COUNTS[-1]), xticks=(0, 60, 120), title="three cells")
    axes.legend(loc="upper right", fontsize=12, borderpad=0.2)


def describe_growth(story: Growth, scans: int) -> str:
    """Describe the picture of these values in words."""
    grid = story.maps[COUNTS.index(scans)]
    area = CELL**2 * np.count_nonzero(grid.free)
    words = ", ".join(f"{name} {story.diary[name][scans - 1] / LOG_4:+.0f}" for name in story.cells)
    return f"""After {scans} scans: {area:.0f} square metres free, {np.count_nonzero(grid.occupied)} cells
    occupied. The three marked cells stand at (in units of log 4): {words}."""


def growth_explorer(recording: Recording) -> Explorer:
    """Make the explorer with one slider: how many scans are in the map."""
    story = growth(recording)
    return Explorer(
        partial(draw_growth, story),
        [Slider("scans", COUNTS, 0, "Scans", "", "g")],
        title="A map grows",
        alt=partial(describe_growth, story),
        play="scans",
    )


# ---- hit, free and clamp

CORRIDOR = (4.2, 8.2, 0.0, 15.0)  # the part of it that is shown: x_min, x_max, y_min, y_max (m)
SEEN = 3  # so many scans must hit a wall cell for it to be well seen
DOOR_CLOSED, DOOR_OPEN = 40, 60  # so many scans see the door closed, and so many see it open after that


def door(
    hit: float, free: float, clamp: float, closed: int = DOOR_CLOSED, opened: int = DOOR_OPEN
) -> np.ndarray:
    """Return log-odds ``(1 + closed + opened,)`` of a door's cell: hit while closed, seen through when open."""
    levels = [0.0]
    for change in [hit] * closed + [-free] * opened:
        levels.append(float(np.clip(levels[-1] + change, -clamp, clamp)))
    return np.array(levels)


def scans_to_believe(hit: float, free: float, clamp: float, closed: int = DOOR_CLOSED) -> int:
    """Return how many scans through the open door it takes until its cell counts as free."""
    level, scans = door(hit, free, clamp, closed, 0)[-1], 0
    while level >= -1e-9:
        level, scans = max(level - free, -clamp), scans + 1
    return scans


@dataclass(frozen=True, eq=False)
class Walls:
    """Scans of a corridor, and which cells at least ``SEEN`` of them hit: its well-seen walls."""

    scans: list[Placed]
    wall: np.ndarray

    def map(self, hit: float, free: float, clamp: float) -> OccupancyGrid:
        """Return the map of the scans; the three numbers in units of log 4."""
        *_, grid = drawn(self.scans, MapConfig(hit=hit * LOG_4, free=free * LOG_4, clamp=clamp * LOG_4))
        return grid

    def worn(self, grid: OccupancyGrid) -> float:
        """Tell which share of the well-seen wall cells is not occupied in the map."""
        return float(np.mean(~grid.occupied[self.wall]))


def walls_of(scans: list[Placed]) -> Walls:
    """Return the scans with their well-seen walls."""
    return Walls(scans, hit_counts(scans, spec_of(scans)) >= SEEN)


def draw_evidence(walls: Walls, hit: float, free: float, clamp: float) -> Figure:
    """Draw a corridor's walls, and a door, for three numbers in units of log 4."""
    grid = walls.map(hit, free, clamp)
    figure, axes = new_figure(5.0, 4.4, 1, 2)
    figure.set_layout_engine("none")
    for ax, place in zip(axes, ((0.12, 0.13, 0.26, 0.76), (0.57, 0.13, 0.41, 0.76)), strict=True):
        ax.set_position(place)
    draw_map(axes[0], grid, f"{100 * walls.worn(grid):.0f} % worn off")
    axes[0].set(xlim=CORRIDOR[:2], ylim=CORRIDOR[2:], xticks=(5, 7))
    levels = door(hit * LOG_4, free * LOG_4, clamp * LOG_4) / LOG_4
    axes[1].step(np.arange(len(levels)), levels, where="post", color=COLOURS["hits"])
    axes[1].axhline(0.0, color=COLOURS["truth"], linestyle=":")
    axes[1].axvspan(DOOR_CLOSED, len(levels), color=COLOURS["free"], alpha=0.12)
    axes[1].set(
        xlabel="scans", ylabel=r"$\lambda$ of the door, in log 4", xlim=(0, len(levels)), xticks=(0, 40, 80)
    )
    axes[1].set(ylim=(-1.1 * clamp, 1.1 * clamp))
    axes[1].set_title(f"open after {scans_to_believe(hit, free, clamp)} scans")
    return figure


def describe_evidence(walls: Walls, hit: float, free: float, clamp: float) -> str:
    """Describe the picture of these values in words."""
    share, needed = walls.worn(walls.map(hit, free, clamp)), scans_to_believe(hit, free, clamp)
    return f"""Hit {hit:g}, free {free:g}, clamp {clamp:g} (in log 4): {100 * share:.0f} % of the corridor's
    well-seen wall cells are not occupied; after {DOOR_CLOSED} scans of a closed door it takes {needed} scans of
    the open one to make it free."""


def evidence_explorer(walls: Walls) -> Explorer:
    """Make the explorer with three sliders: what a hit adds, what a free beam takes away, and the clamp."""
    sliders = [
        Slider("hit", (0.5, 1.0, 2.0), 1, "Hit", "log 4", "g", (0.1, 3.0, 0.1)),
        Slider("free", (0.1, 0.25, 1.0), 2, "Free", "log 4", "g", (0.05, 2.0, 0.05)),
        Slider("clamp", (2.0, 5.0, 50.0), 0, "Clamp", "log 4", "g", (1.0, 60.0, 0.5)),
    ]
    title, alt = "What three numbers decide", partial(describe_evidence, walls)
    return Explorer(partial(draw_evidence, walls), sliders, title=title, alt=alt)


def dead_reckoned_maps(recordings: dict[str, Recording], every: int = 20) -> dict[str, tuple]:
    """Return for each recording: its dead reckoning, the map along it, and the map along the truth."""
    result = {}
    for name, recording in recordings.items():
        odometry, truth = dead_reckoning(recording), recording.true_path()
        drawn = map_along(recording, odometry, every=every), map_along(recording, truth, every=every)
        result[name] = (odometry, *drawn)
    return result


def dead_reckoned_picture(drawn: dict[str, tuple[Trajectory, OccupancyGrid, OccupancyGrid]]) -> Picture:
    """Draw figures 5 and 6 of the report above, and below the maps that true poses draw of the same scans."""
    figure, axes = new_figure(5.0, 6.0, 2, len(drawn), sharex=True, sharey=True)
    words = []
    for column, (name, (odometry, wrong, right)) in enumerate(drawn.items()):
        draw_map(axes[0, column], wrong, f"{name},\ndead reckoning")
        draw_trajectory(axes[0, column], odometry, "odometry")
        draw_map(axes[1, column], right, f"{name},\ntrue poses")
        black = [np.count_nonzero(grid.occupied) for grid in (wrong, right)]
        words.append(f"{name}: {black[0]} occupied cells along dead reckoning, {black[1]} along true poses")
    extents = np.array([ax.images[0].get_extent() for ax in axes.ravel()])
    (left, low), (right, high) = extents[:, ::2].min(axis=0), extents[:, 1::2].max(axis=0)
    for ax in axes.ravel():
        ax.set(xlim=(left, right), ylim=(low, high), facecolor=COLOURS["unknown"])
        ax.label_outer()
    return Picture(
        figure, f"Two drives, mapped along dead reckoning (above) and true poses (below). {'; '.join(words)}."
    )
