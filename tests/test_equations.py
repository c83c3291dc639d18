"""Each equation of the report, 1 to 19, is implemented by exactly one named function, and a chapter shows it."""

import ast
import json
import re
import sys
from pathlib import Path

from box_recording import box_recording

from pfslam.__main__ import main
from pfslam.io.course import save_course

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


NOT_IN_A_RUN = {2}  # a verdict over a whole run, which chapter 09 takes
# For reading, pose by pose and pixel by pixel; tests show that what runs gives the same: the search the same integers
# (test_correlation.py), whole images the same cells (test_texture.py).
FOR_READING = {6: "score_volume", 8: "score_volume", 9: "score_volume", 4: "floor_pixels", 18: "floor_pixels"}


def test_the_function_that_carries_a_label_is_the_one_that_runs(tmp_path):
    """One run of the report's preset by the command line, with a map and a floor, calls every labelled function."""
    save_course(box_recording(), 7, tmp_path, 1)
    called = set()

    def watch(frame, event, _):
        if event == "call":
            called.add(frame.f_code.co_qualname)

    sys.setprofile(watch)
    words = ["run", "7", "--data", str(tmp_path), "--method", "report", "--out", str(tmp_path / "out")]
    try:
        assert main(words) == 0
    finally:
        sys.setprofile(None)
    missing = {number for number, name in EXPECTED.items() if not {name, f"{name}.__post_init__"} & called}
    assert missing == NOT_IN_A_RUN | FOR_READING.keys()
    assert set(FOR_READING.values()) <= called
