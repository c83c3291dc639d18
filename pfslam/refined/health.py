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
UNUSUAL = 5.0
"""A pause is a silence if it is so many times as long as the usual one."""
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
SIGNS: dict[str, np.dtype] = {
    **{"deviation": np.dtype((float, 2)), "sums": np.dtype((float, 4))},
    **dict.fromkeys(("shift", "usual_shift", "strange", "sigma"), np.dtype(float)),
    **dict.fromkeys(("pauses", "moved", "lengths", "driven", "along"), np.dtype(float)),
    **dict.fromkeys(("last_used", "last_silence"), np.dtype(int)),
    **dict.fromkeys(("lost", "dragged", "no_way", "unsure", "unseen"), np.dtype(bool)),
}
"""What is found of each scan from it and those before, never from later ones: so each is judged once."""
Columns = Mapping[str, np.ndarray]


class Steps(Sequence[RefinedStep]):
    """The steps of a run without their clouds, as columns that grow, with what has been computed from them so far.

    >>> steps = Steps([RefinedStep(0.0, np.zeros(3), None, 1.0, 500, drawn=True)])
    >>> len(steps), steps[-1].beams, steps.columns["drawn"].tolist()
    (1, 500, [True])
    """

    def __init__(self, infos: Iterable[RefinedStep] = ()):
        infos = list(infos)
        self._keep({name: _column(name, [getattr(info, name) for info in infos]) for name in COLUMNS})

    @classmethod
    def of_columns(cls, columns: Columns) -> Steps:
        """Make the steps that had these ``columns``."""
        steps = cls()
        steps._keep(columns)
        return steps

    def _keep(self, columns: Columns) -> None:
        self._count, self._judged, self._pasts = len(columns["t"]), 0, [_Past(), _Past()]
        self._rows = {**columns, **{name: np.zeros(self._count, kind) for name, kind in SIGNS.items()}}

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
        for name in COLUMNS:
            value = getattr(step, name)
            self._rows[name][k] = np.nan if value is None else value
        self._count = k + 1

    def cut(self, count: int) -> None:
        """Keep the first ``count`` steps, of which the verdicts may have asked already, and none of the others."""
        self._count = count

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """What happened at each scan, ``(K, ...)`` by the names in ``COLUMNS``."""
        return {name: self._rows[name][: self._count] for name in COLUMNS}

    def judged(self) -> dict[str, np.ndarray]:
        """Return the columns and the ``SIGNS``; only those of new scans are computed.

        ``deviation (K, 2)`` is that of both scores (see ``_Past.judge``), ``shift (K,)`` and ``usual_shift (K,)`` are
        what ``departures`` returns, and ``strange (K,)`` is the share of beams of two seconds that no wall explains.
        ``sigma (K,)`` is the largest standard deviation so far (m) of the position along its worst direction.
        ``last_used (K,)`` is the last scan up to each that was matched or drawn.
        """
        run = {name: rows[: self._count] for name, rows in self._rows.items()}
        if self._judged < self._count:
            pasts = deepcopy(self._pasts)  # after an interrupted question all is as it was
            _NewScans(run, self._judged).judge(pasts)
            self._judged, self._pasts = self._count, pasts
        return run


class _NewScans:
    """The scans of a run from ``done`` on, whose signs are to be found, and those before, whose signs are known."""

    def __init__(self, run: Columns, done: int):
        self.run, self.done, self.k = run, done, np.arange(done, len(run["t"]))
        self.new, self.last = {name: column[done:] for name, column in run.items()}, np.maximum(self.k - 1, 0)

    def judge(self, pasts: Sequence[_Past]) -> None:
        """Fill in the signs, at a cost that does not grow with the scans before.

        A robot is lost if a scan fits the map so badly that the robot cannot be where the filter puts it. Both the
        particles and the estimate must fit badly. If an odometry stands still, the particles stay behind and fit badly,
        but the lines lead the estimate on, and nothing is lost.
        """
        new, deviations = self.new, [p.judge(self.new, name) for p, name in zip(pasts, SCORES, strict=True)]
        new["deviation"][:] = np.transpose(deviations)
        silence, settling = self.silences()
        new["lost"][:] = (new["deviation"] < LOST_BELOW).all(axis=1) & ~settling
        self.find_drags(settling)
        steps = between(self.run["estimate"][self.last], new["estimate"])
        self.find_unseen(steps, silence)
        self.find_bare_corridors(steps)
        new["unsure"][:] = self.so_far("sigma", _sigma(new["covariance"]), np.maximum) > UNSURE_METRES

    def so_far(self, name: str, values: np.ndarray, joined: np.ufunc = np.add) -> np.ndarray:
        """Go on with a sum or maximum. One value goes in at a time: sums are the same however often it is asked."""
        known = self.run[name][max(self.done - 1, 0) : self.done]
        self.new[name][:] = joined.accumulate(np.concatenate([known, values]))[len(known) :]
        return self.new[name]

    def silences(self) -> tuple[np.ndarray, np.ndarray]:
        """Return from how many seconds on a pause is unusual, and which scans are the first after one that is.

        The usual pause is the geometric mean of all so far. A short pause counts as one that is no silence anywhere.
        """
        pause = self.new["t"] - self.run["t"][self.last]
        lengths = np.log(np.maximum(pause, BLIND_SECONDS / UNUSUAL)) * (self.k > 0)
        silence = UNUSUAL * np.exp(self.so_far("pauses", lengths) / np.maximum(self.k, 1))
        last = self.so_far("last_silence", np.where(pause > silence, self.k, -SETTLING), np.maximum)
        return silence, self.k - last < SETTLING

    def find_drags(self, settling: np.ndarray) -> None:
        """Find where scans moved the estimate improbably far, while walls leave part of them unexplained.

        If scans moved the estimate so that more beams end on old walls, the wheels have slipped with somebody in view,
        and nothing is wrong.
        """
        new, departure = self.new, np.where(settling[:, None], 0.0, self.new["departure"])
        sums = self.so_far("sums", np.column_stack([departure, new["unexplained"], new["matched"]]))
        since = np.searchsorted(self.run["t"], new["t"] - WITHIN)
        before = np.where(since[:, None] > 0, self.run["sums"][since - 1], 0.0)
        x, y, unexplained, matched = (sums - before).T
        new["shift"][:], new["strange"][:] = np.hypot(x, y), unexplained / np.maximum(matched, 1.0)
        mean = self.so_far("lengths", np.log(new["shift"] ** 2 + MotionNoise.xy**2)) / (self.k + 1)
        new["usual_shift"][:] = np.exp(mean / 2)
        strange = (new["strange"] > UNEXPLAINED) & (new["old_walls"] < BACK_ON_WALLS)
        new["dragged"][:] = strange & (new["shift"] > IMPROBABLE * new["usual_shift"])

    def find_unseen(self, steps: np.ndarray, silence: np.ndarray) -> None:
        """Find the scans with which a time without a usable one ends.

        If the robot went no farther than usual from one scan to the next, a silence between them has lost nothing. In
        this a radian counts as a metre.
        """
        new, moved = self.new, np.linalg.norm(steps, axis=1)
        far = moved > 2.0 * self.so_far("moved", moved) / np.maximum(self.k, 1)
        used = new["matched"] | new["drawn"]
        self.so_far("last_used", np.where(used, self.k, -1), np.maximum)
        before = self.run["last_used"][self.last]
        longest = np.where(far, silence, np.maximum(silence, LONGEST_PAUSE))
        longest[self.k - before > 1] = BLIND_SECONDS
        new["unseen"][:] = used & (new["t"] - self.run["t"][np.maximum(before, 0)] > longest)

    def find_bare_corridors(self, steps: np.ndarray) -> None:
        """Find where most of the way was driven where no wall shows how far."""
        metres, bare = np.hypot(*steps.T[:2]), ~np.isnan(self.new["silent_direction"][:, 0])
        driven, along = self.so_far("driven", metres), self.so_far("along", metres * bare)
        since = np.searchsorted(self.run["driven"], driven - ALONG_WITHIN)
        self.new["no_way"][:] = along - self.run["along"][since] > ALONG_METRES


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


def _judged(infos: Sequence[RefinedStep]) -> dict[str, np.ndarray]:
    return (infos if isinstance(infos, Steps) else Steps(infos)).judged()


def alarms(infos: Sequence[RefinedStep]) -> np.ndarray:
    """List the times ``(A,)`` (s) at which the robot was found to be lost; falls less than 5 s apart are one alarm."""
    run = _judged(infos)
    t = run["t"][run["lost"]]
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
ALONG_METRES = 10.0
"""Metres along a corridor whose walls do not show the way; over so many, wheels that are 2 % off are off by 0.2 m."""
ALONG_WITHIN = 20.0
"""Metres of driving within which the ``ALONG_METRES`` must lie, so that they belong to one corridor."""

UNSURE_METRES = 1.0
"""Standard deviation of the position (m) above which the run itself does not know where it is.

No run that was right to 5 cm had more than 0.7 m.
"""
LASTING = {
    "lost": "scans fit the map far worse than before: the robot is lost, or was moved by hand",
    "dragged": f"scans moved the estimate {{shift:.2f}} m from its odometry within {WITHIN:.0f} s, "
    "while {strange:.0f} % of the beams met what the map does not have",
    "no_way": f"{ALONG_METRES:.0f} m driven where no wall shows the way along: scans do not tell how far",
    "unsure": "the walls seen fix the position no better than to {sigma:.1f} m (standard deviation)",
}
"""The signs after which a run is in doubt to its end, and the reason that each gives."""


def distrust(infos: Sequence[RefinedStep]) -> list[Distrust]:
    """List the stretches of a run whose estimate is not to be trusted, each with its reason, in order of time.

    Only a stretch without scans can end: when scans fit again, the estimate has found its place in the map. All other
    stretches last, because an error that is drawn into the map stays there.
    """
    run = _judged(infos)
    return sorted([*_lasting(run), *_blind(run)], key=lambda d: d["from"])


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
    return bool((run["dragged"] & ~np.maximum.accumulate(run["lost"])).any())


def departures(infos: Sequence[RefinedStep]) -> tuple[np.ndarray, np.ndarray]:
    """Return how far ``(K,)`` (m) scans moved the estimate from its odometry within two seconds, and what is usual.

    The second array ``(K,)`` (m) is the standard deviation of each component in the run so far. It is computed as the
    geometric mean of all lengths up to there, which a few slips hardly change. It is at least that of the motion model,
    ``MotionNoise.xy``. The square of the ratio of the two is a normalised innovation (Bar-Shalom, Li and Kirubarajan,
    2001). For normal departures it is chi-square with two degrees of freedom, except for a factor of 1.12.
    """
    run = _judged(infos)
    return run["shift"], run["usual_shift"]


def _lasting(run: Columns) -> Iterator[Distrust]:
    """Find the first time of each sign that lasts."""
    for name, reason in LASTING.items():
        for k in np.flatnonzero(run[name])[:1]:
            told = reason.format(
                shift=run["shift"][k], strange=100 * run["strange"][k], sigma=run["sigma"][-1]
            )
            yield {"from": float(run["t"][k]), "to": None, "reason": told}


def _blind(run: Columns) -> Iterator[Distrust]:
    """Find the times without a usable scan, from the last one that was matched to the next."""
    t, last = run["t"], run["last_used"]
    ends = [*np.flatnonzero(run["unseen"])]
    if len(t) and t[-1] - t[max(last[-1], 0)] > BLIND_SECONDS:
        ends.append(len(t))  # still without one
    for k in ends:
        before = last[k - 1]
        missing = "was recorded" if k - before == 1 else "with enough beams"
        if run["rejected"][before + 1 : k].any():  # scans came, but their matches lay beyond the gate
            missing = "that could be believed"
        since, to = float(t[max(before, 0)]), float(t[k]) if k < len(t) else None
        seconds = (t[-1] if to is None else to) - since
        yield {"from": since, "to": to, "reason": f"no scan {missing} for {seconds:.1f} s: odometry alone"}
