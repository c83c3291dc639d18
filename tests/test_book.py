"""The prose against the code: names that the pages mention exist, and sources are cited by known keys."""

import dataclasses
import importlib
import inspect
import json
import re
from pathlib import Path

import pytest
from pfslam_book.show.style import COLOURS

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
    for dotted in re.findall(r"`(pfslam(?:\.\w+)+)`", page.read_text(encoding="utf-8")):
        resolve(dotted)


@pytest.mark.parametrize(("page", "at_least"), [("notation", 40), ("report", 19)])
def test_names_in_tables_of_symbols_and_equations_exist(page, at_least):
    names = re.findall(r"`([a-z_]+(?:\.\w+)+)`", (ROOT / "book" / f"{page}.md").read_text(encoding="utf-8"))
    assert len(names) >= at_least
    for name in names:
        resolve("pfslam." + name)


def test_the_page_on_the_report_says_where_each_equation_is():
    """One row for each, whose chapter is the one that carries the label."""
    text = (ROOT / "book" / "report.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \{eq\}`eq-(\d+)` .*\(\.\./(notebooks/\w+\.ipynb)\)", text, re.MULTILINE)
    assert [int(number) for number, _ in rows] == list(range(1, 20))
    for number, chapter in rows:
        assert f":label: eq-{number}\\n" in (ROOT / chapter).read_text(encoding="utf-8")


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
    cited = {key.strip() for keys in re.findall(r"\{cite(?::t)?\}`([^`]+)`", text) for key in keys.split(",")}
    assert cited == known


def test_links_to_sources_read_as_the_site_cites_them(monkeypatch):
    """In a chapter a citation is a link, because JupyterLab would show the key of a role."""
    monkeypatch.syspath_prepend(str(ROOT / "book" / "_tools"))
    citation, found = importlib.import_module("plain").citation, 0
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        text = "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")
        for words, key in re.findall(r"\[([^\[\]]+)\]\(\.\./book/bibliography\.md#(\w+)\)", text):
            cited = citation(key, ROOT / "book" / "references.bib")[1:-1]
            who, year = cited.rsplit(", ", 1)
            assert words in (cited, f"{who} ({year})"), path.stem
            found += 1
        assert "{cite" not in text, path.stem
    assert found > 40


def test_every_column_of_a_table_has_a_name():
    notebooks = (
        json.loads(path.read_text(encoding="utf-8")) for path in (ROOT / "notebooks").glob("*.ipynb")
    )
    cells = ["".join(c["source"]) for n in notebooks for c in n["cells"] if c["cell_type"] == "markdown"]
    heads = [
        head
        for text in [*(page.read_text(encoding="utf-8") for page in PAGES), *cells]
        for head in re.findall(r"^\|(.*)\|[ ]*\n\|[-:| ]+\|[ ]*$", text, re.MULTILINE)
    ]
    assert len(heads) > 10
    assert [head for head in heads if not all(name.strip() for name in head.split("|"))] == []


def test_the_reference_lists_every_public_module():
    inside = {"bench", "cli", "teaching"}  # programs and figures, not a library
    modules = set()
    for path in (ROOT / "pfslam").rglob("*.py"):
        name = path.relative_to(ROOT / "pfslam").with_suffix("")
        if name.parts[0] == "simulator":  # one call; what it is made of stays inside
            modules.add("simulator")
        elif name.parts[0] not in inside and not path.stem.startswith("_"):
            modules.add(".".join(name.parts))
    text = (ROOT / "book" / "api.md").read_text(encoding="utf-8")
    assert modules - set(re.findall(r"automodule:: pfslam\.([\w.]+)", text)) == set()


def test_the_colours_shown_to_the_reader_are_those_of_the_figures():
    text = (ROOT / "book" / "how_to_use.md").read_text(encoding="utf-8")
    names = ("truth", "odometry", "estimate", "particles", "hits", "free", "unknown", "report")
    assert re.findall(r"background:(#\w+)", text) == [COLOURS[name] for name in names]


def test_every_word_of_the_glossary_leads_to_a_chapter():
    text = (ROOT / "book" / "glossary.md").read_text(encoding="utf-8")
    words = re.findall(r"^(?=\w)(.+)\n(?=  )", text.split("{glossary}")[1], re.MULTILINE)
    links = re.findall(r"^  \[(\d\d\w?)\]\(\.\./(notebooks/\1_\w+\.ipynb)\)$", text, re.MULTILINE)
    assert len(links) == len(words) > 40
    assert all((ROOT / link).is_file() for _, link in links)


def test_figures_are_numbered_by_chapter(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "book" / "_ext"))
    book = importlib.import_module("book_site")
    counted = {
        "book/index": {"figure": {"hero": (1,)}},
        "notebooks/03_prediction_only": {"figure": {"fans": (7,), "corridor": (8,)}, "table": {"t": (1,)}},
    }
    env = type("Env", (), {"toc_fignumbers": counted})
    assert book.number_figures(None, env) == ["notebooks/03_prediction_only"]
    assert counted["notebooks/03_prediction_only"]["figure"] == {"fans": (3, 1), "corridor": (3, 2)}
    assert counted["book/index"]["figure"] == {"hero": (1,)}
