"""Grade what a class has handed in: `python teachers/grade.py FOLDER OUT`, or `make grade FOLDER=copies`.

FOLDER holds a notebook or a folder for each student, under any names. OUT gets a page for each student, `grades.csv`
and `index.html`, a page for the class. Students' code runs in processes of its own; `grading/cage.py` says what
protects you from it, and the page for the class says which of it was there.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import signal
import sys
import tempfile
import time
from contextlib import suppress
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "book"), str(ROOT / "book" / "_tools")]
for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ[variable] = "1"  # before NumPy is loaded: processes are forked, and each core has one
os.environ["PFSLAM_WIDGETS"] = "text"

from grading.cage import Cage, best_cage  # noqa: E402
from grading.copies_of import Copy, chapter_of, find  # noqa: E402
from grading.judge import CRASHED, RIGHT, UNREADABLE, Chapter, Grade  # noqa: E402
from grading.pages import write  # noqa: E402

STOPS = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
"""What ends the grading as Ctrl-C does: a `kill`, and a terminal that is closed."""


def grade_all(copies: list[Copy], chapter: Chapter, cage: Cage, scratch: Path, workers: int) -> None:
    """Grade the copies of a chapter, each by a judge of its own, so many at the same time."""
    context = multiprocessing.get_context("fork")  # the book is loaded once, and every judge has it
    most = sum(task.seconds for task in chapter.tasks) * 1.5 + 60.0
    waiting, running = list(copies), {}
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                copy = waiting.pop(0)
                place = Path(tempfile.mkdtemp(dir=scratch))
                place.chmod(0o711)
                judge = context.Process(target=judged, args=(copy, chapter, cage, place), daemon=True)
                judge.start()
                running[judge.sentinel] = judge, copy, place, time.monotonic() + most
            wait(list(running), timeout=1.0)
            for sentinel, (judge, copy, place, end) in list(running.items()):
                if judge.is_alive() and time.monotonic() < end:
                    continue
                stop(judge, place)
                copy.grades = result(place, chapter)
                print(f"{copy.student}: {copy.points} of {len(chapter.tasks)}", flush=True)
                del running[sentinel]
    finally:  # also if the grading is stopped
        for judge, _, place, _ in running.values():
            stop(judge, place)


def stop(judge: BaseProcess, place: Path) -> None:
    """End a judge that has not ended yet, and the copy that it cannot end itself any more."""
    if judge.is_alive():
        judge.kill()
        with suppress(OSError, ValueError):
            os.killpg(int((place / "leader").read_text()), signal.SIGKILL)
    judge.join()


def judged(copy: Copy, chapter: Chapter, cage: Cage, place: Path) -> None:
    """What the judge of one copy does, in a process of its own: the grades go into a file."""
    for number in STOPS:
        signal.signal(number, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the grading, which ends its judges
    os.chdir(place)
    grades = chapter.judge(copy.cells, cage, place)
    (place / "grades.json").write_text(json.dumps([vars(grade) for grade in grades]), encoding="utf-8")


def result(place: Path, chapter: Chapter) -> list[Grade]:
    """The grades that a judge has written; where it could not, the copy has crashed it."""
    try:
        return [Grade(**grade) for grade in json.loads((place / "grades.json").read_text(encoding="utf-8"))]
    except (OSError, ValueError):
        return [Grade(CRASHED, "The check could not be brought to an end on this copy.")] * len(chapter.tasks)


def main(arguments: list[str] | None = None) -> int:
    """Grade the copies in a folder."""
    parser = argparse.ArgumentParser(prog="python teachers/grade.py", description=main.__doc__)
    parser.add_argument("folder", type=Path, help="a notebook or a folder for each student")
    parser.add_argument("out", type=Path, help="where the pages and grades.csv go")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="copies at the same time")
    options = parser.parse_args(arguments)
    if not hasattr(os, "fork"):
        print("Grading needs Linux or macOS; on Windows run it in WSL.", file=sys.stderr)
        return 2
    if not options.folder.is_dir():
        print(f"{options.folder}: no such folder. Unpack what was handed in there.", file=sys.stderr)
        return 2
    copies, chapters = find(options.folder), {}
    with tempfile.TemporaryDirectory(prefix="pfslam-grade-") as folder:
        scratch = Path(folder)
        scratch.chmod(0o711)
        cage = best_cage(scratch)
        print(cage.words)
        for copy in copies:
            copy.chapter = copy.chapter or chapter_of(copy, ROOT / "notebooks")
        for name in sorted({copy.chapter for copy in copies if copy.chapter}):
            chapter = chapters[name] = Chapter(ROOT / "notebooks" / f"{name}.ipynb")
            if wrong := [g.words for g in chapter.measure(cage, scratch) if g.state != RIGHT]:
                print(f"{name}: the printed solutions do not pass here. {' '.join(wrong)}", file=sys.stderr)
                return 2
            grade_all([c for c in copies if c.chapter == name], chapter, cage, scratch, options.workers)
    write(options.out, copies, chapters, cage)
    unread = sum(copy.grades[0].state == UNREADABLE for copy in copies)
    print(f"{len(copies)} copies, {unread} of them unreadable: {(options.out / 'index.html').resolve()}")
    return 0


if __name__ == "__main__":
    for number in STOPS:
        signal.signal(number, lambda number, frame: sys.exit(128 + number))  # so that everything is put away
    sys.exit(main())
