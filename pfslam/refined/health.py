"""When the estimate of a run is not to be trusted: what the run itself can tell, without the truth.

*Carried off.* The mean score per beam says how well a scan fits the map. A robot that has been carried off, the
"kidnapped robot" of the literature, sees walls where its map has none. So the score falls at once, far below all
earlier scores of the run. These set the scale, because every LiDAR and every building has its own ordinary scores. The
fall does not last: a filter that draws every scan soon has the new place in its map, at the wrong spot, and its scores
look fine again.

*Dragged.* A robot that goes astray slowly keeps its scores, because its map goes astray with it. Two signs together
give it away. Scans move the estimate from where odometry had put it, again and again in the same direction. And part of
their beams end where the map has no wall. People who walk ahead, or glass, drag the estimate along like this. When
wheels slip the scans move the estimate, too, but then walls explain all beams.

``distrust`` gathers these signs, and three simpler ones: no beams, no wall that shows the way along, and a covariance
of the estimate that has become large.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import fields
from typing import TypedDict

import numpy as np

from pfslam.poses import between
from pfslam.refined.noise import MotionNoise
from pfslam.refined.record import RefinedStep

LEAST_PAST = 50
"""Scans that must have been drawn, while the robot moved, before any scan is judged."""
PAST = 400
"""How many of the last of them make up the ordinary scores."""
LOST_BELOW = -8.0
"""Score deviation below which a robot counts as lost.

Ordinary runs went down to -6.3, with people and moving doors among them. In 46 kidnaps of the course's robot the score
fell to -8.9 or lower. Where ordinary scores vary widely, as in a log of 180 beams and a scan every few metres, the fall
of a kidnap may be no larger: two of three raised no alarm there.
"""
BLIND_SECONDS = 2.0
"""Seconds for which odometry alone is good to some centimetres."""
LONGEST_PAUSE = 3600.0
"""Seconds without a reading after which a clock was set, or the robot was switched off and moved."""
SETTLING = 3
"""So many scans after a silence may fit badly: they take back what odometry has drifted.

The scans of a robot that was carried off fit badly for longer.
"""
ONE_ALARM = 5.0
"""Falls of the score that are less than so many seconds apart are one alarm."""
LEAST_SPREAD = 0.005
"""Least spread that scores are measured in: otherwise tiny changes would count in a run whose scores hardly differ."""


SCORES = ("score", "aligned_score")
SHAPES: dict[str, tuple[int, ...]] = {
    "estimate": (3,),
    "silent_direction": (2,),
    "departure": (2,),
    "covariance": (3, 3),
}
KINDS = {"int": int, "bool": bool}
COLUMNS = {
    f.name: np.dtype((KINDS.get(str(f.type), float), SHAPES.get(f.name, ())))
    for f in fields(RefinedStep)
    if f.name != "particles"
}
"""The columns of ``Steps``: all fields of a step but the cloud. Where there is no direction or covariance, NaN."""
OPTIONAL = ("silent_direction", "covariance")
Columns = Mapping[str, np.ndarray]


class Steps(Sequence[RefinedStep]):
    """The steps of a run without their clouds, as columns that grow, with what has been computed from them so far.

    >>> steps = Steps([RefinedStep(0.0, np.zeros(3), None, 1.0, 500, drawn=True)])
    >>> len(steps), steps[-1].beams, steps.columns["drawn"].tolist()
    (1, 500, [True])
    """

    def __init__(self, infos: Iterable[RefinedStep] = ()):
        infos = list(infos)
        self._rows = {name: _column(name, [getattr(info, name) for info in infos]) for name in COLUMNS}
        self._count, self._judged = len(infos), (dict[str, np.ndarray](), [_Past(), _Past()])
        self.judged()

    @classmethod
    def of_columns(cls, columns: Columns) -> Steps:
        """Make the steps that had these ``columns``."""
        steps = cls()
        steps._rows, steps._count = dict(columns), len(columns["t"])
        steps.judged()
        return steps

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, k):
        if isinstance(k, slice):
            return [self[i] for i in range(*k.indices(len(self)))]
        found = {name: column[k] for name, column in self.columns.items()}
        fields = {name: value.copy() if value.shape else value.item() for name, value in found.items()}
        return RefinedStep(particles=None, **fields | {n: None for n in OPTIONAL if np.isnan(found[n]).all()})

    def append(self, step: RefinedStep) -> None:
        """Add the next step, all columns or none."""
        k = self._count
        if k == len(self._rows["t"]):
            size = max(64, 2 * k)  # twice as many, so that a long drive is not copied ever again
            self._rows = {name: np.resize(rows, (size, *rows.shape[1:])) for name, rows in self._rows.items()}
        for name, column in self._rows.items():
            value = getattr(step, name)
            column[k] = np.nan if value is None else value
        self._count = k + 1

    def cut(self, count: int) -> None:
        """Keep the first ``count`` steps, of which the verdicts may have asked already, and none of the others."""
        self._count = count

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """What happened at each scan, ``(K, ...)`` by the names in ``COLUMNS``."""
        return {name: column[: self._count] for name, column in self._rows.items()}

    def judged(self) -> dict[str, np.ndarray]:
        """Return the columns, and what follows from each scan and those before it; only new scans are computed.

        ``deviation (K, 2)`` is that of both scores (see ``_Past.judge``), ``sigma (K,)`` the standard deviation (m)
        of the position along its worst direction, ``moved (K,)`` the length of the step (m, a radian as a metre), and
        ``since (K,)`` the first scan of the two seconds that end at each.
        """
        columns, (judged, pasts) = self.columns, self._judged
        done = len(judged["sigma"]) if judged else 0
        if done < self._count or not judged:
            new, pasts = {name: column[done:] for name, column in columns.items()}, deepcopy(pasts)
            before = columns["estimate"][np.maximum(np.arange(done, self._count) - 1, 0)]
            found = {
                "deviation": np.transpose(
                    [p.judge(new, name) for p, name in zip(pasts, SCORES, strict=True)]
                ),
                "sigma": _sigma(new["covariance"]),
                "moved": np.linalg.norm(between(before, new["estimate"]), axis=1),
                "since": np.searchsorted(columns["t"], new["t"] - WITHIN),
            }
            judged = {name: np.concatenate([judged.get(name, v[:0]), v]) for name, v in found.items()}
            self._judged = judged, pasts
        return columns | judged


def _column(name: str, values: list) -> np.ndarray:
    kind = COLUMNS[name]
    if name in OPTIONAL:
        values = [np.full(kind.shape, np.nan) if value is None else value for value in values]
    return np.array(values, kind.base).reshape(-1, *kind.shape)


class _Past:
    """The ordinary scores of a run so far: the last ones, in order of time and by size."""

    def __init__(self):
        self.scores: list[float] = []
        self.ordered: list[float] = []
        self.middle, self.spread = 0.0, 1.0

    def judge(self, columns: Columns, name: str) -> np.ndarray:
        """Return the deviations ``(K,)`` of the next scans' scores, and take in those that are ordinary.

        A deviation is how far a score lies from the median of those before it, in spreads; below 0 is worse. One spread
        is the distance from the median down to the 5th percentile, divided by 1.645. For normal scores that is one
        standard deviation. It is taken from the lower side, because scores end at 1 and have a long tail below.

        Only scans drawn into the map count as the past: a robot that stands and sees the same thing a thousand times
        must not make the spread small. Scans at which the robot was lost do not count. NaN where a scan was not
        matched, because a blind robot is not a lost one, and while there is too little past.
        """
        found = np.full(len(columns["t"]), np.nan)
        for k in np.flatnonzero(columns["matched"]):
            score = float(columns[name][k])
            if len(self.scores) >= LEAST_PAST:
                found[k] = (score - self.middle) / self.spread
            if columns["drawn"][k] and not found[k] < LOST_BELOW:
                self.scores.append(score)
                insort(self.ordered, score)
                if len(self.scores) > PAST:
                    self.ordered.remove(self.scores.pop(0))
                low, self.middle = self.ordered[len(self.scores) // 20], self.ordered[len(self.scores) // 2]
                self.spread = max((self.middle - low) / 1.645, LEAST_SPREAD)
        return found


def _sigma(covariances: np.ndarray) -> np.ndarray:
    """Return the standard deviation ``(K,)`` (m) of each position along its worst direction, 0 where it is not kept."""
    positions = np.where(np.isnan(covariances[:, :1, :1]), 0.0, covariances[:, :2, :2])
    return np.sqrt(np.linalg.eigvalsh(positions)[:, 1])


def _judged(infos: Sequence[RefinedStep] | Columns) -> Columns:
    """Return the columns of a run, which may be at hand already."""
    if isinstance(infos, Mapping):
        return infos
    return (infos if isinstance(infos, Steps) else Steps(infos)).judged()


def lost(infos: Sequence[RefinedStep] | Columns) -> np.ndarray:
    """Which scans ``(K,)`` bool fit the map so badly that the robot cannot be where the filter puts it.

    Both the particles and the estimate must fit badly. If an odometry stands still, the particles stay behind and fit
    badly, but the lines lead the estimate on, and nothing is lost.
    """
    run = _judged(infos)
    particles, estimate = run["deviation"].T < LOST_BELOW
    return particles & estimate & ~_settling(run["t"])


def _silence(t: np.ndarray) -> float:
    """Return from how many seconds on a time without scans is unusual for this recording."""
    usual = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    return max(BLIND_SECONDS, 5.0 * usual)


def _settling(t: np.ndarray) -> np.ndarray:
    """Which scans ``(K,)`` bool are the first after a silence."""
    pauses, found = np.diff(t, prepend=t[:1]), np.zeros(len(t) + SETTLING, dtype=bool)
    if (pauses > BLIND_SECONDS).any():  # no silence is shorter
        found[np.flatnonzero(pauses > _silence(t))[:, None] + np.arange(SETTLING)] = True
    return found[: len(t)]


def alarms(infos: Sequence[RefinedStep] | Columns) -> np.ndarray:
    """List the times ``(A,)`` (s) at which the robot was found to be lost; falls less than 5 s apart are one alarm."""
    run = _judged(infos)
    t = run["t"][lost(run)]
    return t[np.diff(t, prepend=-np.inf) > ONE_ALARM]


Distrust = TypedDict("Distrust", {"from": float, "to": float | None, "reason": str})
"""A stretch of a run that is not to be trusted, in the recording's clock (s); ``to`` is None where it never ended."""

WITHIN = 2.0
"""Seconds over which departures from odometry are added up. With three, more runs that were right were doubted."""
IMPROBABLE = 4.5
"""A departure of so many standard deviations is no chance: in two dimensions only one of 25,000 is as long.

With 4 the recordings of the studies got the same verdicts. With 5 and more, some that were off got no word.
"""
UNEXPLAINED = 0.02
"""Least share of beams that no wall explains; ordinary drives have less than 1 %."""
BACK_ON_WALLS = 0.1
"""If scans bring so much more of the beams onto old walls, they have taken back a slip.

The share is that at the estimate, less that at the pose to which odometry alone had led. Where wheels slipped among
people, nearly all right corrections raised it by as much. At 0.15 two runs that were right were doubted; at 0.07 two
that were off got no word.
"""
BELIEVED = "that could be believed"
"""What the reason says was missing if scans came, but their matches lay beyond the gate."""
ALONG_METRES = 10.0
"""Metres along a corridor whose walls do not show the way; over so many, wheels that are 2 % off are off by 0.2 m."""
ALONG_WITHIN = 20.0
"""Metres of driving within which the ``ALONG_METRES`` must lie, so that they belong to one corridor."""

UNSURE_METRES = 1.0
"""Standard deviation of the position (m) above which the run itself does not know where it is.

No run that was right to 5 cm had more than 0.7 m.
"""


def distrust(infos: Sequence[RefinedStep]) -> list[Distrust]:
    """List the stretches of a run whose estimate is not to be trusted, each with its reason, in order of time.

    Only a stretch without scans can end: when scans fit again, the estimate has found its place in the map. All other
    stretches last, because an error that is drawn into the map stays there.
    """
    run = _judged(infos)
    signs = _lost(run), _dragged(run), _blind(run), _along(run), _unsure(run)
    return sorted((stretch for sign in signs for stretch in sign), key=lambda d: d["from"])


def in_doubt(stretches: Sequence[Distrust], t: np.ndarray) -> np.ndarray:
    """Which of the times ``(K,)`` (s) lie in a stretch that is not to be trusted, ``(K,)`` bool."""
    doubted = np.zeros(len(t), dtype=bool)
    for stretch in stretches:
        doubted |= (t >= stretch["from"]) & (t <= (np.inf if stretch["to"] is None else stretch["to"]))
    return doubted


def was_dragged(infos: Sequence[RefinedStep]) -> bool:
    """Whether scans seem to have dragged the estimate from its odometry, as people and glass do.

    Only scans before the first alarm count. After a robot was carried off, scans contradict odometry and are right.
    """
    run = _judged(infos)
    before = run["t"] < min(alarms(run), default=np.inf)
    before_alarm = {name: column[before] for name, column in run.items()}
    return any(True for _ in _dragged(before_alarm))


def departures(infos: Sequence[RefinedStep] | Columns) -> tuple[np.ndarray, np.ndarray]:
    """Return how far ``(K,)`` (m) scans moved the estimate from its odometry within two seconds, and what is usual.

    The second array ``(K,)`` (m) is the standard deviation of each component in the run so far. It is computed as the
    geometric mean of all lengths up to there, which a few slips hardly change. It is at least that of the motion model,
    ``MotionNoise.xy``. The square of the ratio of the two is a normalised innovation (Bar-Shalom, Li and Kirubarajan,
    2001). For normal departures it is chi-square with two degrees of freedom, except for a factor of 1.12.
    """
    run = _judged(infos)
    t, departure = run["t"], run["departure"].T
    metres = np.hypot(*(_added_up(moved, run) for moved in np.where(_settling(t), 0.0, departure)))
    mean = np.cumsum(np.log(metres**2 + MotionNoise.xy**2)) / np.arange(1, len(metres) + 1)
    return metres, np.exp(mean / 2)


def _lost(run: Columns) -> Iterator[Distrust]:
    if len(when := alarms(run)):
        reason = "scans fit the map far worse than before: the robot is lost, or was moved by hand"
        yield {"from": float(when[0]), "to": None, "reason": reason}


def _dragged(run: Columns) -> Iterator[Distrust]:
    """Find the first time at which scans moved the estimate improbably far, while walls leave part of them unexplained.

    If scans moved the estimate so that more beams end on old walls, the wheels have slipped with somebody in view, and
    nothing is wrong.
    """
    t, (metres, sigma) = run["t"], departures(run)
    unexplained = _added_up(run["unexplained"], run) / np.maximum(_added_up(run["matched"], run), 1)
    strange = (unexplained > UNEXPLAINED) & (run["old_walls"] < BACK_ON_WALLS)
    found = (metres > IMPROBABLE * sigma) & strange
    if found.any():
        k = int(np.argmax(found))
        dragged = f"scans moved the estimate {metres[k]:.2f} m from its odometry"
        why = f"while {100 * unexplained[k]:.0f} % of the beams met what the map does not have"
        reason = f"{dragged} within {WITHIN:.0f} s, {why}"
        yield {"from": float(t[k]), "to": None, "reason": reason}


def _added_up(values: np.ndarray, run: Columns) -> np.ndarray:
    """Add up the values ``(K,)`` of the two seconds that end at each scan."""
    sums = np.append(0.0, np.cumsum(values))
    return sums[1:] - sums[run["since"]]


def farther_than_usual(poses: np.ndarray) -> np.ndarray:
    """Which of the steps ``(K - 1,)`` between poses ``(K, 3)`` are more than twice the median one.

    A radian counts as a metre. If a robot stood, or went no farther than usual, no scan is missing in between.
    """
    steps = np.linalg.norm(between(poses[:-1], poses[1:]), axis=1)
    return steps > 2.0 * np.median(steps) if len(steps) else steps > 0.0


def _blind(run: Columns) -> Iterator[Distrust]:
    """Find the times without a usable scan, from the last one that was matched to the next."""
    t, used = run["t"], run["matched"] | run["drawn"]
    seen = np.flatnonzero(used)
    # A stretch goes up to each scan that was used, and the last one to the end.
    since, until = np.append(t[:1], t[seen]), np.append(t[seen], t[-1:])
    if not (until - since > BLIND_SECONDS).any():
        return
    ends = np.append(seen, len(t))
    blind, rejected = np.diff(ends, prepend=-1) > 1, np.append(0, np.cumsum(run["rejected"] & ~used))
    why = np.where(np.diff(rejected[ends], prepend=0) > 0, BELIEVED, "with enough beams")
    silence, far = _silence(t), run["moved"] > 2.0 * np.median(run["moved"])  # as in farther_than_usual
    pause = np.where(far[seen], silence, max(silence, LONGEST_PAUSE))
    for k in np.flatnonzero(until - since > np.where(blind, BLIND_SECONDS, np.append(pause, np.inf))):
        to = float(until[k]) if k < len(seen) else None
        missing = why[k] if blind[k] else "was recorded"
        reason = f"no scan {missing} for {until[k] - since[k]:.1f} s: odometry alone"
        yield {"from": float(since[k]), "to": to, "reason": reason}


def _along(run: Columns) -> Iterator[Distrust]:
    """Find the first time at which most of the way was driven where no wall shows how far."""
    x, y = run["estimate"].T[:2]
    metres = np.hypot(np.diff(x, prepend=x[:1]), np.diff(y, prepend=y[:1]))
    driven, along = np.cumsum(metres), np.cumsum(metres * ~np.isnan(run["silent_direction"][:, 0]))
    if not len(along) or along[-1] <= ALONG_METRES:
        return
    since = np.searchsorted(driven, driven - ALONG_WITHIN)
    found = along - along[since] > ALONG_METRES
    if found.any():
        reason = f"{ALONG_METRES:.0f} m driven where no wall shows the way along: scans do not tell how far"
        yield {"from": float(run["t"][int(np.argmax(found))]), "to": None, "reason": reason}


def _unsure(run: Columns) -> Iterator[Distrust]:
    """Find the first time at which the covariance of the estimate leaves the position open."""
    sigma = run["sigma"]
    if (above := sigma > UNSURE_METRES).any():
        reason = f"the walls seen fix the position no better than to {sigma.max():.1f} m (standard deviation)"
        yield {"from": float(run["t"][int(np.argmax(above))]), "to": None, "reason": reason}
