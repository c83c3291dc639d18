"""Chapter 08: the exhibits of the world: people, glass and doors, each beside the same building without them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes

from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import OccupancyGrid
from pfslam.recording import LidarScans, Recording
from pfslam.refined.health import DRAGGED_METRES, DRAGGED_WITHIN
from pfslam.run import SlamResult, run_slam
from pfslam.simulator import Hazards, simulate
from pfslam.slam import SlamConfig
from pfslam.study.disturbances import first_seconds
from pfslam_book.ch08.data_exhibits import Panel, pair
from pfslam_book.ch08.exhibit import COLOUR, STATES, Exhibit, by_name, few_ticks, small_map
from pfslam_book.show.faults import scans_between
from pfslam_book.show.figures import draw_trajectory, map_along
from pfslam_book.show.style import COLOURS

PEOPLE, GLASS, DOORS = Hazards(people=6), Hazards(glass=0.1), Hazards(doors=3)
WITH_PEOPLE, THERE, BACK = 32.0, (10.0, 45.0), (45.0, 75.0)
"""Seconds of the drive: up the corridor behind somebody; the way out, and the way back."""


@dataclass(frozen=True, eq=False)
class WorldRun:
    """One run of the refined filter through a building, with the recording that it was made from."""

    recording: Recording
    result: SlamResult

    @classmethod
    def of(cls, recording: Recording, seconds: float, every: int, second_look: bool = False) -> WorldRun:
        """Run the first seconds of a recording; what a first look gives is kept unless a second one is asked for."""
        part = first_seconds(recording, seconds)
        config = replace(SlamConfig.refined(), every=every)
        rng = np.random.default_rng(0)
        result = run_slam(part, config, rng=rng, keep_particles=False, second_look=second_look)
        return cls(part, result)

    @property
    def ate(self) -> float:
        """Return the root mean square of the error (m)."""
        return trajectory_error(self.result.trajectory, self.recording.true_path()).ate_rmse_m

    def since_start(self, t: np.ndarray | float):
        """Return times as seconds after the first scan."""
        return t - self.result.trajectory.t[0]

    @property
    def doubts(self) -> list[tuple[float, str]]:
        """Return when each stretch that the run itself does not trust begins (s after the first scan), and why."""
        return [(float(self.since_start(d["from"])), d["reason"]) for d in self.result.distrust]

    @property
    def says(self) -> str:
        """Return the first of these doubts in words."""
        return (
            f"in doubt from {self.doubts[0][0]:.0f} s on: {self.doubts[0][1]}" if self.doubts else "no doubt"
        )

    def dragged(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times ``(K,)`` (s) and how far (m) the scans moved the estimate in the two seconds before."""
        t = self.result.trajectory.t
        moved = np.array([info.departure for info in self.result.infos])
        total = np.concatenate([np.zeros((1, 2)), np.cumsum(moved, axis=0)])
        since = np.searchsorted(t, t - DRAGGED_WITHIN)
        return self.since_start(t), np.hypot(*(total[1:] - total[since]).T)

    def silent(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times ``(K,)`` (s) and the share of the beams of each scan that came back without an echo."""
        scans = self.recording.scans()
        missing = ~self.recording.robot.lidar.valid(scans.ranges[::20])
        return self.since_start(scans.t[::20]), missing.mean(axis=1)

    def changed(self) -> np.ndarray:
        """Return the middles ``(C, 2)`` m of wall cells of one way that lie in free space on the other way."""
        path, scans = self.result.trajectory, self.recording.scans()
        used = np.isin(scans.t, path.t)  # between them the path is only interpolated, which blurs turns
        recording = replace(self.recording, lidar=LidarScans(scans.t[used], scans.ranges[used]))
        config = SlamConfig.refined().map
        out, back = (map_along(scans_between(recording, *when), path, config, 1) for when in (THERE, BACK))
        return np.concatenate([walls_gone(out, back), walls_gone(back, out)])


def walls_gone(before: OccupancyGrid, after: OccupancyGrid, near: float = 0.3) -> np.ndarray:
    """Return the wall cells ``(C, 2)`` m of one map that another calls free, and that lie near none of its walls."""
    walls, others = (grid.spec.cell_to_world(np.argwhere(grid.occupied)[:, ::-1]) for grid in (before, after))
    cells = after.spec.world_to_cell(walls)
    inside = after.spec.contains(cells)
    walls, (ix, iy) = walls[inside], cells[inside].T
    apart = np.hypot(*(walls[:, None] - others).transpose(2, 0, 1)).min(axis=1)
    return walls[after.free[iy, ix] & (apart > near)]


def world_runs(recording: Recording) -> dict[str, WorldRun]:
    """Return runs through ``hall``, the recording, and through the same building with people, glass and doors."""
    people, glass, doors = (simulate("hall", hazards=h).recording for h in (PEOPLE, GLASS, DOORS))
    return {
        "empty, every 5th scan": WorldRun.of(recording, WITH_PEOPLE, every=5),
        "people, every 5th scan": WorldRun.of(people, WITH_PEOPLE, every=5),
        "people, every 20th scan": WorldRun.of(people, WITH_PEOPLE, every=20),
        "people, second look": WorldRun.of(people, WITH_PEOPLE, every=5, second_look=True),
        "empty": WorldRun.of(recording, BACK[1], every=20),
        "glass": WorldRun.of(glass, BACK[1], every=20),
        "doors": WorldRun.of(doors, BACK[1], every=20),
    }


def world_faults(runs: dict[str, WorldRun]) -> dict[str, Exhibit]:
    """Return three faults of the world by name, each beside the building without it."""
    return by_name(
        people_exhibit(runs["empty, every 5th scan"], runs["people, every 5th scan"]),
        glass_exhibit(runs["empty"], runs["glass"]),
        door_exhibit(runs["empty"], runs["doors"]),
    )


def map_of(runs: dict[str, WorldRun], window: tuple[float, float, float, float], words: str) -> Panel:
    """Return a part of the map at the end of each run, with the path of the estimate and the true one."""

    def draw(axes: Axes, state: str) -> str:
        run = runs[state]
        small_map(axes, run.result.grid)
        draw_trajectory(axes, run.recording.true_path(), "truth")
        draw_trajectory(axes, run.result.trajectory, "estimate")
        axes.set(xlim=window[:2], ylim=window[2:])
        return f"{words}; the estimate is off by {100 * run.ate:.1f} cm (RMS)"

    return draw


def people_exhibit(empty: WorldRun, people: WorldRun) -> Exhibit:
    """Show somebody who walks ahead of the robot and drags its estimate along."""
    runs = pair(empty, people)
    moved = {state: run.dragged() for state, run in runs.items()}

    def draw(axes: Axes, state: str) -> str:
        for s in STATES:
            axes.plot(*moved[s], color=COLOUR[s], linewidth=2.2 if s == state else 0.8)
        axes.axhline(DRAGGED_METRES, color=COLOURS["truth"], linestyle=":", linewidth=1.2)
        for begin, _ in runs[state].doubts:
            axes.axvline(begin, color=COLOURS["hits"], linewidth=1.2)
        few_ticks(axes, xlabel="time [s]", ylabel="moved by scans in 2 s [m]", ylim=(0, None))
        most = moved[state][1].max()
        return f"scans moved the estimate by at most {most:.2f} m in 2 s; {runs[state].says}"

    reading = {state: float(metres.max()) for state, (_, metres) in moved.items()}
    symptom = map_of(runs, (2.5, 9.0, 5.0, 16.5), "the map of the corridor with true path and estimate")
    what = "six people walk through the building"
    return Exhibit("people", what, "moved by scans in 2 s", "m", reading, symptom, draw)


def glass_exhibit(empty: WorldRun, glass: WorldRun) -> Exhibit:
    """Show walls that send no light back."""
    runs = pair(empty, glass)
    silent = {state: run.silent() for state, run in runs.items()}

    def draw(axes: Axes, state: str) -> str:
        for s in STATES:
            t, share = silent[s]
            axes.plot(t, 100 * share, color=COLOUR[s], linewidth=2.2 if s == state else 0.8)
        few_ticks(axes, xlabel="time [s]", ylabel="beams without echo [%]", ylim=(0, None))
        return (
            f"at most {100 * silent[state][1].max():.0f} % of the beams of a scan come back without an echo"
        )

    reading = {state: float(100 * share.max()) for state, (_, share) in silent.items()}
    symptom = map_of(runs, (2.0, 8.0, 9.0, 17.0), "a part of the corridor's wall")
    what = "a tenth of the walls is glass"
    return Exhibit("glass", what, "most beams without echo", "%", reading, symptom, draw)


def door_exhibit(empty: WorldRun, doors: WorldRun) -> Exhibit:
    """Show doors that open and close while the robot does not see them."""
    runs = pair(empty, doors)
    changed = {state: run.changed() for state, run in runs.items()}

    def draw(axes: Axes, state: str) -> str:
        small_map(axes, runs[state].result.grid)
        x, y = changed[state].T
        axes.scatter(x, y, s=12, color=COLOURS["hits"], linewidths=0)
        axes.set(xlim=(-3.0, 16.0), ylim=(-3.0, 17.0))
        return f"{len(changed[state])} wall cells of one way lie in free space on the other way"

    reading = {state: float(len(cells)) for state, cells in changed.items()}
    symptom = map_of(runs, (3.5, 7.5, 6.5, 10.5), "an alcove of the corridor")
    what = "three doors open or close out of the robot's sight"
    return Exhibit("closed door", what, "wall cells gone or new", "", reading, symptom, draw)
