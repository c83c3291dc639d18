"""What a study costs besides its runs: measured by ``make study-costs`` for the page "Studies at scale".

Starting a worker, handing out a run, keeping it, taking a study up again.
"""

from __future__ import annotations

import csv
import io
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pfslam.io.files import write_text
from pfslam.study import Study, make_study, run_study
from pfslam.study.cost import peak_megabytes
from pfslam.study.runner import missing, run_path
from pfslam.teaching.show.tables import STUDIES, read_table

TABLE = Path("book/tables/studies.csv")
RUNS = 1000
START = """
import time, sys
from pfslam.study import make_study, run_case
row = run_case(make_study({"name": "x", "common": {"method": "dead-reckoning"}}).cases[0])
assert not row["error"], row["error"]
print(time.process_time())
"""


def small_study(runs: int = RUNS) -> Study:
    """So many runs of next to nothing: dead reckoning of the hall's first seconds, under different seeds."""
    common = {"method": "dead-reckoning", "disturb.seconds": 3.0, "seed": {"count": runs}}
    return make_study({"name": "small", "common": common})


def seconds_of(work: Callable[[], Any]) -> float:
    """Processor seconds that a piece of work takes in this process; what others do meanwhile does not count."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def start_of_worker() -> float:
    """Processor seconds until a fresh process has made its first run: imports and the recording."""
    done = subprocess.run([sys.executable, "-c", START], capture_output=True, text=True, check=True)
    return float(done.stdout)


def bytes_per_case(number: int = 20_000) -> float:
    """Memory that one more case takes in the process that hands them out."""
    tracemalloc.start()
    study = small_study(number)
    size, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return size / len(study.cases)


def through_dask(study: Study, folder: Path) -> float:
    """Processor seconds for scheduler and client of a Dask cluster whose two workers are processes of their own."""
    import joblib
    from dask.distributed import Client, LocalCluster

    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None, "host": "127.0.0.1"}
    with LocalCluster(**options) as cluster, Client(cluster), joblib.parallel_config("dask"):
        run_study(small_study(8), folder / "warm")
        return seconds_of(lambda: run_study(study, folder / "dask"))


def measure(folder: Path) -> dict[str, tuple[float, str]]:
    """Every figure with its unit."""
    study = small_study()
    run_study(small_study(8), folder / "warm", jobs=2)
    joblib_seconds = seconds_of(lambda: run_study(study, folder / "joblib", jobs=2))
    files = [run_path(folder / "joblib", case) for case in study.cases]
    tasks = list(zip(study.cases, map(str, files), strict=True))
    example = STUDIES / "example.csv"
    return {
        "start of a worker": (start_of_worker(), "s"),
        "handing out a run, joblib": (1e3 * joblib_seconds / RUNS, "ms"),
        "handing out a run, Dask": (1e3 * through_dask(study, folder) / RUNS, "ms"),
        "check whether a run is kept": (1e3 * seconds_of(lambda: missing(tasks)) / RUNS, "ms"),
        "a kept run": (sum(path.stat().st_size for path in files) / RUNS, "bytes"),
        "a row of the table": (example.stat().st_size / len(read_table("example")["label"]), "bytes"),
        "a case waiting": (bytes_per_case(), "bytes"),
        "memory of the process that hands out": (peak_megabytes() or float("nan"), "MB"),
    }


def main() -> None:
    """Measure and store."""
    with tempfile.TemporaryDirectory() as folder:
        figures = measure(Path(folder))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["what", "value", "unit"])
    writer.writerows([name, f"{value:.4g}", unit] for name, (value, unit) in figures.items())
    write_text(TABLE, text.getvalue())
    print(text.getvalue(), end="")


if __name__ == "__main__":
    main()
