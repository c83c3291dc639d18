"""Your filter, a file that grows: what the reader writes in one chapter is there in the next."""

from __future__ import annotations

import ast
import builtins
import inspect
import runpy
import symtable
import textwrap
from collections.abc import Callable
from pathlib import Path

from pfslam.io.files import read_text, write_text

FILE = Path("my_filter.py")
"""Where the reader's functions are kept: beside the notebook that is open."""
HEADER = "import numpy as np\n\nfrom pfslam.motion import motion_model\n"


def keep(function: Callable, file: Path | str = FILE) -> None:
    """Write a function of the notebook into ``my_filter.py``, in the place of an earlier one of the same name."""
    file, name = Path(file), function.__name__
    code = textwrap.dedent(inspect.getsource(function)).rstrip()
    if "return ..." in code:
        print(f"Not kept: {name} is not written yet.")
        return
    text = read_text(file) if file.exists() else HEADER
    write_text(file, f"{_without(text, name).rstrip()}\n\n\n{code}\n")
    print(f"Kept: {name}, in {file.name}.")
    unknown = _not_in_the_file(read_text(file))
    if unknown:
        print(f"But {file.name} does not have {', '.join(unknown)}. Import or define it inside your function, "
              "and keep the function again.")  # fmt: skip


def kept(file: Path | str = FILE) -> dict[str, Callable]:
    """The functions of ``my_filter.py`` by name; none where there is no such file."""
    if not Path(file).exists():
        return {}
    space = runpy.run_path(str(file))
    return {name: value for name, value in space.items() if inspect.isfunction(value)}


def _without(text: str, name: str) -> str:
    """The file without its function of this name."""
    lines = text.splitlines()
    for node in ast.parse(text).body:
        if isinstance(node, ast.FunctionDef) and node.name == name:
            del lines[node.lineno - 1 : node.end_lineno]
            return _without("\n".join(lines), name)
    return "\n".join(lines)


def _not_in_the_file(text: str) -> list[str]:
    """The names that the functions of a file use and the file neither imports nor defines."""

    def used(table: symtable.SymbolTable) -> set[str]:
        own = {symbol.get_name() for symbol in table.get_symbols() if symbol.is_global()}
        return own.union(*map(used, table.get_children()))

    top = symtable.symtable(text, "my_filter.py", "exec")
    there = {
        symbol.get_name() for symbol in top.get_symbols() if symbol.is_assigned() or symbol.is_imported()
    }
    return sorted(used(top) - there - set(dir(builtins)))
