"""When the estimate of a run is not to be trusted: what the run itself can tell, without the truth.

The mean score per beam says how well a scan fits the map. A robot that has been carried off, the "kidnapped robot" of
the literature, sees walls where its map has none, and the score falls at once, far below all earlier scores of the run.
The run itself sets the scale: every LiDAR and every building has its own ordinary scores. The fall is short. A filter
that draws every scan soon has the new place in its map, at the wrong spot, and its scores look fine again.

A robot that goes astray slowly keeps its scores, because its map goes astray with it. What gives it away is that scans
move the estimate from where odometry had put it, again and again in the same direction, while part of their beams end
where the map has no wall: people who walk ahead, or glass, drag the estimate along. When wheels slip the scans move the
estimate too, but then the walls explain them. ``distrust`` gathers these signs, and simpler ones: no beams, no wall to
show the way along, and a covariance of the estimate that has become large.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterator, Sequence
from typing import TypedDict

import numpy as np

from pfslam.poses import between
from pfslam.slam import Step

LEAST_PAST = 50
"""Scans that must have been drawn, while the robot moved, before any scan is judged."""
PAST = 400
"""How many of the last of them make up the ordinary scores."""
LOST_BELOW = -8.0
"""Score deviation below which a robot counts as lost.

Ordinary runs were measured down to -6.3, people and moving doors included; 46 kidnaps of the course's robot from -8.9
down. Where ordinary scores vary widely, as in a log of 180 beams and a scan every few metres, a kidnap may stay within
them: two of three did, without an alarm.
"""
BLIND_SECONDS = 2.0
"""For so long odometry alone is good to some centimetres."""
LONGEST_PAUSE = 3600.0
"""Seconds without a reading after which a clock was set, or the robot was switched off and moved."""
SETTLING = 3
"""After a silence the first scans take back what odometry has drifted; carried off, a robot fits badly for longer."""
ONE_ALARM = 5.0
"""Falls less than so many seconds apart belong to one alarm."""
LEAST_SPREAD = 0.005
"""A run whose scores hardly differ is not judged more finely than this."""


def score_deviation(infos: Sequence[Step], name: str = "score") -> np.ndarray:
    """Measure how far each score ``(K,)`` lies from the median of those before it, in spreads; below 0 is worse.

    ``name`` is "score" or "aligned_score". One spread is the distance from the median down to the 5th percentile,
    divided by 1.645: one standard deviation if scores were normal, but taken from the lower side, because scores end
    at 1 and have a long tail below. NaN for scans that were not matched (a blind robot is not a lost one) and while
    there is too little past. Scans drawn into the map make up the past, so that a robot that stands and sees the same
    thing a thousand times does not narrow it; scans that were lost themselves do not.
    """
    past: list[float] = []
    ordered: list[float] = []  # the same, by size
    found = np.full(len(infos), np.nan)
    middle, spread = 0.0, 1.0
    for k, info in enumerate(infos):
        if not info.matched:
            continue
        score = getattr(info, name)
        if len(past) >= LEAST_PAST:
            found[k] = (score - middle) / spread
        if info.drawn and not found[k] < LOST_BELOW:
            past.append(score)
            insort(ordered, score)
            if len(past) > PAST:
                ordered.remove(past.pop(0))
            low, middle = ordered[len(past) // 20], ordered[len(past) // 2]
            spread = max((middle - low) / 1.645, LEAST_SPREAD)
    return found


def lost(infos: Sequence[Step]) -> np.ndarray:
    """Which scans ``(K,)`` bool fit the map so badly that the robot cannot be where the filter puts it.

    An odometry that stands still takes the particles from where the lines lead: then they fit badly, the estimate not.
    """
    both = [score_deviation(infos, name) < LOST_BELOW for name in ("score", "aligned_score")]
    return both[0] & both[1] & ~_settling(infos)


def _silence(infos: Sequence[Step]) -> float:
    """Return from how many seconds on a time without scans is one that this recording is not used to."""
    usual = float(np.median(np.diff([info.t for info in infos]))) if len(infos) > 1 else 0.0
    return max(BLIND_SECONDS, 5.0 * usual)


def _settling(infos: Sequence[Step]) -> np.ndarray:
    """Which scans ``(K,)`` bool are the first after a silence."""
    t = np.array([info.t for info in infos])
    first = np.flatnonzero(np.diff(t, prepend=t[:1]) > _silence(infos))
    return np.isin(np.arange(len(t)), first[:, None] + np.arange(SETTLING))


def alarms(infos: Sequence[Step]) -> np.ndarray:
    """List the times ``(A,)`` (s) at which the robot was found to be lost; falls within 5 s are one alarm."""
    times: list[float] = []
    last = -np.inf
    for info, fell in zip(infos, lost(infos), strict=True):
        if fell:
            times += [info.t] if info.t - last > ONE_ALARM else []
            last = info.t
    return np.array(times)


Distrust = TypedDict("Distrust", {"from": float, "to": float | None, "reason": str})
"""A stretch of a run that is not to be trusted, in the recording's clock (s); ``to`` is None where it never ended."""

DRAGGED_WITHIN = 2.0
"""Seconds over which the departures from odometry are added up."""
DRAGGED_METRES = 0.2
"""More than scans correct on ordinary drives, where at most 0.14 m were measured."""
DRAGGED_UNEXPLAINED = 0.02
"""Least share of beams that no wall explains; ordinary drives have less than 1 %."""
DRAGGED_SCANS = 3
"""Fewer scans in that time say little: between two that are a metre apart, odometry may drift as far."""
BACK_ON_WALLS = 0.07
"""By so much more of the beams on old walls, where scans moved the estimate, shows that they took it back.

Where wheels slipped among people, that share rose by 0.1 and more with right corrections, but for a few, and by 0.03 at
most with those that made the error grow.
"""
SUSPECT_METRES = 0.15
"""A second look costs only time, so it is taken at less than ``DRAGGED_METRES``."""
SUSPECT_UNEXPLAINED = 0.01
"""The same for ``DRAGGED_UNEXPLAINED``: glass leaves fewer beams unexplained than people do."""
USUAL_SHARE = 0.1
"""If so often before scans departed as far while walls explained their beams, it is odometry that is bad."""
SCALE_OFF = 0.05
"""An odometry whose scale is off by more is a matter of its own: such departures say nothing about the scans."""
STILL_SHARE, STILL_METRES = 0.1, 1.0
"""An odometry that moves the estimate by less than this share of what scans do, over so many metres, stands still."""
BELIEVED = "that could be believed"
"""What kind of scan was missing, where some came and their matches lay beyond the gate."""
ALONG_METRES = 10.0
"""So far along a corridor whose walls do not show the way, an error of the wheels of 2 % has grown to 0.2 m."""
ALONG_WITHIN = 20.0
"""Metres of driving within which those must lie: they are stretches of one corridor."""

UNSURE_METRES = 1.0
"""Standard deviation of the position above which a run does not know itself where it is.

Of runs that were right to 5 cm none was measured above 0.7 m.
"""


def distrust(infos: Sequence[Step]) -> list[Distrust]:
    """List the stretches of a run whose estimate is not to be trusted, each with its reason, in order of time.

    An error that is drawn into the map stays there, so only blindness ends: when the scans fit again, the estimate is
    back where it was in the map.
    """
    signs = _still(infos), _lost(infos), _dragged(infos), _blind(infos), _along(infos), _unsure(infos)
    return sorted((stretch for sign in signs for stretch in sign), key=lambda d: d["from"])


def in_doubt(stretches: Sequence[Distrust], t: np.ndarray) -> np.ndarray:
    """Which of the times ``(K,)`` (s) lie in a stretch that is not to be trusted, ``(K,)`` bool."""
    doubted = np.zeros(len(t), dtype=bool)
    for stretch in stretches:
        doubted |= (t >= stretch["from"]) & (t <= (np.inf if stretch["to"] is None else stretch["to"]))
    return doubted


def was_dragged(infos: Sequence[Step]) -> bool:
    """Whether scans seem to have dragged the estimate from its odometry, as people and glass do.

    Only scans before the first alarm count: where a robot was carried off, scans contradict odometry and are right.
    """
    when = alarms(infos)
    before = [info for info in infos if len(when) == 0 or info.t < when[0]]
    return any(True for _ in _dragged(before, SUSPECT_METRES, SUSPECT_UNEXPLAINED))


def _steps(infos: Sequence[Step]) -> tuple[np.ndarray, np.ndarray]:
    """Return how far the estimate came up to each scan, and what part of that was the scan's doing, both ``(K, 2)``."""
    poses = np.array([info.estimate[:2] for info in infos]).reshape(-1, 2)
    return np.diff(poses, axis=0, prepend=poses[:1]), np.array([i.departure for i in infos]).reshape(-1, 2)


def _still(infos: Sequence[Step]) -> Iterator[Distrust]:
    """Find the time at which scans have moved the estimate a metre, and the odometry hardly anything.

    Scans count by where they led: those with noise go to and fro.
    """
    step, departure = _steps(infos)
    by_odometry = np.cumsum(np.hypot(*(step - departure).T))
    by_scans = np.hypot(*np.cumsum(departure, axis=0).T)
    found = by_scans > STILL_METRES
    if found.any() and by_odometry[k := int(np.argmax(found))] < STILL_SHARE * by_scans[k]:
        yield {"from": float(infos[k].t), "to": None, "reason": "the odometry stands still while scans move"}


def _lost(infos: Sequence[Step]) -> Iterator[Distrust]:
    if len(when := alarms(infos)):
        reason = "scans fit the map far worse than before: the robot is lost, or was moved by hand"
        yield {"from": float(when[0]), "to": None, "reason": reason}


def _dragged(
    infos: Sequence[Step], least_metres: float = DRAGGED_METRES, least_share: float = DRAGGED_UNEXPLAINED
) -> Iterator[Distrust]:
    """Find the first time at which scans drag the estimate from its odometry while no wall explains part of them.

    An odometry that scans have often corrected as far while walls explained them is bad, and says nothing against them.
    Nor does one that old walls contradict: wheels have slipped, with somebody in view.
    """
    matched = [info for info in infos if info.matched]
    t = np.array([info.t for info in matched])
    step, departure = _steps(matched)
    far = np.hypot(*step.T) > 0.02
    shares = (departure * step)[far].sum(axis=1) / np.square(step[far]).sum(axis=1)
    scale = np.median(shares) if far.any() else 0.0
    departure = departure - scale * step if abs(scale) > SCALE_OFF else departure
    departure = np.where(_settling(matched)[:, None], 0.0, departure)
    sums = np.zeros((len(t) + 1, 3))
    np.cumsum(np.column_stack([departure, [info.unexplained for info in matched]]), axis=0, out=sums[1:])
    since = np.searchsorted(t, t - DRAGGED_WITHIN)
    scans = np.arange(len(t)) + 1 - since
    total = sums[1:] - sums[since]
    metres, unexplained = np.hypot(total[:, 0], total[:, 1]), total[:, 2] / scans
    enough = scans >= DRAGGED_SCANS
    calm = enough & (unexplained <= SUSPECT_UNEXPLAINED)
    for k in np.flatnonzero((metres > least_metres) & (unexplained > least_share) & enough):
        before = metres[:k][calm[:k]]
        usual = (before >= metres[k]).sum() > USUAL_SHARE * len(before)
        if usual or matched[k].old_walls >= BACK_ON_WALLS:
            continue
        dragged = f"scans moved the estimate {metres[k]:.2f} m from its odometry"
        why = f"while {100 * unexplained[k]:.0f} % of the beams met what the map does not have"
        reason = f"{dragged} within {DRAGGED_WITHIN:.0f} s, {why}"
        yield {"from": float(t[k]), "to": None, "reason": reason}
        return


def farther_than_usual(poses: np.ndarray) -> np.ndarray:
    """Which of the steps ``(K - 1,)`` between poses ``(K, 3)`` are more than twice the median one.

    A radian counts as a metre. What a robot that stood, or went its usual metre, did not record is not missing.
    """
    steps = np.linalg.norm(between(poses[:-1], poses[1:]), axis=1)
    return steps > 2.0 * np.median(steps) if len(steps) else steps > 0.0


def _blind(infos: Sequence[Step]) -> Iterator[Distrust]:
    """Find the times without a scan to go by, from the last one that was matched to the next."""
    since, missing = infos[0].t if infos else 0.0, ""
    poses = np.array([info.estimate for info in [*infos[:1], *infos]]).reshape(-1, 3)
    silence, far = _silence(infos), farther_than_usual(poses)
    for info, moved in zip(infos, far, strict=True):
        if not (info.matched or info.drawn):
            missing = BELIEVED if info.rejected or missing == BELIEVED else "with enough beams"
            continue
        if info.t - since > (BLIND_SECONDS if missing else silence if moved else max(silence, LONGEST_PAUSE)):
            yield _blindness(since, info.t, float(info.t), missing or "was recorded")
        since, missing = info.t, ""
    if missing and infos[-1].t - since > BLIND_SECONDS:
        yield _blindness(since, infos[-1].t, None, missing)


def _blindness(begin: float, end: float, to: float | None, missing: str) -> Distrust:
    reason = f"no scan {missing} for {end - begin:.1f} s: odometry alone"
    return {"from": float(begin), "to": to, "reason": reason}


def _along(infos: Sequence[Step]) -> Iterator[Distrust]:
    """Find the first time at which most of the way was driven where no wall shows how far."""
    if len(infos) < 2:
        return
    poses = np.array([info.estimate[:2] for info in infos])
    metres = np.append(0.0, np.hypot(*np.diff(poses, axis=0).T))
    silent = metres * [info.free_direction is not None for info in infos]
    driven, along = np.cumsum(metres), np.cumsum(silent)
    since = np.searchsorted(driven, driven - ALONG_WITHIN)
    found = along - along[since] > ALONG_METRES
    if found.any():
        driven_so = f"{ALONG_METRES:.0f} m driven where no wall shows the way along"
        reason = f"{driven_so}: the wheels alone tell how far"
        yield {"from": float(infos[int(np.argmax(found))].t), "to": None, "reason": reason}


def _unsure(infos: Sequence[Step]) -> Iterator[Distrust]:
    """Find the first time at which the covariance of the estimate leaves the position open."""
    positions = [np.zeros((2, 2)) if i.covariance is None else i.covariance[:2, :2] for i in infos]
    sigma = np.sqrt(np.linalg.eigvalsh(positions)[:, 1]) if positions else np.zeros(0)
    if (above := sigma > UNSURE_METRES).any():
        reason = f"the walls seen fix the position no better than to {sigma.max():.1f} m (standard deviation)"
        yield {"from": float(infos[int(np.argmax(above))].t), "to": None, "reason": reason}
