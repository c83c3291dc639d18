"""The wall between two beams of a coarse scanner.

Beams two degrees apart meet a wall at five metres every 17 cm, more than three cells of the map: what is drawn is a
row of dots. The next scan fits best where its dots lie on those of the map, wherever the wall is. So points are put on
the wall between two beams, which then is a line in the map and in the scan.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from pfslam.events import ScanEvent
from pfslam.poses import wrap_angle

E = TypeVar("E", bound=ScanEvent)
STEEPEST = 12.0
"""Neighbours lie on one wall unless their ranges say that it is seen at a sharper angle: the tangent of 85 degrees."""


def filled(event: E, spacing: float) -> E:
    """Put points on the wall between neighbouring beams, so that they are at most ``spacing`` (rad) apart; 0: none.

    A point has the number of the beam before it. Nothing is filled in where beams between have no return, nor where the
    ranges of two neighbours are too different for one wall.
    """
    if not spacing or len(event.points_b) < 2:
        return event
    x, y = (event.points_b - event.sensor_b).T
    ranges, apart = np.hypot(x, y), np.abs(wrap_angle(np.diff(np.arctan2(y, x))))
    one_wall = np.abs(np.diff(ranges)) < STEEPEST * apart * np.minimum(ranges[1:], ranges[:-1])
    one_wall &= np.diff(event.beams) == 1
    # Each beam is followed by the points up to the next; `share` says how far along each of them is.
    parts = np.append(np.where(one_wall, np.ceil(apart / spacing), 1), 1).astype(int)
    if parts.max() == 1:
        return event
    before = np.repeat(np.arange(len(parts)), parts)
    share = (np.arange(len(before)) - (np.cumsum(parts) - parts)[before]) / parts[before]
    step = np.diff(event.points_b, axis=0, append=event.points_b[-1:])
    points = event.points_b[before] + share[:, None] * step[before]
    return replace(event, points_b=points, beams=event.beams[before])
