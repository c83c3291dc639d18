"""Set-up files: the lock is whole and names no host, versions are stated once, and what is released is tested."""

import hashlib
import importlib.util
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml
from lowest import lowest

import pfslam

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")
BESIDE_IT = ("tests/nbgrader.lock", "book/_tools/lite.lock")
LOCKS = {"requirements.lock": LOCK, **{name: (ROOT / name).read_text(encoding="utf-8") for name in BESIDE_IT}}
ENTRY = re.compile(r"^([\w.-]+)(?:\[[\w,-]+\])?==\S+((?:.*\\\n)+.*)$", re.MULTILINE)


def normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def wanted() -> set[str]:
    """Every package that the project asks for, its own extras aside."""
    groups = PROJECT["project"]["optional-dependencies"].values()
    lines = [*PROJECT["project"]["dependencies"], *(line for group in groups for line in group)]
    return {normal(re.match(r"[\w.-]+", line)[0]) for line in lines} - {"pfslam"}


def test_the_lock_holds_everything_that_the_project_asks_for():
    locked = {normal(name) for name, _ in ENTRY.findall(LOCK)}
    assert wanted() <= locked
    assert "setuptools" in locked, "the build backend too, or building fetches something unpinned"


@pytest.mark.parametrize("lock", LOCKS.values(), ids=LOCKS)
def test_every_locked_package_has_hashes(lock):
    entries = ENTRY.findall(lock)
    assert len(entries) == len(re.findall(r"^[^\s#]", lock, re.MULTILINE)) > 3
    assert [name for name, rest in entries if "--hash=sha256:" not in rest] == []


@pytest.mark.parametrize("lock", LOCKS.values(), ids=LOCKS)
def test_a_lock_names_no_host(lock):
    assert re.findall(r"://|--index-url|--find-links|^-i ", lock, re.MULTILINE) == []


@pytest.mark.parametrize("name", BESIDE_IT)
def test_what_is_installed_on_top_of_the_environment_replaces_nothing_in_it(name):
    beside, below = ({normal(package) for package, _ in ENTRY.findall(lock)} for lock in (LOCKS[name], LOCK))
    assert beside & below == set()


def test_the_number_of_the_version_is_stated_once():
    """Beside the package itself only the history and what a version has made say the number."""
    number = re.compile(rf"(?<![\d.]){re.escape(pfslam.__version__)}(?![\d.])")
    files = [*ROOT.glob("*.*"), ROOT / "Makefile", *ROOT.glob(".github/**/*.yml"), *ROOT.glob("binder/*")]
    files += [*ROOT.glob("pfslam/**/*.py*"), *ROOT.glob("book/*.md"), *ROOT.glob("book/_*/*.*")]
    named = {
        path.relative_to(ROOT).as_posix() for path in files if path.suffix in TEXT and said(number, path)
    }
    assert named == {"pfslam/__init__.py", "CHANGELOG.md"}
    assert re.findall("^## (.*)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)[0] == (
        pfslam.__version__
    )


TEXT = {".py", ".pyi", ".md", ".toml", ".cff", ".yml", ".in", ".txt", ""}


def said(number: re.Pattern, path: Path) -> bool:
    return path.is_file() and bool(number.search(path.read_text(encoding="utf-8")))


def test_addresses_are_stated_where_there_are_any_and_nowhere_else():
    """No address is made up: the package has the one that the site has, or none."""
    address = yaml.safe_load((ROOT / "_config.yml").read_text(encoding="utf-8"))["repository"]["url"]
    assert address in PROJECT["project"].get("urls", {"": ""}).values()


def test_the_lowest_versions_are_those_of_the_project():
    extras = {"a": ["pfslam[b]", "three>=3.0.1", "two>=2.1"], "b": ["four", "five==5.0"]}
    project = {"dependencies": ["one>=1.26.0", "two>=2.1"], "optional-dependencies": extras}
    assert lowest(project) == ["one==1.26.0", "three==3.0.1", "two==2.1"]
    known = {line.partition("==")[0] for line in lowest(PROJECT["project"])}
    groups = ("plots", "study", "ros", "cluster")
    lines = [*PROJECT["project"]["dependencies"]]
    lines += [line for group in groups for line in PROJECT["project"]["optional-dependencies"][group]]
    assert {re.match(r"[\w.-]+", line)[0] for line in lines} - {"pfslam"} <= known


# ---- workflows -----------------------------------------------------------------------------------


def workflow(name: str) -> dict:
    content = yaml.safe_load((ROOT / ".github" / "workflows" / f"{name}.yml").read_text(encoding="utf-8"))
    return content | {"on": content[True]}  # YAML 1.1 reads the word as a truth


def commands(job: dict) -> list[str]:
    return [step["run"] for step in job["steps"] if "run" in step]


TARGETS = set(re.findall(r"^([\w.-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))


def unknown_targets(lines: list[str]) -> set[str]:
    made = [word for line in lines if line.startswith("make ") for word in line.split()[1:]]
    return {word for word in made if "=" not in word} - TARGETS


def test_every_workflow_is_yaml_with_jobs_and_every_target_exists():
    for path in (ROOT / ".github" / "workflows").iterdir():
        for job in workflow(path.stem)["jobs"].values():
            assert unknown_targets(commands(job)) == set()


def test_tags_are_tested_and_nothing_cuts_a_publication_short():
    ci = workflow("ci")
    assert ci["on"]["push"]["tags"] == ["**"]
    cancelled = ci["concurrency"]["cancel-in-progress"]
    assert "github.ref != 'refs/heads/main'" in cancelled
    assert "github.ref_type != 'tag'" in cancelled
    publish = ci["jobs"]["publish"]
    assert publish["concurrency"]["cancel-in-progress"] is False
    assert set(publish["needs"]) == set(ci["jobs"]) - {"publish", "colab"}
    assert ci["jobs"]["colab"]["needs"] == "publish"
    assert any(line.startswith("make lowest") for line in commands(ci["jobs"]["lowest"]))


def test_gitlab_publishes_what_github_does():
    jobs = yaml.safe_load((ROOT / ".gitlab-ci.yml").read_text(encoding="utf-8"))
    here, there = jobs["pages"]["script"], commands(workflow("ci")["jobs"]["whole"])
    assert unknown_targets(here) == set()
    assert here == [*there, "mv _build/html public"]
    assert jobs["pages"]["artifacts"] == {"paths": ["public"]}
    assert jobs["branch"]["script"] == ["bash .ci/run"]


def test_colab_has_a_branch_with_its_copies_and_nothing_else(tmp_path):
    """The commands of the workflow, beside a repository that takes what is pushed."""
    clone, notebook = tmp_path / "clone", Path("notebooks/00_first.ipynb")

    def git(*words: str) -> str:
        name = ("-c", "user.name=ada", "-c", "user.email=ada@localhost")
        done = subprocess.run(["git", *name, *words], cwd=clone, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    clone.mkdir()
    git("init", "-q", "--bare", str(tmp_path / "origin"))
    git("init", "-q")
    git("remote", "add", "origin", str(tmp_path / "origin"))
    for path, text in ((notebook, "the book's"), (Path(".gitignore"), "_build/\n"), (Path("Makefile"), "")):
        (clone / path).parent.mkdir(exist_ok=True)
        (clone / path).write_text(text, encoding="utf-8")
    git("add", "--all")
    git("commit", "-qm", "the book")
    (push,) = commands(workflow("ci")["jobs"]["colab"])
    for copy in ("the first copy", "the second copy"):
        written = clone / "_build" / "colab" / notebook
        written.parent.mkdir(parents=True, exist_ok=True)
        written.write_text(copy, encoding="utf-8")
        subprocess.run(["bash", "-eo", "pipefail", "-c", push], cwd=clone, check=True, capture_output=True)
        git("fetch", "-q", "origin", "+refs/heads/colab:refs/remotes/origin/colab")
        assert git("ls-tree", "-r", "--name-only", "origin/colab").split() == [notebook.as_posix()]
        assert git("show", f"origin/colab:{notebook.as_posix()}") == copy


def test_what_is_released_has_been_tested_and_its_wheel_has_run():
    (job,) = workflow("release")["jobs"].values()
    order = [re.sub(r" PYTHON=.*", "", line) for line in commands(job)]
    release = next(k for k, line in enumerate(order) if line.startswith("gh release"))
    assert order.index("bash .ci/run") < order.index("make release") < order.index("make smoke") < release
    assert "concurrency" not in workflow("release")


# ---- types ---------------------------------------------------------------------------------------

USER = """import pfslam

recording = pfslam.load("hall")
result = pfslam.run_slam(recording)
reveal_type(recording)
reveal_type(result)
reveal_type(result.trajectory)
reveal_type(pfslam.dead_reckoning(recording))
reveal_type(pfslam.map_texture(recording, result.trajectory))
reveal_type(pfslam.SlamConfig.report())
reveal_type(pfslam.simulate("hall").recording)
reveal_type(pfslam.__version__)
pfslam.run_slam("hall")
pfslam.run_slam(recording, particles=3)
pfslam.load()
pfslam.run_slma(recording)
"""
REVEALED = [
    "Recording",
    "SlamResult",
    "Trajectory",
    "Trajectory",
    "FloorTexture",
    "SlamConfig",
    "Recording",
    "str",
]
WRONG = {13: "arg-type", 14: "call-arg", 15: "call-arg", 16: "attr-defined"}


@pytest.mark.slow
def test_a_type_checker_knows_the_interface(tmp_path):
    """In a user's own project, with what a user has installed: sources, stub and marker."""
    everything = "".join(f"\nreveal_type(pfslam.{name})" for name in pfslam.__all__)
    (tmp_path / "mine.py").write_text(USER + everything, encoding="utf-8")
    options = ["--strict", "--follow-imports=silent", "--cache-dir", str(tmp_path / "cache")]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *options, "mine.py"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=os.environ | {"MYPYPATH": str(ROOT)},
    )
    types = re.findall(r'note: Revealed type is "(.*)"', done.stdout)
    assert [name.split(".")[-1] for name in types[: len(REVEALED)]] == REVEALED
    assert len(types) == len(REVEALED) + len(pfslam.__all__)
    assert "Any" not in types
    errors = re.findall(r"^mine\.py:(\d+): error: .*\[([\w-]+)\]$", done.stdout, re.MULTILINE)
    assert {int(line): kind for line, kind in errors} == WRONG
    assert len(errors) == done.stdout.count(": error:") == len(WRONG)


def packer():
    spec = importlib.util.spec_from_file_location("pack", ROOT / "book" / "_tools" / "pack.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_same_files_give_the_same_archive(tmp_path):
    sums = []
    for name, order in (("one", "ab"), ("two", "ba")):
        for letter in order:
            (tmp_path / name / letter).mkdir(parents=True)
            (tmp_path / name / letter / "page.html").write_text(letter, encoding="utf-8")
        archive = tmp_path / f"{name}-out" / "book.zip"
        sums.append(packer().pack(tmp_path / name, archive).read_text(encoding="utf-8"))
        digest, file = sums[-1].split()
        assert digest == hashlib.sha256(archive.read_bytes()).hexdigest()
        assert file == "book.zip"
    assert sums[0] == sums[1]
    assert zipfile.ZipFile(archive).namelist() == ["book/a/page.html", "book/b/page.html"]
