"""The chapters in JupyterLite, an experiment: `make lite` writes a site on which a reader's browser runs the chapters.

Python itself comes to the reader over the network, from the server that JupyterLite names: Pyodide, a Python that was
compiled for browsers, with NumPy, SciPy, OpenCV and Matplotlib. What Pyodide does not have lies beside the chapters, as
wheels, so that no package index is asked. Where the book is made Pyodide's server cannot be reached, so no chapter has
been run in a browser; `book/publish.md` says what has been tried.

`python book/_tools/lite.py wheels` prints the lines of the lock for pip. `python book/_tools/lite.py build STUDENT
DIST JUPYTERLITE OUT` builds the site from the students' copies and the wheel of the project.
"""

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

from copies import ROOT, WHEEL, with_first_cell, write_notebook

from pfslam.errors import DataError

WHEELS = ("anywidget", "comm", "ipywidgets", "jupyterlab-widgets", "psygnal", "shtab")
"""What `INSTALL`, and JupyterLite's own kernel, need and Pyodide does not have."""
INSTALL = """# Run this cell first: it brings the book's code to this page, over the network.
# This is an experiment: we have not run this cell, or any below it, in a browser.
from importlib.metadata import version

import micropip
import piplite

await piplite.install(["opencv-python", "anywidget"])
# The book's code asks for opencv-python-headless, OpenCV without windows. Here opencv-python has none either.
micropip.add_mock_package("opencv-python-headless", version("opencv-python"))
await piplite.install("pfslam[plots]")"""
EXTENSIONS = ("anywidget", "@jupyter-widgets/jupyterlab-manager")
"""The parts of JupyterLab that draw laboratories and sliders."""
SETTINGS = {
    "jupyter-lite-schema-version": 0,
    "jupyter-config-data": {
        "appName": "pfslam",
        "litePluginSettings": {
            "@jupyterlite/pyodide-kernel-extension:kernel": {"disablePyPIFallback": True},
        },
    },
}
DONE = """
The chapters are in {out}. They need a server:
  python -m http.server --bind 127.0.0.1 --directory {out}
This is an experiment. Whoever opens a chapter loads Python and its libraries over the network, from the server of
Pyodide. We have not run this: where the book was made, no browser can reach that server."""


def locked(names: Iterable[str], lock: str) -> str:
    """The entries of a lock file for packages, with their versions and hashes, or ``DataError`` for one without."""
    entries = {entry.partition("==")[0]: entry for entry in re.split(r"\n(?=\S)", lock.strip())}
    if missing := sorted(set(names) - set(entries)):
        raise DataError("requirements.lock", "package", ", ".join(missing), "an entry for each")
    return "\n".join(entries[name] for name in names) + "\n"


def write_sources(folder: Path, student: Path, wheels: Iterable[Path], extensions: Path) -> None:
    """Write into ``folder`` what JupyterLite builds a site from: chapters, wheels, settings."""
    for path in sorted(student.glob("*.ipynb")):
        copy = json.loads(path.read_text(encoding="utf-8"))
        write_notebook(folder / "files" / path.name, with_first_cell(copy, INSTALL))
    (folder / "pypi").mkdir()
    for wheel in wheels:
        shutil.copy(wheel, folder / "pypi")
    how = {
        "apps": ["lab"],
        "federated_extensions": [str(extensions.resolve() / name) for name in EXTENSIONS],
        "no_sourcemaps": True,
        "no_unused_shared_packages": True,
    }
    for name, content in (
        ("jupyter-lite.json", SETTINGS),
        ("jupyter_lite_config.json", {"LiteBuildConfig": how}),
    ):
        (folder / name).write_text(json.dumps(content, indent=1), encoding="utf-8")


def build(student: Path, dist: Path, jupyterlite: Path, out: Path) -> None:
    """Build the site into ``out``; ``jupyterlite`` is its environment, with the wheels in a folder of that name."""
    wheels = [dist / WHEEL, *sorted((jupyterlite / "wheels").glob("*.whl"))]
    extensions = Path(sys.prefix) / "share" / "jupyter" / "labextensions"
    program = jupyterlite / Path(sys.executable).parent.name / "jupyter-lite"
    shutil.rmtree(out, ignore_errors=True)
    with tempfile.TemporaryDirectory() as folder:
        write_sources(Path(folder), student, wheels, extensions)
        words = ["build", "--lite-dir", folder, "--output-dir", str(out.resolve())]
        done = subprocess.run([program, *words], cwd=folder, capture_output=True, text=True)
    if done.returncode:
        print(done.stdout, done.stderr, sep="\n", file=sys.stderr)
        raise DataError("jupyter-lite build", "exit code", done.returncode, "0; its words stand above")


def main(arguments: list[str] | None = None) -> int:
    """Print the lines of the lock for the wheels, or build the site."""
    parser = argparse.ArgumentParser(prog="python book/_tools/lite.py", description=main.__doc__)
    steps = parser.add_subparsers(dest="step", required=True)
    steps.add_parser("wheels")
    site = steps.add_parser("build")
    for name in ("student", "dist", "jupyterlite", "out"):
        site.add_argument(name, type=Path)
    options = vars(parser.parse_args(arguments))
    if options.pop("step") == "wheels":
        print(locked(WHEELS, (ROOT / "requirements.lock").read_text(encoding="utf-8")), end="")
        return 0
    try:
        build(**options)
    except DataError as error:
        print(error, file=sys.stderr)
        return 2
    print(DONE.format(out=options["out"]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
