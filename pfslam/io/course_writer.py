"""Writing a recording in the course format, which ``pfslam.io.course`` describes and reads."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from pfslam.errors import DataError
from pfslam.io.files import write_npz
from pfslam.io.images import write_png
from pfslam.recording import Recording, RgbdStream, image_pairs

Progress = Callable


def set_number(number: int | str) -> str:
    """The number of a set as it stands in file names; ``DataError`` for anything but one to six digits."""
    text = str(number).strip()
    if not re.fullmatch(r"[0-9]{1,6}", text):
        raise DataError("data set", "number", repr(number)[:80], "one to six digits, such as 20")
    return text


def save_course(
    recording: Recording,
    number: int | str,
    out_dir: str | Path,
    image_every: int | None = None,
    *,
    truth_extras: Mapping[str, np.ndarray] | None = None,
    progress: Progress | None = None,
) -> None:
    """Write a recording as set ``number`` into ``out_dir``; each file appears when it is whole.

    ``image_every`` writes every n-th pair of images, none by default. ``truth_extras`` are further arrays for
    the truth file, such as height and pitch. ``progress`` wraps the list of images to write. The robot's
    calibration is not part of the format.
    """
    number, out_dir = set_number(number), Path(out_dir)
    if recording.encoders is None or recording.imu is None:
        raise DataError(recording.name, "recording", "odometry poses only", "encoders and IMU to write")
    if image_every is not None and image_every < 1:
        raise DataError("save_course", "image_every", image_every, "1 or more")
    for name, arrays in _tables(recording, truth_extras or {}).items():
        write_npz(out_dir / f"{name}{number}.npz", **arrays)
    if recording.camera is not None and image_every is not None:
        _save_images(recording.camera, number, out_dir / "dataRGBD", image_every, progress or iter)


def _tables(recording: Recording, truth_extras: Mapping[str, np.ndarray]) -> dict[str, dict[str, np.ndarray]]:
    """The arrays of every ``.npz`` file by the file's name without its number."""
    encoders, imu, lidar, camera, truth = (
        getattr(recording, name) for name in ("encoders", "imu", "lidar", "camera", "truth")
    )
    tables = {
        "Encoders": {"counts": encoders.counts.T, "time_stamps": encoders.t},
        "Imu": {
            "angular_velocity": imu.angular_velocity.T,
            "linear_acceleration": imu.acceleration_g.T,
            "time_stamps": imu.t,
        },
    }
    if lidar is not None:
        model = recording.robot.lidar
        names = ("angle_min", "angle_max", "range_min", "range_max")
        limits = {name: np.array(getattr(model, name)) for name in names}
        limits["angle_increment"] = np.array(model.increment)
        tables["Hokuyo"] = limits | {"ranges": lidar.ranges.T, "time_stamps": lidar.t}
    if camera is not None:
        tables["Kinect"] = {"disparity_time_stamps": camera.disparity_t, "rgb_time_stamps": camera.rgb_t}
    if truth is not None:
        tables["truth"] = {"time_stamps": truth.t, "pose": truth.poses, **truth_extras}
    return tables


def _save_images(camera: RgbdStream, number: str, folder: Path, every: int, progress: Progress) -> None:
    pairs = image_pairs(camera, every=every)
    for i, j in progress(list(zip(pairs.disparity.tolist(), pairs.rgb.tolist(), strict=True))):
        write_png(folder / f"Disparity{number}" / f"disparity{number}_{i + 1}.png", camera.read_disparity(i))
        write_png(folder / f"RGB{number}" / f"rgb{number}_{j + 1}.png", camera.read_rgb(j))
