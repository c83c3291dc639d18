"""Studies: what a file means, what a run gives, what is kept, who does the work, and what is said about bad files."""

import csv
import json
import math
import os
import random
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from types import FunctionType

import numpy as np
import pytest
from study_cases import box_study, deadly_with_row, square_root, write_box

from pfslam import DataError, SlamConfig, load, run_slam, trajectory_error
from pfslam.__main__ import main
from pfslam.evaluation.cloud import cloud_consistency
from pfslam.evaluation.trajectory import aligned_at_first
from pfslam.particles import ControlNoise
from pfslam.refined.matching import SearchConfig
from pfslam.settings import type_hints
from pfslam.study import Case, Study, make_study, read_table, run_case, run_study
from pfslam.study.definition import Disturbances
from pfslam.study.disturbances import DISTURBANCES, disturb
from pfslam.study.run import COSTS
from pfslam.study.sources import PACKAGE, digest_of_sources, modules_behind


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
    changed = config(method="report", **{"noise.sigma_omega": 0.2, "search": "SearchConfig", "particles": 7})
    assert (changed.noise.sigma_omega, changed.search, changed.particles) == (0.2, SearchConfig(), 7)
    assert config(lines=False).lines is None
    assert config(noise="ControlNoise", **{"noise.sigma_v": 1}).noise == ControlNoise(1.0, math.sqrt(0.02))


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
    poses, truth = aligned_at_first(result.trajectory, recording.truth)
    assert row["end_error_m"] == np.hypot(*(poses[-1] - truth[-1])[:2])
    assert (row["scans"], row["updates"]) == (len(result.trajectory), result.updates)
    assert row["error"] == ""
    assert row["cpu_seconds"] > 0


def test_the_built_in_hall_has_its_map_compared():
    case = study_of({"disturb.seconds": 11, "particles": 20}).cases[0]
    row = run_case(case)
    assert row["error"] == ""
    assert 0 < row["ate_rmse_m"] < 0.02
    assert 0.1 < row["map_iou_occupied"] <= 1  # one second of motion shows few walls
    assert row["end_error_m"] <= row["ate_max_m"]


def test_clouds_are_compared_with_the_truth_where_a_study_asks_for_it(box):
    common = {"dataset": 90, "data_dir": str(box), "particles": 20, "method": "report"}
    without, row = map(run_case, study_of(common | {"clouds": [False, True]}).cases)
    assert not {"nees_median", "inside_90", "cloud_claimed_m"} & set(without)
    recording, config = load(90, box), replace(SlamConfig.report(), particles=20)
    result = run_slam(recording, config, rng=np.random.default_rng(0))
    cloud = cloud_consistency(result.infos, recording.truth)
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


@pytest.mark.slow
def test_another_building_is_not_the_built_in_one():
    small = {"simulator.path_length": 30.0, "simulator.robot.lidar.beams": 31}
    common = {"simulator.seed": [1, 2], "method": "dead-reckoning"} | small
    one, two = (run_case(case) for case in study_of(common).cases)
    assert one["error"] == two["error"] == ""
    assert one["ate_rmse_m"] != two["ate_rmse_m"]


def files_in(folder):
    """What each finished run left: its cost is in there, so another run would differ."""
    return {path: path.read_bytes() for path in (folder / "runs").rglob("*.json")}


def test_a_table_reads_back_to_the_last_bit(box, tmp_path):
    endless = {"dataset": 90, "data_dir": str(box), "particles": 2, "draw_metres": math.inf}
    study = study_of(
        endless,
        {"label": "a", "search.prior": True},
        {"label": "b", "method": "dead-reckoning", "every": [5, 10]},
    )
    path = run_study(study, tmp_path, jobs=1)
    table, fresh = read_table(path), run_case(study.cases[0])
    assert [*table["label"]] == [c.label for c in study.cases] == ["a", "b", "b"]
    assert table["ate_rmse_m"][0] == fresh["ate_rmse_m"]
    assert [*table["draw_metres"]] == [math.inf] * 3
    assert np.isnan(table["every"][0])
    assert (table["search.prior"][0], np.isnan(table["search.prior"][1])) == (1.0, True)
    assert [*table["label"][table["every"] == 10]] == ["b"]
    assert set(table["error"]) == {""}
    about = json.loads(path.with_suffix(".json").read_text())
    assert (about["runs"], about["failed"]) == (3, 0)
    assert {"numpy", "opencv", "python", "pfslam"} <= set(about["versions"])


def test_failures_are_rows_that_are_tried_again_and_the_others_go_on(box, tmp_path, capsys):
    """The command says how many failed. A second time, only those are run again."""
    file, data = tmp_path / "little.toml", tmp_path / "data"
    text = f"[common]\ndata_dir = '{data.as_posix()}'\nmethod = 'dead-reckoning'\n"
    text += "[[variant]]\nlabel = 'missing'\ndataset = 91\n[[variant]]\nlabel = 'there'\ndataset = 90\n"
    text += "[[variant]]\nlabel = 'too short'\ndataset = 90\n'disturb.seconds' = 0.01\n"
    file.write_text(text)
    write_box(data)
    for failed in (2, 1):
        assert main(["study", str(file), "--out", str(tmp_path / "out"), "--jobs", "1"]) == 0
        said = capsys.readouterr().out
        assert f"{failed} of 3 runs failed" in said
        assert "little.csv" in said
        missing, there, short = rows(tmp_path / "out" / "little.csv")
        assert ("Encoders91" in missing["error"]) == (failed == 2)
        assert "disturb.seconds" in short["error"]
        assert there["error"] == ""
        assert float(there["ate_rmse_m"]) < 0.1
        for name in ("Encoders", "Imu", "Hokuyo"):
            (data / f"{name}91.npz").write_bytes((data / f"{name}90.npz").read_bytes())


@pytest.mark.slow
def test_what_is_done_is_not_run_again_unless_it_is_damaged_or_of_another_version(box, tmp_path, monkeypatch):
    run_study(box_study(box, seeds=2), tmp_path, jobs=1)
    first = files_in(tmp_path)
    assert len(first) == 8
    before = rows(run_study(box_study(box, seeds=3), tmp_path, jobs=1))
    assert files_in(tmp_path).items() > first.items()
    assert len(before) == len(files_in(tmp_path)) == 12
    damaged, *_ = first
    damaged.write_text('{"ate_rmse_m": 0.0')
    assert rows(run_study(box_study(box, seeds=3), tmp_path, jobs=1)) == before
    monkeypatch.setattr("pfslam.study.runner.version_key", lambda run: "another")
    assert rows(run_study(box_study(box, seeds=3), tmp_path, jobs=1)) == before
    assert len(files_in(tmp_path)) == 24


MEASURED = {
    "mine/__init__.py": "",
    "mine/measure.py": "from .parts import near\nimport helper\n\ndef run(case):\n    return {'a': 1}\n",
    "mine/parts.py": "def near():\n    import mine.deep\n",
    "mine/deep.py": "import json\n",
    "mine/apart.py": "",
    "helper.py": "import numpy\n",
    "stranger.py": "",
}
DIGEST = """
import importlib, sys
from pfslam.study import sources
run = importlib.import_module(sys.argv[1]).run if len(sys.argv) > 1 else None
print(sources.digest_of_sources(run))
"""


def digest(folder, *module):
    """The digest of the sources as a new process finds it, with a package of one's own and no git."""
    done = subprocess.run(
        [sys.executable, "-c", DIGEST, *module],
        env=os.environ | {"PYTHONPATH": str(folder), "PATH": ""},
        capture_output=True,
        text=True,
        check=True,
        cwd=folder,
    )
    return done.stdout


def test_an_edited_source_is_another_run_and_an_untouched_one_the_same(tmp_path):
    """In a copy of the package outside any repository, as an installed one is."""
    shutil.copytree(PACKAGE, tmp_path / "pfslam", ignore=shutil.ignore_patterns("__pycache__"))
    for name, text in MEASURED.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    before = digest(tmp_path), digest(tmp_path, "mine.measure")
    assert (digest(tmp_path), digest(tmp_path, "mine.measure")) == before
    lines, seen = tmp_path / "pfslam" / "refined" / "lines.py", {before[0]}
    for value in ("0.05001", "0.5"):
        text = re.sub(r"^RHO = .*", f"RHO = {value}", lines.read_text(encoding="utf-8"), flags=re.MULTILINE)
        lines.write_text(text, encoding="utf-8")
        seen.add(digest(tmp_path))
    assert len(seen) == 3
    base, filtered = digest(tmp_path, "mine.measure"), digest(tmp_path)
    assert base != before[1]
    for name, text in MEASURED.items():
        (tmp_path / name).write_text(text + "# edited\n")
        follows = name not in ("mine/apart.py", "stranger.py")
        assert (digest(tmp_path, "mine.measure") != base) == follows, name
        assert digest(tmp_path) == filtered
        (tmp_path / name).write_text(text)


def test_what_a_function_is_measured_with_is_found_without_libraries():
    found = modules_behind("study_cases")
    assert {"study_cases", "box_recording", "pfslam.study.runner"} <= set(found)
    assert {name.partition(".")[0] for name in found} == {"study_cases", "box_recording", "rooms", "pfslam"}


def test_a_function_that_is_in_no_file_is_refused():
    run = FunctionType(square_root.__code__, {"__name__": "nowhere"}, "run")
    with pytest.raises(DataError, match="run: found a function of nowhere, expected one in a file"):
        digest_of_sources(run)


def test_the_same_settings_under_two_labels_run_once(box, tmp_path):
    common = {"dataset": 90, "data_dir": str(box), "method": "dead-reckoning"}
    a, b = rows(run_study(study_of(common, {"label": "a"}, {"label": "b"}), tmp_path, jobs=1))
    assert a.pop("label") != b.pop("label")
    assert a == b
    assert len(files_in(tmp_path)) == 1


BAD = {
    'colour = "red"': "key: found 'colour'",
    'name = "a b"': "name: found 'a b'",
    "[common]\nparticle = 3": "key: found 'particle', expected a field of RefinedConfig",
    "[common]\n'simulator.fog' = 3": "a field of SimulatorConfig",
    "[common]\n'disturb.fog' = 3": "key: found 'disturb.fog', expected a field of Disturbances: seconds",
    "[common]\nparticles = 1000000000": "particles: found 1000000000, expected a whole number from 1 to 100000",
    "[common]\n'simulator.laps' = [1, 2000000000]": "simulator.laps: found 2000000000, expected a whole number",
    "[common]\nseed = []": "seed: found an empty list",
    "[common]\nseed = { count = 0 }": "seed: found",
    "[common]\nseed = { count = 99999999999 }": "a count from 1 to",
    "[common]\n'map.free' = { count = 3 }": "a count only for a key of whole numbers",
    "[common]\n'disturb.missing_beams' = 1.5": "disturb.missing_beams: found 1.5, expected a number from 0 to 1",
    "[common]\n'disturb.kidnap' = [nan, 1]": "disturb.kidnap: found [nan, 1], expected a list of 2",
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
    assert main(["study", str(file), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert BAD[text] in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_without_joblib_it_says_what_to_install(box, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "joblib", None)
    with pytest.raises(DataError, match=r"pip install joblib"):
        run_study(box_study(box, 1), tmp_path)


@pytest.mark.parametrize(
    ("text", "complaint"), [("", "table: found nothing"), ("a,b\n1,2\n3\n", "line 3: found 1 cells")]
)
def test_a_table_that_is_none_is_named(tmp_path, text, complaint):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(DataError, match=complaint):
        read_table(tmp_path / "t.csv")


# ---- workers -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def expected(box, tmp_path_factory):
    """The table of a run in this very process, one case after the other."""
    return rows(run_study(box_study(box, 3), tmp_path_factory.mktemp("alone"), jobs=1))


@pytest.mark.slow
def test_two_processes_in_any_order_give_the_table_of_one(box, expected, tmp_path):
    study = box_study(box, 3)
    order = random.Random(5).sample(range(len(study.cases)), len(study.cases))
    mixed = replace(study, cases=tuple(study.cases[i] for i in order))
    assert rows(run_study(mixed, tmp_path, jobs=2)) == [expected[i] for i in order]


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_table(box, expected, tmp_path):
    """Two worker processes on this machine, their web page on any free port."""
    distributed = pytest.importorskip("dask.distributed")
    where = {"dashboard_address": ":0", "host": "127.0.0.1"}
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, **where) as cluster,
        distributed.Client(cluster) as client,
    ):
        assert rows(run_study(box_study(box, 3), tmp_path, client=client)) == expected


def test_a_run_with_a_second_look_says_how_much_it_doubts(box):
    common = {"dataset": 90, "data_dir": str(box), "second_look": [False, True], "particles": 3}
    without, row = map(run_case, study_of(common).cases)
    assert not {"off", "doubted"} & without.keys()
    assert row["ate_rmse_m"] == without["ate_rmse_m"] < 0.05  # there is nothing to look at again
    assert (row["off"], row["doubted"], row["off_and_doubted"]) == (0.0, 0.0, 0.0)


def test_a_study_measures_what_its_function_measures(tmp_path):
    cases = tuple(Case("root", (("number", number),)) for number in (4, 9, -1))
    study = Study("roots", "", cases, run=square_root)
    for jobs in (1, 2):
        table = read_table(run_study(study, tmp_path / str(jobs), jobs=jobs))
        assert table["root"][:2].tolist() == [2.0, 3.0]
        assert "math domain error" in table["error"][2] or "nonnegative" in table["error"][2]
    assert json.loads((tmp_path / "1" / "roots.json").read_text())["command"] == "study_cases.square_root"


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="kills processes the Unix way")
def test_a_worker_that_was_killed_is_one_line_and_the_study_goes_on_later(
    box, expected, tmp_path, monkeypatch
):
    study = box_study(box, 3)
    monkeypatch.setattr("pfslam.study.runner._with_row", deadly_with_row)
    with pytest.raises(DataError, match="worker: found a process that was killed, expected room"):
        run_study(study, tmp_path, jobs=2)
    monkeypatch.undo()
    done = files_in(tmp_path)
    assert rows(run_study(study, tmp_path, jobs=1)) == expected
    assert files_in(tmp_path).items() >= done.items()
