"""JupyterLab as `make lab` starts it, on a copy of the chapters, in a headless Chromium."""

import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CHAPTERS = sorted(path.name for path in (ROOT / "notebooks").glob("*.ipynb"))


def pytest_generate_tests(metafunc):
    if "chapter" in metafunc.fixturenames:
        metafunc.parametrize("chapter", CHAPTERS)


@pytest.fixture(scope="session")
def lab(tmp_path_factory):
    """The address of a running JupyterLab whose folder holds a copy of the chapters."""
    folder = tmp_path_factory.mktemp("lab") / "notebooks"
    shutil.copytree(ROOT / "notebooks", folder, ignore=shutil.ignore_patterns(".ipynb_checkpoints"))
    command = [sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root", "--ServerApp.ip=127.0.0.1"]
    command += ["--ServerApp.port=0", "--IdentityProvider.token=", f"--ServerApp.root_dir={folder}"]
    command += ["--LabApp.expose_app_in_browser=True", f"--LabApp.default_url=/lab/tree/{CHAPTERS[0]}"]
    environment = {key: value for key, value in os.environ.items() if key != "PFSLAM_WIDGETS"}
    environment |= {"JUPYTER_CONFIG_DIR": str(folder.parent / "config"), "PYTHONPATH": str(ROOT)}
    environment |= {"JUPYTER_DATA_DIR": str(folder.parent / "data"), "OPENBLAS_NUM_THREADS": "1"}
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


def address_in(log: Path, server: subprocess.Popen) -> str:
    """The address that the server prints when it is ready."""
    for _ in range(600):
        found = re.search(r"http://127\.0\.0\.1:\d+/", log.read_text(encoding="utf-8"))
        if found:
            return found[0]
        assert server.poll() is None, log.read_text(encoding="utf-8")
        time.sleep(0.1)
    raise TimeoutError(log.read_text(encoding="utf-8"))
