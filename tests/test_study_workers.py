"""The same study on any number of workers, and with workers and whole processes killed in between."""

import os
import random
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import joblib
import pytest
from study_cases import box_study, deadly, write_box
from test_study import rows

from pfslam.study import Study, run_study
from pfslam.study.runner import missing, run_path
from pfslam.study.workers import WORKER_DIED

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="kills processes the Unix way")
SEEDS = 20


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    return write_box(tmp_path_factory.mktemp("box"))


@pytest.fixture(scope="module")
def expected(box, tmp_path_factory):
    """The table of a run in this very process, one case after the other."""
    return rows(run_study(box_study(box, SEEDS), tmp_path_factory.mktemp("alone"), jobs=1))


@contextmanager
def dask_cluster(workers):
    """A Dask cluster of worker processes on this machine, its web page on any free port."""
    dask = pytest.importorskip("dask")
    distributed = pytest.importorskip("dask.distributed")
    with (
        # Or it takes a worker for lost that happens to start again 15 s after it was killed, for good.
        dask.config.set({"distributed.deploy.lost-worker-timeout": "1h"}),
        distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0", host="127.0.0.1"
        ) as cluster,
        distributed.Client(cluster),
    ):
        yield cluster


@pytest.fixture(scope="module")
def cluster():
    with dask_cluster(2) as cluster:
        yield cluster


@contextmanager
def kills(victims, folder, number):
    """While the block runs, kill one of ``victims()`` after every few finished runs, ``number`` times."""
    chance, stop, killed = random.Random(number), threading.Event(), []

    def hunt():
        mark = 0
        while not stop.is_set() and len(killed) < number:
            time.sleep(0.002 + 0.01 * chance.random())
            done, alive = finished(folder), victims()
            if done >= mark and alive:
                with suppress(ProcessLookupError):
                    os.kill(chance.choice(alive), signal.SIGKILL)
                    killed.append(done)
                    mark = done + chance.randint(1, 5)

    hunter = threading.Thread(target=hunt)
    hunter.start()
    try:
        yield killed
    finally:
        stop.set()
        hunter.join()


def finished(folder):
    return sum(1 for _ in Path(folder, "runs").rglob("[!.]*.json"))


def kept(folder):
    """What is on disk of finished runs: the cost is in it, so a run that is made again changes its file."""
    return {path.name: path.read_bytes() for path in Path(folder, "runs").rglob("[!.]*.json")}


def loky_workers():
    """Processes that joblib started for us."""
    executor = joblib.externals.loky.reusable_executor._executor
    return [] if executor is None else list(executor._processes or {})


def test_two_processes_give_the_table_of_one(box, expected, tmp_path):
    assert rows(run_study(box_study(box, SEEDS), tmp_path, jobs=2)) == expected


def test_the_order_of_the_runs_does_not_matter(box, expected, tmp_path):
    study = box_study(box, SEEDS)
    order = list(range(len(study.cases)))
    random.Random(5).shuffle(order)
    mixed = replace(study, cases=tuple(study.cases[i] for i in order))
    assert rows(run_study(mixed, tmp_path, jobs=2)) == [expected[i] for i in order]


def test_threads_give_the_same_table(box, expected, tmp_path):
    with joblib.parallel_config("threading"):
        assert rows(run_study(box_study(box, SEEDS), tmp_path, jobs=2)) == expected


def test_a_dask_cluster_gives_the_same_table(box, expected, tmp_path, cluster):
    with joblib.parallel_config("dask"):
        assert rows(run_study(box_study(box, SEEDS), tmp_path)) == expected


def test_workers_killed_eight_times(box, expected, tmp_path):
    with kills(loky_workers, tmp_path, 8) as killed:
        table = run_study(box_study(box, SEEDS), tmp_path, jobs=2)
    assert len(killed) == 8
    assert rows(table) == expected


def test_dask_workers_killed_four_times(box, expected, tmp_path, cluster):
    with (
        kills(lambda: [w.pid for w in cluster.workers.values() if w.pid], tmp_path, 4) as killed,
        joblib.parallel_config("dask"),
    ):
        table = run_study(box_study(box, SEEDS), tmp_path)
    assert len(killed) == 4
    assert rows(table) == expected


PROGRAM = """
import sys
from study_cases import box_study
from pfslam.study import run_study
run_study(box_study(sys.argv[1], int(sys.argv[2])), sys.argv[3], jobs=int(sys.argv[4]))
"""


def start(box, folder, jobs):
    paths = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-c", PROGRAM, str(box), str(SEEDS), str(folder), str(jobs)]
    return subprocess.Popen(command, env=os.environ | {"PYTHONPATH": paths}, stderr=subprocess.DEVNULL)


def test_the_whole_process_killed_eight_times(box, expected, tmp_path):
    chance, study = random.Random(8), box_study(box, SEEDS)
    total = len(missing([(case, str(run_path(tmp_path, case))) for case in study.cases]))
    for n in range(8):
        before = kept(tmp_path)
        process = start(box, tmp_path, jobs=1 + n % 2)
        wanted = len(before) + chance.randint(0, total // 10)
        while finished(tmp_path) < wanted and process.poll() is None:
            time.sleep(0.002)
        time.sleep(0.02 * chance.random())
        assert process.poll() is None, "it ended before it was killed"
        process.kill()
        process.wait()
        after = kept(tmp_path)
        assert before.items() <= after.items()  # nothing lost, nothing run twice
    assert len(kept(tmp_path)) < total
    before = kept(tmp_path)
    assert rows(run_study(study, tmp_path, jobs=2)) == expected
    assert before.items() <= kept(tmp_path).items()
    assert len(kept(tmp_path)) == total


@pytest.mark.parametrize("backend", ["loky", "dask"])
def test_a_run_that_kills_every_worker_is_one_row(backend, box, expected, tmp_path, monkeypatch, request):
    if backend == "dask":
        request.getfixturevalue("cluster")
    monkeypatch.setattr("pfslam.study.workers.run_and_keep", deadly)
    study = box_study(box, 3)
    with joblib.parallel_config(backend):
        found = rows(run_study(study, tmp_path, jobs=2))
    errors = {(row["label"], row["seed"]): row["error"] for row in found if row["error"]}
    assert list(errors) == [("odometry", "1")]
    assert "WorkerDied" in errors["odometry", "1"]
    monkeypatch.undo()  # the machine's fault is not kept: the next call runs what is missing
    assert not any(row["error"] for row in rows(run_study(study, tmp_path, jobs=1)))


def test_a_run_that_waited_behind_a_deadly_one_is_not_blamed_by_dask(box, tmp_path, monkeypatch):
    """The only worker takes the deadly run first, and each time it dies the next run is waiting on it."""
    monkeypatch.setattr("pfslam.study.workers.run_and_keep", deadly)
    cases = [case for case in box_study(box, 4).cases if case.label == "odometry" and case.get("seed") >= 1]
    with dask_cluster(1), joblib.parallel_config("dask"):
        found = rows(run_study(Study("waiting", "", tuple(cases)), tmp_path, jobs=1))
    assert [row["error"] for row in found] == [WORKER_DIED, "", ""]
