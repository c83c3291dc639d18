"""What the chapters show of the package is the package: real lines, without docstrings, and checks that never raise."""

import ast
import inspect
import textwrap

import pytest
from pfslam_book.show.source import show_source

from pfslam.grid import OccupancyGrid, integrate_scan
from pfslam.motion import motion_model
from pfslam.particles import Particles, predict
from pfslam.refined.field import score_field


@pytest.mark.parametrize("subject", [motion_model, predict, Particles, Particles.at])
def test_shown_source_is_the_real_one_without_docstrings(subject):
    shown = show_source(subject).code
    real = inspect.getsource(subject).splitlines()
    indent = len(real[0]) - len(real[0].lstrip())
    assert set(shown.splitlines()) <= {line[indent:] for line in real}
    for node in ast.walk(ast.parse(shown)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            assert ast.get_docstring(node) is None
    assert show_source(subject, docstring=True).code.count('"""') >= 2


@pytest.mark.parametrize("subject", [motion_model, integrate_scan, OccupancyGrid, Particles, score_field])
def test_docstrings_are_filled_for_the_page_word_by_word(subject):
    """The code is the same, and so are the words; no line of a paragraph is too wide."""

    def tree(code):
        nodes = ast.parse(code)
        for node in ast.walk(nodes):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                node.value = " ".join(node.value.split())
        return ast.dump(nodes)

    shown = show_source(subject, docstring=True).code
    assert tree(shown) == tree(textwrap.dedent(inspect.getsource(subject)))
    for node in ast.walk(ast.parse(shown)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            assert max(map(len, (ast.get_docstring(node, clean=False) or "").splitlines()), default=0) <= 80


def test_committed_notebooks_hold_the_name_alone(monkeypatch):
    monkeypatch.setenv("PFSLAM_WIDGETS", "text")
    assert show_source(predict)._repr_mimebundle_() == {"text/plain": "[source: pfslam.particles.predict]"}
    monkeypatch.setenv("PFSLAM_WIDGETS", "static")
    markdown = show_source(predict)._repr_mimebundle_()["text/markdown"]
    assert markdown.startswith("```python\n# pfslam.particles.predict\ndef predict(")
