"""Chapter 00: a drive with all that its instruments report, a turn on the spot, and a clock that is late."""

from __future__ import annotations

import cv2
import numpy as np

from pfslam.motion import wheel_distance
from pfslam.poses import invert, transform_points
from pfslam.recording import Recording, nearest_stamp
from pfslam.sensors import LidarModel, scan_points
from pfslam_book.exercises.ch00 import (
    check_distance_at,
    check_nearest_within,
    check_scan_points,
    check_to_world,
)
from pfslam_book.show.drives import scans_along, sparser
from pfslam_book.show.keep import keep
from pfslam_book.show.lab import Laboratory, lidar_options, packed, packed_scan, show_lab
from pfslam_book.show.pictures import data_uri
from pfslam_book.show.source import show_source

__all__ = ["check_distance_at", "check_nearest_within", "check_scan_points", "check_to_world", "keep"]
__all__ += ["late_picture", "scrub_picture", "show_source", "turn_picture"]

# ---- everything that the robot knows at one moment

BEAMS_APART = 6
IMAGE_QUALITY = 60
EVERY = 0.5, 6.0  # s between the scans, and between the images, that the page has
FROM, TO, STILL = 8.0, 116.0, 62.0  # s of the slider, and of the stored picture


def at_rest_and_moving(recording: Recording) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time (s from the first encoder reading), speed (m/s) and yaw rate (rad/s), means over tenths of a second."""
    encoders, imu = recording.wheels_and_gyro()
    edges = np.arange(imu.t[0], imu.t[-1], 0.1)
    speed = np.diff(wheel_distance(encoders, recording.robot.encoders, edges)) / 0.1
    turned = np.cumsum(imu.angular_velocity[:, 2] * np.diff(imu.t, prepend=imu.t[0]))
    return edges[:-1] + 0.05 - encoders.t[0], speed, np.diff(np.interp(edges, imu.t, turned)) / 0.1


def ranges_at(recording: Recording, times: np.ndarray) -> np.ndarray:
    """The ranges ``(N, M)``, of some beams, of the scans nearest to times (s from the first encoder reading)."""
    scans, t0 = recording.scans(), recording.wheels_and_gyro()[0].t[0]
    return scans.ranges[nearest_stamp(scans.t, t0 + times), ::BEAMS_APART]


def image_at(recording: Recording, time: float) -> tuple[np.ndarray, float]:
    """The stored colour image nearest in time, made small, and how much later it was taken (s)."""
    camera, t0 = recording.camera, recording.wheels_and_gyro()[0].t[0]
    assert camera is not None
    stored = camera.rgb_t[camera.rgb_index]
    j = nearest_stamp(stored, np.array([t0 + time]))[0]
    image = cv2.resize(camera.read_rgb(int(camera.rgb_index[j])), (240, 180), interpolation=cv2.INTER_AREA)
    return image, float(stored[j] - t0 - time)


def describe_scrub(recording: Recording, time: float) -> str:
    """What the picture shows."""
    t, speed, yaw_rate = at_rest_and_moving(recording)
    k, later = np.argmin(np.abs(t - time)), image_at(recording, time)[1]
    lidar = sparser(recording.robot.lidar, BEAMS_APART)
    reach = np.hypot(*scan_points(ranges_at(recording, np.array([time]))[0], lidar).T)
    return f"""At {time:.0f} s: wheels {speed[k]:.2f} m/s, gyro {yaw_rate[k]:+.2f} rad/s, nearest LiDAR point
    {reach.min():.1f} m away, farthest {reach.max():.1f} m; the image shown was taken {abs(1e3 * later):.0f} ms
    {"later" if later > 0 else "earlier"}."""


def scrub_options(recording: Recording) -> dict:
    """What the script needs: the curves, a scan and a true pose each half second, and an image each six."""
    t, speed, yaw_rate = (packed(values) for values in at_rest_and_moving(recording))
    lidar = sparser(recording.robot.lidar, BEAMS_APART)
    scans, moments = (np.arange(FROM, TO + 0.01, every).tolist() for every in EVERY)
    ranges = [packed_scan(one, lidar) for one in ranges_at(recording, np.array(scans))]
    poses = recording.true_path().at(recording.wheels_and_gyro()[0].t[0] + np.array(scans))
    images = [image_at(recording, time) for time in moments]
    taken = [time + later for time, (_, later) in zip(moments, images, strict=True)]
    return {
        **{"t": t, "speed": speed, "yawRate": yaw_rate},
        "lidar": lidar_options(lidar),
        "scans": {"t": scans, "ranges": ranges, "poses": poses.round(3).tolist()},
        "images": {"t": taken, "sources": [data_uri(image, IMAGE_QUALITY) for image, _ in images]},
        **{"from": FROM, "to": TO, "value": FROM},
    }


def scrub_picture(recording: Recording) -> Laboratory:
    """One slider: the time; a button runs through the drive."""
    alt = describe_scrub(recording, STILL)
    return show_lab("scrub", "The robot drives, and its sensors report", alt, **scrub_options(recording))


# ---- a turn on the spot, in a small room with a thin round post

ROOM = (-1.0, 3.0, -1.0, 2.0)  # m: x_min, x_max, y_min, y_max
POST = (2.0, 1.2, 0.06)  # m: x, y, radius
PLACE = (0.6, 0.3)  # m, where the robot turns
BEAMS = np.deg2rad(np.arange(-135.0, 135.1, 2.0))
WAYS = ("right", "no lever arm", "lever arm on y", "inverse pose")


def room_ranges(sensor: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Exact distances ``(M,)`` from ``sensor (2,)`` along ``directions (M,)`` rad to the walls or the post."""
    d = np.column_stack([np.cos(directions), np.sin(directions)])
    x_min, x_max, y_min, y_max = ROOM
    with np.errstate(divide="ignore"):
        to_x = np.where(d[:, 0] > 0, x_max - sensor[0], sensor[0] - x_min) / np.abs(d[:, 0])
        to_y = np.where(d[:, 1] > 0, y_max - sensor[1], sensor[1] - y_min) / np.abs(d[:, 1])
    to_post = np.subtract(POST[:2], sensor)
    along = d @ to_post
    inside = POST[2] ** 2 - (to_post @ to_post - along**2)
    meets = (inside >= 0) & (along > 0)
    return np.where(meets, along - np.sqrt(np.maximum(inside, 0.0)), np.minimum(to_x, to_y))


def turn_points(way: str, turned_deg: float) -> np.ndarray:
    """All end points ``(M, 2)`` of the scans of a turn on the spot, brought to the world in one of ``WAYS``."""
    arm = np.array(LidarModel().position_b[:2])
    assumed = {"no lever arm": np.zeros(2), "lever arm on y": arm[::-1]}.get(way, arm)
    points = []
    for heading in np.deg2rad(np.arange(0.0, turned_deg + 1.0, 5.0)):
        pose = np.array([*PLACE, heading])
        r = room_ranges(transform_points(pose, arm[None])[0], BEAMS + heading)
        points_b = assumed + np.column_stack([r * np.cos(BEAMS), r * np.sin(BEAMS)])
        points.append(transform_points(invert(pose) if way == "inverse pose" else pose, points_b))
    return np.concatenate(points)


def describe_turn(way: str, turned: float) -> str:
    """Say in words how far the walls are smeared."""
    x, y = turn_points(way, turned).T
    beyond = max(x.max() - ROOM[1], ROOM[0] - x.min(), y.max() - ROOM[3], ROOM[2] - y.min())
    return f"""A room with a post, drawn ({way}) by a robot that has turned on the spot by {turned:.0f} degrees.
    Points lie up to {100 * max(beyond, 0.0):.0f} cm beyond the walls."""


def turn_options() -> dict:
    """What the script needs: the room, the robot in it and the ways to draw."""
    where = {"room": ROOM, "post": POST, "place": PLACE, "arm": LidarModel().position_b[:2], "ways": WAYS}
    return {**where, "beams": np.rad2deg(BEAMS).round(6).tolist()}


def turn_picture() -> Laboratory:
    """A turn on the spot with two controls: what is wrong, and how far the robot has turned."""
    return show_lab("turn", "A turn on the spot", describe_turn(WAYS[1], 360.0), **turn_options())


# ---- scans drawn from the pose of another moment

STRETCHES = {"straight": 78.0, "turn": 86.4}
"""Two moments of ``hall``, s from the first encoder reading: down a corridor, and in its fastest turn."""
AROUND = 0.1 * np.arange(-4, 4)
POINTS_APART = 5  # beams


def shifted_scans(recording: Recording, moment: float, offset: float) -> np.ndarray:
    """Points ``(M, 2)`` of eight scans around a moment, each drawn from the pose ``offset`` s after its stamp."""
    scans, truth, points = recording.scans(), recording.true_path(), []
    lidar = sparser(recording.robot.lidar, POINTS_APART)
    for i in nearest_stamp(scans.t, recording.wheels_and_gyro()[0].t[0] + moment + AROUND):
        points_b = scan_points(scans.ranges[i, ::POINTS_APART], lidar)
        points.append(transform_points(truth.at(scans.t[i] + offset), points_b))
    return np.concatenate(points)


def spread(drawn: np.ndarray, right: np.ndarray) -> float:
    """How far (m, median) a drawn point lies from the nearest of the right ones; every third is asked."""
    dx, dy = (np.subtract.outer(drawn[::3, k], right[:, k]) for k in (0, 1))
    return float(np.median(np.sqrt((dx**2 + dy**2).min(axis=1))))


def describe_late_clock(recording: Recording, right: dict[str, np.ndarray], offset: float) -> str:
    """Say in words how far the drawn points lie from the walls."""
    words = [
        f"{name}: in the median a point lies "
        f"{100 * spread(shifted_scans(recording, moment, offset / 1e3), right[name]):.1f} cm off the walls"
        for name, moment in STRETCHES.items()
    ]
    return f"Eight scans drawn with stamps wrong by {offset:.0f} ms. {'; '.join(words)}."


def late_options(recording: Recording) -> dict:
    """What the script needs of both stretches: eight scans, the true poses around them, and where the robot is."""
    scans, truth, start = recording.scans(), recording.true_path(), recording.wheels_and_gyro()[0].t[0]
    stretches = {}
    for name, moment in STRETCHES.items():
        which = nearest_stamp(scans.t, start + moment + AROUND)
        middle = truth.at(start + moment)[:2].tolist()
        stretches[name] = {"middle": middle, **scans_along(recording, truth, which, POINTS_APART)}
    return {"stretches": stretches}


def late_picture(recording: Recording) -> Laboratory:
    """One slider: by how much the LiDAR's clock is wrong."""
    right = {name: shifted_scans(recording, moment, 0.0) for name, moment in STRETCHES.items()}
    alt = describe_late_clock(recording, right, 100.0)
    return show_lab("late", "Scans with a late clock", alt, **late_options(recording))
