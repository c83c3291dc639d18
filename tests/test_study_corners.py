"""Studies on other systems and in bad hours: no /proc, no Parquet, workers elsewhere, messages that were lost."""

import os
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from study_cases import box_study, write_box
from test_study import rows

from pfslam import DataError
from pfslam.study import Case, make_study, read_table, run_case, run_study
from pfslam.study import cost as cost_module
from pfslam.study.cost import Meter, peak_megabytes
from pfslam.study.provenance import machine, processor_features
from pfslam.study.runner import _row, run_path
from pfslam.study.workers import WORKER_DIED, _outcome, run_and_keep


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    return write_box(tmp_path_factory.mktemp("box"))


# ---- what a run costs ----------------------------------------------------------------------------


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux begins a peak anew")
def test_the_peak_counts_what_was_held_and_given_back():
    meter = Meter()
    before = meter.read()["peak_mb"]
    held = np.ones(25_000_000)  # 200 MB, every page of them touched
    del held
    assert meter.read()["peak_mb"] == pytest.approx(before + 200.0, abs=20.0)


@pytest.mark.parametrize(("system", "unit"), [("linux", 1024), ("darwin", 1)])
def test_where_there_is_no_proc_the_system_is_asked_in_its_own_unit(monkeypatch, tmp_path, system, unit):
    monkeypatch.setattr(cost_module, "STATUS", tmp_path / "nothing")
    resource = pytest.importorskip("resource")
    monkeypatch.setattr(resource, "getrusage", lambda who: SimpleNamespace(ru_maxrss=50_000_000))
    monkeypatch.setattr(sys, "platform", system)
    assert peak_megabytes() == pytest.approx(50.0 * unit)


def test_where_nobody_tells_the_peak_is_empty(monkeypatch, tmp_path):
    monkeypatch.setattr(cost_module, "STATUS", tmp_path / "nothing")
    monkeypatch.setitem(sys.modules, "resource", None)
    assert Meter().read()["peak_mb"] is None


def test_a_processor_that_is_not_described_has_a_name_all_the_same(monkeypatch):
    def refuse(path, **_):
        raise PermissionError(path)

    monkeypatch.setattr("pathlib.Path.read_text", refuse)
    assert machine()["processor"]
    assert processor_features() == ""


# ---- tables --------------------------------------------------------------------------------------


def test_without_parquet_the_table_is_written_all_the_same(box, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    path = run_study(box_study(box, seeds=1), tmp_path, jobs=1)
    assert len(rows(path)) == 4
    assert not path.with_suffix(".parquet").exists()


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "table: found nothing"),
        ("\n", "table: found nothing"),
        ("a,b\n1,2\n3\n", "line 3: found 1 cells"),
    ],
)
def test_a_table_that_is_none_is_named(tmp_path, text, complaint):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(DataError, match=complaint):
        read_table(tmp_path / "t.csv")


# ---- workers -------------------------------------------------------------------------------------


@pytest.mark.skipif(os.name != "posix", reason="parents the Unix way")
def test_a_worker_whose_owner_is_gone_does_nothing(box, tmp_path):
    """1 is the mother of orphans: neither the worker itself nor its parent."""
    code = (
        "import sys; from study_cases import box_study; from pfslam.study.workers import run_and_keep\n"
        f"run_and_keep(box_study({str(box)!r}).cases[0], {str(tmp_path / 'run.json')!r}, owner=int(sys.argv[1]))"
    )
    paths = os.pathsep.join([os.path.dirname(__file__), os.environ.get("PYTHONPATH", "")])
    for owner, code_of_exit, kept in ((1, 1, False), (os.getpid(), 0, True)):
        done = subprocess.run(
            [sys.executable, "-c", code, str(owner)], env=os.environ | {"PYTHONPATH": paths}, timeout=120
        )
        assert (done.returncode, (tmp_path / "run.json").exists()) == (code_of_exit, kept)


def test_a_result_that_cannot_be_kept_is_an_error_to_try_again(box, tmp_path):
    (tmp_path / "runs").write_text("a file where a folder should be")
    path, row = run_and_keep(box_study(box, seeds=1).cases[0], str(tmp_path / "runs" / "run.json"))
    assert path.endswith("run.json")
    assert row["again"]
    assert row["error"].startswith("DataError: ")


def test_memory_that_runs_out_is_an_error_to_try_again(box, tmp_path, monkeypatch):
    def figures(case):
        raise MemoryError("no room")

    monkeypatch.setattr("pfslam.study.run.figures", figures)
    _, row = run_and_keep(box_study(box, seeds=1).cases[0], str(tmp_path / "run.json"))
    assert row == {"error": "MemoryError: no room", "again": True}
    assert not (tmp_path / "run.json").exists()


def elsewhere(case, path, owner=None):
    """A worker on another machine: it has run the case, but its disk is not ours."""
    return path, {key: value for key, value in run_case(case).items() if key != "label"}


def test_results_of_workers_elsewhere_are_kept_here(box, tmp_path, monkeypatch):
    expected = rows(run_study(box_study(box, seeds=1), tmp_path / "here", jobs=1))
    monkeypatch.setattr("pfslam.study.workers.run_and_keep", elsewhere)
    study = box_study(box, seeds=1)
    assert rows(run_study(study, tmp_path / "there", jobs=1)) == expected
    assert all(run_path(tmp_path / "there", case).exists() for case in study.cases)


def told(status, result=None, exception=None):
    """A finished task of Dask as far as the runner asks it; what is an error is raised when asked for."""

    def answer():
        if isinstance(result, Exception):
            raise result
        return result

    return SimpleNamespace(status=status, result=answer, exception=lambda: exception)


class KilledWorker(Exception):
    """Of the name that Dask's has."""


def test_what_a_dask_task_came_to(tmp_path):
    path = str(tmp_path / "run.json")
    row = {"error": ""}
    assert _outcome(told("finished", (path, row)), path) == row
    assert _outcome(told("finished", OSError("the worker is gone")), path) is None  # so it is run again
    assert _outcome(told("lost"), path) is None
    again = {"again": True}
    assert _outcome(told("error", exception=KilledWorker()), path) == {"error": WORKER_DIED} | again
    assert _outcome(told("error", exception=KeyError("x")), path) == {"error": "KeyError: 'x'"} | again
    (tmp_path / "run.json").write_text('{"error": "", "ate_rmse_m": 0.5}')
    assert _outcome(told("lost"), path) == {"error": "", "ate_rmse_m": 0.5}  # its file is there


def test_a_result_that_vanished_is_named(tmp_path):
    case = make_study({"name": "x", "common": {"dataset": "hall"}}).cases[0]
    with pytest.raises(DataError, match="is the folder shared by all"):
        _row(case, str(tmp_path / "run.json"), {})


# ---- cases that no file has been through ---------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("particles", "many", "particles: found 'many', expected a whole number"),
        ("search.yaw_step", [1.0], "search.yaw_step: found [1.0], expected a number"),
        ("particles", 0, "particles: found 0"),
    ],
)
def test_a_case_made_by_hand_names_the_setting_that_does_not_fit(key, value, expected):
    with pytest.raises(DataError) as error:
        Case("mine", (("method", "refined"), (key, value))).config()
    assert expected in str(error.value)
    assert str(error.value).startswith("mine")
