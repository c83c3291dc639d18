"""The wheel by itself: complete, light to start, and enough for a student's notebooks far from any checkout."""

import json
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from copies import CHECK, exercises, expressions, write_copies

import pfslam

ROOT = Path(__file__).resolve().parents[1]
BUILT = ".git .venv* _build out dist build data api __pycache__ *.egg-info .*_cache .hypothesis site.zip*"
PIP = (sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "--no-index")
CHAPTER = "01_dead_reckoning.ipynb"
# What a student does not install: asked for, it is not there.
NOT_INSTALLED = ("myst_nb", "sphinx", "pytest")

pytestmark = pytest.mark.slow


def run(*command, **options) -> str:
    """What a command prints; its complaints if it fails."""
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, encoding="utf-8", check=False, **options
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def tree(tmp_path_factory) -> Path:
    """A copy of the sources, so that nothing is left in the checkout."""
    copy = tmp_path_factory.mktemp("tree") / "pfslam"
    return shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*BUILT.split(), ".ipynb_checkpoints"))


def wheel_of(folder: Path, out: Path) -> Path:
    run(*PIP, "-w", out, folder)
    (built,) = out.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def wheel(tree, tmp_path_factory) -> Path:
    """The wheel, built from the sources."""
    return wheel_of(tree, tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def unpacked(tree, tmp_path_factory) -> Path:
    """The source distribution, built and unpacked."""
    out = tmp_path_factory.mktemp("sources")
    code = "import sys; from setuptools.build_meta import build_sdist; build_sdist(sys.argv[1])"
    run(sys.executable, "-c", code, out, cwd=tree)
    (archive,) = out.glob("*.tar.gz")
    with tarfile.open(archive) as packed:
        packed.extractall(out, filter="data")
    return out / archive.name.removesuffix(".tar.gz")


@pytest.fixture(scope="module")
def classroom(wheel, tmp_path_factory) -> dict:
    """A folder with the wheel installed and the environment of a student: no checkout, no book machinery."""
    folder = tmp_path_factory.mktemp("class room")
    pip = (sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-index")
    run(*pip, "--target", folder / "site", wheel)
    for name in NOT_INSTALLED:
        text = f'raise ModuleNotFoundError("No module named {name}", name={name!r})\n'
        (folder / "site" / f"{name}.py").write_text(text, encoding="utf-8")
    kept = {key: value for key, value in os.environ.items() if key not in ("PFSLAM_WIDGETS", "PYTHONPATH")}
    return {"cwd": folder, "env": kept | {"PYTHONPATH": str(folder / "site"), "OPENBLAS_NUM_THREADS": "1"}}


def test_the_wheel_holds_every_file_of_the_package(wheel):
    held = {name for name in zipfile.ZipFile(wheel).namelist() if not name.startswith("pfslam-")}
    files = {}
    for root in (ROOT / "pfslam", ROOT / "book" / "pfslam_book"):
        files |= {
            path.relative_to(root.parent).as_posix(): path for path in root.rglob("*") if path.is_file()
        }
    assert held == {name for name in files if not name.endswith(".pyc")}


def test_the_sources_build_the_same_wheel_and_are_whole(unpacked, tree, wheel, tmp_path):
    assert unpacked.name == f"pfslam-{pfslam.__version__}"
    files = {path.relative_to(tree).as_posix() for path in tree.rglob("*") if path.is_file()}
    made = {name for name in files if ".egg-info/" in name or name.startswith("build/")}
    assert files - made <= {path.relative_to(unpacked).as_posix() for path in unpacked.rglob("*")}
    first, second = (zipfile.ZipFile(file) for file in (wheel, wheel_of(unpacked, tmp_path)))
    assert {name: first.read(name) for name in first.namelist()} == {
        name: second.read(name) for name in second.namelist()
    }


def test_tests_run_from_the_sources(unpacked):
    kept = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    command = (sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider")
    tests = ("tests/test_poses.py", "tests/test_packaging.py", "-m", "not slow")
    said = run(*command, *tests, cwd=unpacked, env=kept | {"PYTHONPATH": str(unpacked)})
    assert "passed" in said
    assert "skipped" not in said


def test_it_is_the_installed_package_that_runs(classroom):
    code = "import pfslam, pfslam_book; print(pfslam.__file__, pfslam_book.__file__, sep='\\n')"
    where = run(sys.executable, "-c", code, **classroom).split("\n")[:2]
    assert all(Path(path).is_relative_to(classroom["cwd"]) for path in where)


def test_a_students_chapter_runs_outside_the_checkout(classroom):
    folder, path = classroom["cwd"] / "student", ROOT / "notebooks" / CHAPTER
    numbers = ["1"] * len(expressions(json.loads(path.read_text(encoding="utf-8"))))
    write_copies(classroom["cwd"], [path], [numbers])
    command = (sys.executable, "-m", "nbconvert", "--to", "notebook", "--execute", "--inplace", CHAPTER)
    run(*command, **(classroom | {"cwd": folder}))
    ran = json.loads((folder / CHAPTER).read_text(encoding="utf-8"))
    checks = exercises(ran, CHECK)
    assert len(checks) >= 3
    for n, cell in checks.items():
        said = "".join("".join(o.get("data", {}).get("text/plain", "")) for o in cell["outputs"])
        assert said.startswith("Not answered yet"), f"exercise {n}: {said or cell['outputs']}"
