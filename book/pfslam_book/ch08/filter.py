"""Chapter 08, faults of the filter and of the map: runs with one wrong part, and the numbers that give it away."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from pfslam.correlation import map_correlation
from pfslam.evaluation.trajectory import aligned_at_first, rms
from pfslam.grid import LOG_4, GridSpec, MapConfig, OccupancyGrid, integrate_scan
from pfslam.motion import controls
from pfslam.particles import ControlNoise, Particles, predict, resample
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.refined.map import Prior
from pfslam.refined.matching import SearchConfig
from pfslam.refined.noise import MotionNoise
from pfslam.refined.step import RefinedBelief, RefinedConfig, RefinedStep, refined_step
from pfslam.sensors import LidarModel, scan_points
from pfslam_book.ch08.data import BENDS, hall
from pfslam_book.ch08.fault import Panel, Seen
from pfslam_book.show import faults

REPLACED: dict[str, dict] = {
    "kept weights": {"refined.step.resample": faults.keep_weights},
    "torn rows": {"refined.step.resample": faults.torn_rows},
    "w = 0": {"refined.map.match": faults.match_without_translation},
}
"""Which function of the package a broken filter replaces; weights that are too sharp are a setting."""


def plain_filter(particles: int = 100) -> RefinedConfig:
    """Return a particle filter without any search: particles are predicted, weighted where they stand, and resampled.

    With a search that moves every particle to its best pose, most faults of the filter stay hidden.
    """
    noise = MotionNoise(xy=0.006, xy_per_metre=0.03, yaw=0.002, yaw_per_radian=0.04, yaw_per_metre=0.01)
    search = SearchConfig(cells=(0, 0), yaws=(0, 0), yaw_step=0.0025, beam_stride=8, sharpness=20.0)
    plainly = replace(
        RefinedConfig(), lines=None, tilt=False, draw_metres=0.0, draw_radians=0.0, beam_spacing=0.0
    )
    return replace(plainly, particles=particles, every=20, noise=noise, search=search, resample_below=0.5)


@dataclass(frozen=True, eq=False)
class LabRun:
    """A run after its first scan: infos, the clouds before and after each resampling, its last state, the error.

    ``error (K,)`` is the distance (m) from the truth at each step. Where nothing was resampled both clouds are alike.
    """

    infos: tuple[RefinedStep, ...]
    clouds: tuple[tuple[Particles, Particles], ...]
    state: RefinedBelief
    error: np.ndarray

    @property
    def ate(self) -> float:
        """Return the root mean square of the error (m)."""
        return rms(self.error)

    @property
    def seconds(self) -> np.ndarray:
        """Return the times since the first step."""
        return np.array([i.t for i in self.infos]) - self.infos[0].t

    @property
    def spread(self) -> np.ndarray:
        """Return how far off the cloud thinks it may be (m): standard deviation of its positions, at each step."""
        return np.array([np.hypot(*before.poses[:, :2].std(axis=0)) for before, _ in self.clouds])

    @property
    def resampled(self) -> list[tuple[Particles, Particles]]:
        """Return the clouds before and after each resampling."""
        return [pair for info, pair in zip(self.infos, self.clouds, strict=True) if info.resampled]

    @property
    def size(self) -> np.ndarray:
        """Return N_eff / N before resampling, at each step."""
        return np.array([i.effective_sample_size / len(self.state.particles) for i in self.infos])

    @property
    def size_after(self) -> np.ndarray:
        """Return N_eff / N straight after each resampling: 1 if the weights were made equal."""
        return np.array([1.0 / np.sum(new.weights**2) / len(new) for _, new in self.resampled])

    @property
    def known_rows(self) -> float:
        """Return the share of the resampled poses that are, as whole rows, poses of the cloud they were drawn from."""
        known = [(new.poses[:, None] == old.poses).all(axis=2).any(axis=1) for old, new in self.resampled]
        return float(np.mean(known))


def lab_run(recording: Recording, config: RefinedConfig, seed: int = 0) -> LabRun:
    """Return the filter over a recording."""
    rng, state, infos, clouds = np.random.default_rng(seed), config.start(), [], []
    for event in config.used_scans(recording).events():
        state, info = refined_step(state, event, config, rng)
        if info.matched and info.particles is not None:
            infos.append(info)
            clouds.append((info.particles, state.particles))
    path = Trajectory(np.array([i.t for i in infos]), np.array([i.estimate for i in infos]))
    poses, true_poses = aligned_at_first(path, recording.true_path())
    return LabRun(tuple(infos), tuple(clouds), state, np.hypot(*(poses - true_poses)[:, :2].T))


@cache
def filter_run(name: str, seed: int = 0) -> LabRun:
    """Return one run through the bends of the filter of this name, healthy or broken."""
    config = faults.every_beam_a_witness(plain_filter()) if name == "too sharp" else plain_filter()
    return faults.with_fault(
        REPLACED.get(name, {}), lab_run, faults.scans_between(hall(), *BENDS), config, seed
    )


def score_aside(name: str, seed: int = 0, metres: tuple[float, ...] = (0.0, 0.5)) -> np.ndarray:
    """Return the score per beam of the last scan with the cloud moved aside by so many metres."""
    config, state = plain_filter(), filter_run(name, seed).state
    *_, event = config.used_scans(faults.scans_between(hall(), *BENDS)).events()

    def score(aside: float) -> float:
        cloud = Particles(state.particles.poses + [aside, aside, 0.0], state.particles.log_weights)
        prior = Prior(cloud, state.estimate, np.full(2, 1e-4), state.estimate, None)
        return float(state.map.match(event, prior, config.search, np.random.default_rng(0)).score.mean())

    return np.array([faults.with_fault(REPLACED.get(name, {}), score, aside) for aside in metres])


def _errors(run: LabRun) -> Panel:
    """Return the error over time, and as a shade how far off the cloud itself thinks it may be."""
    error, shade = (run.seconds, 100 * run.error), (run.seconds, 200 * run.spread)
    return Panel("time [s]", "error [cm]", curve=error, shade=shade)


def too_sharp(broken: bool) -> Seen:
    """Weigh by the softmax of the count."""
    run = filter_run("too sharp" if broken else "healthy")
    size = Panel("time [s]", "$N_{eff}/N$", curve=(run.seconds, run.size))
    return Seen(float(np.median(run.size)), _errors(run), size)


def kept_weights(broken: bool) -> Seen:
    """Let weights survive resampling."""
    run = filter_run("kept weights" if broken else "healthy")
    curve = (np.arange(len(run.resampled)), run.size_after)
    size = Panel("resampling", "$N_{eff}/N$ after it", curve=curve, limits={"ylim": (0, 1.05)})
    return Seen(float(run.size_after.mean()), _errors(run), size)


def cloud_without_scans(begin: float = 23.0, seconds: float = 4.0, n: int = 300) -> Particles:
    """Return a cloud that was only predicted for some seconds, from the true pose: a banana."""
    t = hall().scans().t[0] + begin
    v, omega, dt = controls(hall()).during(t, t + seconds)
    cloud, rng = Particles.at(np.zeros(3), n), np.random.default_rng(0)
    for k in range(len(v)):
        cloud = predict(cloud, v[k], omega[k], dt[k], ControlNoise(0.3, 0.3), rng)
    return cloud


def torn_rows(broken: bool) -> Seen:
    """Draw positions and headings separately."""
    draw, run = (faults.torn_rows, "torn rows") if broken else (resample, "healthy")
    _, y, theta = draw(cloud_without_scans(), np.random.default_rng(1), "systematic").poses.T
    cloud = (y - y.mean(), np.rad2deg(theta - theta.mean()))
    panel = Panel("sideways [m]", "heading [deg]", dots=cloud)
    return Seen(filter_run(run).known_rows, _errors(filter_run(run)), panel)


def blind(broken: bool) -> Seen:
    """Make points that a pose turns but never moves."""
    name, metres = "w = 0" if broken else "healthy", (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
    scores = score_aside(name, metres=metres)
    panel = Panel("moved aside [m]", "mean score", curve=(metres, scores), limits={"ylim": (0, 1)})
    return Seen(scores[0] - scores[-1], _errors(filter_run(name)), panel)


# ---- the map: a door that opens, and two ways to find a cell


DOOR_BEAMS = slice(440, 641)
"""Fifty degrees straight ahead."""


@cache
def door_scans(at: float = 20.0, distance: float = 1.5) -> tuple[np.ndarray, np.ndarray]:
    """Return two scans ``(beams,)`` from one place in the corridor: a door closed ``distance`` m ahead, and open."""
    scans, angles = hall().scans(), hall().robot.lidar.angles[DOOR_BEAMS]
    opened = scans.ranges[int(np.searchsorted(scans.t, scans.t[0] + at))].astype(float)
    closed = opened.copy()
    closed[DOOR_BEAMS] = np.minimum(closed[DOOR_BEAMS], distance / np.cos(angles))
    return closed, opened


def door_history(
    lidar: LidarModel, clamp: float, shut: int = 60, free: int = 70
) -> tuple[np.ndarray, OccupancyGrid]:
    """Return log-odds ``(K,)`` of a door, shut and then open, scan by scan; and the map ten scans after it opened."""
    closed, opened = door_scans()
    points = np.concatenate([scan_points(closed, lidar), scan_points(opened, lidar), np.zeros((1, 2))])
    grid = OccupancyGrid.empty(GridSpec.around(points, 0.05))
    middle = scan_points(closed, lidar)[np.count_nonzero(lidar.valid(closed[: lidar.beams // 2]))]
    (ix, iy), history, shown = grid.spec.world_to_cell(middle), [], grid
    for k, ranges in enumerate([closed] * shut + [opened] * free):
        beams, sensor = np.flatnonzero(lidar.valid(ranges)), np.array(lidar.position_b[:2])
        integrate_scan(grid, scan_points(ranges, lidar), beams, sensor, MapConfig(clamp=clamp))
        history.append(float(grid.log_odds[iy, ix]))
        shown = grid.copy() if k == shut + 9 else shown
    return np.array(history), shown


def no_clamp(broken: bool) -> Seen:
    """Let log-odds grow without a limit before a door that then opens."""
    history, grid = door_history(hall().robot.lidar, np.inf if broken else 2.0 * LOG_4)
    symptom = Panel(grid=grid, limits={"xlim": (-0.5, 4.5), "ylim": (-2.5, 2.5)})
    panel = Panel("scan", "log-odds of the door", curve=(np.arange(len(history)), history), level=0.0)
    return Seen(float(np.argmax(history[60:] < -0.1) + 1), symptom, panel)


def half_a_cell(broken: bool) -> Seen:
    """Take the floor of a coordinate in the map, and round to the nearest integer in the score."""
    points = scan_points(door_scans()[1], hall().robot.lidar)
    grid = OccupancyGrid.empty(GridSpec.around(np.concatenate([points, np.zeros((1, 2))]), 0.05))
    ix, iy = grid.spec.world_to_cell(points).T
    grid.log_odds[iy, ix] = 1.0
    seen = points + (0.025 if broken else 0.0)  # round(x) is floor(x + 1/2)
    shifts = np.arange(-0.1, 0.1001, 0.005)
    share = np.array([map_correlation(grid.occupied, grid.spec, seen + s) for s in shifts]) / len(points)
    x, y = points[np.argmin(np.hypot(*(points - [1.0, 1.0]).T))]
    symptom = Panel(
        grid=grid, dots=tuple(seen.T), limits={"xlim": (x - 0.4, x + 0.4), "ylim": (y - 0.4, y + 0.4)}
    )
    panel = Panel("moved along x and y [cm]", "share on own walls", curve=(100 * shifts, share))
    return Seen(100 * float(np.mean(shifts[share >= share.max() - 1e-12])), symptom, panel)
