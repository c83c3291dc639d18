"""The book's first picture: the map grows, the particles move, and at the end the floor appears.

The book calls ``write_hero`` whenever it is built: ``hero.webp`` is the animation, ``hero-still.webp`` its last
moment, for readers who want no motion. ``python book/_tools/hero.py book/_static`` writes ``readme.webp``,
the same animation in small, which the README shows. The run is the refined filter on the built-in building, so the
picture shows what the package does today. Everything is drawn with OpenCV: Matplotlib would take ten times as
long for the same frames.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from matplotlib.colors import to_rgb
from pfslam_book.show.pictures import encode
from pfslam_book.show.style import COLOURS, INK, PAPER

from pfslam.grid import GridSpec, OccupancyGrid, integrate_scan
from pfslam.io.datasets import load
from pfslam.io.files import atomic_write
from pfslam.poses import between, transform_points
from pfslam.recording import LidarScans, Recording, nearest_stamp
from pfslam.refined.floor import map_texture
from pfslam.run import SlamResult, run_slam
from pfslam.sensors import LidarModel, scan_points
from pfslam.slam import Step
from pfslam.texture import FloorTexture

PIXELS_PER_CELL = 2
MARGIN = 0.6  # m of paper around the building
FRAMES, FADE = 56, 8  # while the map grows; while the floor appears
FRAME_MS, HOLD_MS = 100, 1600
INSET = 280  # px, the window on the particles
INSET_METRES = 0.2
WIDTH, QUALITY = 820, 60
ANIMATION, STILL, SMALL = "hero.webp", "hero-still.webp", "readme.webp"


@dataclass(frozen=True, eq=False)
class Scene:
    """What all frames share: the run, the cells that are shown, and the finished floor on them."""

    lidar: LidarScans
    model: LidarModel
    result: SlamResult
    spec: GridSpec
    floor: np.ndarray
    seen: np.ndarray


def make_scene(recording: Recording, result: SlamResult, texture: FloorTexture) -> Scene:
    """Cut the run's map and texture (on the same cells) to the building."""
    if recording.lidar is None:
        raise ValueError(f"{recording.name}: no LiDAR")
    grid = result.grid
    iy, ix = np.nonzero(grid.log_odds)
    border = round(MARGIN / grid.spec.resolution)
    low = np.maximum([ix.min() - border, iy.min() - border], 0)
    high = np.minimum([ix.max() + border, iy.max() + border], grid.spec.shape[::-1])
    window = slice(low[1], high[1]), slice(low[0], high[0])
    x, y = np.array(grid.spec.origin) + low * grid.spec.resolution
    spec = GridSpec((float(x), float(y)), grid.spec.resolution, grid.log_odds[window].shape)
    return Scene(
        recording.lidar, recording.robot.lidar, result, spec, texture.rgb[window], texture.seen[window]
    )


def frames(scene: Scene) -> Iterator[tuple[np.ndarray, int]]:
    """The pictures ``(H, W, 3)`` uint8 RGB in order, each with its milliseconds; the finished map comes first."""
    last = len(scene.result.infos) - 1
    maps = dict(growing_map(scene, moments_of(scene.result)))
    yield draw_frame(scene, maps[last], last, floor=1.0), HOLD_MS
    for k, log_odds in maps.items():
        yield draw_frame(scene, log_odds, k), FRAME_MS
    for step in range(1, FADE + 1):
        yield draw_frame(scene, maps[last], last, floor=step / FADE), FRAME_MS


def moments_of(result: SlamResult) -> np.ndarray:
    """The steps to draw: evenly in time while the robot drives, and the last one."""
    way = np.hypot(*(result.trajectory.poses[:, :2] - result.trajectory.poses[0, :2]).T)
    away = np.flatnonzero(way > 0.05)
    stop = np.flatnonzero(np.hypot(*np.diff(result.trajectory.poses[:, :2], axis=0).T) > 0.005)
    last = len(way) - 1
    begin, end = (int(away[0]), int(stop[-1])) if len(away) and len(stop) else (0, last)
    return np.unique(np.append(np.linspace(begin, end, FRAMES).astype(int), last))


def growing_map(scene: Scene, moments) -> Iterator[tuple[int, np.ndarray]]:
    """``(k, log_odds)`` of the map as it was after step k, for the steps in ``moments``."""
    config, spec = scene.result.config, scene.result.grid.spec
    grid = OccupancyGrid.empty(spec)
    offset = np.rint((np.array(scene.spec.origin) - spec.origin) / spec.resolution).astype(int)
    h, w = scene.spec.shape
    wanted = set(np.asarray(moments).tolist())
    for k, info in enumerate(scene.result.infos):
        if info.drawn:
            ranges = scan_at(scene, info)
            points_w = transform_points(info.estimate, scan_points(ranges, scene.model))
            sensor_w = transform_points(info.estimate, np.array([scene.model.position_b[:2]]))[0]
            beams = np.flatnonzero(scene.model.valid(ranges))
            integrate_scan(grid, points_w, beams, sensor_w, config.map)
        if k in wanted:
            yield k, grid.log_odds[offset[1] : offset[1] + h, offset[0] : offset[0] + w].copy()


def scan_at(scene: Scene, info: Step) -> np.ndarray:
    """The ranges ``(beams,)`` of a step's scan."""
    return scene.lidar.ranges[nearest_stamp(scene.lidar.t, np.array([info.t]))[0]]


def draw_frame(scene: Scene, log_odds: np.ndarray, k: int, floor: float = 0.0) -> np.ndarray:
    """Map, path, scan and robot after step ``k``; ``floor`` (0 to 1) is how far the texture has appeared."""
    info = scene.result.infos[k]
    picture = np.empty((*log_odds.shape, 3), dtype=np.float32)
    picture[:] = 0.75 * colour("paper") + 0.25 * colour("unknown")
    picture[log_odds < 0] = 255
    picture[scene.seen] += floor * (scene.floor[scene.seen] - picture[scene.seen])
    picture[log_odds > 0] = colour("truth")
    picture = cv2.resize(
        picture, None, fx=PIXELS_PER_CELL, fy=PIXELS_PER_CELL, interpolation=cv2.INTER_NEAREST
    )
    picture = np.ascontiguousarray(picture[::-1].round().astype(np.uint8))  # y points up
    _draw_path(picture, scene, k, floor)
    if floor == 0.0:
        _draw_scan(picture, scene, info)
    _draw_robot(picture, to_pixels(scene, info.estimate[None, :2])[0], info.estimate[2], 13)
    _draw_words(picture, scene, info)
    _draw_inset(picture, info)
    return picture


def to_pixels(scene: Scene, points_w) -> np.ndarray:
    """Picture coordinates ``(M, 2)``, column and row, whole pixels."""
    cells = (np.asarray(points_w) - scene.spec.origin) / scene.spec.resolution
    cells[:, 1] = scene.spec.shape[0] - cells[:, 1]
    return np.rint(PIXELS_PER_CELL * cells).astype(np.int32)


def colour(name: str) -> np.ndarray:
    """A colour of the book, or ``paper`` or ``ink``, as RGB of 0 to 255."""
    code = {"paper": PAPER, "ink": INK}.get(name) or COLOURS[name]
    return 255 * np.array(to_rgb(code), dtype=np.float32)


def _rgb(name: str) -> tuple[float, ...]:
    return tuple(float(c) for c in colour(name))


def _draw_path(picture: np.ndarray, scene: Scene, k: int, floor: float) -> None:
    """The way so far; it steps back when the floor comes, whose words it crosses."""
    path, drawn = to_pixels(scene, scene.result.trajectory.poses[: k + 1, :2]), picture.copy()
    cv2.polylines(drawn, [path], False, _rgb("estimate"), 3, cv2.LINE_AA)
    opacity = 1.0 - 0.6 * floor
    cv2.addWeighted(drawn, opacity, picture, 1.0 - opacity, 0.0, dst=picture)


def _draw_scan(picture: np.ndarray, scene: Scene, info: Step) -> None:
    points_w = transform_points(info.estimate, scan_points(scan_at(scene, info), scene.model))
    for point in to_pixels(scene, points_w[::3]):
        cv2.circle(picture, point.tolist(), 2, _rgb("hits"), -1)


def _draw_robot(picture: np.ndarray, at: np.ndarray, theta: float, size: int) -> None:
    corners = np.array([[1.3, 0.0], [-0.9, 0.8], [-0.5, 0.0], [-0.9, -0.8]]) * size
    c, s = np.cos(theta), np.sin(theta)
    turned = corners @ np.array([[c, -s], [s, c]])  # rows point down
    shape = np.rint(at + turned).astype(np.int32)
    cv2.fillPoly(picture, [shape], _rgb("estimate"), cv2.LINE_AA)
    cv2.polylines(picture, [shape], True, _rgb("paper"), 2, cv2.LINE_AA)


def _write(
    picture: np.ndarray, text: str, at: tuple[int, int], size: int, name: str = "ink", weight=400
) -> None:
    cv2.putText(picture, text, at, _rgb(name), cv2.FontFace("sans"), size, weight)


def _draw_words(picture: np.ndarray, scene: Scene, info: Step) -> None:
    """The clock and a scale bar of five metres."""
    left, metre = picture.shape[1] - 60 - INSET, PIXELS_PER_CELL / scene.spec.resolution
    seconds = info.t - scene.result.infos[0].t
    _write(picture, f"{seconds:.0f} s", (left, 84), 52, weight=600)
    y = 250 + INSET
    cv2.line(picture, (left, y), (left + round(5 * metre), y), _rgb("ink"), 4)
    _write(picture, "5 m", (left, y - 14), 36)


def _draw_inset(picture: np.ndarray, info: Step) -> None:
    """The cloud around the estimate, enlarged: at the scale of the map it would be one dot."""
    left, top = picture.shape[1] - 60 - INSET, 110
    box = picture[top : top + INSET, left : left + INSET]
    box[:] = colour("paper")
    _draw_robot(box, np.array([INSET / 2, INSET / 2]), np.pi / 2, 40)
    scale = INSET / INSET_METRES
    cloud = info.particles.poses if info.particles is not None else info.estimate[None]
    for x, y, _ in between(info.estimate, cloud):
        u, v = round(INSET / 2 - scale * y), round(INSET / 2 - scale * x)
        cv2.circle(box, (u, v), 5, _rgb("particles"), -1, cv2.LINE_AA)
        cv2.circle(box, (u, v), 5, _rgb("paper"), 1, cv2.LINE_AA)
    cv2.rectangle(picture, (left, top), (left + INSET, top + INSET), _rgb("unknown"), 2)
    label = f"particles ({100 * INSET_METRES:.0f} cm)"
    _write(picture, label, (left, top + INSET + 42), 36)


def encode_animation(pictures: list[np.ndarray], milliseconds: list[int], quality: int = QUALITY) -> bytes:
    """An animated WebP that repeats for ever."""
    animation = cv2.Animation()
    animation.frames = [np.ascontiguousarray(picture[..., ::-1]) for picture in pictures]
    animation.durations = tuple(milliseconds)
    animation.loop_count = 0
    done, data = cv2.imencodeanimation(".webp", animation, [cv2.IMWRITE_WEBP_QUALITY, quality])
    if not done:
        raise RuntimeError("could not encode the animation as WebP")
    return bytes(np.asarray(data))


def scaled(picture: np.ndarray, width: int) -> np.ndarray:
    """The picture, ``width`` pixels wide."""
    height = round(picture.shape[0] * width / picture.shape[1])
    return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)


def hero_frames() -> tuple[list[np.ndarray], list[int]]:
    """Run the filter on the built-in building and draw everything: the pictures and their milliseconds."""
    recording = load("hall")
    result = run_slam(recording)
    texture = map_texture(recording, result.trajectory, result.grid)
    pairs = list(frames(make_scene(recording, result, texture)))
    return [picture for picture, _ in pairs], [milliseconds for _, milliseconds in pairs]


def write_hero(folder: str | Path) -> None:
    """Write the animation and its still into a folder."""
    pictures, milliseconds = hero_frames()
    moving = encode_animation([scaled(picture, WIDTH) for picture in pictures], milliseconds)
    for name, data in ((ANIMATION, moving), (STILL, encode(pictures[0]))):
        _save(Path(folder) / name, data)


def _save(path: Path, data: bytes) -> None:
    with atomic_write(path) as file:
        file.write(data)


def main(arguments: list[str] | None = None) -> None:
    """Write the README's picture."""
    parser = argparse.ArgumentParser(prog="python book/_tools/hero.py", description=main.__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args(arguments).folder
    pictures, milliseconds = hero_frames()
    _save(folder / SMALL, encode_animation([scaled(p, 640) for p in pictures], milliseconds, quality=45))


if __name__ == "__main__":
    main()
