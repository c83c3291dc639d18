"""Your filter, a file that grows: what the reader writes in one chapter is there in the next."""

from __future__ import annotations

import ast
import builtins
import functools
import inspect
import runpy
import symtable
import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from pfslam.io.files import read_text, write_text

FILE = Path("my_filter.py")
"""Where the reader's functions are kept: beside the notebook that is open."""
HEADER = "import numpy as np\n\nfrom pfslam.motion import motion_model\n"


def keep(function: Callable, file: Path | str = FILE) -> None:
    """Write a function into ``my_filter.py``, in the place of an earlier one of the same name, with what it uses.

    Imports at the top of the notebook, its plain constants and its helper functions go with it.
    """
    file, name = Path(file), function.__name__
    code = textwrap.dedent(inspect.getsource(function)).rstrip()
    if "return ..." in code:
        print(f"Not kept: {name} is not written yet.")
        return
    text, unknown = read_text(file) if file.exists() else HEADER, []
    for used, lines in [*_uses(function), (name, code)]:
        if lines is None:
            unknown.append(used)
        elif lines.startswith(("import ", "from ")):
            text = text if lines in text.splitlines() else f"{lines}\n{text}"
        else:
            text = f"{_without(text, used).rstrip()}\n\n\n{lines}\n"
    write_text(file, text)
    print(f"Kept: {name}, in {file.name}.")
    if unknown:
        print(f"But {file.name} cannot have {', '.join(unknown)}. Make it inside your function, or an argument "
              "of it, and keep the function again.")  # fmt: skip


def kept(file: Path | str = FILE) -> dict[str, Callable]:
    """The functions of ``my_filter.py`` by name; none where there is no such file."""
    if not Path(file).exists():
        return {}
    space = runpy.run_path(str(file))
    return {name: value for name, value in space.items() if inspect.isfunction(value)}


def source_of(function: Callable) -> str:
    """The lines of a function, after those of the imports, constants and helpers that it uses."""
    function = inspect.unwrap(function)
    lines = [code for _, code in _uses(function) if code is not None]
    return "\n\n\n".join([*lines, textwrap.dedent(inspect.getsource(function)).rstrip()])


def giving(function: Callable, *kinds: type) -> Callable:
    """The same function, whose answer is an array of this kind, or one array for each of several kinds.

    A check takes lists, tuples and float cells for right; so does whoever calls the function through this.
    """

    @functools.wraps(function)
    def wrapped(*arguments):
        answer = function(*arguments)
        if len(kinds) == 1:
            return np.asarray(answer).astype(kinds[0], copy=False)
        return tuple(
            np.asarray(part).astype(kind, copy=False) for part, kind in zip(answer, kinds, strict=True)
        )

    return wrapped


def _uses(function: Callable, seen: frozenset[str] = frozenset()) -> Iterator[tuple[str, str | None]]:
    """Yield each name that a function takes from outside, with the code that gives it, or None where none can.

    What a helper function uses comes before the helper.
    """
    header = {node.asname or node.name for line in ast.parse(HEADER).body for node in line.names}  # type: ignore[attr-defined]
    seen |= {function.__name__} | header | set(dir(builtins))
    for name in sorted(_names_from_outside(function) - seen):
        value = function.__globals__.get(name, ...)
        if inspect.isfunction(value) and value.__module__ == function.__module__:
            yield from _uses(value, seen)
        yield name, _code_for(name, value, function.__module__)


def _names_from_outside(function: Callable) -> set[str]:
    def used(table: symtable.SymbolTable) -> set[str]:
        own = {symbol.get_name() for symbol in table.get_symbols() if symbol.is_global()}
        return own.union(*map(used, table.get_children()))

    return used(symtable.symtable(textwrap.dedent(inspect.getsource(function)), "my_filter.py", "exec"))


def _code_for(name: str, value: Any, notebook: str) -> str | None:
    """The lines that make a value of the notebook again: an import, a constant or a function."""
    if isinstance(value, ModuleType):
        return f"import {value.__name__}" + (f" as {name}" if name != value.__name__ else "")
    if inspect.isfunction(value) and value.__module__ == notebook:
        return textwrap.dedent(inspect.getsource(value)).rstrip()
    home = getattr(value, "__module__", None)
    own = getattr(value, "__name__", name)
    if home in sys.modules and home != notebook and getattr(sys.modules[home], own, ...) is value:
        return f"from {home} import {own}" + (f" as {name}" if name != own else "")
    if isinstance(value, bool | int | float | str) and repr(value) not in ("nan", "inf", "-inf"):
        return f"{name} = {value!r}"
    return None


def _without(text: str, name: str) -> str:
    """The file without its function, or its constant, of this name."""
    lines = text.splitlines()
    for node in ast.parse(text).body:
        targets = getattr(node, "targets", [])
        if getattr(node, "name", None) == name or [getattr(t, "id", None) for t in targets] == [name]:
            del lines[node.lineno - 1 : node.end_lineno]
            return _without("\n".join(lines), name)
    return "\n".join(lines)
