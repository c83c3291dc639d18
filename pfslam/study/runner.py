"""All the runs of a study, on the processors of this machine or on a Dask cluster.

Each run is kept in a file when it is done, under a name that follows from its settings, sources and libraries. What is
there is not run again, so that a study that was stopped goes on where it was; only runs that failed are tried again.
"""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from pfslam.errors import DataError, need
from pfslam.io.files import check_writable, write_text
from pfslam.io.results import SUMS, check_sum, foreign
from pfslam.study.definition import Case, Study, read_study
from pfslam.study.provenance import machine, version_key, versions
from pfslam.study.run import recording_key, run_case
from pfslam.study.sources import digest_of_sources
from pfslam.study.table import write_table

Row = dict[str, Any]


def run_study(
    study: Study | str | Path, folder: str | Path, *, jobs: int = -1, client: Any = None, progress: Any = None
) -> Path:
    """Run what has not been run yet, write the table and return its path, ``folder/NAME.csv``.

    ``jobs`` counts processes on this machine, -1 for one on each core. ``client`` is a ``dask.distributed.Client``,
    whose cluster does the work instead. ``progress(iterable, total=n)`` may wrap the loop, as tqdm does. Finished runs
    lie in ``folder/runs``; ``folder/NAME.json`` says what made the table.
    """
    study = study if isinstance(study, Study) else read_study(study)
    folder = Path(folder)
    check_writable(folder)
    paths = [run_path(folder, study, case) for case in study.cases]
    rows: dict[Path, Any] = {path: kept(path) for path in paths}
    missing = {path: case for path, case in zip(paths, study.cases, strict=True) if rows[path] is None}
    # Runs on one recording side by side, because a worker keeps the recordings that it read last.
    todo = list(missing.values())
    if study.run is None:
        todo.sort(key=lambda case: repr(recording_key(case)))
    how = partial(_with_row, run=study.run)
    results = _on_this_machine(todo, how, jobs) if client is None else _on_a_cluster(todo, how, client)
    for case, row in progress(results, total=len(todo)) if progress else results:
        rows[path := run_path(folder, study, case)] = row
        if not row["error"]:
            write_text(path, json.dumps(row) + "\n")
    table = [rows[path] | {"label": case.label} for path, case in zip(paths, study.cases, strict=True)]
    settings = (key for case in study.cases for key, _ in case.settings)
    write_table(path := folder / f"{study.name}.csv", table, settings)
    about = provenance(study, table) | {SUMS: {path.name: check_sum(path)}}
    write_text(path.with_suffix(".json"), json.dumps(about, indent=2) + "\n")
    return path


def check_table(study: Study, folder: Path) -> None:
    """Raise ``DataError`` if a table of this name is in a folder and this program did not write it as it is."""
    path = folder / f"{study.name}.csv"
    if path.exists():
        with suppress(OSError, ValueError, LookupError, TypeError):
            if json.loads(path.with_suffix(".json").read_bytes())[SUMS][path.name] == check_sum(path):
                return
        raise foreign(path)


def run_path(folder: Path, study: Study, case: Case) -> Path:
    """Return the file that keeps a run, in a folder for each two first digits, so that none holds too many.

    Studies of filters share their runs; any other keeps its own apart.
    """
    runs = folder / ("runs" if study.run is None else f"runs_{study.name}")
    return runs / case.key[:2] / f"{case.key}-{version_key(study.run)}.json"


def kept(path: Path) -> Row | None:
    """Read a finished run; None if there is none, or if the file is damaged."""
    with suppress(OSError, ValueError):
        row = json.loads(path.read_bytes())
        return row if isinstance(row, dict) and "error" in row else None
    return None


def _on_this_machine(cases: list[Case], run: Callable, jobs: int) -> Iterator[tuple[Case, Row]]:
    """Yield cases with their rows from joblib's processes, in the order in which they finish."""
    need("joblib", "study")
    import joblib

    deaf = partial(signal.signal, signal.SIGINT, signal.SIG_IGN)
    pool = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered", initializer=deaf)
    try:
        yield from _workers_without_ctrl_c(lambda: pool(joblib.delayed(run)(case) for case in cases))
    except BrokenProcessPool:
        expected = "room for all of them: fewer --jobs, then the same command goes on where it stopped"
        raise DataError("pfslam study", "worker", "a process that was killed", expected) from None


def _workers_without_ctrl_c(start: Callable[[], Any]) -> Any:
    """Start workers with Ctrl-C blocked: a terminal sends it to every process, and the caller ends its workers.

    One that the caller gets meanwhile reaches it when all have started. Python's resource tracker, which the first
    worker would start, unblocks the signal (seen in 3.11 to 3.13), and is therefore started before.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows, where a worker ignores it once it runs
        return start()
    from multiprocessing import resource_tracker  # a browser's Python has none, and can read studies

    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        return start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _with_row(case: Case, run: Callable | None) -> tuple[Case, Row]:
    return case, run_case(case, run)


def _on_a_cluster(cases: list[Case], run: Callable, client: Any) -> Iterator[tuple[Case, Row]]:
    """Yield cases with their rows from a Dask cluster, whose scheduler gives a task that lost its worker to another."""
    from dask.distributed import as_completed

    futures = {client.submit(run, case, pure=False): case for case in cases}
    for future in as_completed(list(futures)):
        case, error = futures.pop(future), future.exception()
        lost = dict(case.settings) | {"error": f"{type(error).__name__}: {error}"}
        yield future.result() if error is None else (case, lost)


def provenance(study: Study, rows: list[Row]) -> dict[str, Any]:
    """Say what made a table: its study, the versions and the machine."""
    command = f"python -m pfslam study {study.name}.toml"
    return {
        "study": study.name,
        "about": study.about,
        "command": command if study.run is None else f"{study.run.__module__}.{study.run.__name__}",
        "tolerance": study.tolerance,
        "runs": len(rows),
        "failed": sum(bool(row["error"]) for row in rows),
        "cpu_seconds": round(sum(row.get("cpu_seconds") or 0.0 for row in rows), 1),
        "versions": versions() | {"sources": digest_of_sources(study.run)[:12]},
        "machine": machine(),
    }
