"""The node's logic without ROS: messages go in as they come, steps, poses and reasons for doubt come out.

It only reads the fields of messages, so messages of a bag serve as well. What cannot be used is counted and told, and
raises nothing.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter, deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import islice
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

import pfslam
from pfslam.errors import DataError
from pfslam.evaluation.corrections import NEUTRAL, find_corrections
from pfslam.io.bags import LATE, MOVED, find_place, is_fixed
from pfslam.io.selection import select
from pfslam.io.topics import NUMBERS, ODOMETRY, TF, Topic, frame_of, stamp_of
from pfslam.poses import Trajectory, compose, invert, quaternion_to_rotation, transform
from pfslam.recording import LidarScans, Recording
from pfslam.refined.health import BLIND_SECONDS
from pfslam.sensors import RobotModel
from pfslam_ros.localizer import Localizer, known_map
from pfslam_ros.scanner import LEARN, Scanner, beams_of

MOST_WAITING = 1000
"""Scans, and ten times as many poses of the odometry, that wait at most."""
CHECK_AFTER = 20.0
"""Seconds of scans that the check-up is given."""
MOST_POSES = 2000
"""Poses that the path keeps at most: then every second one goes."""
MAPPING, LOCALIZATION = "mapping", "localization"
WRONG = {
    "masks": ("mask", "beams see the robot itself"),
    "delay": ("scan_delay", "scans and odometry do not keep the same time"),
    "yaw": ("lidar_yaw", "the LiDAR looks elsewhere than tf says"),
    "scale": ("odometry_scale", "the robot does not drive as far as its odometry says"),
}
"""What the check-up can put right: the parameter, and what is wrong."""


@dataclass(frozen=True)
class Parameters:
    """The parameters of the node, by the names of slam_toolbox and AMCL where these have one."""

    mode: str = MAPPING
    map_file_name: str = ""
    """Where a map is saved and gone on from; with ``localization``, the map: YAML of map_server, or such a file."""
    base_frame: str = "base_link"
    odom_frame: str = "odom"
    map_frame: str = "map"
    scan_topic: str = "scan"
    odom_topic: str = ""
    """A topic of Odometry; without one the odometry is that of tf."""
    map_update_interval: float = 5.0
    """Seconds between two maps, and between two paths."""
    transform_tolerance: float = 0.5
    """Seconds by which map -> odom is stamped later than its scan, for others to use it until the next comes."""
    scan_delay: float = 0.0
    """Seconds by which scans are stamped too late."""
    lidar_yaw: float = 0.0
    """Degrees by which the LiDAR looks to the left of what tf says."""
    odometry_scale: float = 1.0
    """How many times as far the robot drives as its odometry says."""
    mask: tuple[float, ...] = ()
    """Sectors (deg, 0 ahead and left positive: from, to, from, to ...) of beams that see the robot itself."""

    def corrections(self) -> dict[str, Any]:
        """Return what is to be put right, as arguments of ``pfslam.io.selection.select``."""
        masks = [list(self.mask[k : k + 2]) for k in range(0, len(self.mask), 2)]
        stated = {"masks": masks, "delay": self.scan_delay}
        stated |= {"yaw": self.lidar_yaw, "scale": self.odometry_scale}
        return {name: value for name, value in stated.items() if value != NEUTRAL[name]}


@dataclass(frozen=True)
class Drive:
    """What the check-up is given: poses of the odometry and scans, each with its time (s)."""

    odometry: list[tuple[float, np.ndarray]] = field(default_factory=list)
    scans: list[tuple[float, np.ndarray]] = field(default_factory=list)

    def wants(self, t: float) -> bool:
        """Whether what is of time ``t`` (s) is still of use; a second more than needed, for poses after the scans."""
        return not self.scans or t < self.scans[0][0] + CHECK_AFTER + LATE


class Core:
    """SLAM, or localization, of one robot: ``on_...`` take messages, and ``due`` yields the steps they allow."""

    def __init__(self, parameters: Parameters):
        self.parameters, self.corrections = parameters, parameters.corrections()
        if parameters.mode not in (MAPPING, LOCALIZATION):
            raise DataError("parameter", "mode", parameters.mode, f"{MAPPING} or {LOCALIZATION}")
        self.file = Path(parameters.map_file_name) if parameters.map_file_name else None
        if parameters.mode == LOCALIZATION and not self.file:
            raise DataError("parameter", "map_file_name", "nothing", "the map to localize in")
        self.known = known_map(parameters.map_file_name) if parameters.mode == LOCALIZATION else None
        self.saved: pfslam.Mapper | None = None
        self.frames: dict[tuple[str, str], Topic] = {}
        self.frame = ""
        self.scanner: Scanner | None = None
        self.filter: Any = None
        self.waiting: deque[Any] = deque(maxlen=MOST_WAITING)
        self.poses: deque[tuple[float, str, np.ndarray]] = deque(maxlen=10 * MOST_WAITING)
        self.samples: deque[tuple[float, np.ndarray]] = deque(maxlen=MOST_WAITING)
        self.newest, self.last, self.shift = -np.inf, -np.inf, 0.0
        self.scans, self.steps, self.stride = 0, 0, 1
        self.asked, self.quiet = 0, 0
        self.path: list[tuple[float, np.ndarray]] = []
        self.first: Drive | None = Drive()
        self.lines: list[str] = []
        self.left_out: Counter[str] = Counter()
        self.told: Counter[str] = Counter()
        self.examples: dict[str, str] = {}
        if self.known is None and self.file and self.file.exists():
            self.saved = pfslam.Mapper.load(self.file)
            for step in self.saved.steps:
                self._keep(step.t, step.estimate)
                self.last = step.t

    def on_tf(self, message: Any) -> None:
        """Take a TFMessage of /tf or /tf_static: the tree of frames, and the odometry where no topic has it."""
        for part in message.transforms:
            pair, row = (frame_of(part), part.child_frame_id.lstrip("/")), np.array(NUMBERS[TF](part))
            with self._counting("transforms"):
                if pair[0] == self.parameters.odom_frame and not self.parameters.odom_topic:
                    self._on_pose(stamp_of(part), pair[1], row)
                elif (said := self.frames.get(pair)) is None:
                    self.frames[pair] = _said(_checked(row)[None])
                elif len(said.rows) == 1 and not is_fixed(two := np.vstack([said.rows, _checked(row)])):
                    self.frames[pair] = _said(two)  # a frame that moves

    def on_odometry(self, message: Any) -> None:
        """Take an Odometry message."""
        with self._counting("odometry"):
            child = message.child_frame_id.lstrip("/") or self.parameters.base_frame
            self._on_pose(stamp_of(message), child, np.array(NUMBERS[ODOMETRY](message)))

    def on_scan(self, message: Any) -> None:
        """Take a LaserScan; it waits until the odometry has come as far."""
        with self._counting("scans"):
            frame, t = beams_of(message).frame, stamp_of(message)
            self.frame = self.frame or frame
            if frame != self.frame:
                raise DataError("scan", "frame", frame, "that of the first scan")
            if self.newest - t > LATE:
                self.waiting.clear()  # of the time before a clock was set back
            elif t <= self.newest:
                raise DataError("scan", "stamp", f"{t:.3f} s", "a later one than that of the scan before")
            self.waiting.append(message)
            self.newest = t

    def on_initial_pose(self, message: Any) -> None:
        """Take a PoseWithCovarianceStamped in the map's frame, as RViz sends it: the search begins there."""
        with self._counting("initial poses"):
            pose = _planar(_matrix(_checked(np.array(NUMBERS[ODOMETRY](message)))))
            covariance = np.array(message.pose.covariance).reshape(6, 6)[np.ix_([0, 1, 5], [0, 1, 5])]
            if not isinstance(self.filter, Localizer) or not np.isfinite(covariance).all():
                expected = f"finite numbers, after the first scans, in mode {LOCALIZATION}"
                raise DataError("initial pose", "pose", pose, expected)
            self.filter.begin_near(pose, covariance)

    def due(self) -> Iterator[Any]:
        """Yield the step of each scan whose time has come: its ``t`` (s) and ``estimate (3,)``."""
        if self.filter is None and len(self.waiting) >= LEARN:
            with self._counting("attempts to begin"):
                self._begin([*islice(self.waiting, LEARN)])
        if self.filter is None or self.scanner is None:
            return
        while self.poses:
            with self._counting("odometry"):
                self._move(*self.poses.popleft())
        while self.waiting and self.filter.reaches(self.scanner.time(self.waiting[0]) + self.shift):
            step = None
            with self._counting("scans"):
                step = self._use(self.waiting.popleft())
            if step is not None:
                yield step

    @property
    def located(self) -> bool:
        """Whether there is a pose: at once where a map is made, and where it is known once the robot is found."""
        return self.steps > 0 and getattr(self.filter, "found", True)

    def map_to_odom(self, step: Any) -> np.ndarray:
        """Return the pose ``(3,)`` of the odometry's frame in the map's that puts the robot where a step found it."""
        samples = [*self.samples]
        k = bisect_left(samples, step.t, key=itemgetter(0))
        t, poses = zip(*samples[max(k - 1, 0) : k + 1], strict=True)
        robot = Trajectory(np.array(t), np.array(poses)).at(np.clip(step.t, t[0], t[-1]))
        return compose(step.estimate, invert(robot))

    def stamp(self, t: float) -> float:
        """Return the stamp (s) of messages about the time ``t`` of a step, by the robot's clock as it goes now."""
        return t - self.shift

    def doubt(self) -> str | None:
        """Say why the pose is not to be trusted now, None while it is; to be asked once a second."""
        self.quiet = 0 if self.steps > self.asked else self.quiet + 1
        self.asked = self.steps
        if self.filter is not None and self.steps and self.quiet <= BLIND_SECONDS:
            return self.filter.doubt
        since = f"no scan was used for more than {BLIND_SECONDS:.0f} s" if self.steps else "not begun"
        if len(self.waiting) < (1 if self.filter else LEARN):
            return f"{since}: no scans come"
        return f"{since}: {'no odometry comes' if self.filter else 'tf does not tell where the LiDAR is'}"

    def decided(self) -> list[str]:
        """Say in a line each what was decided since this was last asked."""
        lines, self.lines = self.lines, []
        return lines

    def news(self) -> list[str]:
        """Say in a line each what was left out, where that is more than when this was last asked."""
        new = [what for what, n in self.left_out.items() if n != self.told[what]]
        self.told = self.left_out.copy()
        return [f"{self.left_out[what]} {what}; the last time found {self.examples[what]}" for what in new]

    def save(self) -> str | None:
        """Save the map and all that is needed to go on; return what was done, None where there is nothing to save."""
        if self.file is None or self.filter is None or self.known is not None:
            return None
        self.filter.save(self.file)
        return f"{len(self.filter.steps)} scans are saved in {self.file}"

    def first_seconds(self) -> Recording | None:
        """Return the first seconds of the drive, for ``findings``: once, when they are over."""
        drive, scanner = self.first, self.scanner
        if not (drive and scanner and drive.scans):
            return None
        if drive.scans[-1][0] - drive.scans[0][0] < CHECK_AFTER:
            return None
        self.first = None
        odometry, scans = (
            (np.array(part) for part in zip(*rows, strict=True)) for rows in (drive.odometry, drive.scans)
        )
        robot = RobotModel(lidar=scanner.model)
        whole = Recording(
            "the first seconds", robot, odometry=Trajectory(*odometry), lidar=LidarScans(*scans)
        )
        return select(whole, start=0.0)  # without the odometry from before the LiDAR was switched on

    def _on_pose(self, t: float, child: str, row: np.ndarray) -> None:
        """Keep a sample of the odometry; where its clock was set back, time goes on a second after the last."""
        if not t:
            raise DataError("odometry", "stamp", "0 s", "the time of the pose")
        if self.last - (t + self.shift) > LATE:
            self.shift = self.last + LATE - t
            self.lines.append(f"the clock was set back to {t:.3f} s: poses and scans go on from there")
            self.waiting.clear()
        self.last = max(self.last, t + self.shift)
        self.poses.append((t + self.shift, child, _checked(row)))

    def _place(self, frame: str, of: str) -> np.ndarray:
        T = find_place(self.frames, frame, of)
        if T is None:
            there = ", ".join(f"{a} -> {b}" for a, b in sorted(self.frames)) or "no frames at all"
            raise DataError("tf", f"{of} in {frame}", there, "a fixed chain of frames between them")
        return T

    def _begin(self, messages: list[Any]) -> None:
        """Learn the scanner from its first scans, and make the filter."""
        T_bl = self._place(self.parameters.base_frame, frame_of(messages[0]))
        self.scanner = Scanner.of(messages, T_bl, self.corrections)
        lidar = self.scanner.model
        if self.saved is not None:
            before = self.saved.odometer.robot.lidar
            ours, theirs = ([m.beams, m.angle_min, m.angle_max, *m.position_b] for m in (lidar, before))
            if not np.allclose(ours, theirs, rtol=0.0, atol=MOVED):
                raise DataError(self.file, "LiDAR", lidar, f"that of the saved map, {before}")
        self.filter = self.saved or (Localizer(lidar, self.known) if self.known else pfslam.Mapper(lidar))
        x, y, z = lidar.position_b
        self.lines += [
            *self.scanner.notes,
            f"begun: {lidar.beams} beams at x {x:.3f} m, y {y:.3f} m, z {z:.3f} m",
        ]

    def _move(self, t: float, child: str, row: np.ndarray) -> None:
        """Give the filter a pose of the odometry."""
        T, base = _matrix(row), self.parameters.base_frame
        pose = _planar(T if child == base else T @ self._place(child, base))
        driven = pose * [self.parameters.odometry_scale, self.parameters.odometry_scale, 1.0]
        self.filter.add_odometry(t, driven)
        self.samples.append((t, pose))
        if self.first and self.first.wants(t):
            self.first.odometry.append((t, driven))

    def _use(self, message: Any) -> Any:
        """Give the filter a scan, if it is one of every so many; return its step."""
        assert self.scanner is not None
        t, ranges = self.scanner.time(message) + self.shift, self.scanner.ranges(message)
        if self.first and self.first.wants(t):
            self.first.scans.append((t, ranges))
        self.scans += 1
        if (self.scans - 1) % self.scanner.every:
            return None
        if not self.filter.covers(t):
            raise DataError("scan", "odometry", f"none before {t:.3f} s", "odometry before it and after it")
        step = self.filter.add(t, ranges)
        self._keep(step.t, step.estimate)
        return step

    def _keep(self, t: float, estimate: np.ndarray) -> None:
        """Add a pose to the path, which keeps every second one where it would grow too long."""
        if self.steps % self.stride == 0:
            self.path.append((t, estimate))
        self.steps += 1
        if len(self.path) > MOST_POSES:
            del self.path[1::2]
            self.stride *= 2

    @contextmanager
    def _counting(self, what: str) -> Iterator[None]:
        """Count a message that cannot be used, in the place of raising."""
        try:
            yield
        except DataError as error:
            reason = f"{what} left out: {error.source}, {error.field}: expected {error.expected}"
            self.left_out[reason] += 1
            self.examples[reason] = error.found


def findings(recording: Recording, parameters: Parameters) -> list[str]:
    """Check the first seconds of a drive, as the command ``check`` does; a line for each thing to put right."""
    known = parameters.corrections()
    found, _, answers = find_corrections(recording, known)
    lines = []
    for name, value in found.items():
        parameter, what = WRONG[name]
        if name == "masks":
            value = (np.ravel(value) - parameters.lidar_yaw).tolist()
        lines.append(f"{what}: set the parameter {parameter} to {value} and start the node anew")
    wrong = [answer for answer in answers if answer.severity in ("warning", "stop")]
    return lines + [f"{a.question} {a.found}, expected {a.expected}. {a.remedy}".strip() for a in wrong]


def _said(rows: np.ndarray) -> Topic:
    """What was said of a pair of frames, as the reader of bags keeps it."""
    t = np.zeros(len(rows))
    return Topic("tf", TF, t, t, t, rows)


def _checked(row: np.ndarray) -> np.ndarray:
    """Return a position and a quaternion ``(7,)`` of length 1, as they must be."""
    length = float(np.linalg.norm(row[3:]))
    if not np.isfinite(row).all() or abs(length - 1.0) > 0.01:
        raise DataError("tf", "pose", row, "finite numbers, a quaternion of length 1")
    return np.append(row[:3], row[3:] / length)


def _matrix(row: np.ndarray) -> np.ndarray:
    return transform(quaternion_to_rotation(row[3:]), row[:3])


def _planar(T: np.ndarray) -> np.ndarray:
    return np.array([T[0, 3], T[1, 3], np.arctan2(T[1, 0], T[0, 0])])
