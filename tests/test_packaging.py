"""Set-up files: the lock is whole and names no host, and the wheel carries every file that is not Python."""

import hashlib
import importlib.util
import re
import tomllib
import zipfile
from pathlib import Path

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
