"""The prose against the code: names that the pages mention exist, and sources are cited by known keys."""

import dataclasses
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted((ROOT / "book").glob("*.md"))


def resolve(dotted: str) -> None:
    """Import the longest module of a dotted name and follow its attributes; dataclass fields count."""
    parts = dotted.split(".")
    module = importlib.import_module(".".join(parts[:2]))
    target = module
    for name in parts[2:]:
        fields = {f.name for f in dataclasses.fields(target)} if dataclasses.is_dataclass(target) else set()
        if name in fields:
            return
        target = getattr(target, name)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_names_of_the_package_exist(page):
    for dotted in re.findall(r"`(pfslam(?:\.\w+)+)`", page.read_text(encoding="utf-8")):
        resolve(dotted)


def test_names_in_the_notation_exist():
    names = re.findall(r"`([a-z_]+(?:\.\w+)+)`", (ROOT / "book" / "notation.md").read_text(encoding="utf-8"))
    assert len(names) > 30
    for name in names:
        resolve("pfslam." + name)


def test_the_notation_covers_every_equation_that_has_symbols():
    table = (ROOT / "book" / "notation.md").read_text(encoding="utf-8")
    cited = {
        int(n)
        for row in re.findall(r"^\|([\d, ]+)\|", table, re.MULTILINE)
        for n in row.split(",")
        if n.strip()
    }
    assert cited >= set(range(4, 20))


def test_every_source_is_cited_and_every_citation_known():
    known = set(
        re.findall(
            r"^@\w+\{(\w+),", (ROOT / "book" / "references.bib").read_text(encoding="utf-8"), re.MULTILINE
        )
    )
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    cited = {key.strip() for keys in re.findall(r"\{cite\}`([^`]+)`", text) for key in keys.split(",")}
    assert cited == known
