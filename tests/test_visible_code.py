"""What a reader sees unfolded stands alone, and little of it draws or prints."""

import ast
import builtins
import json
import symtable

import pytest
from test_notebooks import NOTEBOOKS, given

FOLDED = {"hide-input", "hide-cell", "remove-input", "remove-cell"}
BEING_REWRITTEN = ["09_beyond_the_report"]
CALM = [path for path in NOTEBOOKS if path.stem[:2] in ("00", "01", "02", "04")]
SHOWS = {"print", "show", "sheet", "plan", "COLOURS"}


def code_cells(path):
    """Of each code cell its name, its source and its tags."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    cells = [cell for cell in cells if cell["cell_type"] == "code"]
    return [(cell["id"], "".join(cell["source"]), set(cell["metadata"].get("tags", []))) for cell in cells]


def bound(source):
    """The names that a cell gives a value to, its imports too."""
    nodes = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Import | ast.ImportFrom)]
    imported = {(alias.asname or alias.name).split(".")[0] for node in nodes for alias in node.names}
    return given(source) | imported


def taken(source):
    """The names that a cell takes from the cells above it, or from Python."""
    found, tables = set(), [symtable.symtable(source, "cell", "exec")]
    while tables:
        table = tables.pop()
        top = table.get_type() == "module"
        found |= {s.get_name() for s in table.get_symbols() if s.is_referenced() and (top or s.is_global())}
        tables += table.get_children()
    return found - bound(source)


def borrowed(cells):
    """Names whose last value before a visible cell comes from a folded one; the imports are for all."""
    known, wrong = dict.fromkeys(dir(builtins), True), []
    for name, source, tags in cells:
        visible = not tags & FOLDED
        if visible:
            wrong += [f"{name}: {one}" for one in sorted(taken(source)) if not known.get(one)]
        known |= dict.fromkeys(bound(source), visible or "setup" in tags)
    return wrong


def showing(source):
    """How many lines of a cell draw, print or give alt text, and how many lines it has.

    All lines of a statement do that names an artist or ``print``, or what such a statement gave a value to: a figure,
    its axes, whatever a loop over them counts. Of a loop only the head is meant. Blank lines and comments are no lines.
    """
    marked, lines = set(SHOWS), set()
    statements = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.stmt)]
    for node in sorted(statements, key=lambda node: node.lineno):
        children = list(ast.iter_child_nodes(node))
        inner = [child.lineno for child in children if isinstance(child, ast.stmt | ast.ExceptHandler)]
        own = [child for child in children if not isinstance(child, ast.stmt | ast.ExceptHandler)]
        names = [name for child in own for name in ast.walk(child) if isinstance(name, ast.Name)]
        if any(name.id in marked or name.id.startswith("draw_") for name in names):
            lines |= set(range(node.lineno, min(inner, default=node.end_lineno + 1)))
            marked |= {name.id for name in names if isinstance(name.ctx, ast.Store)}
    numbered = enumerate(source.splitlines(), start=1)
    code = {number for number, line in numbered if line.strip() and not line.strip().startswith("#")}
    return len(lines & code), len(code)


def test_a_name_from_a_folded_cell_is_found_wherever_it_is_used():
    setup, folded, seen = ("a", "import numpy as np", {"hide-input", "setup"}), {"hide-input"}, set()
    cells = [setup, ("b", "x, y = 1, 2", folded), ("c", "z = [np.abs(x) for k in range(3)]", seen)]
    assert borrowed(cells) == ["c: x"]
    assert borrowed([*cells, ("d", "def f(x):\n    return x + y", seen)]) == ["c: x", "d: y"]
    assert borrowed([setup, ("b", "x = 1", seen), ("c", "x = 2", folded), ("d", "x", seen)]) == ["d: x"]
    assert borrowed([setup, ("b", "x = 1", folded), ("c", "x = 2\nx", seen), ("d", "x", seen)]) == []


@pytest.mark.parametrize(
    "path", [p for p in NOTEBOOKS if p.stem not in BEING_REWRITTEN], ids=lambda path: path.stem
)
def test_a_visible_cell_takes_no_name_from_a_folded_one(path):
    assert borrowed(code_cells(path)) == []


@pytest.mark.parametrize("path", CALM, ids=lambda path: path.stem)
def test_at_most_a_fifth_of_what_a_reader_sees_draws_or_prints(path):
    """Stubs of exercises and their checks are not counted."""
    rest = ("exercise-", "check-")
    cells = [
        cell for cell in code_cells(path) if not any(tag.startswith(rest) or tag in FOLDED for tag in cell[2])
    ]
    counts = [showing(source) for _, source, _ in cells]
    shown, lines = (sum(count) for count in zip(*counts, strict=True))
    assert 5 * shown <= lines


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_how_we_looked_is_short(path):
    found = [source for _, source, tags in code_cells(path) if "found" in tags]
    assert [source for source in found if len(source.splitlines()) > 30] == []
