"""What each instrument is: where it sits, what its numbers mean, and how they become SI units.

The defaults are the robot of the report. Positions are in the body frame b: origin on the floor under the
chassis centre, x forward, y left, z up, metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated

import numpy as np

from pfslam.errors import DataError
from pfslam.poses import roll_pitch_yaw, rotation_matrix, transform
from pfslam.settings import Range, Settings

STANDARD_GRAVITY = 9.80665  # m/s^2 in one g
MAX_BEAMS = 20_000
MAX_RANGE = 1e4
"""Metres."""
STEEPEST_DEG = 10.0
"""A LiDAR that leans more than this does not measure a floor plan."""
FLOOR_CLEARANCE = 0.1
"""What is lower than this above the ground under the robot (m) is taken to be floor, and no wall."""
Coordinate = Annotated[float, Range(-1000.0, 1000.0)]
Position = tuple[Coordinate, Coordinate, Coordinate]
BeamAngle = Annotated[float, Range(-20.0, 20.0)]
Distance = Annotated[float, Range(0.0, MAX_RANGE)]
Number = Annotated[float, Range(-1e9, 1e9)]
Positive = Annotated[float, Range(1e-6, 1e9)]


@dataclass(frozen=True)
class EncoderModel(Settings):
    """Four wheel encoders that report counts since their previous reading (columns FR, FL, RR, RL)."""

    metres_per_count: Annotated[float, Range(1e-9, 100.0)] = 0.0022
    """Travel per count. The report rounds pi * 0.254 m / 360 = 0.0022166 m to 0.0022 m, 0.75 % short."""
    track: Annotated[float, Range(1e-3, 100.0)] = 0.394
    """Distance between left and right wheels (m)."""


@dataclass(frozen=True)
class ImuModel(Settings):
    """Gyro and accelerometer."""

    yaw_axis: Annotated[int, Range(0, 2)] = 2
    """Column about whose axis the body yaws: 2 for columns x, y, z, 1 for y, z, x and 0 for z, x, y."""
    gyro_bias: Annotated[float, Range(-100.0, 100.0)] = 0.0
    """Yaw rate that the gyro shows at rest (rad/s)."""
    gyro_scale: Annotated[float, Range(-100.0, 100.0)] = 1.0
    """True yaw rate over measured yaw rate."""

    def in_body(self, readings: np.ndarray) -> np.ndarray:
        """Put the columns of raw readings ``(K, 3)``, of gyro or accelerometer, in the order of the body's x, y, z."""
        # Always laid out alike: sums are the same to the last bit, whatever the order of the columns was.
        return np.ascontiguousarray(np.roll(readings, 2 - self.yaw_axis, axis=1))

    def yaw_rate(self, angular_velocity: np.ndarray) -> np.ndarray:
        """True-scale yaw rate ``(K,)`` in rad/s from raw angular velocity ``(K, 3)`` in rad/s."""
        return self.gyro_scale * (angular_velocity[:, self.yaw_axis] - self.gyro_bias)


@dataclass(frozen=True)
class LidarModel(Settings):
    """A planar range finder. Beam i points at ``angle_min + i * increment``, counter-clockwise, 0 = forward."""

    angle_min: BeamAngle = float(np.deg2rad(-135.0))
    angle_max: BeamAngle = float(np.deg2rad(135.0))
    beams: Annotated[int, Range(1, MAX_BEAMS)] = 1081
    range_min: Distance = 0.1
    range_max: Distance = 30.0
    position_b: Position = (0.13323, 0.0, 0.51435)
    sweep: Annotated[float, Range(-100.0, 100.0)] = 0.0
    """Time (s) from the first beam to the last, the stamp being the middle beam's; 0 if all at once, or unknown.

    Negative where the last beam is measured first: a scanner that turns clockwise, or hangs upside down.
    """

    def __post_init__(self):
        super().__post_init__()
        for low, high in (("angle_min", "angle_max"), ("range_min", "range_max")):
            found = getattr(self, low), getattr(self, high)
            if found[0] > found[1]:
                raise DataError("LidarModel", f"{low}, {high}", found, "the lesser first")

    @classmethod
    def mounted(
        cls, T_bl: np.ndarray, ends: Sequence[float], beams: int, limits: Sequence[float], sweep: float = 0.0
    ) -> tuple[LidarModel, int]:
        """Describe a scanner at ``T_bl (4, 4)`` on the robot, by the angles (rad) of its first beam and of its last.

        ``limits`` are the least and the largest range (m), ``sweep`` the time (s) from the first beam to the last. Also
        returns the step, 1 or -1, that puts its ranges in the model's order: those of a scanner that turns clockwise,
        or hangs upside down, run the other way. Raises ``DataError`` where it does not measure a floor plan.
        """
        lean = float(np.degrees(np.arccos(np.clip(abs(T_bl[2, 2]), 0.0, 1.0))))
        if lean > STEEPEST_DEG:
            raise DataError("LidarModel", "mounting", f"a lean of {lean:.0f} deg", "a level LiDAR")
        seen = np.arctan2(T_bl[1, 0], T_bl[0, 0]) + np.sign(T_bl[2, 2]) * np.asarray(ends)
        low, high = (np.sort(seen) - 2.0 * np.pi * np.round(seen.mean() / (2.0 * np.pi))).tolist()
        step = 1 if seen[0] <= seen[1] else -1
        least, most = limits
        return cls(low, high, beams, least, most, tuple(T_bl[:3, 3].tolist()), step * sweep), step

    @property
    def angles(self) -> np.ndarray:
        """Beam angles ``(beams,)`` in the LiDAR frame (rad)."""
        return np.linspace(self.angle_min, self.angle_max, self.beams)

    @property
    def increment(self) -> float:
        """Angle between neighbouring beams (rad)."""
        return (self.angle_max - self.angle_min) / max(self.beams - 1, 1)

    def valid(self, ranges: np.ndarray) -> np.ndarray:
        """Which ranges are measurements: at least ``range_min`` and below ``range_max``.

        Exactly ``range_max`` is what many scanners write where nothing came back: as a measurement it would be a wall.
        """
        return np.isfinite(ranges) & (ranges >= self.range_min) & (ranges < self.range_max)


_OPTICAL_TO_CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class RgbdModel(Settings):
    """A depth camera that reports disparity, and a colour camera beside it; the constants of Eq. 16 and 17.

    ``pitch`` is positive downwards. Pixels are u (column) and v (row); images are ``[v, u]``.
    """

    width: Annotated[int, Range(1, 10_000)] = 640
    height: Annotated[int, Range(1, 10_000)] = 480
    focal_u: Positive = 585.05108211
    focal_v: Positive = 585.05108211
    skew: Number = 0.0
    centre_u: Number = 315.83800193
    centre_v: Number = 242.94140713
    disparity_slope: Number = -0.00304
    disparity_offset: Number = 3.31
    depth_scale: Positive = 1.03
    rgb_focal: Positive = 526.37
    rgb_baseline: Number = -4.5 * 1750.46
    rgb_offset_u: Number = 19276.0
    rgb_offset_v: Number = 16662.0
    rgb_divisor: Positive = 585.051
    position_b: Position = (0.16766, 0.0, 0.38001)
    roll: Number = 0.0
    pitch: Number = float(np.deg2rad(18.0))
    yaw: Number = 0.0

    @classmethod
    def registered(cls, width: int, height: int, K: np.ndarray, T_bo: np.ndarray) -> RgbdModel:
        """Describe a camera that gives depth in metres, and a colour for each of its pixels.

        ``K (3, 3)`` are its intrinsics and ``T_bo (4, 4)`` places its optical frame in the body's. Its disparity is one
        over depth in steps of 1e-4 1/m, each worth 1 mm at 3 m; the largest that fits 16 bits is 0.15 m away.
        """
        roll, pitch, yaw = roll_pitch_yaw(T_bo[:3, :3] @ _OPTICAL_TO_CAMERA.T)
        (fu, skew, u), (_, fv, v), _ = np.asarray(K, dtype=float).tolist()
        disparity = 1e-4, 0.0, 1.0  # slope, offset, scale
        colour = 1.0, 0.0, 0.0, 0.0, 1.0  # of Eq. 16: each pixel's is in the same pixel
        place = tuple(T_bo[:3, 3].tolist())
        return cls(width, height, fu, fv, skew, u, v, *disparity, *colour, place, roll, pitch, yaw)

    @property
    def K(self) -> np.ndarray:
        """Intrinsics ``(3, 3)`` of the depth camera for pixels (u, v, 1): Eq. 17, principal point in (u, v) order."""
        return np.array(
            [[self.focal_u, self.skew, self.centre_u], [0.0, self.focal_v, self.centre_v], [0.0, 0.0, 1.0]]
        )

    @property
    def T_bc(self) -> np.ndarray:
        """Camera frame (x forward, y left, z up) to body frame, ``(4, 4)``."""
        return transform(rotation_matrix(self.roll, self.pitch, self.yaw), self.position_b)

    @property
    def T_bo(self) -> np.ndarray:
        """Optical frame (x right, y down, z forward) to body frame, ``(4, 4)``."""
        return self.T_bc @ transform(_OPTICAL_TO_CAMERA)


@dataclass(frozen=True)
class RobotModel(Settings):
    """The instruments of one robot; the defaults are those of the report's."""

    encoders: EncoderModel = field(default_factory=EncoderModel)
    imu: ImuModel = field(default_factory=ImuModel)
    lidar: LidarModel = field(default_factory=LidarModel)
    camera: RgbdModel = field(default_factory=RgbdModel)


def nearest_ranges(angles: np.ndarray, first: float, increment: float, ranges: np.ndarray) -> np.ndarray:
    """Return the ranges ``(K,)`` at ``angles (K,)`` of a scan ``(B,)`` from the angle ``first`` on, all in rad.

    Each is the nearest beam's, NaN where there is none: so turns of a scanner that spins freely, with some beams more
    or less each time, come to the same angles. A negative ``increment`` is that of a scanner that turns clockwise.
    """
    beyond = (angles - first) * np.sign(increment) + 0.5 * abs(increment)
    k = (beyond % (2.0 * np.pi) / max(abs(increment), 1e-9)).astype(int)
    return np.where(k < len(ranges), np.asarray(ranges)[np.minimum(k, len(ranges) - 1)], np.nan)


def scan_points(ranges: np.ndarray, lidar: LidarModel) -> np.ndarray:
    """End points ``(M, 2)`` of the valid beams of a scan, in the body frame (m). Implements Eq. 7.

    ``ranges`` is ``(beams,)`` in metres. The floor is taken to be flat and the LiDAR to be level.
    """
    ranges = np.asarray(ranges, dtype=float)
    valid = lidar.valid(ranges)
    points_l = ranges[valid][:, None] * beam_directions(lidar).compress(valid, axis=0)
    return points_l + lidar.position_b[:2]


@lru_cache(maxsize=8)
def beam_directions(lidar: LidarModel) -> np.ndarray:
    """Unit vectors ``(beams, 2)`` along the beams in the LiDAR frame, made once for all scans of a scanner."""
    directions = np.stack([np.cos(lidar.angles), np.sin(lidar.angles)], axis=-1)
    directions.flags.writeable = False
    return directions
