"""A map while the robot drives: scans go in one at a time, pose, map and doubt come out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from pfslam.errors import DataError
from pfslam.events import Odometer
from pfslam.grid import OccupancyGrid
from pfslam.io.beliefs import read_belief, write_belief
from pfslam.refined.health import distrust
from pfslam.sensors import LidarModel, RobotModel
from pfslam.slam import Belief, SlamConfig, Step, slam_step


class Mapper:
    """SLAM for a robot's own node: each scan is handed over with where the odometry was at its stamp.

    ``config=None`` is ``SlamConfig.refined()``, ``rng=None`` seed 0; ``config.every`` is for whoever calls ``add``. The
    estimate is that of the first look of ``run_slam`` over the same scans and odometry, to the last bit. The map's
    frame is the robot at its first scan.

    >>> mapper = Mapper(LidarModel())
    >>> step = mapper.add(10.0, np.full(1081, 2.0), (0.0, 0.0, 0.0))
    >>> mapper.pose.tolist(), step.drawn, mapper.doubt
    ([0.0, 0.0, 0.0], True, None)
    """

    def __init__(
        self,
        lidar: LidarModel,
        config: SlamConfig | None = None,
        *,
        rng: np.random.Generator | None = None,
    ):
        self.config = SlamConfig.refined() if config is None else config
        if self.config.maps != "shared":
            raise DataError("Mapper", "maps", self.config.maps, "shared: one map")
        self.rng = np.random.default_rng(0) if rng is None else rng
        self.odometer, self.belief = Odometer(RobotModel(lidar=lidar)), Belief.start(self.config)
        self.steps: list[Step] = []
        """What happened at each scan, as in ``SlamResult.infos``, without the clouds."""

    def add(self, t: float, ranges, odometry) -> Step:
        """Take the scan stamped ``t`` (s) with ``ranges (B,)`` (m), and return what became of it.

        ``odometry (3,)`` is the pose (m, m, rad) of the robot's own odometry at that stamp, in whatever frame that has.
        Ranges that are no measurement may be NaN, infinite or out of range, as scanners report them. Where the LiDAR
        has a sweep, the robot is taken to move during it as it did since the scan before, and to stand at the first.
        Where the odometry jumps it goes on from where it was; ``odometer.jumps`` counts that.
        Raises ``DataError``, and leaves the scan out, where the numbers cannot be used.
        """
        beams = self.odometer.robot.lidar.beams
        try:
            t, ranges, odometry = float(t), np.asarray(ranges, dtype=float), np.asarray(odometry, dtype=float)
        except (TypeError, ValueError):
            raise DataError("Mapper", "scan or odometry", "something else", "numbers") from None
        if ranges.shape != (beams,):
            raise DataError("Mapper", "ranges", f"shape {ranges.shape}", f"({beams},), one for each beam")
        self.odometer.add_pose(t, odometry)
        event = self.odometer.event(t, ranges)
        self.belief, step = slam_step(self.belief, event, self.config, self.rng)
        self.steps.append(replace(step, particles=None))
        return step

    @property
    def pose(self) -> np.ndarray:
        """The estimate ``(3,)`` (m, m, rad) at the last scan."""
        return self.belief.estimate

    @property
    def covariance(self) -> np.ndarray | None:
        """The covariance ``(3, 3)`` of the pose, as in ``Step``; None before the first scan and without lines."""
        return self.steps[-1].covariance if self.steps else None

    @property
    def grid(self) -> OccupancyGrid:
        """The map so far, which goes on changing: ``grid.log_odds.copy()`` keeps it."""
        return self.belief.grid

    @property
    def doubt(self) -> str | None:
        """Why the pose is not to be trusted now, as ``SlamResult.distrust`` says it; None while it is.

        All scans so far are asked: some milliseconds after a thousand, so a node asks once a second.
        """
        reasons = [stretch["reason"] for stretch in distrust(self.steps) if stretch["to"] is None]
        return reasons[0] if reasons else None

    def save(self, path: str | Path) -> None:
        """Write all that the next scan needs into one ``.npz`` file of plain numbers, whole or not at all."""
        write_belief(path, self.config, self.rng, self.odometer, self.belief, self.steps)

    @classmethod
    def load(cls, path: str | Path) -> Mapper:
        """Read what ``save`` wrote, and go on as if nothing had been; ``DataError`` for any other file."""
        mapper = cls.__new__(cls)
        mapper.config, mapper.rng, mapper.odometer, mapper.belief, mapper.steps = read_belief(path)
        return mapper
