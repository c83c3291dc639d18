"""Detection of a lost or kidnapped robot from the scores of its run.

The mean score per beam says how well a scan fits the map. A robot that has been carried off, the "kidnapped robot" of
the literature, sees walls where its map has none, and the score falls at once, far below all earlier scores of the run.
The run itself sets the scale: every LiDAR and every building has its own ordinary scores.

The fall is short. A filter that draws every scan soon has the new place in its map, at the wrong spot, and its scores
look fine again. So an alarm says when the robot was lost, not whether it still is. Over a map that is no longer drawn
the score stays low for as long as the robot is lost.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pfslam.slam import StepInfo

LEAST_PAST = 50
"""So many scans, drawn while the robot moved, must have been scored before any scan is judged."""
PAST = 400
"""So many of them are remembered."""
LOST_BELOW = -8.0
"""Score deviation below which a robot counts as lost.

Ordinary runs were measured down to -6.3, people and moving doors included; 46 kidnaps of the course's robot from -8.9
down. Where ordinary scores vary widely, as in a log of 180 beams and a scan every few metres, a kidnap may stay within
them: two of three did, without an alarm.
"""
ONE_ALARM = 5.0
"""Falls less than so many seconds apart belong to one alarm."""
LEAST_SPREAD = 0.005
"""A run whose scores hardly differ is not judged more finely than this."""


def score_deviation(infos: Sequence[StepInfo]) -> np.ndarray:
    """Measure how far each score ``(K,)`` lies from the median of those before it, in spreads; below 0 is worse.

    One spread is the distance from the median down to the 5th percentile, divided by 1.645: one standard deviation if
    scores were normal, but taken from the lower side, because scores end at 1 and have a long tail below. NaN for scans
    that were not matched (a blind robot is not a lost one) and while there is too little past. Scans drawn into the
    map make up the past, so that a robot that stands and sees the same thing a thousand times does not narrow it;
    scans that were lost themselves do not.
    """
    past: list[float] = []
    found = np.full(len(infos), np.nan)
    middle, spread = 0.0, 1.0
    for k, info in enumerate(infos):
        if not info.matched:
            continue
        if len(past) >= LEAST_PAST:
            found[k] = (info.score - middle) / spread
        if info.drawn and not found[k] < LOST_BELOW:
            past = [*past[1 - PAST :], info.score]
            ordered = sorted(past)
            low, middle = ordered[len(past) // 20], ordered[len(past) // 2]
            spread = max((middle - low) / 1.645, LEAST_SPREAD)
    return found


def lost(infos: Sequence[StepInfo]) -> np.ndarray:
    """Tell which scans ``(K,)`` bool fit the map so badly that the robot cannot be where the filter puts it."""
    return score_deviation(infos) < LOST_BELOW


def alarms(infos: Sequence[StepInfo]) -> np.ndarray:
    """List the times ``(A,)`` (s) at which the robot was found to be lost; falls within 5 s are one alarm."""
    times: list[float] = []
    last = -np.inf
    for info, fell in zip(infos, lost(infos), strict=True):
        if fell:
            times += [info.t] if info.t - last > ONE_ALARM else []
            last = info.t
    return np.array(times)
