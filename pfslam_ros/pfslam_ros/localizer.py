"""Where in a saved map? The search of the command ``locate``, one scan at a time, in the manner of ``Mapper``."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import pfslam
from pfslam.beyond.localization import (
    EXPLAINED_SHARE,
    NEAR_METRES,
    NEAR_RADIANS,
    KnownMap,
    LocalizationConfig,
    LocalizationInfo,
    LocalizationState,
    localization_step,
    spread,
)
from pfslam.grid import OccupancyGrid
from pfslam.particles import Particles
from pfslam.poses import wrap_angle
from pfslam.sensors import LidarModel, RobotModel


def known_map(path: str | Path) -> OccupancyGrid:
    """Read the map to localize in: a map_server map (YAML), or what a node that maps has saved (npz)."""
    return pfslam.Mapper.load(path).grid if Path(path).suffix == ".npz" else pfslam.read_known_map(path)


class Localizer:
    """A search for the pose in a known map: odometry and scans go in as they come. The seed is 0, as of ``locate``."""

    def __init__(self, lidar: LidarModel, grid: OccupancyGrid):
        self.config, self.rng = LocalizationConfig(), np.random.default_rng(0)
        self.known = KnownMap.of(grid, self.config)
        self.odometer = pfslam.Odometer(RobotModel(lidar=lidar))
        self.add_odometry, self.reaches = self.odometer.add_pose, self.odometer.reaches
        self.covers = self.odometer.covers
        n = self.config.first
        self.begin(Particles(spread(grid, n, self.rng), np.zeros(n)))

    def begin(self, particles: Particles) -> None:
        """Begin the search with these particles."""
        self.state = LocalizationState(particles)
        self.info: LocalizationInfo | None = None
        self.explained = np.zeros(2)  # sum and number of the shares since the pose was found

    def begin_near(self, pose: np.ndarray, covariance: np.ndarray) -> None:
        """Begin the search around a pose ``(3,)`` (m, m, rad) of a covariance ``(3, 3)``, in the frame of the map."""
        n = self.config.particles
        self.begin(Particles(self.rng.multivariate_normal(pose, covariance, n), np.zeros(n)))

    def add(self, t: float, ranges: np.ndarray) -> LocalizationInfo:
        """Take the scan stamped ``t`` (s) with ``ranges (B,)`` (m); ``DataError`` where it cannot be used."""
        event = self.odometer.event(t, ranges)
        self.state, info = localization_step(self.state, event, self.known, self.rng)
        self.info = info
        if info.used and (self.found or self.explained[1]):
            self.explained += info.explained, 1.0
        return info

    @property
    def found(self) -> bool:
        """Whether the particles agree on one place."""
        return self.info is not None and self.info.share >= self.config.found

    @property
    def grid(self) -> OccupancyGrid:
        """The map that was given."""
        return self.known.grid

    @property
    def pose(self) -> np.ndarray:
        """The estimate ``(3,)`` (m, m, rad) in the map's frame, at the last scan."""
        return np.zeros(3) if self.info is None else self.info.estimate

    @property
    def covariance(self) -> np.ndarray | None:
        """The covariance ``(3, 3)`` of the particles that the estimate is the mean of; None before the first scan."""
        if self.info is None or self.info.particles is None:
            return None
        off = self.info.particles.poses - self.info.estimate
        off[:, 2] = wrap_angle(off[:, 2])
        near = (np.hypot(*off[:, :2].T) <= NEAR_METRES) & (np.abs(off[:, 2]) <= NEAR_RADIANS)
        weights = self.info.particles.weights * near
        return (off.T * weights) @ off / max(weights.sum(), 1e-12)

    @property
    def doubt(self) -> str | None:
        """Why the pose is not to be trusted, by the rules of ``locate``; None while it is."""
        if self.info is None or not self.found:
            share = 0.0 if self.info is None else self.info.share
            return f"the robot is not found yet: {100 * share:.0f} % of the particles agree on a place"
        mean = self.explained[0] / max(self.explained[1], 1.0)
        if mean >= EXPLAINED_SHARE:
            return None
        return f"the map explains only {100 * mean:.0f} % of what was seen: is it the map of this place?"
