"""All the runs of a study, on any number of processes or machines, each kept on disk when it is done.

The work goes through joblib: processes on this machine by default, a Dask cluster inside
``joblib.parallel_config("dask")``. A run is kept by the worker that made it, under a name that follows from its
settings and the version; what is there is never run again, so that a study that was stopped goes on where it was.
Only runs that failed are tried again.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from pfslam.errors import DataError
from pfslam.io.files import check_writable, write_text
from pfslam.study.definition import Case, Study, read_study
from pfslam.study.provenance import (
    code_fingerprint,
    cores,
    machine,
    processor_features,
    version_key,
    versions,
)
from pfslam.study.run import COSTS, recording_key
from pfslam.study.table import write_table
from pfslam.study.workers import Task, finish, import_joblib, read_run


def run_study(
    study: Study | str | Path, folder: str | Path, *, jobs: int = -1, progress: Callable | None = None
) -> Path:
    """Run what has not been run yet and write the table; gives its path, ``folder/NAME.csv``.

    ``jobs`` counts processes, -1 is one for each core. ``progress(iterable, total=n)`` may wrap the loop, as tqdm
    does. Finished runs lie in ``folder/runs``; what made the table is said in ``folder/NAME.json``.
    """
    joblib = import_joblib()
    study = study if isinstance(study, Study) else read_study(study)
    folder = Path(folder)
    check_writable(folder)
    tasks = [(case, str(run_path(folder, case))) for case in study.cases]
    todo = missing(tasks)
    results = finish(joblib, todo, jobs)
    failed = {
        path: row
        for path, row in (progress(results, total=len(todo)) if progress else results)
        if row.get("again")
    }
    table = [_row(case, path, failed) for case, path in tasks]
    write_table(folder / f"{study.name}.csv", table)
    write_text(folder / f"{study.name}.json", json.dumps(provenance(study, table), indent=2) + "\n")
    return folder / f"{study.name}.csv"


def run_path(folder: Path, case: Case) -> Path:
    """Where a run is kept; a folder for each two first digits, so that none holds too many."""
    return folder / "runs" / case.key[:2] / f"{case.key}-{version_key()}.json"


def missing(tasks: Iterable[Task]) -> list[Task]:
    """Tasks without a result, each once, those of one recording side by side."""
    found = {path: (case, path) for case, path in tasks if read_run(path) is None}
    return sorted(found.values(), key=lambda task: repr(recording_key(task[0])))


def _row(case: Case, path: str, failed: dict[str, dict]) -> dict[str, Any]:
    """A row of the table: the case as it is written, then what its run gave."""
    run = failed.get(path) or read_run(path)
    if run is None:
        raise DataError(
            path, "run", "nothing", "the result that was written there: is the folder shared by all?"
        )
    head = {"label": case.label} | dict(case.settings)
    return head | {key: value for key, value in run.items() if key not in head and key != "again"}


def provenance(study: Study, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """What made a table."""
    cpu = [row["cpu_seconds"] for row in rows if row.get("cpu_seconds") is not None]
    variants = dict.fromkeys(case.label for case in study.cases)
    return {
        "study": study.name,
        "about": study.about,
        "command": f"python -m pfslam study {study.name}.toml",
        "tolerance": study.tolerance,
        "runs": len(rows),
        "failed": sum(bool(row["error"]) for row in rows),
        "cpu_seconds": round(sum(cpu), 1),
        "never compared": list(COSTS),
        "variants": {label: _shared(study, label) for label in variants},
        "versions": versions(),
        "machine": machine() | {"features": processor_features(), "cores": cores()},
        "code": code_fingerprint(),
    }


def _shared(study: Study, label: str) -> dict[str, Any]:
    """The values that each setting takes in a variant."""
    values: dict[str, dict[str, Any]] = {}
    for case in study.cases:
        if case.label == label:
            for key, value in case.settings:
                values.setdefault(key, {})[json.dumps(value)] = value
    return {key: list(found.values()) for key, found in values.items()}
