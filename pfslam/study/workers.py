"""Runs that are done by workers: processes of this machine through joblib, or a Dask cluster.

A worker keeps what it has finished on disk itself, so that nothing is lost when it, or the study, is killed.
"""

from __future__ import annotations

import itertools
import json
import os
import warnings
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType
from typing import Any

from pfslam.errors import DataError
from pfslam.io.files import write_text
from pfslam.study.definition import Case
from pfslam.study.run import run_case

Task = tuple[Case, str]
"""A case, and the path of the file that keeps its run."""
Result = tuple[str, dict[str, Any]]
"""That path, and the row that the run gave."""
AT_ONCE = 10_000
"""So many tasks are known to a Dask scheduler at a time."""
WORKER_DIED = "WorkerDied: the process was killed, perhaps for its memory"
FRUITLESS = 2
"""After so many deaths of workers without a single run finished in between, runs get a process each."""


def import_joblib() -> ModuleType:
    """The module, which belongs to an extra."""
    try:
        import joblib
    except ImportError as error:
        raise DataError("pfslam study", "package", error.name, "joblib: pip install pfslam[study]") from error
    return joblib


def run_and_keep(case: Case, path: str, owner: int | None = None) -> Result:
    """What a worker does: run a case unless its result is there, and put the result there.

    ``owner`` is the process that the worker works for: when that is gone, so is the worker, which would otherwise
    run on beside whoever takes the study up again.
    """
    if os.name == "posix" and owner not in (None, os.getpid(), os.getppid()):
        os._exit(1)
    kept = read_run(path)
    if kept is not None:
        return path, kept
    try:
        row = run_case(case)
        row = {key: None if value != value else value for key, value in row.items() if key != "label"}
        if row["error"]:
            return path, row | {"again": True}
        write_text(path, json.dumps(row) + "\n")
    except (MemoryError, OSError, DataError) as error:  # no room, in memory or on the disk
        return path, _again(f"{type(error).__name__}: {error}")
    return path, row


def _again(error: str) -> dict[str, Any]:
    """What stands for a run that failed: it is not kept, so that the next call tries it again."""
    return {"error": error, "again": True}


def read_run(path: str | Path) -> dict[str, Any] | None:
    """A kept run; None if there is none, or if the file is damaged."""
    with suppress(OSError, ValueError):
        row = json.loads(Path(path).read_bytes())
        return row if isinstance(row, dict) and "error" in row else None
    return None


def finish(joblib: ModuleType, todo: list[Task], jobs: int) -> Iterator[Result]:
    """Results in the order in which they come in."""
    client = getattr(joblib.parallel.get_active_backend()[0], "client", None)
    results = _through_dask(client, todo) if client is not None else _through_joblib(joblib, todo, jobs)
    for path, row in results:
        if not row.get("again") and read_run(path) is None:  # the worker keeps it elsewhere
            write_text(path, json.dumps(row) + "\n")
        yield path, row


def _through_joblib(joblib: ModuleType, todo: list[Task], jobs: int) -> Iterator[Result]:
    """Results from joblib's workers; those that die are replaced, and what they had not finished is run again."""
    fruitless = 0
    while todo and fruitless < FRUITLESS:
        done = set()
        work = joblib.delayed(run_and_keep)
        try:
            pool = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")
            results = pool(work(case, path, os.getpid()) for case, path in todo)
            with _closed(results):
                for path, row in results:
                    done.add(path)
                    yield path, row
            return
        except BrokenProcessPool:
            for _, path in todo:
                row = read_run(path) if path not in done else None
                if row is not None:  # finished, but its message went down with the pool
                    done.add(path)
                    yield path, row
        todo = [task for task in todo if task[1] not in done]
        fruitless = 0 if done else fruitless + 1
    for task in todo:
        yield _alone(joblib, task)


@contextmanager
def _closed(results: Generator) -> Iterator[None]:
    """Stop the workers when the block ends before they do, without joblib's warning that they were stopped."""
    try:
        yield
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            results.close()


def _alone(joblib: ModuleType, task: Task) -> Result:
    """One run in a process of its own, so that if it kills its worker again it is known which it was."""
    try:
        with joblib.parallel_config("loky"):
            results = joblib.Parallel(n_jobs=2, return_as="generator")([joblib.delayed(run_and_keep)(*task)])
        return next(results)
    except BrokenProcessPool:
        return task[1], _again(WORKER_DIED)


def _through_dask(client: Any, todo: list[Task]) -> Iterator[Result]:
    """Results from a Dask cluster. Its scheduler gives a task that lost its worker to another, three times.

    Then it gives it up, and with it what only waited its turn on the same workers. So each of those is run by itself.
    """
    given_up = []
    for task, row in _from_cluster(client, todo):
        if row["error"] == WORKER_DIED:
            given_up.append(task)
        else:
            yield task[1], row
    for task in given_up:
        for _, row in _from_cluster(client, [task]):
            yield task[1], row


def _from_cluster(client: Any, todo: list[Task]) -> Iterator[tuple[Task, dict[str, Any]]]:
    """Tasks with their rows, as they come in.

    joblib's own way to Dask waits for ever for a task that was given up, so tasks go to the client directly.
    """
    from dask.distributed import as_completed

    waiting, given, running = iter(todo), {}, as_completed()

    def submit(tasks: Iterable[Task]) -> None:
        for task in tasks:
            future = client.submit(run_and_keep, *task, pure=False)
            given[future.key] = task
            running.add(future)

    submit(itertools.islice(waiting, AT_ONCE))
    for future in running:
        task = given.pop(future.key)
        row = _outcome(future, task[1])
        if row is None:
            submit([task])
        else:
            yield task, row
            submit(itertools.islice(waiting, 1))


def _outcome(future: Any, path: str) -> dict[str, Any] | None:
    """What a finished task of Dask gave; None if its message was lost with a worker before it came here."""
    row = read_run(path)
    if row is not None:
        return row
    if future.status == "finished":
        with suppress(Exception):  # the worker may die while it is asked
            return future.result()[1]
    if future.status == "error":
        error = future.exception()
        died = type(error).__name__ == "KilledWorker"
        return _again(WORKER_DIED if died else f"{type(error).__name__}: {error}")
    return None
