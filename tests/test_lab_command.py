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
    assert main(["lab", "01", "--folder", str(tmp_path), "--copy-only"]) == 0
    assert (tmp_path / CHAPTERS[0].name).read_text() == "my answers"
    assert [command[-1] for command in opened] == [str(tmp_path), str(tmp_path / CHAPTERS[0].name)]
    assert f"0 chapters copied, {len(CHAPTERS)} were there" in capsys.readouterr().out


@pytest.mark.parametrize("number", ["99", "x", "", "-1", "005"])
def test_an_unknown_chapter_is_one_line(number, tmp_path, opened, capsys):
    assert main(["lab", "--folder", str(tmp_path / "mine"), "--", number]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "one of 00, 01, 02" in said
    assert not (tmp_path / "mine").exists()


def test_the_exit_code_is_that_of_jupyterlab(tmp_path, monkeypatch):
    monkeypatch.setattr(lab.sys, "executable", str(tmp_path / "python"))
    (tmp_path / "python").write_text("#!/bin/sh\nexit 7\n")
    (tmp_path / "python").chmod(0o755)
    assert main(["lab", "00", "--folder", str(tmp_path / "mine")]) == 7


BOOK = SimpleNamespace(submodule_search_locations=["/nowhere/a/pfslam_book"])
INSTALLED = {
    "no jupyterlab, expected the extra lab, or: pip install jupyterlab": find_spec("pfslam_book"),
    "found none, expected notebooks in /nowhere/a/pfslam_book/chapters": BOOK,
    "package: found no pfslam_book": None,
}


@pytest.mark.parametrize("words", INSTALLED)
def test_what_is_not_installed_is_named(words, tmp_path, opened, monkeypatch, capsys):
    found = {"pfslam_book": INSTALLED[words]}
    monkeypatch.setattr(lab.importlib.util, "find_spec", found.get)
    assert main(["lab", "00", "--folder", str(tmp_path)]) == 2
    assert words in capsys.readouterr().err
    assert opened == []
