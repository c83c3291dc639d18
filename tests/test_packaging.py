"""Set-up files: the lock is whole and names no host, and the wheel carries every file that is not Python."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")
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


def test_every_locked_package_has_hashes():
    entries = ENTRY.findall(LOCK)
    assert len(entries) > 100
    assert len(entries) == len(re.findall(r"^[\w.-]+(?:\[[\w,-]+\])?==", LOCK, re.MULTILINE))
    assert [name for name, rest in entries if "--hash=sha256:" not in rest] == []


def test_the_lock_names_no_host():
    assert re.findall(r"://|--index-url|--find-links|^-i ", LOCK, re.MULTILINE) == []


def test_the_wheel_carries_the_files_that_are_not_python():
    patterns = PROJECT["tool"]["setuptools"]["package-data"]
    for path in (ROOT / "pfslam").rglob("*"):
        if path.is_dir() or path.suffix in (".py", ".pyc"):
            continue
        package = ".".join(path.parent.relative_to(ROOT).parts)
        assert any(path.match(pattern) for pattern in patterns.get(package, [])), path


@pytest.mark.parametrize("target", ["book", "test", "lab", "clean", "check-book"])
def test_make_has_what_the_readme_promises(target):
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
