"""The prose against the code: names that the pages mention exist, and sources are cited by known keys."""

import dataclasses
import importlib
import inspect
import re
from pathlib import Path

import pytest
from sphinx.util.parallel import make_chunks

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted((ROOT / "book").glob("*.md"))


def resolve(dotted: str) -> None:
    """Follow a dotted name from the package down; modules are imported as needed, and dataclass fields count."""
    target = importlib.import_module("pfslam")
    for name in dotted.split(".")[1:]:
        fields = {f.name for f in dataclasses.fields(target)} if dataclasses.is_dataclass(target) else set()
        if name in fields:
            return
        if not hasattr(target, name) and inspect.ismodule(target):
            importlib.import_module(f"{target.__name__}.{name}")
        target = getattr(target, name)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_names_of_the_package_exist(page):
    """Elsewhere with the package's name before them, in the tables of symbols and equations without."""
    bare = page.stem in ("notation", "report")
    pattern = r"`([a-z_]+(?:\.\w+)+)`" if bare else r"`pfslam\.(\w+(?:\.\w+)*)`"
    names = re.findall(pattern, page.read_text(encoding="utf-8"))
    assert len(names) >= 19 or not bare
    for name in names:
        resolve(f"pfslam.{name}")


def test_the_page_on_the_report_says_where_each_equation_is():
    """One row for each, whose chapter is the one that carries the label."""
    text = (ROOT / "book" / "report.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \{eq\}`eq-(\d+)` .*\(\.\./(notebooks/\w+\.ipynb)\)", text, re.MULTILINE)
    assert [int(number) for number, _ in rows] == list(range(1, 20))
    for number, chapter in rows:
        assert f":label: eq-{number}\\n" in (ROOT / chapter).read_text(encoding="utf-8")


def test_every_source_is_cited_and_every_citation_known():
    sources = (ROOT / "book" / "references.bib").read_text(encoding="utf-8")
    known = set(re.findall(r"^@\w+\{(\w+),", sources, re.MULTILINE))
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    cited = {key.strip() for keys in re.findall(r"\{cite(?::t)?\}`([^`]+)`", text) for key in keys.split(",")}
    assert cited == known


@pytest.mark.parametrize("cores", [2, 3, 4])
def test_every_heap_of_pages_holds_its_share_of_the_chapters(monkeypatch, cores):
    monkeypatch.syspath_prepend(str(ROOT / "book" / "_ext"))
    names = [f"book/{n:02d}" for n in range(90)] + [f"notebooks/{n:02d}" for n in range(14)]
    dealt = list(names)
    importlib.import_module("book_site").deal_out(type("App", (), {"parallel": cores}), None, dealt)
    assert sorted(dealt) == names
    held = [sum("notebooks" in name for name in heap) for heap in make_chunks(dealt, cores)]
    assert max(held) - min(held) <= 1


def test_figures_are_numbered_by_chapter(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "book" / "_ext"))
    book = importlib.import_module("book_site")
    counted = {
        "book/trust": {"figure": {"hall": (6,), "ring": (9,)}},
        "notebooks/03_prediction_only": {"figure": {"fans": (7,), "corridor": (8,)}, "table": {"t": (1,)}},
    }
    env = type("Env", (), {"toc_fignumbers": counted})
    assert book.number_figures(None, env) == list(counted)
    assert counted["notebooks/03_prediction_only"]["figure"] == {"fans": (3, 1), "corridor": (3, 2)}
    assert counted["book/trust"]["figure"] == {"hall": (1,), "ring": (2,)}
