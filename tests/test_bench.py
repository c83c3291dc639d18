"""The benchmark: what it compares is the same work, and what it writes is complete. Nothing here depends on speed."""

import json
import os
from types import SimpleNamespace

import pytest
from bench import command, sections
from bench.measure import THREADS, Row, Section
from box_recording import box_recording

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


def test_memory_is_that_of_the_run(monkeypatch):
    monkeypatch.setattr(
        sections, "MEMORY", sections.MEMORY.replace("main(sys.argv[1:])", "held = b'x' * 200_000_000")
    )
    (row,) = sections.memory(("--no-texture",)).rows
    assert row.what == "run hall --no-texture"
    assert row.value is None or 200 < row.value < 500


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


def test_laboratories_are_measured_by_the_books_tool_where_there_is_one(tmp_path):
    tool = tmp_path / "tool.py"
    assert "checkout" in command.laboratories(tool)
    tool.write_text("print('slide 12 ms')\n")
    assert command.laboratories(tool) == "laboratories, slide 12 ms"
    tool.write_text("raise SystemExit('no Chromium on this machine')\n")
    assert command.laboratories(tool) == "laboratories: not measured (no Chromium on this machine)"


@pytest.mark.parametrize("quick", [True, False])
def test_only_a_whole_benchmark_opens_a_browser(quick, monkeypatch, capsys):
    for name in THREADS:
        monkeypatch.setenv(name, "1")
    monkeypatch.setattr(command, "recordings_for", lambda data: {})
    monkeypatch.setattr(command, "measured", lambda *given: [])
    monkeypatch.setattr(command, "laboratories", lambda: "laboratories, here")
    command.bench(quick)
    assert ("laboratories, here" in capsys.readouterr().out) is not quick
