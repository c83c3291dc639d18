"""The benchmark: what it compares is the same work, and what it writes is complete. Nothing here depends on speed."""

import json
import os
from types import SimpleNamespace

import numpy as np
import pytest
from box_recording import box_recording

from pfslam import DataError, SlamConfig
from pfslam.bench import command, measure, sections
from pfslam.bench.measure import THREADS, Row, Section

TINY = sections.Effort(1.0, 1, 20, 4, (5, 40))


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """The box is driven from its first scan on."""
    monkeypatch.setattr(sections, "STILL", 3)


@pytest.fixture(scope="module")
def box():
    return box_recording()


def values(section):
    return {row.what: row.value for row in section.rows}


def test_a_row_takes_the_median_and_the_range():
    row = Row.of("a", [3.0, 1.0, 2.0], "ms")
    assert (row.low, row.value, row.high) == (1.0, 2.0, 3.0)
    assert str(row).split() == ["a", "2", "ms", "(1", "to", "3)"]


def test_what_is_not_measured_is_said_in_the_table():
    text = str(Section("title", "how", [Row("slow", 12345.6, "x"), Row("absent", None, "")]))
    assert text.startswith("title\n  how\n")
    assert "12346 x" in text
    assert "not measured" in text


def test_rounds_are_interleaved_after_one_that_is_not_counted():
    calls = []
    jobs = {name: lambda name=name: calls.append(name) for name in "ab"}
    spent = measure.interleaved(jobs, 2)
    assert calls == list("ab" * 3)
    assert {name: s.shape for name, s in spent.items()} == {"a": (2,), "b": (2,)}


def test_a_run_ends_after_the_seconds_asked_for(box):
    assert sections._run_for(box, SlamConfig.matching(), 1.0) == pytest.approx(1.0, abs=0.2)
    whole = sections._run_for(box, SlamConfig.matching(), np.inf)
    assert whole == pytest.approx(box.lidar.t[-1] - box.lidar.t[0], abs=0.5)


def test_every_method_is_run(box):
    found = values(sections.runs("box", box, TINY))
    assert {what.split(",")[0] for what in found} == {"refined", "report", "matching", "per-particle"}
    assert all(value > 0 for value in found.values())


def test_scoring_compares_the_same_integers(box, monkeypatch):
    assert values(sections.scoring(box, TINY))["same integers in the sample"] == 1.0
    by_definition = sections._definition
    monkeypatch.setattr(sections, "_definition", lambda *a: [s + 1 for s in by_definition(*a)])
    assert values(sections.scoring(box, TINY))["same integers in the sample"] == 0.0


def test_the_parts_of_an_update_are_found_and_add_up(box):
    parts = sections.update_parts(box, 4)
    rest = parts.pop("the rest")
    assert list(parts) == list(sections.PARTS)
    assert all(spent > 0 for spent in parts.values())
    assert 0 <= rest < sum(parts.values())


def test_growth_has_a_row_for_each_number_of_particles(box):
    assert list(values(sections.growth(box, TINY))) == ["5 particles", "40 particles"]


def test_a_fresh_process_gives_its_last_line_or_its_complaint():
    assert measure.in_fresh_process("import os; print(1); print(os.environ['OMP_NUM_THREADS'])") == "1"
    with pytest.raises(DataError, match="ZeroDivisionError"):
        measure.in_fresh_process("1 / 0")


def test_memory_is_that_of_the_run(monkeypatch):
    monkeypatch.setattr(
        sections, "MEMORY", sections.MEMORY.replace("main(sys.argv[1:])", "held = b'x' * 200_000_000")
    )
    (row,) = sections.memory(("--no-texture",)).rows
    assert row.what == "run hall --no-texture"
    assert row.value is None or 200 < row.value < 500


def test_set_20_is_measured_where_it_lies(monkeypatch, tmp_path):
    monkeypatch.setattr(command, "load", lambda name, data=None: name)
    monkeypatch.setenv("PFSLAM_DATA", str(tmp_path))
    assert list(command.recordings_for(None)) == ["hall"]
    (tmp_path / "Encoders20.npz").touch()
    assert list(command.recordings_for(None)) == ["hall", "20"]
    assert list(command.recordings_for(tmp_path)) == ["hall", "20"]


def test_the_benchmark_starts_itself_again_with_one_thread(monkeypatch, tmp_path):
    started = []
    monkeypatch.setattr(
        command.subprocess, "run", lambda c, env: started.append((c, env)) or SimpleNamespace(returncode=3)
    )
    monkeypatch.delenv(THREADS[0], raising=False)
    with pytest.raises(SystemExit) as stopped:
        command.bench(True, tmp_path / "a.json", tmp_path)
    assert stopped.value.code == 3
    options, environment = started[0]
    asked = ["-m", "pfslam", "bench", "--quick", "--json", str(tmp_path / "a.json"), "--data", str(tmp_path)]
    assert options[1:] == asked
    assert all(environment[name] == "1" for name in THREADS)


def test_json_holds_the_machine_and_every_row(monkeypatch, tmp_path, capsys, box):
    for name in THREADS:
        monkeypatch.setenv(name, "1")
    monkeypatch.setattr(command, "QUICK", TINY)
    monkeypatch.setattr(command, "recordings_for", lambda data: {"box": box})
    monkeypatch.setattr(command, "memory", lambda kinds: Section("memory", "how", [Row("run", 1.0, "MB")]))
    command.bench(True, tmp_path / "deep" / "bench.json")
    written = json.loads((tmp_path / "deep" / "bench.json").read_text())
    assert set(written) == {"machine", "quick", "sections"}
    assert {"processor", "cores", "numpy", "opencv"} <= set(written["machine"])
    assert len(written["sections"]) == 5
    printed = capsys.readouterr().out
    assert all(row["what"] in printed for s in written["sections"] for row in s["rows"])
    assert os.listdir(tmp_path / "deep") == ["bench.json"]
