"""Chapter 08, faults of the filter and of the map: runs with one wrong part, and the numbers that give it away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.correlation import map_correlation
from pfslam.evaluation.trajectory import aligned_at_first, rms
from pfslam.grid import LOG_4, GridSpec, MapConfig, OccupancyGrid, integrate_scan
from pfslam.map import Prior
from pfslam.motion import controls
from pfslam.particles import ControlNoise, MotionNoise, Particles, predict
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.refined.search.matching import SearchConfig
from pfslam.run import used_scans
from pfslam.sensors import LidarModel, scan_points
from pfslam.slam import Belief, SlamConfig, Step, slam_step


def plain_filter(particles: int = 100) -> SlamConfig:
    """Return a particle filter without any search: particles are predicted, weighted where they stand, and resampled.

    With a search that moves every particle to its best pose, most faults of the filter stay hidden.
    """
    noise = MotionNoise(xy=0.006, xy_per_metre=0.03, yaw=0.002, yaw_per_radian=0.04, yaw_per_metre=0.01)
    search = SearchConfig(
        yaw_step=0.0025,
        cells=(0, 0),
        yaws=(0, 0),
        beam_stride=8,
        field="distance",
        sharpness=20.0,
        weight="likelihood",
    )
    drawing = MapConfig(free=0.1 * LOG_4, clamp=5.0 * LOG_4)
    return SlamConfig(
        particles=particles,
        every=20,
        noise=noise,
        search=search,
        map=drawing,
        estimate="mean",
        resample_below=0.5,
    )


@dataclass(frozen=True, eq=False)
class LabRun:
    """A run after its first scan: infos, the clouds before and after each resampling, its last state, the error.

    ``error (K,)`` is the distance (m) from the truth at each step. Where nothing was resampled both clouds are alike.
    """

    infos: tuple[Step, ...]
    clouds: tuple[tuple[Particles, Particles], ...]
    state: Belief
    error: np.ndarray

    @property
    def ate(self) -> float:
        """Return the root mean square of the error (m)."""
        return rms(self.error)

    @property
    def spread(self) -> np.ndarray:
        """Return how far off the cloud thinks it may be (m): standard deviation of its positions, at each step."""
        return np.array([np.hypot(*before.poses[:, :2].std(axis=0)) for before, _ in self.clouds])

    @property
    def resampled(self) -> list[tuple[Particles, Particles]]:
        """Return the clouds before and after each resampling."""
        return [pair for info, pair in zip(self.infos, self.clouds, strict=True) if info.resampled]

    @property
    def typical_spread(self) -> float:
        """Return the median of that over the run (m)."""
        return float(np.median(self.spread))

    @property
    def seconds(self) -> np.ndarray:
        return np.array([i.t for i in self.infos]) - self.infos[0].t

    @property
    def n_eff_share(self) -> np.ndarray:
        """Return N_eff / N before resampling, at each step."""
        return np.array([i.effective_sample_size / len(self.state.particles) for i in self.infos])

    @property
    def n_eff_after(self) -> float:
        """Return mean of N_eff / N straight after resampling: 1 if the weights were made equal."""
        return float(np.mean([n_eff_of(after) for _, after in self.resampled]))

    @property
    def families(self) -> np.ndarray:
        """Return how many of the first particles still have a descendant, after each step."""
        ancestor, alive = np.arange(len(self.state.particles)), []
        for before, after in self.clouds:
            ancestor = ancestor[parents(before, after)]
            alive.append(len(np.unique(ancestor)))
        return np.array(alive)

    @property
    def known_rows(self) -> float:
        """Return the share of the resampled poses that are, as whole rows, poses of the cloud they were drawn from."""
        return float(np.mean([known_share(new.poses, old.poses) for old, new in self.resampled]))

    @property
    def score(self) -> float:
        """Return the median over the run of the mean score per beam."""
        return float(np.median([i.score for i in self.infos]))


def n_eff_of(particles: Particles) -> float:
    """Return N_eff / N of one cloud."""
    return float(1.0 / np.sum(particles.weights**2) / len(particles))


def known_share(new: np.ndarray, old: np.ndarray) -> float:
    """Return which share of the rows of ``new (N, 3)`` are rows of ``old (N, 3)``."""
    return float(np.mean((new[:, None, :] == old).all(axis=2).any(axis=1)))


def parents(before: Particles, after: Particles) -> np.ndarray:
    """Return from which particle of the cloud ``before`` the position of each one ``after`` came, ``(N,)``."""
    return (after.poses[:, None, :2] == before.poses[:, :2]).all(axis=2).argmax(axis=1)


def lab_run(recording: Recording, config: SlamConfig, seed: int = 0) -> LabRun:
    """Return the filter over a recording."""
    rng, state, infos, clouds = np.random.default_rng(seed), Belief.start(config), [], []
    for event in used_scans(recording, config).events():
        state, info = slam_step(state, event, config, rng)
        if info.matched and info.particles is not None:
            infos.append(info)
            clouds.append((info.particles, state.particles))
    path = Trajectory(np.array([i.t for i in infos]), np.array([i.estimate for i in infos]))
    poses, true_poses = aligned_at_first(path, recording.true_path())
    return LabRun(tuple(infos), tuple(clouds), state, np.hypot(*(poses - true_poses)[:, :2].T))


def shift_test(recording: Recording, run: LabRun, config: SlamConfig, metres: float = 0.5):
    """Return the score per beam of the last scan with the cloud where it is, and moved aside by ``metres``."""
    rng, state = np.random.default_rng(0), run.state
    *_, event = used_scans(recording, config).events()
    moved = Particles(state.particles.poses + [metres, metres, 0.0], state.particles.log_weights)
    priors = (
        Prior(p, state.estimate, np.full(2, 1e-4), state.estimate, None) for p in (state.particles, moved)
    )
    return tuple(float(state.map.match(event, prior, config.search, rng).score.mean()) for prior in priors)


# ---- a cloud torn apart


def cloud_without_scans(recording: Recording, begin: float, seconds: float, n: int = 300) -> Particles:
    """Return a cloud that was only predicted for some seconds, from the true pose: a banana."""
    t = recording.scans().t[0] + begin
    v, omega, dt = controls(recording).during(t, t + seconds)
    cloud, rng = Particles.at(np.zeros(3), n), np.random.default_rng(0)
    for k in range(len(v)):
        cloud = predict(cloud, v[k], omega[k], dt[k], ControlNoise(0.3, 0.3), rng)
    return cloud


def sideways(particles: Particles) -> np.ndarray:
    """Return how far left ``(N,)`` m of the cloud's middle each particle lies, seen along the way from the origin."""
    poses = particles.poses - particles.poses.mean(axis=0)
    theta = np.arctan2(*particles.poses[:, 1::-1].mean(axis=0))
    return -np.sin(theta) * poses[:, 0] + np.cos(theta) * poses[:, 1]


def heading_against_side(particles: Particles) -> float:
    """Return correlation of heading and sideways place over the cloud."""
    return float(np.corrcoef(sideways(particles), particles.poses[:, 2])[0, 1])


def heading_if_placed(particles: Particles, sigma: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """Return headings ``(N,)`` rad from their mean, and weights ``(N,)``, with the place known to ``sigma`` m."""
    side, heading = sideways(particles), particles.poses[:, 2] - particles.poses[:, 2].mean()
    weights = np.exp(-0.5 * (side / sigma) ** 2)
    weights /= weights.sum()
    return heading - weights @ heading, weights


# ---- the map: a door that opens, and two ways to find a cell


DOOR_BEAMS = slice(440, 641)
"""Fifty degrees straight ahead."""


def door_scans(
    recording: Recording, at: float = 20.0, distance: float = 1.5
) -> tuple[np.ndarray, np.ndarray]:
    """Return two scans ``(beams,)`` from one place in the corridor: a door closed ``distance`` m ahead, and open."""
    scans = recording.scans()
    opened = scans.ranges[int(np.searchsorted(scans.t, scans.t[0] + at))].astype(float)
    closed = opened.copy()
    lidar = recording.robot.lidar
    closed[DOOR_BEAMS] = np.minimum(closed[DOOR_BEAMS], distance / np.cos(lidar.angles[DOOR_BEAMS]))
    return closed, opened


@dataclass(frozen=True, eq=False)
class DoorMap:
    """Log-odds ``(K,)`` of the middle of the door scan by scan, and the map ten scans after the door has opened."""

    history: np.ndarray
    grid: OccupancyGrid
    opened_at: int

    @property
    def to_believe(self) -> int:
        """Return how many scans through the open door the map needs until its cell is free."""
        return int(np.argmax(self.history[self.opened_at :] < -0.1)) + 1


def door_map(closed, opened, lidar: LidarModel, clamp: float, shut: int = 60, free: int = 70) -> DoorMap:
    """A standing robot maps a door for ``shut`` scans while it is closed and ``free`` scans while it is open."""
    points = np.concatenate([scan_points(closed, lidar), scan_points(opened, lidar), np.zeros((1, 2))])
    grid = OccupancyGrid.empty(GridSpec.around(points, 0.05))
    sensor, config = np.array(lidar.position_b[:2]), MapConfig(clamp=clamp)
    middle = scan_points(closed, lidar)[np.count_nonzero(lidar.valid(closed[: lidar.beams // 2]))]
    (ix, iy), history, shown = grid.spec.world_to_cell(middle), [], grid
    for k, ranges in enumerate([closed] * shut + [opened] * free):
        beams = np.flatnonzero(lidar.valid(ranges))
        integrate_scan(grid, scan_points(ranges, lidar), beams, sensor, config)
        history.append(float(grid.log_odds[iy, ix]))
        shown = grid.copy() if k == shut + 9 else shown
    return DoorMap(np.array(history), shown, shut)


def self_match(ranges: np.ndarray, lidar: LidarModel, shifts: np.ndarray, rounded: bool) -> np.ndarray:
    """Return the share of a scan's points on the walls it drew itself, when it is moved aside by ``shifts`` m.

    ``rounded``: the score takes the *nearest* integer where the map took the floor.
    """
    points = scan_points(ranges, lidar)
    spec = GridSpec.around(np.concatenate([points, np.zeros((1, 2))]), 0.05)
    ix, iy = spec.world_to_cell(points).T
    occupied = np.zeros(spec.shape, dtype=bool)
    occupied[iy, ix] = True
    half = 0.5 * spec.resolution if rounded else 0.0  # round(x) is floor(x + 1/2)
    counts = [map_correlation(occupied, spec, points + s + half) for s in shifts]
    return np.array(counts) / len(points)


def best_shift(shifts: np.ndarray, share: np.ndarray) -> float:
    """Return the middle (m) of the shifts that score best."""
    return float(np.mean(shifts[share >= share.max() - 1e-12]))
