"""Section 7: the floor texture, image pairs a second once they are decoded, beside the time to decode or render."""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from pfslam.bench.setting import Setting
from pfslam.bench.tables import Row, Section, interleaved
from pfslam.io.images import read_png, write_png
from pfslam.motion import dead_reckoning
from pfslam.recording import RgbdStream, image_pairs
from pfslam.texture.mapping import map_texture


def texture(setting: Setting) -> Section:
    """7. Image pairs a second of ``map_texture`` with images in memory, and of reading them."""
    rows = []
    for name, recording in setting.recordings.items():
        if recording.camera is None or len(recording.camera.disparity_index) == 0:
            continue
        stream, seconds, count = in_memory(recording.camera, setting.effort.image_pairs)
        # Dead reckoning does for a trajectory: the work is the same.
        work = partial(map_texture, replace(recording, camera=stream), dead_reckoning(recording))
        spent = interleaved({"paint": work}, setting.effort.rounds)["paint"]
        decoded = decode_seconds(stream, setting.effort.rounds)
        rows.append(Row.of(f"{name}: painted", count / spent, "pairs/s", target=60.0, note=f"{count} pairs"))
        rows.append(Row.of(f"{name}: time to decode one pair of PNG files", 1e3 * decoded, "ms"))
        if name in ("hall", "ramp"):
            rows.append(Row(f"{name}: time to render one pair", 1e3 * seconds / count, "ms"))
        rows.append(Row.of(f"{name}: time to paint one pair", 1e3 * spent / count, "ms"))
    return Section(
        7, "Floor texture", rows, "refined settings, 640 x 480, the floor's plane fitted as in every run"
    )


def decode_seconds(stream: RgbdStream, rounds: int) -> np.ndarray:
    """Seconds ``(rounds,)`` to read one pair of images from PNG files, as a course set stores them."""
    disparity = stream.read_disparity(int(stream.disparity_index[0]))
    rgb = stream.read_rgb(int(stream.rgb_index[0]))
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / "disparity.png", Path(folder) / "rgb.png"]
        write_png(paths[0], disparity)
        write_png(paths[1], rgb)

        def decode():
            read_png(paths[0], (*disparity.shape, 1), np.dtype(np.uint16))
            read_png(paths[1], rgb.shape, np.dtype(np.uint8))

        return interleaved({"decode": decode}, rounds)["decode"]


def in_memory(camera: RgbdStream, pairs: int) -> tuple[RgbdStream, float, int]:
    """So many image pairs from the middle of a stream held in memory, the seconds to read them, their number."""
    chosen = image_pairs(camera)
    first = max((len(chosen.disparity) - pairs) // 2, 0)
    depth, colour = chosen.disparity[first : first + pairs], chosen.rgb[first : first + pairs]
    begin = time.process_time()
    disparity = {int(k): camera.read_disparity(int(k)) for k in depth}
    rgb = {int(j): camera.read_rgb(int(j)) for j in colour}
    seconds = time.process_time() - begin
    stream = replace(
        camera,
        read_disparity=disparity.__getitem__,
        read_rgb=rgb.__getitem__,
        disparity_index=np.unique(depth),
        rgb_index=np.unique(colour),
    )
    return stream, seconds, len(depth)
