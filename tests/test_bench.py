"""The benchmark: what it compares is the same work, what it writes is complete. Nothing here depends on speed."""

import json
import os
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from box_recording import box_recording

from pfslam import DataError, SlamConfig
from pfslam.bench import command, processes, scoring
from pfslam.bench.compiled import _score_poses
from pfslam.bench.floor import in_memory, texture
from pfslam.bench.growth import _on_larger_map, growth
from pfslam.bench.machine import THREADS, describe
from pfslam.bench.runs import run_for
from pfslam.bench.setting import Effort, Setting, drive
from pfslam.bench.tables import Row, Section, interleaved, number, slope
from pfslam.bench.update import profile
from pfslam.correlation import map_correlation
from pfslam.grid import GridSpec
from pfslam.poses import transform_points

TINY = Effort(1, 1, None, 20, 3, (5, 40), 2, 2)
ROW_KEYS = {"what", "value", "unit", "low", "high", "target", "best", "limit", "note", "met"}


@pytest.fixture(scope="module")
def setting():
    return Setting({"box": box_recording()}, TINY, describe())


def test_row_takes_median_and_range_and_judges_by_the_median():
    row = Row.of("a", [3.0, 1.0, 2.0], "ms", target=2.0, best="at most")
    assert (row.low, row.value, row.high, row.met) == (1.0, 2.0, 3.0, True)
    assert replace(row, target=1.9).met is False
    assert Row("b", 2.0, "x", target=2.1).met is False
    assert Row("b", 2.2, "x", target=2.1).met is True
    assert Row("c", None, "x", target=1.0).met is None
    assert Row("d", 1.0, "x").met is None


def test_what_is_missed_or_not_measured_is_said_in_the_table():
    text = str(Section(1, "title", [Row("slow", 1.0, "x", target=2.0), Row("absent", None, "")], "how"))
    assert "MISSED" in text
    assert "not measured" in text
    assert text.startswith("1. title\n  how\n")


def test_numbers_have_three_digits():
    assert [number(x) for x in (0.012345, 1.2345, 98.76, 12345.6, None)] == [
        "0.0123",
        "1.23",
        "98.8",
        "12346",
        "-",
    ]


def test_rounds_are_interleaved_after_one_that_is_not_counted():
    calls = []
    jobs = {name: lambda name=name: calls.append(name) for name in "ab"}
    spent = interleaved(jobs, 2)
    assert calls == list("ab" * 3)
    assert {name: s.shape for name, s in spent.items()} == {"a": (2,), "b": (2,)}
    calls.clear()
    interleaved(jobs, 1, warm_up=False)
    assert calls == list("ab")


def test_slope_is_the_exponent():
    x = np.array([1.0, 10.0, 300.0])
    assert slope(x, 7.0 * x**1.5) == pytest.approx(1.5)


def test_compiled_loop_scores_what_the_definition_scores():
    rng = np.random.default_rng(0)
    occupied, spec = rng.random((20, 30)) < 0.3, GridSpec((-0.77, -0.51), 0.05, (20, 30))
    points, poses = rng.uniform(-0.9, 0.9, (25, 2)), rng.normal(0.0, 0.3, (12, 3))
    scores = np.zeros(len(poses))
    _score_poses(occupied.astype(np.float32), np.array(spec.origin), 0.05, points, poses, scores)
    expected = [map_correlation(occupied, spec, transform_points(pose, points)) for pose in poses]
    np.testing.assert_array_equal(scores, expected)


def values(section):
    return {row.what: row.value for row in section.rows}


def test_scoring_compares_the_same_integers(setting):
    section = scoring.scoring(setting)
    assert values(section)["same integers in the sample"] == 1.0
    assert "145800 poses" in section.note


def test_scoring_would_see_a_wrong_integer(setting, monkeypatch):
    by_definition = scoring.definition
    monkeypatch.setattr(scoring, "definition", lambda *a: [s + 1 for s in by_definition(*a)])
    assert values(scoring.scoring(setting))["same integers in the sample"] == 0.0


def test_sample_is_drawn_from_the_perturbations_of_the_particles(setting):
    place = scoring.off_lattice(drive(setting.recording, SlamConfig.report(), 3)[0])
    poses, _ = scoring.sampled_poses(place, scoring.search_from(place), 50)
    cloud = place.state.particles.poses
    away = np.abs(poses[:, None] - cloud).min(axis=1)
    assert (away <= np.array([0.05, 0.05, 0.005]) * 4.5 + 1e-9).all()


def test_without_numba_its_rows_say_so(setting, monkeypatch):
    monkeypatch.setattr(scoring, "compiled_loop", lambda: None)
    monkeypatch.setattr(scoring, "CLOUDS", {"compact": (0.02, 0.003)})
    rows = scoring.clouds(setting).rows
    assert (rows[0].value, "not installed" in rows[0].note) == (None, True)
    assert [row.what.split()[0] for row in rows[-3:]] == [
        f"COST_PER_{n}" for n in ("HEADING", "PATCH", "NODE")
    ]


def test_compiled_rival_is_compared_on_the_same_integers(setting, monkeypatch):
    monkeypatch.setattr(scoring, "compiled_loop", lambda: _score_poses)  # uncompiled: the same arithmetic
    place = (
        scoring.off_lattice(drive(setting.recording, SlamConfig.report(), 3)[0]).with_crowd(1).with_stride(40)
    )
    row = scoring._against_compiled("wide", place, setting)[0]
    assert "same integers" in row.note
    assert (row.target, row.best) == (1.0, "at most")


def test_growth_has_a_slope_for_each_quantity(setting):
    found = values(growth(setting))
    for what in ("refined: particles", "report: particles", "beams", "resolution", "map size", "scans"):
        assert np.isfinite(found[f"{what}: slope"])
    assert "refined: 40 particles against 200" in found


def test_a_larger_map_gives_the_same_update(setting):
    place, _ = drive(setting.recording, SlamConfig.refined(), 3)
    larger = _on_larger_map(place, 3)
    assert larger.state.grid.log_odds.size > 8 * place.state.grid.log_odds.size
    np.testing.assert_allclose(larger.update().estimate, place.update().estimate, atol=1e-9)


def test_run_ends_after_the_seconds_asked_for():
    recording = box_recording(images=0)
    config = replace(SlamConfig.report(), particles=5, every=1)
    assert run_for(recording, config, 1.0) == pytest.approx(1.0)
    whole = run_for(recording, config, None)
    assert whole == pytest.approx(recording.lidar.t[-1] - recording.lidar.t[0], abs=0.4)


def test_images_are_read_once_and_then_held(setting):
    reads = []
    camera = box_recording().camera
    counted = replace(camera, read_rgb=lambda j: reads.append(j) or camera.read_rgb(j))
    held, _, count = in_memory(counted, 2)
    assert count == len(reads) == 2
    np.testing.assert_array_equal(held.read_rgb(reads[0]), camera.read_rgb(reads[0]))
    assert len(reads) == 2
    assert {"box: painted", "box: time to decode one pair of PNG files"} <= set(values(texture(setting)))


def test_profile_lists_the_parts_with_what_the_machine_would_need(setting):
    rows = profile(setting).rows
    assert [row.what for row in rows][-1] == "whole update"
    assert {"predict", "polish", "draw the scan"} <= {row.what for row in rows}
    assert all(row.limit >= 0 for row in rows[:-1])


def test_fresh_process_gives_its_last_line_or_its_complaint():
    assert (
        processes.in_fresh_process("import os; print(1); print(os.environ['OMP_NUM_THREADS'])", threads=2)
        == "2"
    )
    with pytest.raises(DataError, match="ZeroDivisionError"):
        processes.in_fresh_process("1 / 0")


def test_peak_memory_grows_with_what_a_process_holds():
    code = "from pfslam.bench.processes import peak_megabytes\n{}\nprint(peak_megabytes())"
    small = float(processes.in_fresh_process(code.format("")))
    large = float(processes.in_fresh_process(code.format("held = bytearray(200_000_000)")))
    assert 150 < large - small < 250


def test_fingerprint_is_that_of_the_run():
    recording = box_recording(images=0)
    assert processes.fingerprint(3, recording) == processes.fingerprint(3, recording)
    assert processes.fingerprint(3, recording) != processes.fingerprint(4, recording)


def test_set_20_is_measured_where_it_lies(monkeypatch, tmp_path):
    monkeypatch.setattr(command, "load", lambda name, data=None: name)
    monkeypatch.setenv("PFSLAM_DATA", str(tmp_path))
    assert list(command.recordings_for(None)) == ["hall"]
    (tmp_path / "Encoders20.npz").touch()
    assert list(command.recordings_for(None)) == ["hall", "20"]
    assert list(command.recordings_for(tmp_path)) == ["hall", "20"]


def test_benchmark_starts_itself_again_with_one_thread(monkeypatch, tmp_path):
    started = []
    monkeypatch.setattr(
        command.subprocess, "run", lambda c, env: started.append((c, env)) or SimpleNamespace(returncode=3)
    )
    monkeypatch.delenv(THREADS[0], raising=False)
    with pytest.raises(SystemExit) as stopped:
        command.bench(True, tmp_path / "a.json", tmp_path)
    assert stopped.value.code == 3
    options, environment = started[0]
    assert options[1:] == [
        "-m",
        "pfslam",
        "bench",
        "--quick",
        "--json",
        str(tmp_path / "a.json"),
        "--data",
        str(tmp_path),
    ]
    assert all(environment[name] == "1" for name in THREADS)


def test_json_holds_machine_and_every_row(monkeypatch, tmp_path, capsys):
    for name in THREADS:
        monkeypatch.setenv(name, "1")
    monkeypatch.setattr(command, "QUICK", TINY)
    monkeypatch.setattr(command, "recordings_for", lambda data: {"box": box_recording()})
    monkeypatch.setattr(command, "sections", lambda quick: [scoring.scoring, profile])
    command.bench(True, tmp_path / "deep" / "bench.json")
    written = json.loads((tmp_path / "deep" / "bench.json").read_text())
    assert set(written) == {"machine", "quick", "sections"}
    assert {"cpu", "cores", "blas", "threads", "noise", "load"} <= set(written["machine"])
    assert [s["number"] for s in written["sections"]] == [1, 8]
    assert all(set(row) == ROW_KEYS for s in written["sections"] for row in s["rows"])
    printed = capsys.readouterr().out
    assert all(row["what"] in printed for s in written["sections"] for row in s["rows"])
    assert os.listdir(tmp_path / "deep") == ["bench.json"]


@pytest.mark.parametrize("quick", [True, False])
def test_every_question_of_the_benchmark_is_asked(quick):
    assert len(command.sections(quick)) == 10
