"""The committed notebooks: text outputs only, small, in the book, and in reading order."""

import ast
import json
import re
from pathlib import Path

import pytest
from strip import strip_notebook

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))

SHOWN = {"text/plain": "1", "text/html": "<b>1</b>", "image/png": "iVBOR"}
MARKDOWN = {"user_expressions": [{"expression": "x", "result": {}}], "jupyter": {"source_hidden": True}}
CODE = {"execution": {"iopub.execute_input": "now"}, "scrolled": True, "tags": ["hide-cell"]}
OUTPUTS = [
    {"output_type": "stream", "name": "stdout", "text": "kept\n"},
    {"output_type": "stream", "name": "stderr", "text": "a progress bar"},
    {"output_type": "display_data", "metadata": {}, "data": {"image/png": "iVBOR"}},
    {"output_type": "execute_result", "execution_count": 7, "metadata": {}, "data": SHOWN},
]
CELL = {"cell_type": "code", "id": "b", "source": "1", "execution_count": 7, "outputs": OUTPUTS}
LOUD = {
    "metadata": {"kernelspec": {"name": "python3"}, "widgets": {"state": {}}},
    "nbformat": 4,
    "nbformat_minor": 5,
    "cells": [
        {"cell_type": "markdown", "id": "a", "metadata": MARKDOWN, "source": "text"},
        {**CELL, "metadata": CODE},
    ],
}


def test_stripping_keeps_text_and_tags_and_nothing_else():
    stripped = strip_notebook(LOUD)
    cell = stripped["cells"][1]
    assert stripped["cells"][0]["metadata"] == {}
    assert cell["metadata"]["tags"] == ["hide-cell"]
    assert cell["metadata"].keys() == {"tags", "jupyter"}
    assert cell["execution_count"] == cell["outputs"][1]["execution_count"] == 1
    assert [o.get("data", o.get("text")) for o in cell["outputs"]] == ["kept\n", {"text/plain": "1"}]
    assert "widgets" not in stripped["metadata"]
    assert strip_notebook(stripped) == stripped


@pytest.mark.parametrize(
    ("tags", "folded"),
    [
        (["hide-input", "setup"], {"source_hidden": True}),
        (["listing", "remove-input"], {"source_hidden": True}),
        (["hide-cell", "solution-1"], {"source_hidden": True, "outputs_hidden": True}),
        (["exercise-1"], None),
    ],
)
def test_jupyterlab_folds_what_the_site_folds(tags, folded):
    metadata = {"tags": tags, "collapsed": False, "jupyter": {"outputs_hidden": True}}
    stripped = strip_notebook({**LOUD, "cells": [{**CELL, "metadata": metadata}]})["cells"][0]
    assert stripped["metadata"].get("jupyter") == folded


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_committed_notebook_holds_text_outputs_only(path):
    notebook = json.loads(path.read_text(encoding="utf-8"))
    assert strip_notebook(notebook) == notebook, "run `make strip`"
    assert not [o for c in notebook["cells"] for o in c.get("outputs", []) if o["output_type"] == "error"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_links_have_words_and_formulas_their_numbers(path):
    """JupyterLab shows the file name for an empty link, and counts formulas that carry no number from 1."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    text = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    assert "[](" not in text
    assert "$$" not in text, (
        "a displayed formula is a {math} directive, with `:enumerated: false` if it has no number"
    )
    labels = re.findall(r"^:label: eq-(\d+)\n:enumerator: (\d+)$", text, re.MULTILINE)
    assert len(labels) == text.count(":label:")
    assert all(label == shown for label, shown in labels)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_code_fits_the_column_of_a_laptop(path):
    """At 1280 px a line of the site has room for 83 characters; what is folded away may be longer."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    shown = [c for c in cells if c["cell_type"] == "code"]
    shown = [c for c in shown if not {"setup", "remove-input"} & set(c["metadata"].get("tags", []))]
    prose = "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")
    fenced = re.findall(r"^```(.*?)\n(.*?)^```$", prose, re.MULTILINE | re.DOTALL)
    listings = [text for kind, text in fenced if not kind.startswith("{")]
    lines = "\n".join(["".join(cell["source"]) for cell in shown] + listings).split("\n")
    assert not [line for line in lines if len(line) > 83]


def test_chapters_are_in_the_book_in_reading_order():
    listed = re.findall(
        r"file: notebooks/(\w+)$", (ROOT / "_toc.yml").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert listed == [path.stem for path in NOTEBOOKS]


def given(source: str) -> set[str]:
    """The names that a cell gives a value to, at its top level and in its loops, not inside its functions."""
    names: set[str] = set()

    def visit(node):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
            return
        if isinstance(node, ast.Lambda | ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp):
            return
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(ast.parse(source))
    return names


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_name_that_a_sentence_quotes_keeps_its_value(path):
    """JupyterLab evaluates sentences when all cells have run: a name used again below would change them."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    quoted: set[str] = set()
    for cell in cells:
        source = "".join(cell["source"])
        if cell["cell_type"] == "code":
            assert quoted & given(source) == set()
        for text in re.findall(r"\{eval\}`([^`]+)`", source if cell["cell_type"] == "markdown" else ""):
            quoted |= {node.id for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Name)}
