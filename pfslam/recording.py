"""A data set in memory: what each instrument said, and when.

Every stream keeps its own clock stamps ``t`` in seconds, one row per reading. Streams are paired by stamp, never by
index. A stream that the robot did not have is ``None``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeVar

import numpy as np

from pfslam.errors import DataError
from pfslam.poses import Trajectory, check_rows, check_stamps
from pfslam.sensors import RobotModel

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Encoders:
    """``t (K,)`` s; ``counts (K, 4)`` since the previous reading, columns FR, FL, RR, RL, forward positive."""

    t: np.ndarray
    counts: np.ndarray

    def __post_init__(self):
        check_stamps(self.t, "encoders")
        check_rows(self.counts, "encoders", "counts", (len(self.t), 4))


@dataclass(frozen=True, eq=False)
class Imu:
    """``t (K,)`` s; ``angular_velocity (K, 3)`` rad/s; ``acceleration_g (K, 3)`` in units of gravity."""

    t: np.ndarray
    angular_velocity: np.ndarray
    acceleration_g: np.ndarray

    def __post_init__(self):
        check_stamps(self.t, "imu")
        check_rows(self.angular_velocity, "imu", "angular_velocity", (len(self.t), 3))
        check_rows(self.acceleration_g, "imu", "acceleration_g", (len(self.t), 3))


@dataclass(frozen=True, eq=False)
class LidarScans:
    """``t (K,)`` s; ``ranges (K, beams)`` m as reported, invalid readings included."""

    t: np.ndarray
    ranges: np.ndarray

    def __post_init__(self):
        check_stamps(self.t, "lidar")
        if np.ndim(self.ranges) != 2 or self.ranges.shape[0] != len(self.t) or self.ranges.shape[1] == 0:
            raise DataError(
                "lidar", "ranges", f"shape {np.shape(self.ranges)}", f"({len(self.t)}, beams >= 1)"
            )


@dataclass(frozen=True, eq=False)
class RgbdStream:
    """Disparity and colour images with a clock each: ``disparity_t (K,)``, ``rgb_t (J,)`` in seconds.

    Images are read (or rendered) one at a time: ``read_disparity(k) -> (480, 640) uint16`` and
    ``read_rgb(j) -> (480, 640, 3) uint8``, indices from 0. ``disparity_index`` and ``rgb_index`` list the images that
    exist, since a recording may keep only every n-th.
    """

    disparity_t: np.ndarray
    rgb_t: np.ndarray
    read_disparity: Callable[[int], np.ndarray]
    read_rgb: Callable[[int], np.ndarray]
    disparity_index: np.ndarray
    rgb_index: np.ndarray

    def __post_init__(self):
        check_stamps(self.disparity_t, "camera (disparity)")
        check_stamps(self.rgb_t, "camera (rgb)")


def chosen(stream: T, rows: np.ndarray, **others: np.ndarray) -> T:
    """Return a stream of the readings of a mask ``(K,)``, with some of its arrays replaced by ``others``."""
    kept = {field.name: getattr(stream, field.name)[rows] for field in fields(stream)}  # type: ignore[arg-type]
    return replace(stream, **kept | others)  # type: ignore[type-var]


SCANS_PER_SECOND = 8.0
"""How many scans of a faster scanner a filter uses unless told otherwise: 5 of the course's 40 make one update."""
SCATTER_SCANS = 200
"""Scans of a recording, evenly spread, from which the scatter of its ranges is estimated."""


@dataclass(frozen=True, eq=False)
class Recording:
    """One drive. ``odometry`` is for logs that hold integrated odometry poses instead of encoders and gyro."""

    name: str
    robot: RobotModel = field(default_factory=RobotModel)
    encoders: Encoders | None = None
    imu: Imu | None = None
    odometry: Trajectory | None = None
    lidar: LidarScans | None = None
    camera: RgbdStream | None = None
    truth: Trajectory | None = None
    dropped: dict[str, int] = field(default_factory=dict)
    """Readings left out while loading, by reason."""
    notes: tuple[str, ...] = ()
    """What the loader had to decide or saw, each in one line, for the user to read."""
    scan_matched: bool = False
    """Whether the odometry was made of the scans, because there is no other (``refined.scan_odometry``)."""

    def __post_init__(self):
        only_scans = self.encoders is None and self.lidar is not None
        if self.odometry is None and (self.encoders is None or self.imu is None) and not only_scans:
            found = "neither encoders with IMU nor odometry poses"
            raise DataError(self.name, "odometry", found, "one of the two, or scans alone")
        if self.lidar is not None and self.lidar.ranges.shape[1] != self.robot.lidar.beams:
            beams = (f"{n} beams" for n in (self.lidar.ranges.shape[1], self.robot.lidar.beams))
            raise DataError(self.name, "lidar ranges", *beams)

    def wheels_and_gyro(self) -> tuple[Encoders, Imu]:
        """The encoders and the IMU; ``DataError`` if the recording lacks one of them."""
        if self.encoders is None or self.imu is None:
            missing = "encoders" if self.encoders is None else "imu"
            expected = "a recording with encoders and IMU; with_scan_odometry makes an odometry of scans"
            raise DataError(self.name, missing, "nothing", expected)
        return self.encoders, self.imu

    def scans(self) -> LidarScans:
        """The LiDAR scans; ``DataError`` if the recording has none."""
        if self.lidar is None:
            raise DataError(self.name, "lidar", "no scans", "a recording with LiDAR")
        return self.lidar

    @property
    def motion(self) -> str:
        """What tells how the robot moved: "odometry", "encoders and gyro", or "scans" alone."""
        if self.scan_matched or (self.odometry is None and self.encoders is None):
            return "scans"
        return "encoders and gyro" if self.odometry is None else "odometry"

    def streams(self) -> dict[str, Any]:
        """The streams of numbers that the recording has, by their names; images are not among them."""
        parts = {name: getattr(self, name) for name in ("encoders", "imu", "odometry", "lidar", "truth")}
        return {name: part for name, part in parts.items() if part is not None}

    @property
    def default_every(self) -> int:
        """Every how-many-th scan a filter uses unless told otherwise, so that it sees about eight a second."""
        if self.lidar is None or len(self.lidar.t) < 2:
            return 1
        rate = 1.0 / float(np.median(np.diff(self.lidar.t)))
        return max(1, round(rate / SCANS_PER_SECOND))

    def range_scatter(self) -> float:
        """Estimate how far the ranges of neighbouring beams scatter (m): their standard deviation, 0 without scans.

        On a straight wall two beams say where a third between them ends, whatever the angle between them; what is left
        is noise. Far away, neighbours lie on different things: so the nearest quarter of the triples is taken, and of
        these the median, because some lie across an edge. Noise does not depend on how far apart the beams are, but
        what a bend of the wall leaves does, at least in proportion: what grows from neighbours to every other beam is
        taken off. Beams so few that this cannot be seen show no noise.
        """
        if self.lidar is None:
            return 0.0
        ranges = self.lidar.ranges[:: max(1, len(self.lidar.ranges) // SCATTER_SCANS)]
        seen = self.robot.lidar.valid(ranges)
        near, far = (_off_the_wall(ranges, seen, k, k * self.robot.lidar.increment) for k in (1, 2))
        # With a bend s: near^2 = noise^2 + s^2, and far^2 = noise^2 + (2 s)^2.
        noise = near**2 - max(far**2 - near**2, 0.0) / 3.0 if max(near, far) < np.inf else 0.0
        return float(np.sqrt(max(noise, 0.0)))

    def true_path(self) -> Trajectory:
        """The true trajectory of a simulated recording; ``DataError`` where nobody knows it."""
        if self.truth is None:
            raise DataError(self.name, "truth", "none", "a simulated recording, which knows its truth")
        return self.truth


def _off_the_wall(ranges: np.ndarray, seen: np.ndarray, apart: int, angle: float) -> float:
    """Return the spread (m) of ranges ``(K, beams)`` about those of a wall through the beams on either side.

    These are ``apart`` beams, or ``angle`` rad, away. Along a wall 1 / r is a sum of sine and cosine, so that the
    middle one of three is 2 a b cos(angle) / (a + b). Infinite where no three beams are ``seen`` in less than half a
    turn.
    """
    count = max(ranges.shape[1] - 2 * apart, 0)
    right, middle, left = (slice(k, k + count) for k in (0, apart, 2 * apart))
    triples = seen[:, right] & seen[:, middle] & seen[:, left]
    if not triples.any() or 2.0 * angle >= np.pi:
        return np.inf
    triples &= ranges[:, middle] <= np.quantile(ranges[:, middle][triples], 0.25)
    a, r, b = (ranges[:, part][triples].astype(float) for part in (right, middle, left))
    share = 2.0 * np.cos(angle) / (a + b) ** 2  # times b^2 and a^2, what an error of a or of b does
    off = (r - share * a * b * (a + b)) / np.sqrt(1.0 + share**2 * (a**4 + b**4))
    return float(np.median(np.abs(off)) / 0.6745)


@dataclass(frozen=True, eq=False)
class Pairs:
    """Images matched by time: indices ``disparity (P,)``, ``rgb (P,)``; ``unpaired`` counts those without partner."""

    disparity: np.ndarray
    rgb: np.ndarray
    unpaired: int


def nearest_stamp(t: np.ndarray, query: np.ndarray) -> np.ndarray:
    """Index ``(Q,)`` of the stamp in ``t (K,)`` (increasing) nearest to each ``query (Q,)``; the earlier on a tie."""
    t, query = np.asarray(t, dtype=float), np.asarray(query, dtype=float)
    right = np.clip(np.searchsorted(t, query), 1, max(len(t) - 1, 1))
    left = right - 1
    if len(t) == 1:
        return np.zeros(query.shape, dtype=int)
    return np.where(query - t[left] <= t[right] - query, left, right)


def image_pairs(camera: RgbdStream, max_gap: float = 0.1, every: int = 1) -> Pairs:
    """Each stored RGB image with the stored disparity image nearest in time, at most ``max_gap`` seconds away.

    ``every`` keeps every n-th pair.
    """
    if len(camera.disparity_index) == 0 or len(camera.rgb_index) == 0:
        none = np.zeros(0, dtype=int)
        return Pairs(none, none, len(camera.rgb_index))
    t_rgb, t_disparity = camera.rgb_t[camera.rgb_index], camera.disparity_t[camera.disparity_index]
    nearest = nearest_stamp(t_disparity, t_rgb)
    near = np.abs(t_disparity[nearest] - t_rgb) <= max_gap
    return Pairs(
        camera.disparity_index[nearest[near]][::every],
        camera.rgb_index[near][::every],
        int(np.count_nonzero(~near)),
    )
