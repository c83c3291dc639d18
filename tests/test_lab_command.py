"""``pfslam lab``: the chapters beside the reader's work, which is never written over."""

import sys
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import pytest

from pfslam.__main__ import main
from pfslam.cli import lab

CHAPTERS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))


@pytest.fixture
def opened(monkeypatch):
    """What would have been started."""
    calls = []

    class Server:
        """A JupyterLab that gets one Ctrl-C, asks whether to stop, and stops by itself."""

        interrupts = 1

        def __init__(self, command):
            calls.append(command)

        def wait(self):
            if self.interrupts:
                self.interrupts -= 1
                raise KeyboardInterrupt
            return 0

    monkeypatch.setattr(lab.subprocess, "Popen", Server)
    return calls


def test_all_chapters_are_copied_and_one_is_opened(tmp_path, opened, capsys):
    assert main(["lab", "5", "--folder", str(tmp_path / "mine")]) == 0
    assert [p.name for p in sorted((tmp_path / "mine").iterdir())] == [p.name for p in CHAPTERS]
    page = tmp_path / "mine" / "05_particle_filter_slam.ipynb"
    assert opened == [[sys.executable, "-m", "jupyterlab", str(page)]]
    assert page.read_bytes() == (CHAPTERS[0].parent / page.name).read_bytes()
    assert f"{len(CHAPTERS)} chapters copied" in capsys.readouterr().out


def test_the_readers_work_is_never_written_over(tmp_path, opened, capsys):
    (tmp_path / CHAPTERS[0].name).write_text("my answers")
    assert main(["lab", "--folder", str(tmp_path)]) == 0
    assert main(["lab", "00", "--folder", str(tmp_path)]) == 0
    assert (tmp_path / CHAPTERS[0].name).read_text() == "my answers"
    assert opened[0][-1] == str(tmp_path)
    assert f"0 chapters copied, {len(CHAPTERS)} were there" in capsys.readouterr().out


def test_copy_only_opens_nothing(tmp_path, opened):
    assert main(["lab", "--copy-only", "--folder", str(tmp_path)]) == 0
    assert opened == []


@pytest.mark.parametrize("number", ["99", "x", "", "-1", "005"])
def test_an_unknown_chapter_is_one_line(number, tmp_path, opened, capsys):
    assert main(["lab", "--folder", str(tmp_path / "mine"), "--", number]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "chapter" in said
    assert "00, 01, 02" in said
    assert not (tmp_path / "mine").exists()


def only_the_book(name):
    return find_spec(name) if name == "pfslam_book" else None


def test_the_exit_code_is_that_of_jupyterlab(tmp_path, monkeypatch):
    monkeypatch.setattr(lab.sys, "executable", str(tmp_path / "python"))
    (tmp_path / "python").write_text("#!/bin/sh\nexit 7\n")
    (tmp_path / "python").chmod(0o755)
    assert main(["lab", "00", "--folder", str(tmp_path / "mine")]) == 7


def test_without_jupyterlab_it_says_what_to_install(tmp_path, opened, monkeypatch, capsys):
    monkeypatch.setattr(lab.importlib.util, "find_spec", only_the_book)
    assert main(["lab", "00", "--folder", str(tmp_path)]) == 2
    assert "pip install" in capsys.readouterr().err
    assert opened == []


@pytest.mark.parametrize("found", [True, False])
def test_without_the_book_it_says_where_chapters_come_from(found, tmp_path, monkeypatch, capsys):
    book = SimpleNamespace(submodule_search_locations=[str(tmp_path / "a" / "pfslam_book")])
    monkeypatch.setattr(lab.importlib.util, "find_spec", lambda name: book if found else None)
    assert main(["lab", "00", "--folder", str(tmp_path / "mine")]) == 2
    said = capsys.readouterr().err
    assert ("notebooks in" if found else "package: found no pfslam_book") in said
