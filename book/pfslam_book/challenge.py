"""Twenty buildings nobody has seen: a reader's filter in all of them beside three others, and a file for the class."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pfslam import Trajectory, __version__
from pfslam.errors import DataError
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.io.files import read_text, write_text
from pfslam.motion import dead_reckoning
from pfslam.recording import Recording
from pfslam.run import run_slam
from pfslam.simulator import Hazards, simulate
from pfslam.slam import SlamConfig
from pfslam.study.disturbances import first_seconds
from pfslam_book import your_filter
from pfslam_book.show.checks import Check, attempt, hint, passed
from pfslam_book.show.keep import source_of
from pfslam_book.show.tables import Shown
from pfslam_book.your_filter import BOOK, Filter, drive

SEEDS = tuple(range(901, 921))
"""The buildings. No chapter and no study uses them."""
SECONDS = 60.0
HAZARDS = Hazards(people=3, doors=2, slip=2)
"""People who cross the way, doors that open or close unseen, and moments at which the wheels slip."""
GOOD = 0.1
"""A building counts as mastered if the error stays below this (m, RMS)."""
SAME = 0.02
"""So far (m) may a second run be from the first: another processor rounds otherwise."""


def building(seed: int, seconds: float = SECONDS) -> Recording:
    """Simulate the first seconds of a drive: level floors for an odd seed, slopes for an even one."""
    simulation = simulate("hall" if seed % 2 else "ramp", seed=seed, hazards=HAZARDS)
    return first_seconds(simulation.recording, seconds)


def filters(step: Callable, mine: Filter) -> dict[str, Callable[[Recording], Trajectory]]:
    """The reader's filter and the three that it is compared with, each as a way from a recording to a path."""
    return {
        "yours": lambda recording: drive(step, mine, recording).trajectory,
        "the book's": lambda recording: drive(your_filter.step, Filter(**BOOK), recording).trajectory,
        "the report's": lambda recording: run_slam(recording, SlamConfig.report()).trajectory,
        "dead reckoning": dead_reckoning,
    }


def off(run: Callable[[Recording], Trajectory], recording: Recording) -> float | None:
    """The error of a filter on a drive (m, RMS); None where it stops with an error or loses its numbers."""
    found = attempt(lambda: trajectory_error(run(recording), recording.true_path()).ate_rmse_m)
    return round(found, 4) if isinstance(found, float) and np.isfinite(found) else None


def code_of(step: Callable, mine: Filter) -> str:
    """The source of a filter: the reader's parts with what they use, and the loop."""
    own = [part for name, part in sorted(vars(mine).items()) if part is not BOOK[name]]
    return "\n\n\n".join(source_of(function) for function in [*own, step]) + "\n"


def digest(code: str) -> str:
    """The fingerprint of a source: another one as soon as a letter is changed."""
    return hashlib.sha256(code.encode()).hexdigest()[:16]


def in_words(errors: Sequence[float | None]) -> list[str]:
    """How many buildings are mastered, the median and the largest error, as cells of a table."""
    values = np.array([np.inf if error is None else error for error in errors])
    numbers = [
        f"{number:.3f}" if np.isfinite(number) else "stopped" for number in (np.median(values), values.max())
    ]
    return [f"{np.count_nonzero(values < GOOD)} of {len(values)}", *numbers]


def challenge(
    step: Callable,
    mine: Filter,
    name: str = "",
    seeds: Sequence[int] = SEEDS,
    file: Path | str = "challenge.json",
    seconds: float = SECONDS,
) -> Shown:
    """Drive a filter through buildings that nobody has seen, beside three others, and write a file for the teacher.

    ``step`` is the loop and ``mine`` its parts. It takes some minutes, and prints a line for each building. The file
    holds the ``name``, the errors, the source of the filter and its fingerprint.
    """
    runs, code = filters(step, mine), code_of(step, mine)
    errors: dict[str, list[float | None]] = {who: [] for who in runs}
    for seed in seeds:
        recording = building(seed, seconds)
        for who, run in runs.items():
            errors[who].append(off(run, recording))
        told = ", ".join(
            f"{who} {'stopped' if e[-1] is None else f'{e[-1]:.3f} m'}" for who, e in errors.items()
        )
        print(f"building {seed}: {told}", flush=True)
    entry = {"name": name, "version": __version__, "seconds": seconds, "seeds": list(seeds), "errors": errors}
    write_text(file, json.dumps(entry | {"digest": digest(code), "code": code}, indent=1))
    print(f"Written: {file}")
    head = ["filter", f"below {GOOD:g} m", "median [m]", "worst [m]"]
    return Shown(head, [[who, *in_words(some)] for who, some in errors.items()])


def read_entry(path: Path) -> dict[str, Any]:
    """What a student has handed in, or ``DataError`` that names the file."""
    try:
        entry = json.loads(read_text(path))
        errors = [None if error is None else float(error) for error in entry["errors"]["yours"]]
        whole = len(errors) == len(entry["seeds"]) > 0 and digest(entry["code"]) and entry["digest"]
    except (ValueError, KeyError, TypeError, AttributeError):
        whole = False
    if not whole:
        raise DataError(path, "content", "something else", "a file that `challenge` has written")
    return entry | {"mine": errors}


def rank(folder: Path | str) -> Shown:
    """Rank the files of a class: by the buildings below 0.1 m, and then by the median error.

    The last column says whether the fingerprint belongs to the source in the file.
    """
    entries = [(path, read_entry(path)) for path in sorted(Path(folder).glob("**/*.json"))]

    def key(pair: tuple[Path, dict[str, Any]]) -> tuple[float, float]:
        values = np.array([np.inf if error is None else error for error in pair[1]["mine"]])
        return -float(np.mean(values < GOOD)), float(np.median(values))

    rows = []
    for place, (path, entry) in enumerate(sorted(entries, key=key), start=1):
        own = "its own" if digest(entry["code"]) == entry["digest"] else "ANOTHER"
        rows.append([f"{place}", entry["name"] or path.stem, *in_words(entry["mine"]), own])
    return Shown(
        ["rank", "name", f"below {GOOD:g} m", "median [m]", "worst [m]", "source"], rows, left=[1, 5]
    )


def made_by(file: Path | str, step: Callable, mine: Filter, number: int = 0) -> Check:
    """Whether a filter made a file: its source has the fingerprint, and one building again gives the same error."""
    entry = read_entry(Path(file))
    if digest(code_of(step, mine)) != entry["digest"]:
        return hint(f"{Path(file).name} was made by another source.")
    seed, told = entry["seeds"][number], entry["mine"][number]
    again = off(filters(step, mine)["yours"], building(seed, entry["seconds"]))
    words = f"In building {seed} the file says {told} m, and the filter now {again} m."
    same = told == again or (told is not None and again is not None and abs(told - again) <= SAME)
    return passed(words) if same else hint(words)
