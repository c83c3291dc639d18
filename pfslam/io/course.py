"""The course format: one ``.npz`` file per instrument and two folders of images, named by the set's number.

``EncodersNN.npz``, ``ImuNN.npz`` (or ``IMUNN.npz``), ``HokuyoNN.npz``, ``KinectNN.npz``, ``truthNN.npz``,
``dataRGBD/DisparityNN/disparityNN_I.png`` and ``dataRGBD/RGBNN/rgbNN_I.png`` with I from 1. They may lie in a
``data`` folder, and case does not matter. Encoders and IMU must be there; the rest may be absent. An optional key
``sweep`` of the LiDAR's file is the time (s) from the first beam of a scan to its last, the stamp being the middle
beam's (negative if the scanner turns clockwise); scans are then deskewed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from pfslam.errors import DataError, naming_source
from pfslam.io.files import MAX_PNG_BYTES, decode_png, read_bytes, read_npz, write_npz, write_png
from pfslam.io.loading import LONGEST_SWEEP, Log, readings, stamps
from pfslam.poses import Trajectory, check_shape
from pfslam.recording import Encoders, Imu, LidarScans, Recording, RgbdStream, image_pairs
from pfslam.sensors import MAX_BEAMS, LidarModel, RgbdModel, RobotModel

LIMITS = ("angle_min", "angle_max", "range_min", "range_max")
FULL_TURN = 2.0 * np.pi + 1e-3


def set_number(number: int | str) -> str:
    """Return the number of a set as in file names; ``DataError`` for anything but one to six digits."""
    text = str(number).strip()
    if not re.fullmatch(r"[0-9]{1,6}", text):
        raise DataError("data set", "number", repr(number)[:80], "one to six digits, such as 20")
    return text


def numbers_in(folder: Path) -> list[str]:
    """List the numbers of the sets in a folder, or in its ``data`` folder, by their files of encoders."""
    entries = [path.name for start in (folder, folder / "data") if start.is_dir() for path in start.iterdir()]
    matches = (re.fullmatch(r"encoders([0-9]{1,6})\.npz", name, re.IGNORECASE) for name in entries)
    return sorted({match[1] for match in matches if match})


def load_course(number: int | str, data_dir: str | Path) -> Recording:
    """Load set ``number`` from the folder ``data_dir``.

    Readings that cannot be used, such as ranges that are not a number or images without a stamp, are counted
    in ``recording.dropped``. Raises ``DataError`` naming file, field, value and what was expected.
    """
    number = set_number(number)
    folder = Path(data_dir)
    if not folder.is_dir():
        raise DataError(folder, "data folder", "no such folder", f"a folder with Encoders{number}.npz")
    log = Log(folder)
    encoders = Encoders(*_rows(_require(folder, f"Encoders{number}.npz"), counts=4))
    imu = Imu(*_rows(_require(folder, f"Imu{number}.npz"), angular_velocity=3, linear_acceleration=3))
    robot, lidar = RobotModel(), None
    if path := find_file(folder, f"Hokuyo{number}.npz"):
        model, lidar = _load_lidar(path, log)
        robot = replace(robot, lidar=model)
    camera = _load_camera(folder, number, robot.camera, log)
    path = find_file(folder, f"truth{number}.npz")
    truth = _load_truth(path) if path else None
    return Recording(number, robot, encoders, imu, None, lidar, camera, truth, **log.said())


def find_file(folder: Path, *parts: str) -> Path | None:
    """Find the file or folder ``parts`` below ``folder`` or ``folder/data``, ignoring case."""
    for start in (folder, folder / "data"):
        found = [start]
        for part in parts:
            entries = (path for place in found if place.is_dir() for path in place.iterdir())
            alike = [path for path in entries if path.name.lower() == part.lower()]
            found = sorted(alike, key=lambda path: (path.name != part, path.name))  # called at once
        if found:
            return found[0]
    return None


def _require(folder: Path, name: str) -> Path:
    path = find_file(folder, name)
    if path is None:
        raise DataError(folder / name, "file", "no such file", f"{name} in {folder} or in its data folder")
    return path


def _rows(path: Path, **columns: int) -> tuple[np.ndarray, ...]:
    """Read the stamps ``(K,)`` of a file, then readings ``(K, n)`` from arrays ``(n, K)``, given by name and n."""

    def check(name: str, stated: np.ndarray, before: Mapping[str, np.ndarray]) -> None:
        if name in columns:
            t = stamps(path, before["time_stamps"], "time_stamps")
            check_shape(stated, str(path), name, (columns[name], len(t)))

    data = read_npz(path, ("time_stamps", *columns), check=check)
    t = stamps(path, data["time_stamps"], "time_stamps")
    values = (readings(path, data[key], key, (n, len(t))) for key, n in columns.items())
    return t, *(np.ascontiguousarray(rows.T) for rows in values)


def _load_lidar(path: Path, log: Log) -> tuple[LidarModel, LidarScans]:
    data = read_npz(path, (*LIMITS, "time_stamps", "ranges"), ("sweep",), partial(_check_ranges, path))
    t, raw = stamps(path, data["time_stamps"], "time_stamps"), data["ranges"]
    with np.errstate(over="ignore"):
        ranges = np.ascontiguousarray(raw.T, dtype=np.float32)
    log.leave_out("ranges that are not a number", np.isnan(ranges))
    # The angle between beams follows from the limits; the file's own may be [0, 0], and is not used.
    numbers = {key: _scalar(path, data, key) for key in (*LIMITS, "sweep") if key in data}
    return _lidar_model(path, numbers, raw.shape[0]), LidarScans(t, ranges)


def _check_ranges(path: Path, name: str, raw: np.ndarray, before: Mapping[str, np.ndarray]) -> None:
    """Raise ``DataError`` unless limits are numbers, and ranges have a row for each beam, a column for each stamp."""
    if name in (*LIMITS, "sweep") and raw.size != 1:
        raise DataError(path, name, f"{raw.dtype} of shape {raw.shape}", "one finite number")
    if name == "ranges":
        count = len(stamps(path, before["time_stamps"], "time_stamps"))
        fits = raw.ndim == 2 and raw.shape[1] == count and 1 <= raw.shape[0] <= MAX_BEAMS
        if not fits or raw.dtype.kind not in "fiu":
            expected = f"numbers of shape (beams, {count}), at most {MAX_BEAMS} beams"
            raise DataError(path, "ranges", f"{raw.dtype} of shape {raw.shape}", expected)


def _lidar_model(path: Path, numbers: dict[str, float], beams: int) -> LidarModel:
    low, high, least, most = (numbers[key] for key in LIMITS)
    sweep = numbers.get("sweep", 0.0)
    if abs(low) > FULL_TURN or high - low > FULL_TURN:
        raise DataError(path, "angle_min, angle_max", f"{low:g} to {high:g}", "radians, at most one turn")
    if abs(sweep) > LONGEST_SWEEP:
        expected = f"seconds from the first beam to the last, at most {LONGEST_SWEEP:g}"
        raise DataError(path, "sweep", f"{sweep:g}", expected)
    with naming_source(path):
        return LidarModel(low, high, beams, least, most, sweep=sweep)


def _scalar(path: Path, data: Mapping[str, np.ndarray], key: str) -> float:
    value = np.asarray(data[key])
    if value.dtype.kind not in "fiu" or not np.isfinite(value).all():
        raise DataError(path, key, value.reshape(()), "one finite number")
    return float(value.reshape(()))


def _load_truth(path: Path) -> Trajectory:
    def check(name: str, stated: np.ndarray, before: Mapping[str, np.ndarray]) -> None:
        if name == "pose":
            t = stamps(path, before["time_stamps"], "time_stamps")
            check_shape(stated, str(path), name, (len(t), 3))

    data = read_npz(path, ("time_stamps", "pose"), check=check)
    t = stamps(path, data["time_stamps"], "time_stamps")
    return Trajectory(t, readings(path, data["pose"], "pose", (len(t), 3)))


def _load_camera(folder: Path, number: str, camera: RgbdModel, log: Log) -> RgbdStream | None:
    kinds = {"disparity": f"Disparity{number}", "rgb": f"RGB{number}"}
    folders = {kind: find_file(folder, "dataRGBD", name) for kind, name in kinds.items()}
    files = {kind: numbered_images(folders[kind], kind + number) for kind in kinds}
    path = find_file(folder, f"Kinect{number}.npz")
    if path is None:
        log.leave_out("images without a stamp", sum(len(f) for f in files.values()))
        return None
    data = read_npz(path, ("disparity_time_stamps", "rgb_time_stamps"))
    t = {kind: stamps(path, data[f"{kind}_time_stamps"], f"{kind}_time_stamps") for kind in kinds}
    index = {kind: np.array(sorted(k for k in files[kind] if k < len(t[kind])), dtype=int) for kind in kinds}
    log.leave_out("images without a stamp", sum(len(files[kind]) - len(index[kind]) for kind in kinds))
    size = (camera.height, camera.width)
    read_disparity = partial(_read_image, files["disparity"], (*size, 1), np.uint16)
    read_rgb = partial(_read_image, files["rgb"], (*size, 3), np.uint8)
    return RgbdStream(t["disparity"], t["rgb"], read_disparity, read_rgb, index["disparity"], index["rgb"])


def numbered_images(folder: Path | None, stem: str) -> dict[int, Path]:
    """Find the images ``stem_I.png`` of a folder, by index I - 1."""
    if folder is None or not folder.is_dir():
        return {}
    pattern = re.compile(re.escape(stem) + r"_([1-9][0-9]{0,8})\.png", re.IGNORECASE)
    matches = ((pattern.fullmatch(path.name), path) for path in folder.iterdir())
    return {int(match[1]) - 1: path for match, path in matches if match}


def _read_image(files: Mapping[int, Path], shape: tuple[int, int, int], dtype: type, k: int) -> np.ndarray:
    """Read image ``k`` from its file; ``shape`` is (height, width, channels)."""
    if int(k) not in files:
        raise DataError("images", "index", k, "the index of an image that exists")
    path = files[int(k)]
    return decode_png(path, read_bytes(path, MAX_PNG_BYTES), shape, dtype)


def save_course(
    recording: Recording,
    number: int | str,
    out_dir: str | Path,
    image_every: int | None = None,
    *,
    truth_extras: Mapping[str, np.ndarray] | None = None,
    progress: Callable | None = None,
) -> None:
    """Write a recording as set ``number`` into ``out_dir``; each file appears when it is whole.

    ``image_every`` writes every n-th pair of images, none by default. ``truth_extras`` are further arrays for the
    truth file, such as height and pitch on slopes. ``progress`` wraps the list of images to write. The robot's
    calibration is not part of the format.
    """
    number, out_dir = set_number(number), Path(out_dir)
    if recording.encoders is None or recording.imu is None:
        expected = "encoders and IMU; pfslam.save writes any recording into one .npz file"
        raise DataError(recording.name, "recording", "odometry poses only", expected)
    if image_every is not None and image_every < 1:
        raise DataError("save_course", "image_every", image_every, "1 or more")
    for name, arrays in _tables(recording, truth_extras or {}).items():
        write_npz(out_dir / f"{name}{number}.npz", **arrays)
    if recording.camera is not None and image_every is not None:
        _save_images(recording.camera, number, out_dir / "dataRGBD", image_every, progress or iter)


def _tables(recording: Recording, truth_extras: Mapping[str, np.ndarray]) -> dict[str, dict[str, np.ndarray]]:
    """List the arrays of every ``.npz`` file, by the file's name without its number."""
    encoders, imu = recording.wheels_and_gyro()
    lidar, camera, truth = recording.lidar, recording.camera, recording.truth
    rates, pushes = (recording.robot.imu.in_body(raw).T for raw in (imu.angular_velocity, imu.acceleration_g))
    tables = {
        "Encoders": {"counts": encoders.counts.T, "time_stamps": encoders.t},
        "Imu": {"angular_velocity": rates, "linear_acceleration": pushes, "time_stamps": imu.t},
    }
    if lidar is not None:
        model = recording.robot.lidar
        limits = {name: np.array(getattr(model, name)) for name in LIMITS}
        limits["angle_increment"] = np.array(model.increment)
        if model.sweep:
            limits["sweep"] = np.array(model.sweep)
        tables["Hokuyo"] = limits | {"ranges": lidar.ranges.T, "time_stamps": lidar.t}
    if camera is not None:
        tables["Kinect"] = {"disparity_time_stamps": camera.disparity_t, "rgb_time_stamps": camera.rgb_t}
    if truth is not None:
        tables["truth"] = {"time_stamps": truth.t, "pose": truth.poses, **truth_extras}
    return tables


def _save_images(camera: RgbdStream, number: str, folder: Path, every: int, progress: Callable) -> None:
    pairs = image_pairs(camera, every=every)
    for i, j in progress(list(zip(pairs.disparity.tolist(), pairs.rgb.tolist(), strict=True))):
        write_png(folder / f"Disparity{number}" / f"disparity{number}_{i + 1}.png", camera.read_disparity(i))
        write_png(folder / f"RGB{number}" / f"rgb{number}_{j + 1}.png", camera.read_rgb(j))
