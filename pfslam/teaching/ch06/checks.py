"""Checks of the exercises of chapter 06. Each takes the student's function and says what is wrong in words."""

from __future__ import annotations

import numpy as np

from pfslam.sensors import RgbdModel
from pfslam.teaching.show.checks import (
    Check,
    attempt,
    hint,
    is_number,
    is_unanswered,
    not_a_number,
    passed,
    unanswered,
)
from pfslam.texture.floor import back_project, depth_from_disparity, nearest_floor

PIXEL = (310, 413, 566)
"""Column, row and disparity of the journey's first pixel."""


def check_optical_point(optical_point) -> Check:
    """Whether ``optical_point(u, v, d)`` returns (X, Y, Z) in metres for a pixel on the letter C."""
    camera, (u, v, d) = RgbdModel(), PIXEL
    answer = attempt(optical_point, u, v, d)
    if is_unanswered(answer):
        return unanswered()
    if isinstance(answer, Check):
        return answer
    if np.shape(answer) != (3,) or not all(is_number(x) for x in answer):
        return hint(f"Three numbers are asked for, X, Y and Z in metres; your function returns {answer!r}.")
    point = np.asarray(answer, dtype=float)
    depth = float(depth_from_disparity(d, camera))
    expected = back_project(u, v, depth, camera.K)[0]
    if np.allclose(point, expected, atol=1e-3):
        return passed(
            f"({expected[0]:.3f}, {expected[1]:.3f}, {expected[2]:.3f}) m: just left of the axis, below it."
        )
    printed_K = camera.K.copy()
    printed_K[0, 2], printed_K[1, 2] = camera.centre_v, camera.centre_u
    ray = expected / depth
    wrong = [
        (
            back_project(u, v, depth, printed_K)[0],
            "You used K as it is printed. u counts columns, so 315.84 belongs into "
            "the first row: an image of 640 columns has its centre near column 320.",
        ),
        (
            ray * depth / np.linalg.norm(ray),
            "You took the depth for the length of the ray. Z is measured along the "
            "optical axis: do not normalise K^-1 (u, v, 1).",
        ),
        (ray * 1.03 * (3.31 - 0.00304 * d), "You multiplied by dd. dd is an inverse depth: Z = 1.03 / dd."),
        (back_project(v, u, depth, camera.K)[0], "Row and column are exchanged: (u, v) is (column, row)."),
        (ray, "That is the ray, for one metre of depth. Multiply it by the depth."),
    ]
    for value, words in wrong:
        if np.allclose(point, value, atol=1e-3):
            return hint(words)
    if not np.isclose(point[2], depth, atol=1e-3):
        return hint(f"Begin with Z: 1.03 / (3.31 - 0.00304 * {d}) = {depth:.3f} m; you have {point[2]:.3f}.")
    return hint(
        f"Z is right. X should be {expected[0]:.3f} and Y {expected[1]:.3f} m: look at the centre and the focal length."
    )


def check_blind_ring(blind_ring) -> Check:
    """Whether ``blind_ring(height, pitch, rows, centre_v, focal)`` returns the distance of the nearest floor (m)."""
    camera = RgbdModel()
    height, pitch, half = (
        camera.position_b[2],
        camera.pitch,
        (camera.height - 0.5 - camera.centre_v) / camera.focal_v,
    )
    answer = attempt(blind_ring, height, pitch, camera.height, camera.centre_v, camera.focal_v)
    verdict = not_a_number(answer, "metres")
    if verdict is not None:
        return verdict
    expected = nearest_floor(camera)
    if abs(answer - expected) < 0.005:
        return passed(f"{expected:.2f} m in front of the camera.")
    wrong = {
        height
        / np.tan(
            pitch
        ): "That is where the optical axis meets the floor. The lowest row looks down more steeply.",
        height
        / np.tan(
            np.arctan(half)
        ): "You forgot the pitch: the camera already looks down before the field of view counts.",
        height
        / np.tan(
            pitch - np.arctan(half)
        ): "You went up from the axis. The lowest row looks down by pitch plus half the field of view.",
        height
        * np.tan(
            pitch + np.arctan(half)
        ): "Turn the triangle round: the angle is at the floor, so the height is divided by the tangent.",
        height
        / np.sin(
            pitch + np.arctan(half)
        ): "That is the length of the ray. Asked is the distance along the floor.",
        height / np.tan(np.deg2rad(pitch) + np.arctan(half)): "The pitch is in radians already.",
        height / np.tan(pitch + half): "Nearly: half / focal is a tangent, not an angle. Take its arctan.",
    }
    for value, words in wrong.items():
        if abs(answer - value) < 0.005:
            return hint(words)
    return hint(
        f"Your function returns {answer:.3f} m, expected {expected:.3f} m. Draw height, floor and lowest ray."
    )


CELLS = np.array([0, 2, 2, 1, 0, 2, 4, 1])
RANGES = np.array([1.0, 3.0, 0.8, 2.0, 4.0, 1.5, 0.6, 2.5])
COLOURS_SEEN = np.array([200, 90, 40, 120, 60, 70, 250, 10], dtype=np.uint8)


def check_best_view(best_view) -> Check:
    """Whether ``best_view(cells, ranges, colours, n)`` gives each cell the colour seen from nearest, -1 if unseen."""
    answer = attempt(best_view, CELLS.copy(), RANGES.copy(), COLOURS_SEEN.copy(), 5)
    if is_unanswered(answer):
        return unanswered()
    if isinstance(answer, Check):
        return answer
    answer = np.asarray(answer)
    if answer.shape != (5,) or answer.dtype.kind not in "iuf":
        return hint(
            f"One colour for each of the 5 cells is asked for, shape (5,); yours has the shape {answer.shape}."
        )
    if answer[3] != -1:
        return hint(f"Nobody saw cell 3, so it should be -1; yours is {answer[3]}. Unseen is not black.")
    nearest = _painted(lambda views: views[np.argmin(RANGES[views])])
    if np.array_equal(answer, nearest):
        return passed("Each cell shows what was seen from nearest.")
    if np.array_equal(answer, _painted(lambda views: views[-1])):
        return hint(
            "The last view wins: a late look from far away erases a sharp one. Mind the order of writing."
        )
    if np.array_equal(answer, _painted(lambda views: views[0])):
        return hint("The first view wins. It was taken from as far away as chance had it.")
    if np.array_equal(answer, _painted(lambda views: views[np.argmax(RANGES[views])])):
        return hint("The farthest view wins: sort the other way round.")
    if np.allclose(answer, _painted(lambda views: views), atol=1.0):
        return hint("That is the average of all views: the blurred ones are mixed into the sharp ones.")
    at = int(np.argmax(answer != nearest))
    return hint(f"Cell {at} was seen from nearest with colour {nearest[at]:.0f}; yours is {answer[at]}.")


def _painted(pick) -> np.ndarray:
    """The colour of each of five cells, by a rule that picks among a cell's views; -1 where there are none."""
    views = [np.flatnonzero(number == CELLS) for number in range(5)]
    return np.array([COLOURS_SEEN[pick(v)].mean() if len(v) else -1.0 for v in views])
