"""Each equation of the report, 1 to 19, is implemented by exactly one named function, and a chapter shows it."""

import ast
import json
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
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
    """Every (equation, name) whose docstring says that it implements one."""
    for path in sorted((ROOT / "pfslam").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                for numbers in LABEL.findall(ast.get_docstring(node) or ""):
                    yield from ((int(n), node.name) for n in numbers.split(", "))


def test_each_equation_has_exactly_one_home():
    assert sorted(labelled()) == sorted(EXPECTED.items())


def test_a_chapter_shows_each_equation_beside_its_function():
    """A label eq-n, by which other pages link to it, and the name of the function that is the equation."""
    notebooks = [
        json.loads(p.read_text(encoding="utf-8"))["cells"] for p in (ROOT / "notebooks").glob("*.ipynb")
    ]
    texts = ["\n".join("".join(cell["source"]) for cell in cells) for cells in notebooks]
    for number, name in EXPECTED.items():
        label = rf":label: eq-{number}\b"
        assert any(re.search(label, text) and re.search(rf"\b{name}\b", text) for text in texts), number
