"""Each equation of the report, 1 to 19, is implemented by exactly one named function or class."""

import ast
import json
import re
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "pfslam"
LABEL = re.compile(r"Implements Eq\. (\d+(?:, \d+)*)")

# Where a reader finds them, in the report's own order.
EXPECTED = {
    1: "motion_model",
    2: "slam_cost",
    3: "motion_model",
    4: "project_floor",
    5: "motion_model",
    6: "map_correlation",
    7: "scan_points",
    8: "map_correlation",
    9: "map_correlation",
    10: "Particles",
    11: "predict",
    12: "reweight",
    13: "effective_sample_size",
    14: "probability",
    15: "integrate_scan",
    16: "associate_rgb",
    17: "back_project",
    18: "to_world",
    19: "wheel_speed",
}


def labelled():
    """Every (equation, name, file) whose docstring says that it implements one."""
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                for numbers in LABEL.findall(ast.get_docstring(node) or ""):
                    yield from ((int(n), node.name, path.name) for n in numbers.split(", "))


def test_each_equation_has_exactly_one_home():
    count = Counter(number for number, _, _ in labelled())
    assert dict(count) == dict.fromkeys(range(1, 20), 1)


def test_equations_live_where_the_design_says():
    assert {number: name for number, name, _ in labelled()} == EXPECTED


def test_labels_are_written_in_one_way():
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        assert len(re.findall(r"[Ii]mplements [Ee]q", text)) == len(LABEL.findall(text)), path.name


def chapters():
    """The text of each notebook, all cells."""
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        yield path.stem, "\n".join("".join(cell["source"]) for cell in cells)


def test_a_chapter_shows_each_equation_beside_its_function():
    """A label eq-n, by which other pages link to it, and the name of the function that is the equation."""
    texts = [text for _, text in chapters()]
    for number, name in EXPECTED.items():
        assert any(
            re.search(rf":label: eq-{number}\b", text) and re.search(rf"\b{name}\b", text) for text in texts
        ), number
