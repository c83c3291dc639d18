"""The chapters in JupyterLite, an experiment: what lies beside them, and the site that `make lite` has built.

Python comes to the reader over the network, so no test runs a cell there. Without the site its tests are skipped.
"""

import ast
import functools
import hashlib
import http.server
import importlib.metadata
import json
import os
import re
import subprocess
import sys
import threading
import tomllib
from pathlib import Path

import pytest
from copies import ROOT, WHEEL, source, write_notebook
from lite import INSTALL, WHEELS, locked, write_sources
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from pfslam.errors import DataError

SITE = ROOT / "_build" / "lite"
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")
# Pyodide 314.0.6, which the locked JupyterLite loads, is a Python 3.14 with these packages and many more.
PYODIDE = {
    "ipython": "9.12.0",
    "matplotlib": "3.10.8",
    "numpy": "2.4.6",
    "opencv-python": "4.11.0.86",
    "platformdirs": "4.9.4",
    "pyyaml": "6.0.3",
    "scipy": "1.18.0",
    "tqdm": "4.67.3",
    "traitlets": "5.14.3",
    "typing-extensions": "4.15.0",
    "widgetsnbextension": "4.0.999",  # JupyterLite's own
}
BROWSER = {
    "sys_platform": "emscripten",
    "platform_system": "Emscripten",
    "python_version": "3.14",
    "extra": "",
}


def strings(function: str) -> list[str]:
    """The words with which the first cell calls a function, in order."""
    tree = compile(INSTALL, "first cell", "exec", ast.PyCF_ALLOW_TOP_LEVEL_AWAIT | ast.PyCF_ONLY_AST)
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    found = [call.args[0] for call in calls if ast.unparse(call.func) == function]
    return [n.value for node in found for n in ast.walk(node) if isinstance(n, ast.Constant)]


def requirements(package: Requirement) -> list[Requirement]:
    """What a package asks for in a browser; of our own the project's file is asked, which is never out of date."""
    if package.name == "pfslam":
        project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        lines = [project["optional-dependencies"][extra] for extra in package.extras]
        return [Requirement(line) for line in sum(lines, project["dependencies"])]
    found = [Requirement(line) for line in importlib.metadata.requires(package.name) or ()]
    return [asked for asked in found if asked.marker is None or asked.marker.evaluate(BROWSER)]


def test_pyodide_or_a_wheel_beside_the_chapters_has_all_that_the_first_cell_asks_for():
    waiting, carried = [Requirement(text) for text in strings("piplite.install")], set()
    assert {requirement.name for requirement in waiting} == {"opencv-python", "anywidget", "pfslam"}
    while waiting:
        asked = waiting.pop()
        name = canonicalize_name(asked.name)
        if name in PYODIDE:
            assert asked.specifier.contains(PYODIDE[name]), f"{asked}: Pyodide has {PYODIDE[name]}"
        elif name not in strings("micropip.add_mock_package"):
            carried.add(name)
            waiting += requirements(asked)
    assert carried == {*WHEELS, "pfslam"}


# What Pyodide could not import, and packages that the first cell leaves out.
IMPORT_ALL = """
import importlib, pkgutil, sys
for kind in ("forkserver", "resource_tracker", "shared_memory", "synchronize"):
    sys.modules[f"multiprocessing.{kind}"] = None
for lacking in ("curses", "dask", "distributed", "grp", "joblib", "pwd", "resource", "rosbags", "tkinter"):
    sys.modules[lacking] = None
for name in ("pfslam", "pfslam_book"):
    for module in pkgutil.walk_packages(importlib.import_module(name).__path__, f"{name}."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
            print(module.name)
"""


@pytest.mark.slow
def test_a_python_without_what_browsers_lack_imports_every_module():
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "book")])}
    command = [sys.executable, "-c", IMPORT_ALL]
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    assert {"pfslam.study.runner", "pfslam_book.ch13.bag"} <= {*done.stdout.split()}


def test_the_wheels_are_those_of_the_lock_file():
    lines = locked(WHEELS, LOCK)
    assert re.findall(r"^([\w-]+)==", lines, re.MULTILINE) == [*WHEELS]
    assert all(line in LOCK.splitlines() for line in lines.splitlines())
    with pytest.raises(DataError, match="nowhere"):
        locked(["shtab", "nowhere"], LOCK)


def test_a_chapter_is_the_students_copy_after_a_cell_that_names_no_address(tmp_path):
    student, wheel = tmp_path / "student", tmp_path / WHEEL
    cells = [{"cell_type": "code", "id": "own", "metadata": {}, "outputs": [], "source": "1 + 1"}]
    write_notebook(
        student / "01_own.ipynb", {"cells": cells, "nbformat": 4, "nbformat_minor": 5, "metadata": {}}
    )
    wheel.write_bytes(b"a wheel")
    (tmp_path / "site").mkdir()
    write_sources(tmp_path / "site", student, [wheel], tmp_path)
    install, *rest = read(tmp_path / "site" / "files" / "01_own.ipynb")["cells"]
    assert rest == cells
    assert source(install) == INSTALL
    assert "we have not run this" in INSTALL
    assert (tmp_path / "site" / "pypi" / WHEEL).read_bytes() == b"a wheel"
    settings = (tmp_path / "site" / "jupyter-lite.json").read_text(encoding="utf-8")
    assert "://" not in INSTALL + settings


def read(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


# ---- the site that `make lite` has built ---------------------------------------------------------


@pytest.fixture(scope="module")
def lite_site() -> Path:
    """The folder of the site; off by default, so these tests are skipped even where a browser is required."""
    if not SITE.is_dir():
        pytest.skip(f"an experiment that is off by default: no {SITE} (make lite)")
    return SITE


class Handler(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@pytest.fixture(scope="module")
def address(lite_site):
    """The site on this machine's own server."""
    handler = functools.partial(Handler, directory=str(lite_site))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()


@pytest.mark.nightly
def test_the_site_lists_all_chapters_each_with_its_first_cell(lite_site):
    listed = {entry["name"] for entry in read(lite_site / "api" / "contents" / "all.json")["content"]}
    assert listed == {path.name for path in NOTEBOOKS}
    for name in listed:
        assert source(read(lite_site / "files" / name)["cells"][0]) == INSTALL


@pytest.mark.nightly
def test_the_site_has_its_wheels_and_asks_no_index(lite_site):
    index = (lite_site / "pypi" / "all.json").read_text(encoding="utf-8")
    files = [release for p in json.loads(index).values() for (release,) in p["releases"].values()]
    assert {canonicalize_name(f["filename"].partition("-")[0]) for f in files} == {*WHEELS, "pfslam"}
    for file in files:
        wheel = lite_site / "pypi" / file["filename"]
        assert hashlib.sha256(wheel.read_bytes()).hexdigest() == file["digests"]["sha256"]
    settings = read(lite_site / "jupyter-lite.json")["jupyter-config-data"]["litePluginSettings"]
    kernel = settings["@jupyterlite/pyodide-kernel-extension:kernel"]
    assert kernel["disablePyPIFallback"] is True
    assert kernel["pipliteUrls"][0].startswith("./pypi/all.json")
    assert "://" not in index + json.dumps(settings)


@pytest.mark.nightly
@pytest.mark.browser
def test_a_chapter_opens_in_a_browser_without_a_network(address, chromium):
    """JupyterLab comes up and lists the chapters; one opens with its text. It asks for Python alone from elsewhere."""
    page, complaints, strangers = chromium.new_page(viewport={"width": 1280, "height": 800}), [], []
    page.on("request", lambda r: r.url.startswith((address, "data:", "blob:")) or strangers.append(r.url))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda m: m.type == "error" and complaints.append(f"{m.text} {m.location['url']}"))
    page.goto(f"{address}/lab/index.html")
    chapters = page.locator(".jp-DirListing-item")
    chapters.first.wait_for()
    assert chapters.locator(".jp-DirListing-itemText").all_inner_texts() == [path.name for path in NOTEBOOKS]
    with page.expect_request("**/pyodide.mjs"):
        chapters.first.dblclick()
    page.get_by_role("heading", name="00 The robot and its data").wait_for()
    first = page.locator(".jp-Notebook .jp-CodeCell .cm-content").first
    assert first.inner_text().split() == INSTALL.split()
    assert {url.rpartition("/")[2] for url in strangers} == {"pyodide.mjs"}
    known = ("/pyodide.mjs", "/favicon.ico")  # the browser asks for the second by itself
    assert [words for words in complaints if not words.endswith(known)] == []
    page.close()
