"""Settings of a simulated drive; the defaults are the real robot of the report on a flat floor."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import radians
from typing import Annotated, Literal

from pfslam.sensors import EncoderModel, LidarModel, RobotModel
from pfslam.settings import Range, Settings

Share = Annotated[float, Range(0.0, 1.0)]
Offset = Annotated[float, Range(-10.0, 10.0)]
Offsets = tuple[Offset, Offset, Offset]
Spread = Annotated[float, Range(0.0, 10.0)]
End = Annotated[float, Range(-5.0, 5.0)]
Ends = tuple[End, End]


@dataclass(frozen=True)
class SlipModel(Settings):
    """Wheel slip: a skid-steered robot turns by dragging its wheels sideways."""

    true_metres_per_count: Annotated[float, Range(1e-9, 100.0)] = 0.254 * 3.141592653589793 / 360
    """What the wheel really travels per count; the report rounds it to 0.0022 m."""
    effective_track: Annotated[float, Range(1e-3, 100.0)] = 0.735
    """Track (m) that turns a wheel difference into yaw; the wheels stand 0.394 m apart."""
    straight: Annotated[float, Range(-0.9, 0.9)] = 0.013
    """Wheel travel lost on the floor, as a fraction."""
    turning: Annotated[float, Range(-0.9, 0.9)] = 0.008
    """Further loss per rad/s of yaw rate."""
    wander: Annotated[float, Range(0.0, 0.9)] = 0.006
    """Standard deviation of the slow changes of the loss, and of left against right."""


@dataclass(frozen=True)
class GyroModel(Settings):
    """Errors of the gyro and the accelerometer."""

    bias: Offsets = (0.0039, 0.0051, 0.0005)
    warm_up: Offset = 0.0020
    """Extra yaw bias at switch-on (rad/s), gone after a second."""
    scale: Annotated[float, Range(0.01, 100.0)] = 1.03
    """True rate over shown rate."""
    noise: Spread = 0.0039
    """Standard deviation at rest (rad/s)."""
    sway: Spread = 0.025
    """Roll and pitch rate of the body per m/s of speed, standard deviation (rad/s)."""
    acceleration_bias_g: Offsets = (-0.009, -0.008, 0.011)
    acceleration_noise_g: Spread = 0.001
    acceleration_sway_g: Spread = 0.008
    """Shaking per m/s of speed, standard deviation (g)."""


@dataclass(frozen=True)
class Timing(Settings):
    """When the instruments begin and end, relative to the encoders (s)."""

    still_start: Annotated[float, Range(0.0, 3600.0)] = 9.7
    still_end: Annotated[float, Range(0.0, 3600.0)] = 8.4
    imu: Ends = (0.28, -1.42)
    camera: Ends = (1.80, 1.00)
    jitter: Share = 1.0
    """Scale of all clock jitter; 0 gives stamps without any."""


@dataclass(frozen=True)
class Hazards(Settings):
    """What makes a drive hard: all of it is off unless asked for, and each has random numbers of its own."""

    people: Annotated[int, Range(0, 1000)] = 0
    """People, each of whom meets the robot once: the first walks ahead of it, the others cross its way or pass it."""
    doors: Annotated[int, Range(0, 1000)] = 0
    """Doors, across the deepest side alcoves, that open or close whenever the robot is where it cannot see them."""
    glass: Share = 0.0
    """Share of the walls' length that is glass, where half of the beams return nothing and half ``range_max``."""
    sweep: Annotated[float, Range(0.0, 1.0)] = 0.0
    """Time (s) from the first beam of a scan to the last, about 0.025 for a real scanner; 0 is the robot's own."""
    bumps: Annotated[int, Range(0, 1000)] = 0
    """Stretches of a few seconds on which the floor pitches or rolls the robot by 1.5 to 3 degrees."""
    slip: Annotated[int, Range(0, 1000)] = 0
    """Moments at which all wheels lock, or spin at twice their speed."""


@dataclass(frozen=True)
class SimulatorConfig(Settings):
    """One simulated drive.

    ``layout``: "arms" (two corridors at a right angle and a cluttered room), "loop" (a small ring of corridors),
    "symmetric" (one that looks the same after half a turn), "ring" (60 m by 40 m, with shallow door
    frames), "corridor" (20 m along a bare corridor whose ends are out of range).
    """

    name: str = "hall"
    number: Annotated[int, Range(0, 10**9)] = 20
    layout: Literal["arms", "loop", "symmetric", "ring", "corridor"] = "arms"
    laps: Annotated[int, Range(1, 1000)] = 1
    """How often the route is driven, one lap after the other (not for "corridor")."""
    path_length: Annotated[float, Range(1.0, 1e5)] = 95.2
    """Length of the drive (m), reached by choosing where the robot turns round ("arms" only)."""
    cruise_speed: Annotated[float, Range(0.01, 100.0)] = 0.97
    top_yaw_rate: Annotated[float, Range(0.01, 100.0)] = 1.5
    slopes: bool = False
    robot: RobotModel = field(default_factory=RobotModel)
    timing: Timing = field(default_factory=Timing)
    slip: SlipModel = field(default_factory=SlipModel)
    gyro: GyroModel = field(default_factory=GyroModel)
    quantised: bool = True
    """Whole counts, millimetres, 1e-6 rad/s, microseconds. Off only for checks of the exact geometry."""
    range_noise: Annotated[float, Range(0.0, 100.0)] = 0.01
    """Standard deviation of a range (m)."""
    invalid_share: Share = 0.004
    """Share of the beams that return nothing."""
    hazards: Hazards = field(default_factory=Hazards)
    disparity_noise: Annotated[float, Range(0.0, 1000.0)] = 0.5
    """Standard deviation of a disparity before rounding (counts)."""
    missing_disparity: Share = 0.01
    """Share of the pixels near enough for a reading that have none."""


HALL = SimulatorConfig()
RAMP = SimulatorConfig(
    name="ramp",
    number=21,
    path_length=91.0,
    cruise_speed=1.03,
    top_yaw_rate=1.85,
    slopes=True,
    timing=Timing(still_start=12.9, still_end=10.3, imu=(0.48, -1.57), camera=(3.33, -3.32)),
    gyro=GyroModel(
        bias=(0.0015, 0.0037, 0.0003), warm_up=-0.0020, acceleration_bias_g=(-0.005, -0.006, 0.008)
    ),
)
RING = SimulatorConfig(
    name="ring",
    number=95,
    layout="ring",
    robot=RobotModel(lidar=LidarModel(range_max=20.0)),
    slip=SlipModel(true_metres_per_count=EncoderModel().metres_per_count / 1.02, straight=0.0),
    gyro=GyroModel(bias=(0.0039, 0.0051, radians(0.1)), scale=1.0),
)
"""Long corridors, a scanner that does not see their ends, wheels that count 2 % too much, and a gyro that drifts."""
PRESETS = {"hall": HALL, "ramp": RAMP, "ring": RING}
