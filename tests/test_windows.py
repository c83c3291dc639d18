"""What can be looked at without Windows: names of files, encodings, and modules that Python has not there."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from windows_names import refused

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ("pfslam", "book", "teachers", "tests")
FOLDERS = (*SOURCES, "notebooks", "binder", ".ci", ".github")
USER = "C:\\Users\\" + 20 * "u"  # a name of an account has twenty letters at most
NOT_THERE = ("fcntl", "grp", "pty", "pwd", "readline", "resource", "syslog", "termios", "tty")


def files() -> list[str]:
    """The files of the project."""
    found = [path for path in ROOT.iterdir() if path.is_file()]
    found += [path for name in FOLDERS for path in (ROOT / name).rglob("*") if path.is_file()]
    return [path.relative_to(ROOT).as_posix() for path in found if "__pycache__" not in path.parts]


@pytest.mark.parametrize(
    "name", ["con", "Nul.txt", "a/aux/b.py", "a:b", "what?.md", "end.", "end ", "x" * 260]
)
def test_names_that_windows_does_not_take_are_refused(name):
    assert refused([name, "console.py", "auxiliary/nulls.md"]) == [name]


def test_large_and_small_letters_make_no_other_file():
    assert refused(["a/Map.py", "a/map.py", "b/map.py"]) == ["a/Map.py", "a/map.py"]


def test_windows_takes_every_file_of_the_project():
    """In a clone among somebody's documents, and in an environment there, as the wheel's files are."""
    found = files()
    assert len(found) > 300
    assert refused(found, f"{USER}\\Documents\\pfslam\\") == []
    installed = [
        name.removeprefix("book/") for name in found if name.startswith(("pfslam/", "book/pfslam_book/"))
    ]
    assert refused(installed, f"{USER}\\Documents\\slam\\env\\Lib\\site-packages\\") == []
    assert not [name for name in found if (ROOT / name).is_symlink()]


def test_every_text_file_is_opened_with_its_encoding():
    """Without one Windows reads and writes in an alphabet of its own."""
    rule = (sys.executable, "-m", "ruff", "check", "--isolated", "--preview", "--select", "PLW1514")
    done = subprocess.run([*rule, *SOURCES], cwd=ROOT, capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_what_is_imported_needs_no_module_that_windows_has_not():
    """The package, the chapters and what grades, which then says in a sentence where it can run."""
    code = f"""
import os, signal, sys
for name in {NOT_THERE}:
    sys.modules[name] = None
del os.fork, os.geteuid, os.killpg, signal.SIGKILL, signal.pthread_sigmask
import importlib, pathlib
for path in sorted(pathlib.Path("book/pfslam_book").glob("ch[0-9]*")):
    importlib.import_module("pfslam_book." + path.stem)
import pfslam.__main__, grade
sys.exit(grade.main(["copies", "out"]))
"""
    paths = os.pathsep.join(str(ROOT / name) for name in (".", "book", "teachers"))
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        encoding="utf-8",
    )
    assert (done.returncode, done.stderr.strip()) == (
        2,
        "Grading needs Linux or macOS; on Windows run it in WSL.",
    )
