"""ROS bags: laser scans with odometry, an IMU and images, read without ROS.

ROS 1 bags, ROS 2 bag folders (sqlite3 or mcap) and single mcap or db3 files are read through the pure Python library
rosbags, the extra ``ros``, which is imported when a bag is opened and not before. The messages are the standard ones of
ROS: LaserScan or PointCloud2, Odometry, TFMessage, Imu, Image. What is left out is counted in ``recording.dropped``;
what had to be decided or looks odd is said in ``recording.notes``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError, naming_source
from pfslam.io.clouds import Slicer, without_blind_ends
from pfslam.io.headings import with_better_headings
from pfslam.io.jumps import joined
from pfslam.io.loading import GRAVITY_LIMIT, LONGEST_SWEEP, POSE_LIMIT, Log
from pfslam.io.topics import (
    CLOUD,
    IMAGE,
    IMU,
    ODOMETRY,
    SCAN,
    TF,
    Beams,
    Topic,
    frame_of,
    list_topics,
    read_topics,
)
from pfslam.io.upright import upright
from pfslam.poses import Trajectory, chain_transforms, quaternion_to_rotation, rotation_matrix, transform
from pfslam.recording import Imu, LidarScans, Recording, RgbdStream
from pfslam.sensors import (
    MAX_BEAMS,
    MAX_RANGE,
    STANDARD_GRAVITY,
    LidarModel,
    RgbdModel,
    RobotModel,
    nearest_ranges,
)
from pfslam.texture import disparity_from_depth_image

LATE = 1.0
"""Seconds of more delay than usual, from its stamp to the bag, that a message is called late for."""
MOVED = 0.01
"""A pair of frames that moves or turns by more than this (m, rad) is not fixed."""
USES = {
    "scan": (SCAN, ("/scan",)),
    "cloud": (CLOUD, ("/points",)),
    "odom": (ODOMETRY, ("/odom",)),
    "imu": (IMU, ("/imu/data", "/imu")),
    "depth": (IMAGE, ()),
    "rgb": (IMAGE, ()),
}
"""The type of the messages for each use, and the usual names of their topic."""
INFO = "sensor_msgs/msg/CameraInfo"
DEPTHS = {"16UC1": ("u2", 1e-3), "mono16": ("u2", 1e-3), "32FC1": ("f4", 1.0)}
"""Encodings of depth: the type of a pixel, and what one of it is in m."""
COLOURS = {"rgb8", "bgr8", "rgba8", "bgra8"}
OTHERS = [f"sensor_msgs/msg/{kind}" for kind in ("MultiEchoLaserScan", "CompressedImage")]
COUNTED = {CLOUD, *OTHERS, *(kind for kind, _ in USES.values())}
"""The types of messages that are counted where their topic is not read."""


@dataclass(frozen=True)
class BagOptions:
    """What a bag does not say by itself: the topics to use, by name, and the LiDAR's place ``(x, y, yaw)`` m, rad.

    With ``odom_frame`` the odometry is read from /tf, and is that of a robot in this frame. Without ``odometry`` none
    is read. ``slice`` has the heights (m) between which points of clouds make scans.
    """

    scan: str | None = None
    odom: str | None = None
    imu: str | None = None
    rgb: str | None = None
    depth: str | None = None
    odom_frame: str | None = None
    lidar_at: tuple[float, float, float] | None = None
    odometry: bool = True
    slice: tuple[float, float] | None = None


def load_bag(
    path: str | Path, options: BagOptions | None = None, progress: Callable | None = None
) -> Recording:
    """Read a ROS bag: its scans, its odometry as logged, its IMU, and the LiDAR's place from the tree of frames.

    Header stamps count; the bag's own time takes their place only where all of them are zero. Messages are put in the
    order of their stamps; of those with the same stamp the first counts. ``progress`` wraps the messages as they are
    read. A bag of scans without odometry is read all the same. Raises ``DataError`` naming topic and time.
    """
    path, options = Path(path), options or BagOptions()
    log, listed = Log(path), list_topics(path)
    chosen = choose_topics(log, listed, options)
    trees = [name for name, (kind, _) in listed.items() if kind == TF]
    cloud = chosen.pop("cloud", None)
    topics = read_topics(path, {*chosen.values(), *trees}, progress=progress)
    for name in chosen.values():
        _check_number(log, topics[name], listed[name][1])
    # Taken out where they are used, so that an hour of them is not held twice.
    read = {use: _ordered(log, topics.pop(name)) for use, name in chosen.items() if use != "info"}
    frames = _read_frames(log, (topics.pop(name) for name in trees))
    odometry, base = _odometry(log, read.pop("odom", None), frames, options, bool(cloud or "scan" in read))
    imu = _imu(log, read.pop("imu"), frames, base) if "imu" in read else None
    if odometry is not None:
        odometry, notes = with_better_headings(odometry, imu)
        log.notes += notes
    model, lidar, eye, camera = LidarModel(), None, RgbdModel(), None
    scans = cloud or chosen.get("scan", "")
    place = partial(_place_of_lidar, log, scans, frames, base, options, odometry is not None)
    if cloud:
        slicer = Slicer(log, cloud, place, options.slice, odometry and joined(odometry))
        model, lidar = _slices(log, slicer, listed[cloud][1], progress)
    if "scan" in read:
        model, lidar = read_scans(log, read["scan"], place)
    if "info" in chosen:
        info = topics[chosen["info"]].contents[0]
        eye, camera = _images(log, read["depth"], read["rgb"], info, frames, base)
    robot = RobotModel(lidar=model, camera=eye)
    return Recording(path.stem, robot, imu=imu, odometry=odometry, lidar=lidar, camera=camera, **log.said())


def _check_number(log: Log, topic: Topic, expected: int) -> None:
    """Raise ``DataError`` for a topic without messages, of which the index says how many are ``expected``."""
    if not len(topic.t):
        raise DataError(log.path, topic.name, "no messages", f"{expected}, as the index of the bag says")


def choose_topics(log: Log, topics: Mapping[str, tuple[str, int]], options: BagOptions) -> dict[str, str]:
    """Choose the topics for each use: the one named, the only one of its type, or one of the usual name.

    Clouds are used where a slice of them is asked for, or their topic, or where there are no scans.
    Images are used where depth, with the word in its name, colour and the depth camera's description are all there.
    """
    chosen = {}
    left = {"odom"} if options.odom_frame or not options.odometry else set()
    left.add("scan" if _goes_by_clouds(topics, options) else "cloud")
    for use, (kind, usual) in USES.items():
        option = "scan" if use == "cloud" else use
        named = getattr(options, option)
        if use in left:
            continue
        found = [name for name, (its, number) in topics.items() if its == kind and number]
        if named:
            fit = [name for name in found if name.lstrip("/") == named.lstrip("/")]
        else:
            fit = [name for name in found if kind != IMAGE or ("depth" in name.lower()) == (use == "depth")]
        best = fit if len(fit) == 1 else [name for name in usual if name in fit]
        if best:
            chosen[use] = best[0]
        elif named or (fit and option in ("scan", "odom")):
            field, expected = f"--{option} {named or 'NAME'}", f"one topic of {kind.rpartition('/')[2]}"
            raise DataError(log.path, field, ", ".join(found) or "none", expected)
    info = chosen.get("depth", "").rpartition("/")[0] + "/camera_info"
    if "rgb" in chosen and info in topics and topics[info][0] == INFO and topics[info][1]:
        chosen["info"] = info
    else:
        chosen = {use: name for use, name in chosen.items() if USES[use][0] != IMAGE}
    for name, (kind, number) in topics.items():
        if kind in COUNTED and name not in chosen.values():
            log.leave_out(f"messages of {kind.rpartition('/')[2]} on {name}, which is not read", number)
    return chosen


def _goes_by_clouds(topics: Mapping[str, tuple[str, int]], options: BagOptions) -> bool:
    """Whether scans are to be made of clouds."""
    kinds = {name.lstrip("/"): kind for name, (kind, number) in topics.items() if number}
    if options.slice is not None or options.scan is not None:
        return options.slice is not None or kinds.get(str(options.scan).lstrip("/")) == CLOUD
    return CLOUD in kinds.values() and SCAN not in kinds.values()


Frames = dict[tuple[str, str], Topic]
"""The tree of frames: what was said of each pair (parent, child)."""


def _ordered(log: Log, topic: Topic) -> Topic:
    """Put messages in the order of their stamps, each stamp once, and speak of what is odd."""
    if not topic.t.any():
        log.notes.append(f"the stamps on {topic.name} are zero: the bag's own time is used")
        topic = replace(topic, t=topic.arrived)
    topic = topic.keep(log, topic.t != 0, "without a stamp", "times")
    delay = topic.arrived - topic.t
    delay -= np.median(delay)
    late = np.abs(delay, out=delay) > LATE
    if late.any():
        first = topic.arrived[late.argmax()]
        log.notes.append(f"messages on {topic.name} late or early: {late.sum()}, the first at {first:.3f} s")
    order = log.in_order(f"messages on {topic.name}", topic.t)
    return topic if np.array_equal(order, np.arange(len(topic.t))) else topic[order]


def _poses(log: Log, topic: Topic) -> Topic:
    """Keep the messages whose position and quaternion are a pose, and make the quaternions' length 1."""
    turns = np.clip(topic.rows[:, 3:], -2.0, 2.0, out=topic.rows[:, 3:])
    length = np.linalg.norm(turns, axis=1)
    good = _within(topic.rows, POSE_LIMIT[0]) & (np.abs(length - 1.0) < 0.01)
    turns[good] /= length[good, None]
    return topic.keep(log, good, "that are no poses", "finite numbers, a quaternion of length 1")


def _within(rows: np.ndarray, limit: float) -> np.ndarray:
    """Which rows ``(K,)`` are numbers nearer to 0 than a limit, without a copy of all of them."""
    return (rows.max(axis=1) < limit) & (rows.min(axis=1) > -limit)


def _read_frames(log: Log, topics: Iterable[Topic]) -> Frames:
    """Collect the transforms of TFMessages, by pair of frames."""
    found: dict[tuple[str, str], list[Topic]] = {}
    for topic in topics:
        for pair in dict.fromkeys(topic.contents):
            of_pair = np.fromiter((names == pair for names in topic.contents), bool, len(topic.t))
            found.setdefault(pair, []).append(topic if of_pair.all() else topic[of_pair])
    named = {pair: Topic.joined(f"/tf ({' -> '.join(pair)})", TF, parts) for pair, parts in found.items()}
    return {pair: _poses(log, topic) for pair, topic in named.items()}


def find_place(frames: Frames, base: str, frame: str) -> np.ndarray | None:
    """Return the transform ``(4, 4)`` of ``frame`` in ``base``, None if no chain of fixed pairs joins them."""
    fixed = {pair: said.rows[0] for pair, said in frames.items() if is_fixed(said.rows)}
    places = {pair: transform(quaternion_to_rotation(row[3:]), row[:3]) for pair, row in fixed.items()}
    return chain_transforms(places, base, frame)


def is_fixed(rows: np.ndarray) -> bool:
    """Whether poses ``(K, 7)`` are one; a quaternion and its negative are the same turn."""
    away, cosine = np.abs(rows[:, :3] - rows[0, :3]), np.abs(rows[:, 3:] @ rows[0, 3:])
    return bool(away.max() <= MOVED and cosine.min() >= np.cos(0.5 * MOVED))


def _usual_base(frames: Frames) -> str:
    """Return the frame of the robot where no odometry names it."""
    return "base_footprint" if any("base_footprint" in pair for pair in frames) else "base_link"


def _odometry(
    log: Log, topic: Topic | None, frames: Frames, options: BagOptions, has_scans: bool
) -> tuple[Trajectory | None, str]:
    """Return the odometry and the frame that it moves: from Odometry messages, else from the tree of frames.

    A robot that ``has_scans`` can do without: then there is None, and a note where one was looked for.
    """
    usual, asked = _usual_base(frames), options.odom_frame
    if not options.odometry:
        return None, usual
    if topic is not None:
        base = topic.contents[0].child or usual
        topic = _poses(log, topic)
    else:
        # Frames of a robot's own name are known by their last part, as in robot1/odom.
        pairs = [pair for pair in frames if pair[0].rpartition("/")[2].startswith("odom")]
        if asked:
            pairs = [pair for pair in frames if pair[0].strip("/") == asked.strip("/")]
        if not pairs:
            moving = [f"{a} -> {b} on /tf" for (a, b), said in frames.items() if len(said.t) > 1]
            found = ", ".join(moving) or "none"
            expected = f"{asked or 'nav_msgs/Odometry, or odom'} -> base_link on /tf"
            if asked or not has_scans:
                raise DataError(log.path, "odometry", found, expected)
            log.notes.append(f"odometry: found {found}, looked for {expected}")
            return None, usual
        parent, base = pair = min(pairs, key=lambda pair: ("base" not in pair[1], pair))
        log.notes.append(f"odometry is read from /tf: {parent} -> {base}")
        topic = _ordered(log, frames[pair])
    x, y, z, w = topic.rows[:, 3:].T
    heading = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y**2 + z**2))
    return Trajectory(topic.t, np.column_stack([topic.rows[:, :2], heading])), base


def _imu(log: Log, topic: Topic, frames: Frames, base: str) -> Imu | None:
    """Read the IMU, its axes turned into the body's: as the tree of frames says, or gravity."""
    topic.rows[:, 3:] /= STANDARD_GRAVITY
    good = _within(topic.rows, GRAVITY_LIMIT[0])
    frame, topic = topic.contents[0].frame, topic.keep(log, good, "without usable numbers")
    if len(topic.t) < 2:
        return None
    rates, pushes = topic.rows[:, :3], topic.rows[:, 3:]
    T = find_place(frames, base, frame)
    R, taken = upright(pushes.mean(axis=0)) if T is None else (T[:3, :3], "")
    if T is None:
        log.notes.append(f"no chain of frames from {base} to {frame}: {topic.name} is taken for {taken}")
    return Imu(topic.t, rates @ R.T, pushes @ R.T)


def _place_of_lidar(
    log: Log, name: str, frames: Frames, base: str, options: BagOptions, needed: bool, frame: str
) -> np.ndarray:
    """Find the transform ``(4, 4)`` of a LiDAR's frame in the body's; where it is not ``needed``, they may be the same.

    ``name`` is that of its topic.
    """
    if options.lidar_at is not None:
        x, y, yaw = options.lidar_at
        if abs(yaw) > 2.0 * np.pi:
            expected = f"radians, at most one turn ({yaw:g} degrees are {np.radians(yaw):.4f})"
            raise DataError(log.path, "--lidar-at, YAW", f"{yaw:g}", expected)
        log.notes.append(f"the LiDAR is taken to be at x {x:g} m, y {y:g} m, yaw {yaw:g} rad, as asked for")
        return transform(rotation_matrix(yaw=yaw), (x, y, LidarModel().position_b[2]))
    T = find_place(frames, base, frame)
    if T is None and not needed:
        said = f"no fixed chain of frames from {base} to {frame}"
        log.notes.append(f"{said}: the path is that of the LiDAR itself")
        return transform(np.eye(3), (0.0, 0.0, LidarModel().position_b[2]))
    if T is None:
        there = ", ".join(f"{parent} -> {child}" for parent, child in sorted(frames)) or "no frames at all"
        found = f"no fixed chain of frames from {base} to {frame or 'a frame without a name'}, only {there}"
        expected = "one on /tf_static, or --lidar-at X Y YAW"
        raise DataError(log.path, f"{name}, place of the LiDAR", found, expected)
    return T


def read_scans(log: Log, topic: Topic, place: Callable[[str], np.ndarray]) -> tuple[LidarModel, LidarScans]:
    """Describe the LiDAR, whose frame has a ``place (4, 4)`` on the robot, and arrange its scans.

    They are then counter-clockwise, seen from above.
    """
    frame = topic.contents[0].frame
    T = place(frame)
    same = [beams.frame == frame for beams in topic.contents]
    topic = topic.keep(log, same, f"of other frames than {frame}")
    usable = [has_angles(beams) for beams in topic.contents]
    topic = topic.keep(log, usable, "without usable angles", "beams over at most one turn")
    for what, odd in (("not a number", np.isnan), ("infinite", np.isinf), ("zero", partial(np.equal, 0))):
        number = sum(int(np.count_nonzero(odd(ranges))) for ranges in topic.rows)
        log.leave_out(f"ranges on {topic.name} that are {what}", number)
    usual, ranges = at_usual_angles(log, topic)
    between = np.median([beams.time_increment for beams in topic.contents])
    sweep, period = (ranges.shape[1] - 1) * float(between), np.median(np.diff(topic.t, append=np.inf))
    if not abs(sweep) <= min(LONGEST_SWEEP, 1.1 * period):
        log.notes.append(f"a sweep of {sweep:g} s on {topic.name} is not used: a scan lasts less")
        sweep = 0.0
    if T[2, 2] < 0:
        log.notes.append(f"{frame} hangs upside down: the beams of {topic.name} are put in the other order")
    limits = _limits(log, topic.name, usual, ranges)
    with naming_source(log.path, f"{topic.name}, "):
        model, step = LidarModel.mounted(T, ends(usual), ranges.shape[1], limits, sweep)
    # ROS stamps the first beam, this package the middle one.
    return model, LidarScans(topic.t + 0.5 * sweep, np.ascontiguousarray(ranges[:, ::step]))


def _slices(
    log: Log, slicer: Slicer, expected: int, progress: Callable | None
) -> tuple[LidarModel, LidarScans]:
    """Read the ``expected`` clouds of a topic as scans, and describe the level scanner that would have made them."""
    topic = read_topics(log.path, [slicer.name], progress=progress, slicer=slicer)[slicer.name]
    _check_number(log, topic, expected)
    log.notes.append(slicer.said())
    return read_scans(log, without_blind_ends(log, _ordered(log, topic)), slicer.level)


def _limits(log: Log, name: str, beams: Beams, ranges: np.ndarray) -> tuple[float, float]:
    """Return the least and the largest range (m) as stated; some drivers state none, such as 0 or infinity."""
    least, most = beams.range_min, beams.range_max
    if not 0.0 <= least < MAX_RANGE:
        log.notes.append(f"a least range of {least:g} m on {name} is none: 0 is used")
        least = 0.0
    if not least < most <= MAX_RANGE:
        farthest = float(ranges.max(initial=least, where=(ranges > least) & (ranges < MAX_RANGE)))
        log.notes.append(
            f"a largest range of {most:g} m on {name} is none: {farthest:g} m, the farthest, is used"
        )
        most = farthest
    return least, most


def has_angles(beams: Beams) -> bool:
    """Whether a scan has beams at different angles, over at most one turn."""
    n, low, step = beams.number, abs(beams.angle_min), abs(beams.angle_increment)
    turns = (n - 1) * step <= 2.0 * np.pi + 0.02 and (step > 0.0 or n == 1)
    return bool(1 <= n <= MAX_BEAMS and low < 7.0 and turns)


def ends(beams: Beams) -> tuple[float, float]:
    """Return the angles (rad) of the first beam and of the last, as the scanner counts them."""
    return beams.angle_min, beams.angle_min + (beams.number - 1) * beams.angle_increment


def at_usual_angles(log: Log, topic: Topic) -> tuple[Beams, np.ndarray]:
    """Put all scans at the angles of most, ``(K, beams)``, and return the beams of one of those as well.

    A scanner that spins freely varies its beams from turn to turn.
    """
    shape_of = {beams: (beams.number, *np.round(ends(beams), 4)) for beams in set(topic.contents)}
    shapes = [shape_of[beams] for beams in topic.contents]
    shape, alike = Counter(shapes).most_common(1)[0]
    usual = topic.contents[shapes.index(shape)]
    if alike == len(shapes):  # an hour of ranges is not copied
        return usual, np.stack(list(topic.rows)) if topic.rows.ndim == 1 else topic.rows
    angles = np.linspace(*ends(usual), usual.number)
    rows = [
        ranges if s == shape else nearest_ranges(angles, beams.angle_min, beams.angle_increment, ranges)
        for ranges, beams, s in zip(topic.rows, topic.contents, shapes, strict=True)
    ]
    put = f"scans on {topic.name} put at the angles of most, by nearest beams"
    log.notes.append(f"{put}: {len(shapes) - alike}")
    return usual, np.array(rows, dtype=np.float32)


def _images(
    log: Log, depth: Topic, rgb: Topic, info: Any, frames: Frames, base: str
) -> tuple[RgbdModel, RgbdStream | None]:
    """Describe the camera and give its images, or count them if they are not to be used."""
    frame = frame_of(depth.contents[0])
    T_bo, K = find_place(frames, base, frame), (info.k if hasattr(info, "k") else info.K).reshape(3, 3)
    shapes = {(m.height, m.width) for m in (*depth.contents, *rgb.contents, info)}
    unread = {m.encoding for m in depth.contents} - {*DEPTHS} | {m.encoding for m in rgb.contents} - COLOURS
    if len(shapes) > 1 or frame_of(rgb.contents[0]) != frame:
        why = "depth and colour are not registered: sizes or frames differ"
    elif unread:
        why = f"not read: encoding {', '.join(sorted(unread))}"
    elif not (np.isfinite(K).all() and K[0, 0] > 0 and K[1, 1] > 0):
        why = "the depth camera is not calibrated: no focal length in its CameraInfo"
    elif T_bo is None:
        why = f"no fixed chain of frames from {base} to {frame}"
    else:
        camera = RgbdModel.registered(info.width, info.height, K, T_bo)
        read = partial(_disparity, log.path, depth, camera), partial(_colours, log.path, rgb)
        return camera, RgbdStream(depth.t, rgb.t, *read, np.arange(len(depth.t)), np.arange(len(rgb.t)))
    for topic in (depth, rgb):
        log.leave_out(f"images on {topic.name} ({why})", len(topic.t))
    return RgbdModel(), None


def _disparity(path: Path, topic: Topic, camera: RgbdModel, k: int) -> np.ndarray:
    """Read depth image ``k`` as disparity ``(H, W)`` uint16."""
    dtype, unit = DEPTHS[topic.contents[k].encoding]
    order = ">" if topic.contents[k].is_bigendian else "<"
    return disparity_from_depth_image(unit * _pixels(path, topic, k, order + dtype, 1)[..., 0], camera)


def _colours(path: Path, topic: Topic, k: int) -> np.ndarray:
    """Read colour image ``k`` as ``(H, W, 3)`` uint8, red first."""
    letters = topic.contents[k].encoding.removesuffix("8")
    pixels = _pixels(path, topic, k, "u1", len(letters))
    return np.ascontiguousarray(pixels[..., [letters.index(letter) for letter in "rgb"]])


def _pixels(path: Path, topic: Topic, k: int, dtype: str, channels: int) -> np.ndarray:
    """Read the pixels ``(H, W, channels)`` of image ``k``; ``DataError`` if it is damaged."""
    m, arrived = topic.contents[k], topic.arrived[k]
    found = read_topics(path, [topic.name], at=arrived)[topic.name].contents
    try:
        data = next(message.data for message in found if message.header == m.header)
        rows = data[: m.height * m.step].reshape(m.height, m.step)
        used = np.ascontiguousarray(rows[:, : m.width * channels * np.dtype(dtype).itemsize])
        return used.view(dtype).reshape(m.height, m.width, channels)
    except (ValueError, StopIteration) as error:
        place = f"{topic.name} at {arrived:.3f}"
        raise DataError(path, place, f"{type(error).__name__}: {error}", "a whole image") from error
