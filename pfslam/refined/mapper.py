"""A map while the robot drives: scans go in one at a time, pose, map and doubt come out."""

from __future__ import annotations

import json
from collections.abc import Sequence
from copy import copy
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.grid import Canvas, GridSpec, OccupancyGrid
from pfslam.io.files import read_npz, write_npz
from pfslam.particles import Particles
from pfslam.refined.health import COLUMNS, Steps, distrust
from pfslam.refined.map import RefinedMap
from pfslam.refined.odometer import Odometer
from pfslam.refined.outliers import WaitingScan
from pfslam.refined.record import RefinedStep
from pfslam.refined.step import RefinedBelief, RefinedConfig, refined_step
from pfslam.sensors import LidarModel, RobotModel
from pfslam.settings import changed, plain, written
from pfslam.slam import SlamConfig

FORMAT = b"pfslam belief 6"
"""Changes with the layout of the file, and the seal with it."""
LAYERS = ("log_odds", "scores", "slots", "sums", "first", "drawn")
STEPS = {f"step_{name}": name for name in COLUMNS}


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

        Only the scans since the last question are judged: after four hours it takes half a millisecond to ask.
        """
        return next((doubt["reason"] for doubt in distrust(self._steps) if doubt["to"] is None), None)

    def save(self, path: str | Path) -> None:
        """Write all that the next scan needs into one ``.npz`` file of plain numbers, whole or not at all.

        The layers of the map and the columns of the steps are arrays; all that is small is JSON, kept as its UTF-8
        bytes in the array ``told``. The array ``seal`` is a check sum over them, so that a file is the one that was
        written, or refused.
        """
        state, map, odometer = self.rng.bit_generator.state, self.belief.map, vars(self.odometer)
        if state["bit_generator"] != "PCG64":
            raise DataError(path, "rng", state["bit_generator"], "NumPy's default generator, PCG64")
        belief = self.belief
        told = {
            "config": plain(self.config),
            "lidar": plain(self.odometer.robot.lidar),
            "rng": state,
            "odometer": {name: value for name, value in odometer.items() if name != "robot"},
            "particles": vars(belief.particles),
            "belief": [belief.estimate, belief.variance, belief.covariance, belief.corrected],
            "map": [map.spec.origin, map.drawn_at, [vars(scan) for scan in map.waiting]],
        }
        text = json.dumps(told, default=_as_list)
        moments, drawn = map.moments, np.reshape(map.drawn, (-1, 3, 3))
        layers = map.grid.log_odds, map.field, moments.slots.values, moments.sums, moments.first, drawn
        arrays = {"told": np.frombuffer(text.encode(), dtype=np.uint8)}
        arrays |= dict(zip(LAYERS, layers, strict=True))
        arrays |= {key: self._steps.columns[name] for key, name in STEPS.items()}
        write_npz(path, **arrays, seal=_seal(arrays))

    @classmethod
    def load(cls, path: str | Path) -> Mapper:
        """Read what ``save`` wrote, and go on as if nothing had been; ``DataError`` for any other file."""
        data = read_npz(path, ("told", *LAYERS, *STEPS, "seal"))
        if not np.array_equal(data.pop("seal"), _seal(data)):
            expected = "what Mapper.save of this version wrote"
            raise DataError(path, "seal", "one of other numbers than the file's", expected)
        told = json.loads(data["told"].tobytes(), object_hook=_as_array)
        config = changed(RefinedConfig(), written(RefinedConfig, told["config"]))
        mapper = cls(changed(LidarModel(), written(LidarModel, told["lidar"])), config)
        mapper.rng.bit_generator.state = told["rng"]
        vars(mapper.odometer).update(told["odometer"])
        particles = Particles(**told["particles"])
        # Normalised a second time, weights may differ in the last bit.
        vars(particles).update(told["particles"])
        map = _map_of(data, config, *told["map"])
        estimate, variance, covariance, corrected = told["belief"]
        mapper.belief = RefinedBelief(particles, estimate, map, variance, covariance, corrected)
        mapper._steps = Steps.of_columns({name: data[key] for key, name in STEPS.items()})
        return mapper


def _map_of(data: dict[str, np.ndarray], config: RefinedConfig, origin, drawn_at, waiting) -> RefinedMap:
    """Put a map together again, of its layers and of what JSON held."""
    spec = GridSpec(origin, config.map.resolution, data["log_odds"].shape)
    map = RefinedMap(config.map, spec, config.lines, config.outliers)
    map._log_odds, map._scores, slots = (Canvas(spec, data[n].dtype, data[n]) for n in LAYERS[:3])
    map.moments.slots, map.moments.used = slots, len(data["first"])
    map.moments._sums, map.moments._first = data["sums"], data["first"]
    map.drawn, map.drawn_at, map.is_empty = list(data["drawn"]), drawn_at, drawn_at is None
    map.waiting = tuple(WaitingScan(**scan) for scan in waiting)
    return map


def _as_list(value: Any) -> Any:
    return {"array": value.tolist()} if isinstance(value, np.ndarray) else value.item()


def _as_array(told: dict[str, Any]) -> Any:
    return np.array(told["array"]) if "array" in told else told


def _seal(arrays: dict[str, np.ndarray]) -> np.ndarray:
    """Compute a check sum over names, types, shapes and numbers."""
    seal = blake2b(FORMAT)
    for name, values in arrays.items():
        seal.update(f"{name} {values.dtype} {values.shape}".encode() + values.tobytes())
    return np.frombuffer(seal.digest(), dtype=np.uint8)


def _numbers(t, values) -> tuple[float, np.ndarray]:
    try:
        return float(t), np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise DataError("Mapper", "scan or odometry", "something else", "numbers") from None
