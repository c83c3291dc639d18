"""Show the reader the lines of the package that are an equation: the real ones, never a copy."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable

from pfslam.teaching.show.pictures import output_mode


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
    code = textwrap.dedent(inspect.getsource(subject))
    if not docstring:
        code = _without_docstrings(code)
    return Source(code.rstrip(), f"{subject.__module__}.{subject.__qualname__}")


def _without_docstrings(code: str) -> str:
    """The code without its docstrings and the blank line after one; comments and all else stay."""
    lines = code.splitlines()
    dropped: set[int] = set()
    for node in ast.walk(ast.parse(code)):
        body = getattr(node, "body", None)
        for statement in body if isinstance(body, list) else []:
            if isinstance(statement, ast.Expr) and isinstance(getattr(statement.value, "value", None), str):
                last = statement.end_lineno or statement.lineno
                dropped.update(range(statement.lineno - 1, last))
                if last < len(lines) and not lines[last].strip():
                    dropped.add(last)
    return "\n".join(line for number, line in enumerate(lines) if number not in dropped)
