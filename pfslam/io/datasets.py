"""From what a user types to a recording."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from pfslam.errors import DataError
from pfslam.io.bags import BagOptions, load_bag
from pfslam.io.carmen import load_carmen
from pfslam.io.course import load_course, numbers_in
from pfslam.io.jumps import without_jumps
from pfslam.io.recordings import load_recording
from pfslam.io.topics import INDEX
from pfslam.recording import Recording, image_pairs

BUILT_IN = ("hall", "ramp", "ring")
BAGS = (".bag", ".mcap", ".db3", ".active", ".zstd")
"""Of the files of bags; one alone that is not closed (.active) or packed (.zstd) is refused."""
IMAGE_EVERY = 8
"""The built-in sets offer every eighth pair of images, because each one has to be rendered."""


def load(
    dataset: str | int | Path,
    data_dir: str | Path | None = None,
    *,
    bag: BagOptions | None = None,
    odometry: bool = True,
    progress: Callable | None = None,
) -> Recording:
    """Load the recording that ``dataset`` names.

    ``"hall"``, ``"ramp"`` and ``"ring"`` are the built-in simulated sets, with truth, and with every eighth pair of
    images, rendered when it is read (``simulate`` gives all). A number is a set in the course format, whose
    files lie in ``data_dir`` (None: ``$PFSLAM_DATA``, else ``data/``). Anything else is a path: of a ROS bag, of an
    ``.npz`` file that ``save`` wrote, of a folder with one set in the course format, or of a CARMEN log. ``bag`` says
    what a bag does not. Without ``odometry`` none is kept, as if only scans told how the robot moved. ``progress`` may
    wrap the work of simulating or of reading a bag, as tqdm does. Raises ``DataError`` for what is none of these.

    >>> from pfslam import load
    >>> recording = load("hall")
    >>> recording.lidar.ranges.shape[1]
    1081
    """
    bag = bag if odometry else replace(bag or BagOptions(), odometry=False)
    found = _load(str(dataset), data_dir, bag, progress)
    return without_jumps(found if odometry else replace(found, odometry=None, encoders=None))


def _load(
    text: str, data_dir: str | Path | None, bag: BagOptions | None, progress: Callable | None
) -> Recording:
    """Load a recording as it was logged."""
    reads = _reader(text)
    if bag not in (None, BagOptions(), BagOptions(odometry=False)) and reads is not load_bag:
        expected = "a .bag, .mcap or .db3 file or its folder"
        raise DataError(text[:200], "options for ROS bags", "no ROS bag", expected)
    if text in BUILT_IN:
        return _built_in(text, progress)
    if text.isascii() and text.isdigit():
        return load_course(text, data_folder(data_dir))
    if reads is None:
        accepted = (
            f"{', '.join(BUILT_IN)}, the number of a set in {data_folder(data_dir)}, or the path of a ROS bag, "
            "of an .npz recording, of a folder with one set, or of a CARMEN log"
        )
        raise DataError("pfslam", "data set", repr(text[:200]), accepted)
    return load_bag(text, bag, progress) if reads is load_bag else reads(text)


def _reader(text: str) -> Callable[..., Recording] | None:
    """Find what reads the file or folder of this name, by its kind; None if there is none."""
    path = Path(text)
    with suppress(OSError, ValueError):  # a name too long for the system, or with a zero byte
        if path.exists() and is_bag(path):
            return load_bag
        if path.is_file():
            return load_recording if path.suffix == ".npz" else load_carmen
        if path.is_dir() and len(numbers := numbers_in(path)) == 1:
            return partial(load_course, numbers[0])
    return None


def is_bag(path: Path) -> bool:
    """Whether a path is a bag, by its name: a file of a bag's kind, or a folder that holds such files."""
    names = [entry.name for entry in path.iterdir()] if path.is_dir() else [path.name]
    return any(name == INDEX or Path(name).suffix.lower() in BAGS for name in names)


def data_folder(data_dir: str | Path | None = None) -> Path:
    """Return the folder of numbered sets: ``data_dir``, else ``$PFSLAM_DATA``, else ``data``."""
    return Path(data_dir or os.environ.get("PFSLAM_DATA") or "data")


def dataset_name(dataset: str | int | Path) -> str:
    """Return a short name for folders and titles: built-in name, number, or the log's name without its extension."""
    text = str(dataset)
    return text if text in BUILT_IN or text.isdigit() else Path(text).stem or "log"


def _built_in(name: str, progress: Callable | None) -> Recording:
    from pfslam.simulator.cache import cached_simulation

    recording = cached_simulation(name, progress).recording
    if recording.camera is None:
        return recording
    pairs = image_pairs(recording.camera, every=IMAGE_EVERY)
    camera = replace(recording.camera, disparity_index=pairs.disparity, rgb_index=pairs.rgb)
    return replace(recording, camera=camera)
