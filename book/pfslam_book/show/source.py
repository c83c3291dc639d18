"""Show the reader the lines of the package that are an equation: the real ones, never a copy.

Only the words of docstrings are filled anew, since the package is written in wider lines than the page holds.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable, Iterator
from itertools import groupby

from pfslam_book.show.pictures import output_mode

WIDTH = 80
"""Columns of code that the page holds on a laptop."""


class Source:
    """Code of the package with the module that it comes from, highlighted where the reader's page can.

    Committed notebooks hold the name alone: there a copy would go stale.
    """

    def __init__(self, code: str, name: str):
        self.code, self.name = code, name

    def __repr__(self) -> str:
        return f"[source: {self.name}]"

    def _repr_mimebundle_(self, include=None, exclude=None) -> dict[str, str]:
        if output_mode() == "text":
            return {"text/plain": repr(self)}
        text = f"# {self.name}\n{self.code}"
        return {"text/plain": text, "text/markdown": f"```python\n{text}\n```"}


def show_source(subject: Callable | type, *, docstring: bool = False) -> Source:
    """The source of a function or class of the package; its docstrings are left out unless asked for.

    Make it the last expression of a cell.
    """
    lines = textwrap.dedent(inspect.getsource(subject)).rstrip().splitlines()
    for block in sorted(_docstrings("\n".join(lines)), key=lambda block: -block.start):
        after = block.stop < len(lines) and not lines[block.stop].strip()
        end = block.stop + (after and not docstring)
        lines[block.start : end] = _filled(lines[block.start : block.stop]) if docstring else []
    return Source("\n".join(lines), f"{subject.__module__}.{subject.__qualname__}")


def _docstrings(code: str) -> Iterator[range]:
    """Yield the lines of each docstring, counted from 0."""
    for node in ast.walk(ast.parse(code)):
        body = getattr(node, "body", None)
        for statement in body if isinstance(body, list) else []:
            if isinstance(statement, ast.Expr) and isinstance(getattr(statement.value, "value", None), str):
                yield range(statement.lineno - 1, statement.end_lineno or statement.lineno)


def _filled(lines: list[str]) -> list[str]:
    """Fill those paragraphs of a docstring that are too wide for the page; examples and lists stay as they are."""
    indent = lines[0][: len(lines[0]) - len(lines[0].lstrip())]
    filled: list[str] = []
    for words, paragraph in groupby(lines, key=lambda line: bool(line.strip().strip('"'))):
        kept = list(paragraph)
        plain = words and not any(line.lstrip().startswith((">>>", "- ")) for line in kept)
        if plain and max(map(len, kept)) > WIDTH:
            text = indent + " ".join(line.strip() for line in kept)
            kept = textwrap.wrap(text, WIDTH, subsequent_indent=indent, break_on_hyphens=False)
        filled += kept
    return filled
