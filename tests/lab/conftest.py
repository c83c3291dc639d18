"""JupyterLab in a headless Chromium: as `make lab` starts it, and as a class may have it, without our extension."""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
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
    (tmp_path / "work").mkdir()
    cell = {"cell_type": "code", "metadata": {}, "outputs": [], "execution_count": None}
    cells = [{**cell, "id": f"cell-{k}", "source": source} for k, source in enumerate(READERS_CELLS)]
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    notebook = {"cells": cells, "metadata": kernel, "nbformat": 4, "nbformat_minor": 5}
    write_json(tmp_path / "work" / "00_mine.ipynb", notebook)
    with running_lab(tmp_path / "work") as address:
        yield address


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
