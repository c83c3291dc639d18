"""A map while the robot drives: scans go in one at a time, pose, map and doubt come out."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from pathlib import Path

import numpy as np

from pfslam.errors import DataError
from pfslam.grid import OccupancyGrid
from pfslam.refined.beliefs import read_belief, write_belief
from pfslam.refined.health import Steps, distrust
from pfslam.refined.odometer import Odometer
from pfslam.refined.record import RefinedStep
from pfslam.refined.step import RefinedBelief, RefinedConfig, refined_step
from pfslam.sensors import LidarModel, RobotModel
from pfslam.slam import SlamConfig


class Mapper:
    """SLAM for a robot's own node: odometry and scans go in as they come.

    ``config=None`` is ``SlamConfig.refined()``, ``rng=None`` seed 0; ``config.every`` is for whoever calls ``add``. The
    estimate is that of the first look of ``run_slam`` over the same scans and odometry, to the last bit. The map's
    frame is the robot at its first scan.

    >>> mapper = Mapper(LidarModel())
    >>> mapper.add_odometry(10.0, (0.0, 0.0, 0.0))
    >>> mapper.reaches(10.1)
    False
    >>> mapper.add_odometry(10.2, (0.1, 0.0, 0.0))
    >>> step = mapper.add(10.1, np.full(1081, 2.0)) if mapper.covers(10.1) else None
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
        self.config = RefinedConfig() if config is None else RefinedConfig.of(config)
        if not isinstance(self.config.start(), RefinedBelief):
            raise DataError("Mapper", "config", type(self.config).__name__, "settings of one map")
        self.rng = np.random.default_rng(0) if rng is None else rng
        begins = self.config.predict_before_first_scan
        self.odometer, self.belief = Odometer(RobotModel(lidar=lidar), begins), self.config.start()
        self._steps = Steps()

    def add_odometry(self, t: float, pose) -> None:
        """Take a pose ``(3,)`` (m, m, rad) of the robot's own odometry, in whatever frame that has, stamped ``t`` (s).

        Every sample counts, in the order of the stamps. Where the odometry jumps it goes on from where it was;
        ``odometer.jumps`` counts that. Raises ``DataError``, and leaves the sample out, where it cannot be used.
        """
        self.odometer.add_pose(*_numbers(t, pose))

    def reaches(self, t: float) -> bool:
        """Whether the odometry goes on to the last beam of a scan stamped ``t`` (s), so that its time has come."""
        return self.odometer.reaches(t)

    def covers(self, t: float) -> bool:
        """Whether there is odometry on both sides of a scan stamped ``t`` (s), as ``add`` and ``run_slam`` need it.

        A scan that is reached and not covered came before the first sample: a run leaves it out, too.
        """
        return self.odometer.covers(t)

    def add(self, t: float, ranges, odometry=None) -> RefinedStep:
        """Take the scan stamped ``t`` (s) with ``ranges (B,)`` (m), and return what became of it.

        Where the robot was is read off between the samples of ``add_odometry``. A node that knows the pose at that
        very stamp hands it over as ``odometry (3,)`` instead: where the LiDAR has a sweep, the robot is then taken to
        move during it as it did since the scan before, and to stand at the first. Ranges that are no measurement may be
        NaN, infinite or out of range, as scanners report them. Raises ``DataError`` where the numbers cannot be used.
        After an exception of any kind the scan is left out, and everything is as it was.
        """
        beams = self.odometer.robot.lidar.beams
        t, ranges = _numbers(t, ranges)
        if ranges.shape != (beams,):
            raise DataError("Mapper", "ranges", f"shape {ranges.shape}", f"({beams},), one for each beam")
        odometer = {name: copy(value) for name, value in vars(self.odometer).items()}
        before = self.belief, len(self._steps), self.rng.bit_generator.state
        drawn = self.belief.map.undo
        try:
            if odometry is not None:
                self.add_odometry(t, odometry)
            event = self.odometer.event(t, ranges)
            self.belief, step = refined_step(self.belief, event, self.config, self.rng)
            self._steps.append(step)
            return step
        except BaseException:  # Ctrl-C, too: a node saves its belief when it is stopped
            self.belief, count, self.rng.bit_generator.state = before
            vars(self.odometer).update(odometer)
            self._steps.cut(count)
            if (undo := self.belief.map.undo) is not drawn and undo is not None:
                undo()
                self.belief.map.undo = drawn
            raise

    @property
    def steps(self) -> Sequence[RefinedStep]:
        """What happened at each scan, as in ``SlamResult.infos``, without the clouds."""
        return self._steps

    @property
    def pose(self) -> np.ndarray:
        """The estimate ``(3,)`` (m, m, rad) at the last scan."""
        return self.belief.estimate

    @property
    def covariance(self) -> np.ndarray | None:
        """The covariance ``(3, 3)`` of the pose, as in a step; None before the first scan and without lines."""
        return self.steps[-1].covariance if self.steps else None

    @property
    def grid(self) -> OccupancyGrid:
        """The map so far, which goes on changing: ``grid.log_odds.copy()`` keeps it."""
        return self.belief.grid

    @property
    def doubt(self) -> str | None:
        """Why the pose is not to be trusted now, as ``RefinedResult.distrust`` says it; None while it is.

        All scans so far are asked: some ten milliseconds after four hours, so a node asks once a second.
        """
        reasons = [stretch["reason"] for stretch in distrust(self._steps) if stretch["to"] is None]
        return reasons[0] if reasons else None

    def save(self, path: str | Path) -> None:
        """Write all that the next scan needs into one ``.npz`` file of plain numbers, whole or not at all."""
        write_belief(path, self.config, self.rng, self.odometer, self.belief, self._steps)

    @classmethod
    def load(cls, path: str | Path) -> Mapper:
        """Read what ``save`` wrote, and go on as if nothing had been; ``DataError`` for any other file."""
        mapper = cls.__new__(cls)
        mapper.config, mapper.rng, mapper.odometer, mapper.belief, mapper._steps = read_belief(path)
        return mapper


def _numbers(t, values) -> tuple[float, np.ndarray]:
    try:
        return float(t), np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise DataError("Mapper", "scan or odometry", "something else", "numbers") from None
