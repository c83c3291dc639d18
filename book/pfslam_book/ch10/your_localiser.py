"""Chapter 10, the check of your localiser: robots are carried away, and any localiser is timed until it finds them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from pfslam.beyond.localization import locate
from pfslam.events import ScanEvent
from pfslam.grid import OccupancyGrid
from pfslam.recording import Recording
from pfslam.refined.events import LevelledScans
from pfslam.simulator import Simulation, simulate
from pfslam.simulator.cache import cached_simulation
from pfslam_book.ch10.building import kidnapped, part, true_map, two_halves
from pfslam_book.show.checks import Check, attempt, hint, in_full, is_unanswered, passed, unanswered

SEARCHES = ((0.0, 4.0), (4.0, 14.0), (14.0, 24.0))
"""From when to when (s) the robot is looked for: it wakes up anywhere, and is then carried away twice."""
MISSES = 1
"""So many searches may fail: chance plays a part, and one miss may be bad luck."""
NEAR = 1.0
"""A robot is found from the moment on at which most of the weight stays within this distance of it (m)."""
SHAPES = (
    "Return a list with (t, poses (n, 3), weights (n,)) for each scan that you use: the cloud after weighing."
)


class Case(NamedTuple):
    """A known map, a drive in it, and the drive's scans."""

    grid: OccupancyGrid
    recording: Recording
    events: Sequence[ScanEvent]


class Run(NamedTuple):
    """Of each step its time (s), the share of the weight near the robot, if any particle is near, and their number."""

    t: np.ndarray
    share: np.ndarray
    near: np.ndarray
    number: np.ndarray


def carried_away(simulation: Simulation) -> Case:
    """Cut a drive of 24 s in which the robot is carried away after 4 and after 14 s."""
    recording = part(simulation.recording, 15.0, 80.0)
    recording = part(kidnapped(kidnapped(recording, 4.0, 30.0), 14.0, 45.0), 0.0, SEARCHES[-1][1])
    return Case(true_map(simulation), recording, list(LevelledScans.of(recording).events()))


@cache
def buildings() -> dict[str, Case]:
    """The drives of the check: in the built-in building, and in another one of the same kind."""
    simulations = {"hall": cached_simulation("hall"), "another building": simulate("hall", seed=1)}
    return {name: carried_away(simulation) for name, simulation in simulations.items()}


@cache
def books_seconds(name: str) -> list[float]:
    """How long the book's localiser takes in each search of a building (s)."""
    case = buildings()[name]
    infos = [info for info in locate(case.grid, case.recording).infos if info.used and info.particles]
    return seconds(
        run_of([(i.t, i.particles.poses, i.particles.weights) for i in infos if i.particles], case)
    )


def run_of(steps: list[tuple], case: Case) -> Run:
    """What the truth says about the clouds of a localiser."""
    rows, truth, begin = [], case.recording.true_path(), case.events[0].t
    for t, poses, weights in steps:
        near = np.hypot(*(poses[:, :2] - truth.at(t)[:2]).T) <= NEAR
        rows.append((t - begin, weights[near].sum() / weights.sum(), near.any(), len(poses)))
    return Run(*np.array(rows, dtype=float).T)


def seconds(run: Run) -> list[float]:
    """After how many seconds each search ends for good; infinity if it does not."""
    found = []
    for begin, end in SEARCHES:
        during = np.flatnonzero((run.t >= begin) & (run.t < end))
        lost = during[run.share[during] <= 0.5]
        after = during[during > lost[-1]] if len(lost) else during
        found.append(float(run.t[after[0]] - begin) if len(after) else np.inf)
    return found


def as_steps(answer, case: Case) -> list[tuple] | Check:
    """The steps of a localiser as times, poses ``(n, 3)`` and weights ``(n,)``, or what is wrong with them."""
    steps = attempt(lambda: [(float(s[0]), *(np.asarray(a, dtype=float) for a in s[1:3])) for s in answer])
    if isinstance(steps, Check) or not steps or any(len(step) < 3 for step in steps):
        return hint(SHAPES)
    times, clouds, weights = zip(*steps, strict=True)
    if any(w.ndim != 1 or poses.shape != (len(w), 3) for poses, w in zip(clouds, weights, strict=True)):
        return hint(SHAPES)
    if not all(np.isfinite(numbers).all() for numbers in (*clouds, *weights)):
        return hint("Some poses or weights are not numbers. Was a sum of weights 0, by which you divided?")
    if not all(w.sum() > 0 for w in weights):
        return hint(
            "The weights of a cloud are all 0: a product of many likelihoods is too small for a number. Add their "
            "logarithms, and subtract the greatest before you take the exponential."
        )
    if times[0] < case.events[0].t or times[-1] > case.events[-1].t or np.min(np.diff(times), initial=1) <= 0:
        return hint("The times of your steps are not those of the scans, one after the other: take event.t.")
    return steps


REASONS = {
    "no scan": "You used no scan of that time.",
    "lost again": "There it had found the robot, and lost it again. Does each particle move by event.motion, in the "
    "direction that it faces, and with noise of its own?",
    "elsewhere": "There particles stood near the robot most of the time, but the weight was elsewhere. Are they "
    "weighed by the scan, and does each move by event.motion, in the direction that it faces?",
    "start": "There most of the time no particle was near the robot. Does the first cloud cover all free cells and all "
    "headings, with enough particles?",
    "carried away": "There most of the time no particle was near the robot. Resampling only copies particles, and "
    "none stood where the robot was put down. Where the scans fit worse than they did, draw some anew from the whole "
    "map.",
}
"""What the clouds of a search that failed seem to say, in words."""


def reason(run: Run, k: int) -> str:
    """The words for a search that failed, from what its clouds did."""
    during = (run.t >= SEARCHES[k][0]) & (run.t < SEARCHES[k][1])
    if not during.any():
        return REASONS["no scan"]
    found = np.cumsum(run.share[during] > 0.5) / np.arange(1, np.count_nonzero(during) + 1)
    if found.max() > 0.5:  # most of the time until then; a cloud may also cross the robot's way by chance
        return REASONS["lost again"]
    if run.near[during].mean() > 0.5:
        return REASONS["elsewhere"]
    return REASONS["carried away" if k else "start"]


def in_words(found: list[float]) -> str:
    """The seconds of all searches of a drive."""
    said = [f"{after:.1f} s" if np.isfinite(after) else "never" for after in found]
    return f"{', '.join(said[:-1])} and {said[-1]}"


def check_localiser(theirs: Callable) -> Check:
    """Whether ``localiser(grid, events, rng)`` finds a robot that wakes up anywhere and is carried away, four times."""
    place = two_halves()
    few = Case(place.grid, place.recording, list(LevelledScans.of(place.recording).events())[:8])
    answer = attempt(lambda: in_full(theirs(place.grid, few.events, np.random.default_rng(0))))
    if is_unanswered(answer):
        return unanswered()
    steps = answer if isinstance(answer, Check) else as_steps(answer, few)
    if isinstance(steps, Check):
        return steps
    score, reasons = [], []
    for name, case in buildings().items():
        answer = attempt(lambda case=case: in_full(theirs(case.grid, case.events, np.random.default_rng(0))))
        steps = answer if isinstance(answer, Check) else as_steps(answer, case)
        if isinstance(steps, Check):
            return steps
        run = run_of(steps, case)
        found, number = seconds(run), f"{run.number.mean():,.0f}"
        books = in_words(books_seconds(name))
        score.append(
            f"In {name} it finds it after {in_words(found)}, with {number} particles (the book's: {books})."
        )
        reasons += [reason(run, k) for k, after in enumerate(found) if not np.isfinite(after)]
    words = " ".join(["The robot wakes up, and is carried away twice.", *score, *reasons[:1]])
    return hint(words) if len(reasons) > MISSES else passed(words)
