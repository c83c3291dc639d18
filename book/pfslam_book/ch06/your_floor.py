"""Chapter 06, the check of your floor: any program that paints a drive is scored by the true floor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np

from pfslam.grid import GridSpec
from pfslam.poses import Trajectory
from pfslam.recording import image_pairs
from pfslam.refined.floor import EMPTY
from pfslam.sensors import RgbdModel
from pfslam.texture import TextureConfig, inverse_depth, paint, project_floor, view_code
from pfslam_book.ch06.drives import Drive, judge_for, load_drive
from pfslam_book.show.checks import Check, attempt, hint, is_unanswered, passed, unanswered

NEAR = 32
"""A colour is right if it is no more than so many levels of 255 off, over red, green and blue on average.

The letters are some 130 levels darker than the floor around them.
"""
SLACK = 0.01
"""A floor counts as painted if no more than this share of its cells is missing to what the report's rule reaches."""
CAMERA = RgbdModel()
PAGE = replace(TextureConfig.report(), view="best")
"""The settings of the chapter's own painter."""


@dataclass(frozen=True)
class Way:
    """A way to paint: camera and settings of the six steps, what becomes of each pose, and of the picture."""

    camera: RgbdModel = CAMERA
    config: TextureConfig = PAGE
    pose: Callable[[np.ndarray], np.ndarray] = lambda pose: pose
    picture: Callable[[np.ndarray], np.ndarray] = lambda rgb: rgb


BOOK = Way()


def with_camera(**changes) -> Way:
    """The chapter's way with another camera."""
    return Way(camera=replace(CAMERA, **changes))


REPORT = Way(config=TextureConfig.report())
OTHER_WAYS = {
    "the last view of a cell stays, whether it is near or far": REPORT,
    "every depth pixel takes the colour of the same pixel of the colour image, without step 1": with_camera(
        rgb_focal=1, rgb_baseline=0, rgb_offset_u=0, rgb_offset_v=0, rgb_divisor=1
    ),
    "the place of the camera on the robot is left out": with_camera(position_b=(0, 0, CAMERA.position_b[2])),
    "every point counts as floor, without step 5": Way(config=replace(PAGE, floor_tolerance=100.0)),
    "all images are painted as if the robot stood still at the origin": Way(pose=np.zeros_like),
    "the heading turns the points to the wrong side": Way(pose=lambda pose: pose * [1, 1, -1]),
    "red and blue are exchanged": Way(picture=lambda rgb: rgb[..., ::-1]),
    "x and y are exchanged in the picture": Way(picture=lambda rgb: rgb.transpose(1, 0, 2)),
    "the picture is upside down: its first row has the smallest y": Way(picture=lambda rgb: rgb[::-1]),
}
"""What a program may do differently, in words. Not all of it is wrong."""


@cache
def few_pairs(every: int = 300) -> Drive:
    """Load the drive of the chapter with the image pair nearest to each ``every``-th scan."""
    return load_drive("hall", every)


@cache
def part_of(drive: Drive, step: int) -> Drive:
    """Keep one image pair of ``step`` of a drive, none from its start."""
    stream, rows = drive.stream, slice(step // 2, None, step)
    few = replace(stream, disparity_index=stream.disparity_index[rows], rgb_index=stream.rgb_index[rows])
    return replace(drive, stream=few, recording=replace(drive.recording, camera=few))


@lru_cache(32)
def painted(drive: Drive, path: Trajectory, spec: GridSpec, way: Way = BOOK) -> np.ndarray:
    """Paint a drive as the chapter does, or in another way: colours ``(H, W, 3)``, black where nothing is seen."""
    stream, canvas = drive.stream, np.full(spec.shape, EMPTY)
    pairs = image_pairs(stream)
    for i, j in zip(pairs.disparity, pairs.rgb, strict=True):
        disparity, image, t = stream.read_disparity(i), stream.read_rgb(j), stream.disparity_t[i]
        if not path.covers(t):
            continue
        v, u = np.nonzero(inverse_depth(disparity, way.camera) > 0)
        seen = project_floor(u, v, disparity[v, u], way.pose(path.at(t)), way.camera, spec, way.config)
        column, line = np.rint([seen.u_rgb, seen.v_rgb]).astype(int)
        good = (column >= 0) & (column < image.shape[1]) & (line >= 0) & (line < image.shape[0])
        codes = view_code(image[line[good], column[good]], seen.depth[good], seen.points_w[good], spec)
        paint(canvas, seen.cells[good], codes, way.config.view)
    codes = np.where(canvas == EMPTY, 0, canvas)
    return way.picture(np.stack([codes >> shift & 255 for shift in (16, 8, 0)], axis=-1).astype(np.uint8))


def alike(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """In which cells ``(H, W)`` two pictures have nearly the same colour."""
    return np.abs(one.astype(float) - other).mean(axis=2) <= NEAR


def difference(theirs: Callable, drive: Drive, path: Trajectory, spec: GridSpec) -> str:
    """The way that a program seems to paint, in words; nothing if its picture is most like that of the book's."""
    mine = as_picture(attempt(theirs, drive, path, spec), spec)
    if isinstance(mine, Check):
        return ""

    def agrees(way: Way) -> float:
        other = painted(drive, path, spec, way)
        if other.shape != mine.shape:
            return 0.0
        either = mine.any(axis=2) | other.any(axis=2)
        return float((alike(mine, other) & either).sum() / either.sum())

    likeness = {words: agrees(way) for words, way in {"": BOOK, **OTHER_WAYS}.items()}
    words = max(likeness, key=lambda words: likeness[words])
    if not words or likeness[words] <= 0.5:  # it looks like none of them
        return ""
    return f" Your picture looks most like the one that comes out if {words}."


def as_picture(answer, spec: GridSpec) -> np.ndarray | Check:
    """What a program returned as colours ``(H, W, 3)`` from 0 to 255, or what it is instead."""
    if isinstance(answer, Check) or is_unanswered(answer):
        return answer if isinstance(answer, Check) else unanswered()
    if attempt(np.shape, answer) != (*spec.shape, 3):
        return hint(f"Return one array of colours, {(*spec.shape, 3)}: rows, columns, and red, green, blue.")
    rgb = np.nan_to_num(np.asarray(answer, dtype=float))
    if not rgb.any():
        return hint(
            "You painted nothing. If no point passes step 5, look at the heights: are the centres in K in the order "
            "(u, v), is the pitch positive downwards, and is every length in metres?"
        )
    if rgb.max() <= 1:
        return hint("Your colours end at 1. Give them as the camera does, from 0 to 255.")
    return rgb


def check_floor(theirs: Callable, path: Trajectory, spec: GridSpec) -> Check:
    """Whether ``floor(drive, path, spec)`` paints the floor of a drive: colours ``(H, W, 3)``, black where unseen."""
    drive = few_pairs()
    mine = as_picture(attempt(theirs, drive, path, spec), spec)
    if isinstance(mine, Check):
        return mine
    judge = judge_for(drive, spec)

    def right(rgb: np.ndarray) -> float:
        seen = rgb.any(axis=2)
        good = alike(rgb, judge.colours) & judge.floor & seen
        return float(good.sum() / (judge.visible | seen).sum())

    seen, found = np.asarray(mine.any(axis=2)), right(mine)
    books, reports = (right(painted(drive, path, spec, way)) for way in (BOOK, REPORT))
    covered, beside = seen[judge.visible].mean(), 1 - judge.floor[seen].mean()
    words = (
        f"{100 * found:.0f} % is painted right, {100 * books:.0f} % by the book's program, and {100 * reports:.0f} % "
        f"if it keeps the last view, as the report does. Yours covers {100 * covered:.0f} % of the floor that is seen, "
        f"and {100 * beside:.0f} % of its paint lies beside the floor."
    )
    words += difference(theirs, part_of(drive, 5), path, spec)
    return passed(words) if found >= reports - SLACK else hint(words)
