"""A simulated building, robot and drive with exact truth.

``simulate("hall")`` stands for the report's data set 20 and ``simulate("ramp")`` for set 21: the same building with
slopes on its floor. ``simulate("ring")`` is a drive round four long corridors. Another seed gives another building, and
``Hazards`` put people, glass and more into it. Everything comes from one seed, through independent streams of random
numbers, so that the same call gives the same numbers on any machine and any number of cores.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pfslam.errors import DataError
from pfslam.grid import GridSpec
from pfslam.io.files import MAX_FIELD_BYTES
from pfslam.poses import Trajectory
from pfslam.recording import LidarScans, Recording, RgbdStream
from pfslam.settings import changed
from pfslam.simulator.camera import CameraRenderer
from pfslam.simulator.clocks import LIDAR_CLOCK, START_OF_TIME, camera_stamps, ticks_and_stamps, unix
from pfslam.simulator.config import HALL, PRESETS, RAMP, RING, Hazards, SimulatorConfig
from pfslam.simulator.drive import Drive, drive_path
from pfslam.simulator.hazards import add_hazards
from pfslam.simulator.lidar import measured, seen_through, true_ranges
from pfslam.simulator.odometry import encoder_counts, imu_samples
from pfslam.simulator.world import World, make_world

DEFAULT_SEED = 2021  # the building of the built-in sets

__all__ = ["HALL", "PRESETS", "RAMP", "RING", "Hazards", "Simulation", "SimulatorConfig", "simulate"]


@dataclass(frozen=True, eq=False)
class Simulation:
    """A recording, and what only a simulator knows about it.

    ``recording.truth`` holds the poses at the LiDAR's stamps; ``z``, ``pitch``, ``roll`` ``(K,)`` (m, rad) are the rest
    of the truth there.
    """

    recording: Recording
    config: SimulatorConfig
    seed: int
    world: World
    drive: Drive
    z: np.ndarray
    pitch: np.ndarray
    roll: np.ndarray
    renderer: CameraRenderer

    def floor_image(self, spec: GridSpec) -> np.ndarray:
        """Give the true colours ``(H, W, 3)`` uint8 of the floor, averaged over each cell."""
        return self.renderer.floor.image(spec, self.world.pose_pw)


def simulate(
    what: str | SimulatorConfig = "hall",
    seed: int | None = None,
    ranges: np.ndarray | None = None,
    progress: Callable | None = None,
    *,
    hazards: Hazards | None = None,
) -> Simulation:
    """Simulate one drive.

    ``what`` is "hall", "ramp", "ring" or a configuration; ``seed=None`` is the built-in building. ``hazards`` take the
    place of the configuration's own. Casting the scans takes most of the time: ``ranges (K, beams)`` of an earlier call
    with the same arguments may be given back instead, and ``progress`` wraps the casting, as tqdm does.

    >>> from pfslam.simulator import Hazards, simulate
    >>> len(simulate("hall", seed=7, hazards=Hazards(people=6)).world.people)
    6
    """
    config = _configuration(what, hazards)
    seed = DEFAULT_SEED if seed is None else _whole(seed)
    world = make_world(config, np.random.SeedSequence(seed))
    streams = np.random.SeedSequence([seed, config.number]).spawn(12)
    drive_rng, wheels, imu, scan_clock, scans, _, bumps, slips, *life = map(np.random.default_rng, streams)
    drive = drive_path(world.path, world.slopes, config, drive_rng, bumps)
    world = add_hazards(world, drive, config, *life[:3])
    ticks = ticks_and_stamps(LIDAR_CLOCK, 0.0087, drive.duration, scan_clock, config.timing.jitter)
    stamps = unix(ticks[1], config.quantised)
    ranges = _cast(config, world, drive, stamps, scans, life[3], progress) if ranges is None else ranges
    poses, z, pitch, roll = _truth(config, drive, stamps)
    renderer = _camera(config, world, drive, streams[5])
    recording = Recording(
        name=config.name,
        robot=config.robot,
        encoders=encoder_counts(drive, config, wheels, slips),
        imu=imu_samples(drive, config, imu),
        lidar=LidarScans(stamps, ranges),
        camera=_stream(renderer, config),
        truth=Trajectory(stamps, poses),
    )
    return Simulation(recording, config, seed, world, drive, z, pitch, roll, renderer)


def _truth(config: SimulatorConfig, drive: Drive, stamps: np.ndarray) -> tuple[np.ndarray, ...]:
    """Poses ``(K, 3)``, z, pitch and roll ``(K,)`` at the stamps."""
    truth = drive.at(stamps - START_OF_TIME)
    # Micrometres are exact enough, and the last bits, which differ between processors, stay out of the files.
    return tuple(np.round(values, 6) for values in truth) if config.quantised else truth


def _cast(
    config: SimulatorConfig,
    world: World,
    drive: Drive,
    stamps: np.ndarray,
    rng,
    glass,
    progress: Callable | None,
) -> np.ndarray:
    """Cast all scans: ranges ``(K, beams)`` float32 as the LiDAR reports them; glass has a generator of its own."""
    lidar = config.robot.lidar
    if 4 * len(stamps) * lidar.beams > MAX_FIELD_BYTES:
        expected = f"at most {MAX_FIELD_BYTES / 2**30:.0f} GiB of ranges"
        raise DataError("simulate", "scans, beams", (len(stamps), lidar.beams), expected)
    t = stamps - START_OF_TIME
    exact = true_ranges(world, drive, lidar, t, progress)
    ranges = measured(exact, config, rng)
    if len(world.glass):
        panes = true_ranges(world.panes, drive, lidar, t, only_walls=True)
        ranges = seen_through(ranges, panes < exact + 1e-6, lidar.range_max, glass)
    return ranges


def _configuration(what: str | SimulatorConfig, hazards: Hazards | None) -> SimulatorConfig:
    if not isinstance(what, SimulatorConfig):
        if what not in PRESETS:
            raise DataError("simulate", "name", repr(what), f"one of {', '.join(PRESETS)}")
        what = PRESETS[what]
    config = what if hazards is None else replace(what, hazards=hazards)
    return changed(config, {"robot.lidar.sweep": config.hazards.sweep}) if config.hazards.sweep else config


def _whole(seed) -> int:
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise DataError("simulate", "seed", repr(seed), "a whole number, 0 or more")
    return int(seed)


def _camera(
    config: SimulatorConfig, world: World, drive: Drive, seed: np.random.SeedSequence
) -> CameraRenderer:
    begin, end = config.timing.camera
    disparity, rgb, images = seed.spawn(3)
    jitter = config.timing.jitter
    t = camera_stamps(begin, drive.duration + end, np.random.default_rng(disparity), jitter)
    t_rgb = camera_stamps(begin + 0.1445, drive.duration + end + 0.02, np.random.default_rng(rgb), jitter)
    t, t_rgb = (unix(stamps, config.quantised) - START_OF_TIME for stamps in (t, t_rgb))
    return CameraRenderer(world, drive, config, t, t_rgb, tuple(images.spawn(3)))


def _stream(renderer: CameraRenderer, config: SimulatorConfig) -> RgbdStream:
    t, t_rgb = (unix(stamps, config.quantised) for stamps in (renderer.disparity_t, renderer.rgb_t))
    every = (np.arange(len(t)), np.arange(len(t_rgb)))
    return RgbdStream(t, t_rgb, renderer.read_disparity, renderer.read_rgb, *every)
