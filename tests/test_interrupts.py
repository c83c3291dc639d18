"""A Ctrl-C is answered once, whenever it comes."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pfslam.io.interrupts import ctrl_c_held_back, starting_workers

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")

INTERRUPTED_IMPORT = """
import signal, sys
class Last:
    def __del__(self):  # what is raised here, or in the callback of a weak reference, is printed and lost
        signal.raise_signal(signal.SIGINT)
class Finder:
    def find_spec(name, path, target=None):
        if name == {name!r}:
            Last()
sys.meta_path.insert(0, Finder)
from pfslam.__main__ import main
sys.exit(main({words!r}))
"""


def test_it_counts_when_the_block_has_ended():
    reached = []

    def work():
        with ctrl_c_held_back():
            signal.raise_signal(signal.SIGINT)
            reached.append("the end of the block")
        reached.append("what comes after it")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert reached == ["the end of the block"]


def test_blocks_may_stand_in_each_other():
    reached = []

    def work():
        with ctrl_c_held_back():
            with ctrl_c_held_back():
                signal.raise_signal(signal.SIGINT)
            reached.append("the end of the outer block")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert reached == ["the end of the outer block"]


def test_processes_that_start_in_the_block_never_take_it():
    show = [sys.executable, "-c", "import signal; print(signal.SIGINT in signal.pthread_sigmask(0, []))"]
    with starting_workers():
        inside = subprocess.check_output(show, text=True)
    assert (inside, subprocess.check_output(show, text=True)) == ("True\n", "False\n")


def test_where_the_system_cannot_hold_it_back_the_block_runs_all_the_same(monkeypatch):
    monkeypatch.delattr(signal, "pthread_sigmask")
    reached = []

    def work():
        with starting_workers():
            reached.append("the block")
            signal.raise_signal(signal.SIGINT)
            reached.append("what comes after it")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert reached == ["the block"]


@pytest.mark.parametrize("name", ["cv2", "numpy.random", "numpy.random.mtrand", "pfslam.study.runner"])
def test_none_is_lost_while_modules_are_imported(tmp_path, name):
    words = ["run", str(tmp_path / "no such.log"), "--out", str(tmp_path / "o")]
    code = INTERRUPTED_IMPORT.format(name=name, words=words)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "pfslam: interrupted\n")


def test_none_is_lost_while_a_study_imports_joblib(tmp_path):
    (tmp_path / "s.toml").write_text(
        'name = "s"\n[common]\ndataset = "no such.log"\n[[variant]]\nlabel = "a"\n'
    )
    words = ["study", str(tmp_path / "s.toml"), "--out", str(tmp_path / "o")]
    code = INTERRUPTED_IMPORT.format(name="joblib", words=words)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "pfslam: interrupted\n")
    assert not Path(tmp_path, "o").exists()
