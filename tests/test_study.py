"""Studies: what a file means, what a run gives, what is kept, who does the work, and what is said about bad files."""

import csv
import json
import math
import os
import random
import sys
from dataclasses import replace

import numpy as np
import pytest
from pfslam_book.show.tables import select
from study_cases import box_study, deadly_with_row, write_box

from pfslam import DataError, SlamConfig, load, run_slam, trajectory_error
from pfslam.__main__ import main
from pfslam.evaluation.cloud import cloud_consistency
from pfslam.particles import ControlNoise
from pfslam.settings import type_hints
from pfslam.study import Case, make_study, read_study, read_table, run_case, run_study
from pfslam.study.definition import Disturbances
from pfslam.study.disturbances import DISTURBANCES, disturb
from pfslam.study.run import COSTS


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    return write_box(tmp_path_factory.mktemp("box"))


def rows(path):
    """The rows of a table without their cost, which differs from run to run."""
    with open(path, newline="", encoding="utf-8") as file:
        return [{k: v for k, v in row.items() if k not in COSTS} for row in csv.DictReader(file)]


def study_of(common, *variants):
    """The study of some settings and variants."""
    return make_study({"name": "x", "common": common} | ({"variant": [*variants]} if variants else {}))


def test_lists_make_a_grid_and_variants_change_it():
    common = {"dataset": ["hall", "ramp"], "seed": {"count": 3, "from": 5}, "particles": 10}
    one = {"label": "a", "method": "report", "map": {"free": [0.1, 0.2]}}
    two = {"label": "b", "particles": [20, 30], "search.cells": [2, 4]}
    study = study_of(common, one, two)
    assert len(study.cases) == 2 * 3 * 2 + 2 * 3 * 2
    first, last = study.cases[0], study.cases[-1]
    settings = {"dataset": "hall", "method": "report", "seed": 5, "particles": 10, "map.free": 0.1}
    assert dict(first.settings) == settings
    assert (last.label, last.get("dataset"), last.get("seed"), last.get("particles")) == ("b", "ramp", 7, 30)
    assert last.get("search.cells") == (2, 4)  # a pair is one value, not a grid
    assert [c.get("map.free") for c in study.cases[:2]] == [0.1, 0.2]  # the last key changes fastest
    assert len({case.key for case in study.cases}) == 24
    pairs = study_of({"disturb.blind": [[20, 22], [20, 25]]}).cases
    assert [case.get("disturb.blind") for case in pairs] == [(20.0, 22.0), (20.0, 25.0)]
    with pytest.raises(DataError, match="mine: particles: found 'many', expected a whole number"):
        Case("mine", (("method", "refined"), ("particles", "many"))).config()


def test_what_a_file_may_do_to_a_recording_is_what_there_is():
    assert set(type_hints(Disturbances)) == set(DISTURBANCES)
    cases = study_of({"disturb.seconds": [False, 3]}).cases
    assert [case.parts()[Disturbances].seconds for case in cases] == [None, 3.0]


def test_settings_reach_the_configuration():
    def config(**settings):
        return study_of(settings).cases[0].config()

    assert config() == SlamConfig.refined()
    assert config(method="report") == SlamConfig.report()
    changed = config(method="report", **{"noise.sigma_omega": 0.2, "search.prior": True, "particles": 7})
    assert (changed.noise.sigma_omega, changed.search.prior, changed.particles) == (0.2, True, 7)
    assert config(lines=False).lines is None
    assert config(method="report", lines=True).lines == SlamConfig.refined().lines
    assert config(noise="ControlNoise", **{"noise.sigma_v": 1}).noise == ControlNoise(1.0, math.sqrt(0.02))
    assert config(tilt=False, every=3).every == 3


def test_a_row_says_what_the_same_run_by_hand_gives(box):
    settings = {"dataset": 90, "data_dir": str(box), "seed": 4, "particles": 20, "disturb.missing_beams": 0.2}
    study = study_of(settings)
    row = run_case(study.cases[0])
    recording = disturb(load(90, box), {"missing_beams": 0.2}, 4)
    config = replace(SlamConfig.refined(), particles=20)
    result = run_slam(recording, config, rng=np.random.default_rng(4))
    error = trajectory_error(result.trajectory, recording.truth)
    assert row["ate_rmse_m"] == error.ate_rmse_m
    assert row["heading_rmse_deg"] == error.heading_rmse_deg
    assert (row["scans"], row["updates"]) == (len(result.trajectory), result.updates)
    assert row["error"] == ""
    assert row["cpu_seconds"] > 0
    assert row["peak_mb"] is None or row["peak_mb"] > 20


def test_the_built_in_hall_has_its_map_compared():
    case = study_of({"disturb.seconds": 11, "particles": 20}).cases[0]
    row = run_case(case)
    assert row["error"] == ""
    assert 0 < row["ate_rmse_m"] < 0.02
    assert 0.1 < row["map_iou_occupied"] <= 1  # one second of motion shows few walls
    assert row["end_error_m"] <= row["ate_max_m"]


def test_clouds_are_compared_with_the_truth_where_a_study_asks_for_it(box):
    common = {
        "dataset": 90,
        "data_dir": str(box),
        "particles": 20,
        "clouds": [False, True],
        "method": "report",
    }
    without, row = map(run_case, study_of(common).cases)
    assert row["error"] == ""
    assert not {"nees_median", "inside_90", "cloud_claimed_m"} & set(without)
    recording, config = load(90, box), replace(SlamConfig.report(), particles=20)
    cloud = cloud_consistency(
        run_slam(recording, config, rng=np.random.default_rng(0)).infos, recording.truth
    )
    assert [row[f"inside_{share}"] for share in (50, 90, 99)] == list(cloud.inside.values())
    assert (row["cloud_claimed_m"], row["cloud_actual_m"]) == (cloud.claimed_m, cloud.actual_m)
    assert row["ate_rmse_m"] == without["ate_rmse_m"]  # the comparison changes nothing of the run


def test_intel_has_relations(real_data, monkeypatch):
    monkeypatch.setenv("PFSLAM_DATA", str(real_data))
    common = {"dataset": "intel/intel.log", "method": "dead-reckoning"}
    row = run_case(study_of(common).cases[0])
    assert row["error"] == ""
    assert row["scans"] == 910
    assert row["relation_xy_m"] > 0.1  # raw odometry is far off
    assert "ate_rmse_m" not in row


def test_another_building_is_not_the_built_in_one():
    small = {"simulator.path_length": 30.0, "simulator.robot.lidar.beams": 31}
    common = {"simulator.seed": [1, 2], "method": "dead-reckoning"} | small
    one, two = (run_case(case) for case in study_of(common).cases)
    assert one["error"] == two["error"] == ""
    assert one["ate_rmse_m"] != two["ate_rmse_m"]


def test_a_table_reads_back_to_the_last_bit(box, tmp_path):
    study = box_study(box, seeds=3)
    path = run_study(study, tmp_path, jobs=1)
    table = read_table(path)
    assert [c.label for c in study.cases] == list(table["label"])
    fresh = run_case(study.cases[0])
    assert table["ate_rmse_m"][0] == fresh["ate_rmse_m"]
    assert set(table["error"]) == {""}
    assert np.isnan(table["particles"][-1])
    some = select(table, label="matching", every=10)
    assert len(some["seed"]) == 3
    assert set(some["every"]) == {10.0}
    about = json.loads(path.with_suffix(".json").read_text())
    assert (about["runs"], about["failed"]) == (len(study.cases), 0)
    assert {"numpy", "opencv", "python", "pfslam"} <= set(about["versions"])


def test_failures_are_rows_and_the_others_go_on(box, tmp_path):
    study = study_of(
        {"data_dir": str(box), "method": "dead-reckoning"},
        {"label": "missing", "dataset": 77},
        {"label": "there", "dataset": 90},
        {"label": "too short", "dataset": 90, "disturb.seconds": 0.01},
    )
    missing, there, short = rows(run_study(study, tmp_path, jobs=1))
    assert "Encoders77" in missing["error"]
    assert "disturb.seconds" in short["error"]
    assert there["error"] == ""
    assert float(there["ate_rmse_m"]) < 0.1


def test_an_endless_setting_is_kept_and_read_back(box, tmp_path):
    common = {"dataset": 90, "data_dir": str(box), "particles": 2, "draw_metres": math.inf}
    study = study_of(common)
    table = read_table(run_study(study, tmp_path, jobs=1))
    assert table["error"][0] == ""
    assert table["draw_metres"][0] == math.inf


def test_what_failed_is_tried_again(tmp_path):
    study = study_of({"dataset": 90, "data_dir": str(tmp_path / "data"), "particles": 2})
    (failed,) = rows(run_study(study, tmp_path, jobs=1))
    assert "Encoders90" in failed["error"]
    write_box(tmp_path / "data")
    (done,) = rows(run_study(study, tmp_path, jobs=1))
    assert done["error"] == ""


def test_what_is_done_is_not_run_again(box, tmp_path):
    run_study(box_study(box, seeds=2), tmp_path, jobs=1)
    first = {p: p.read_bytes() for p in (tmp_path / "runs").rglob("*.json")}
    assert len(first) == 8
    table = run_study(box_study(box, seeds=3), tmp_path, jobs=1)
    assert {p: p.read_bytes() for p in first} == first  # the cost is in there: another run would differ
    assert len(rows(table)) == len(list((tmp_path / "runs").rglob("*.json"))) == 12


def test_a_damaged_result_is_made_anew(box, tmp_path):
    before = rows(run_study(box_study(box, seeds=1), tmp_path, jobs=1))
    damaged, *_ = (tmp_path / "runs").rglob("*.json")
    damaged.write_text('{"ate_rmse_m": 0.0')
    assert rows(run_study(box_study(box, seeds=1), tmp_path, jobs=1)) == before


def test_results_of_other_versions_are_not_taken(box, tmp_path, monkeypatch):
    run_study(box_study(box, seeds=1), tmp_path, jobs=1)
    number = len(list((tmp_path / "runs").rglob("*.json")))
    monkeypatch.setattr("pfslam.study.runner.version_key", lambda: "another")
    run_study(box_study(box, seeds=1), tmp_path, jobs=1)
    assert len(list((tmp_path / "runs").rglob("*.json"))) == 2 * number


def test_the_same_settings_under_two_labels_run_once(box, tmp_path):
    twice = make_study(
        {
            "name": "x",
            "common": {"dataset": 90, "data_dir": str(box), "method": "dead-reckoning"},
            "variant": [{"label": "a"}, {"label": "b"}],
        }
    )
    a, b = rows(run_study(twice, tmp_path, jobs=1))
    assert a.pop("label") != b.pop("label")
    assert a == b
    assert len(list((tmp_path / "runs").rglob("*.json"))) == 1


BAD = {
    'colour = "red"': "key: found 'colour'",
    'name = "a b"': "name: found 'a b'",
    "[common]\nparticle = 3": "key: found 'particle', expected a field of SlamConfig",
    "[common]\n'simulator.fog' = 3": "a field of SimulatorConfig",
    "[common]\n'disturb.fog' = 3": "key: found 'disturb.fog', expected a field of Disturbances: seconds",
    "[common]\nparticles = 2.5": "particles: found 2.5, expected a whole number",
    "[common]\nparticles = 1000000000": "particles: found 1000000000, expected a whole number from 1 to 100000",
    "[common]\n'search.yaws' = [[4, 30], [4, 2000000000]]": "search.yaws: found [4, 2000000000], expected a list of 2",
    "[common]\n'simulator.laps' = [1, 2000000000]": "simulator.laps: found 2000000000, expected a whole number",
    "[common]\nseed = []": "seed: found an empty list",
    "[common]\nseed = { count = 0 }": "seed: found",
    "[common]\nseed = { count = 99999999999 }": "a count from 1 to",
    "[common]\n'map.free' = { count = 3 }": "a count only for a key of whole numbers",
    "[common]\nsearch.field = ['distance', 'blur']": "search.field: found 'blur', expected one of occupied, distance",
    "[common]\n'disturb.missing_beams' = 1.5": "disturb.missing_beams: found 1.5, expected a number from 0 to 1",
    "[common]\n'disturb.blind' = 3": "disturb.blind: found 3, expected a list",
    '[common]\nmethod = "magic"': "method: found 'magic', expected one of report",
    "[common]\nmethod = 'report'\n'lines.rho' = 0.1": "lines.rho: found is off",
    "[common]\n'noise.sigma_v' = 0.1": "key: found 'noise.sigma_v', expected a field of MotionNoise",
    "[common]\ndataset = '7'\n'simulator.seed' = 1": "hall, ramp or ring",
    "[common]\nseed = { count = 5000 }\nparticles = [1, 2, 3]\n'map.free' = ["
    + "0.1, " * 99
    + "]": "at most 1000000",
    "[[variant]]\nparticles = 3": "variant 1: found no label",
    "[[variant]]\nlabel = 'a'\n[[variant]]\nlabel = 'a'": "variant 2: found 'a', expected a label of its own",
    "variant = [3]": "variant 1: found no label",
    "common = [": "a study in TOML",
    "tolerance = 'much'": "tolerance: found 'much'",
}


@pytest.mark.parametrize("text", BAD, ids=lambda text: text.replace("\n", " ")[:40])
def test_a_bad_file_is_one_clear_line(text, tmp_path, capsys):
    file = tmp_path / "bad.toml"
    file.write_text(text)
    with pytest.raises(DataError) as error:
        read_study(file)
    assert BAD[text] in str(error.value)
    assert main(["study", str(file), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_file_that_is_not_there(tmp_path, capsys):
    assert main(["study", str(tmp_path / "none.toml")]) == 2
    assert "none.toml" in capsys.readouterr().err


def test_without_joblib_it_says_what_to_install(box, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "joblib", None)
    with pytest.raises(DataError, match=r"pip install pfslam\[study\]"):
        run_study(box_study(box), tmp_path)


def test_the_command_writes_table_and_provenance(box, tmp_path, capsys):
    file = tmp_path / "little.toml"
    file.write_text(
        f"[common]\ndataset = 90\ndata_dir = '{box.as_posix()}'\nmethod = 'dead-reckoning'\nseed = {{count = 2}}\n"
        "'disturb.seconds' = [3, 0.01]\n"
    )
    assert main(["study", str(file), "--out", str(tmp_path / "out"), "--jobs", "1"]) == 0
    words = capsys.readouterr().out
    assert "2 of 4 runs failed" in words
    assert "little.csv" in words
    assert {"little.csv", "little.json"} <= {p.name for p in (tmp_path / "out").iterdir()}


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

SEEDS = 3


@pytest.fixture(scope="module")
def expected(box, tmp_path_factory):
    """The table of a run in this very process, one case after the other."""
    return rows(run_study(box_study(box, SEEDS), tmp_path_factory.mktemp("alone"), jobs=1))


@pytest.fixture(scope="module")
def client():
    """A Dask cluster of two worker processes on this machine, its web page on any free port."""
    distributed = pytest.importorskip("dask.distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", host="127.0.0.1"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def test_two_processes_in_any_order_give_the_table_of_one(box, expected, tmp_path):
    study = box_study(box, SEEDS)
    order = list(range(len(study.cases)))
    random.Random(5).shuffle(order)
    mixed = replace(study, cases=tuple(study.cases[i] for i in order))
    assert rows(run_study(mixed, tmp_path, jobs=2)) == [expected[i] for i in order]


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_table(box, expected, tmp_path, client):
    assert rows(run_study(box_study(box, SEEDS), tmp_path, client=client)) == expected


@pytest.mark.skipif(os.name != "posix", reason="kills processes the Unix way")
def test_a_worker_that_was_killed_is_one_line_and_the_study_goes_on_later(box, tmp_path, monkeypatch):
    study = box_study(box, 3)
    monkeypatch.setattr("pfslam.study.runner._with_row", deadly_with_row)
    with pytest.raises(DataError, match="worker: found a process that was killed, expected room"):
        run_study(study, tmp_path, jobs=2)
    monkeypatch.undo()
    done = {path: path.read_bytes() for path in (tmp_path / "runs").rglob("*.json")}
    assert not any(row["error"] for row in rows(run_study(study, tmp_path, jobs=1)))
    assert all(path.read_bytes() == content for path, content in done.items())
