"""What a search in a known map leaves: its summary, its picture, and a closing line for the user."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from pfslam.beyond.localization import LocalizationResult
from pfslam.cli.summary import said_by_the_loader
from pfslam.grid import OccupancyGrid
from pfslam.io.formats import map_pixels
from pfslam.recording import Recording

UNSURE, SURE, END = (170, 170, 170), (0, 114, 178), (213, 94, 0)
"""Colours (RGB) of estimates that were not found yet, of those that were, and of the last pose."""


def summarise_search(recording: Recording, result: LocalizationResult) -> dict[str, Any]:
    """Collect the figures of a search: when the pose was found, for how long, and with how many particles."""
    numbers = [info.number for info in result.infos]
    found = result.found_at
    return {
        "scans": len(result.infos),
        "updates": sum(info.used for info in result.infos),
        "found_at": found,
        "seconds_to_find": None if found is None else found - float(result.trajectory.t[0]),
        "located_share": float(result.located.mean()),
        "located_at_end": bool(result.located[-1]),
        "particles": {"most": max(numbers), "fewest": min(numbers), "mean": float(np.mean(numbers))},
        "dropped": recording.dropped | result.dropped,
        "notes": list(recording.notes),
    }


def picture_of_search(grid: OccupancyGrid, result: LocalizationResult) -> np.ndarray:
    """Draw the estimates over the map, ``(H, W, 3)`` uint8 RGB: grey while unsure, blue once found, the last in red."""
    pixels = np.ascontiguousarray(np.repeat(map_pixels(grid)[..., None], 3, axis=2))
    cells = grid.spec.world_to_cell(result.trajectory.poses[:, :2])
    places = np.column_stack([cells[:, 0], grid.spec.shape[0] - 1 - cells[:, 1]]).clip(-10_000, 10**6)
    size = max(1, round(0.1 / grid.spec.resolution))
    for place, sure in zip(places.tolist(), result.located, strict=True):
        cv2.circle(pixels, place, size, SURE if sure else UNSURE, -1)
    cv2.circle(pixels, places[-1].tolist(), 2 * size, END, -1)
    return pixels


def closing_words_of_search(recording: Recording, result: LocalizationResult, out: Path) -> str:
    """Write a few lines for the user: what the loader said, when and where the robot was found, and where files are."""
    lines = said_by_the_loader(recording)
    if result.found_at is None:
        lines.append("not found: at no scan did the cloud agree on one place")
    else:
        seconds = result.found_at - result.trajectory.t[0]
        x, y, theta = result.trajectory.poses[-1]
        place = f"({x:.2f} m, {y:.2f} m, {np.degrees(theta):.0f} deg)"
        if result.located[-1]:
            lines.append(f"found after {seconds:.1f} s; now at {place}")
        else:
            lines.append(f"not sure at the end: seemed found after {seconds:.1f} s; last guess {place}")
            lines.append("is it the map of this building?")
    return "\n".join([*lines, f"results are in {out}"])
