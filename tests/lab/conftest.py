"""JupyterLab in a headless Chromium: as `make lab` starts it, and as a class may have it, without our extension."""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest
from copies import expressions, write_copies

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
CHAPTERS = [path.name for path in NOTEBOOKS]
SETTINGS = ROOT / "book" / "_tools" / "jupyterlab_overrides.json"  # what `make env` gives to JupyterLab
MYST = "jupyterlab-myst"


# Every change is looked at in a chapter with many numbers in its sentences, and in the one with the longest loop.
OFTEN = ("02", "05")


def pytest_generate_tests(metafunc):
    if "chapter" in metafunc.fixturenames:
        often = OFTEN if "lab" in metafunc.fixturenames else ()
        marks = {name: [] if name[:2] in often else [pytest.mark.nightly] for name in CHAPTERS}
        metafunc.parametrize("chapter", [pytest.param(name, marks=marks[name]) for name in CHAPTERS])


@pytest.fixture(scope="session")
def lab(tmp_path_factory):
    """The address of a running JupyterLab whose folder holds a copy of the chapters."""
    folder = tmp_path_factory.mktemp("lab") / "notebooks"
    shutil.copytree(ROOT / "notebooks", folder, ignore=shutil.ignore_patterns(".ipynb_checkpoints"))
    with running_lab(folder) as address:
        yield address


READERS_CELLS = (
    """from pfslam_book import ch05
calls = []
def update(weights, likelihood):
    calls.append("update")
    return weights * likelihood / (weights @ likelihood)
def resample(poses, weights, rng):
    calls.append("resample")
    return poses[rng.choice(len(poses), len(poses), p=weights)], weights * 0 + 1 / len(weights)
ch05.drive_lab(update, resample)""",
    """def forgotten(weights, likelihood):
    return weight * likelihood
ch05.drive_lab(forgotten)""",
)


@pytest.fixture
def readers_lab(tmp_path):
    """A JupyterLab with a notebook in which a reader's functions drive the laboratory of chapter 05."""
    write_notebook(tmp_path / "work" / "00_mine.ipynb", READERS_CELLS)
    with running_lab(tmp_path / "work") as address:
        yield address


# What the cells with laboratories take from the cells before them, without the minutes of chapter 06's filter.
BEFORE_THE_LABORATORIES = """import numpy as np, pfslam
from types import SimpleNamespace
from pfslam_book import ch01, ch02, ch03, ch04, ch05, ch06, ch10, ch12
hall = pfslam.load("hall")
corner, corridor = ch04.place_at(hall, 14.5), ch04.place_at(hall, 27.0)
shot = ch06.take_shot(ch06.load_drive("hall"))
result = SimpleNamespace(grid=corner.grid)"""


@pytest.fixture(scope="session")
def laboratories(tmp_path_factory):
    """A JupyterLab with a notebook of all the chapters' cells that show a laboratory, and how many there are."""
    folder = tmp_path_factory.mktemp("laboratories") / "work"
    cells = [cell for path in NOTEBOOKS for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    shown = [source for source in code if re.search(r"^ch\d\d\.\w+_lab\(", source, re.MULTILINE)]
    write_notebook(folder / "00_laboratories.ipynb", [BEFORE_THE_LABORATORIES, *shown])
    with running_lab(folder) as address:
        yield address, len(shown)


@pytest.fixture(scope="session")
def bare_lab(tmp_path_factory):
    """A JupyterLab that knows no MyST, on the students' copies; "0.25" stands for every number."""
    out = tmp_path_factory.mktemp("bare")
    numbers = [["0.25"] * len(expressions(json.loads(p.read_text(encoding="utf-8")))) for p in NOTEBOOKS]
    write_copies(out, NOTEBOOKS, numbers)
    with running_lab(out / "student", disabled=(MYST,)) as address:
        yield address


@contextmanager
def running_lab(folder: Path, disabled: tuple[str, ...] = ()) -> Iterator[str]:
    """A server of our own on the folder, with settings of its own."""
    command = [sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root", "--ServerApp.ip=127.0.0.1"]
    command += ["--ServerApp.port=0", "--IdentityProvider.token=", f"--ServerApp.root_dir={folder}"]
    command += ["--LabApp.expose_app_in_browser=True", f"--LabApp.default_url=/lab/tree/{CHAPTERS[0]}"]
    environment = {key: value for key, value in os.environ.items() if key != "PFSLAM_WIDGETS"}
    environment |= {"JUPYTER_CONFIG_DIR": str(folder.parent / "config"), "PYTHONPATH": str(ROOT)}
    environment |= {"JUPYTER_DATA_DIR": str(folder.parent / "data"), "OPENBLAS_NUM_THREADS": "1"}
    config = folder.parent / "config"
    write_json(
        config / "labconfig" / "page_config.json", {"disabledExtensions": dict.fromkeys(disabled, True)}
    )
    for plugin, settings in json.loads(SETTINGS.read_text(encoding="utf-8")).items():
        package, name = plugin.split(":")
        write_json(config / "lab" / "user-settings" / package / f"{name}.jupyterlab-settings", settings)
    with open(folder.parent / "server.log", "w", encoding="utf-8") as log:
        server = subprocess.Popen(command, cwd=folder, env=environment, stdout=log, stderr=log)
        try:
            yield address_in(folder.parent / "server.log", server)
        finally:
            server.terminate()
            try:
                server.wait(20)
            except subprocess.TimeoutExpired:  # it waits for a kernel that is still starting
                server.kill()


def write_notebook(path: Path, sources: Sequence[str]) -> None:
    """A notebook of code cells that nobody has run."""
    cell = {"cell_type": "code", "metadata": {}, "outputs": [], "execution_count": None}
    cells = [{**cell, "id": f"cell-{k}", "source": source} for k, source in enumerate(sources)]
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    write_json(path, {"cells": cells, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5})


def write_json(path: Path, content: dict) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content), encoding="utf-8")


def address_in(log: Path, server: subprocess.Popen) -> str:
    """The address that the server prints when it is ready."""
    for _ in range(600):
        found = re.search(r"http://127\.0\.0\.1:\d+/", log.read_text(encoding="utf-8"))
        if found:
            return found[0]
        assert server.poll() is None, log.read_text(encoding="utf-8")
        time.sleep(0.1)
    raise TimeoutError(log.read_text(encoding="utf-8"))
