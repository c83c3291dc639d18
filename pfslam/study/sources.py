"""The sources of a run: what names its results, so that an edited program does not return the numbers of the old one.

They are all files of the package, the command line and comments among them: a run too many costs less than a rule that
must be right about what matters. A study with a function of its own adds that function's module and, from module to
module, what it imports, unless it was installed from elsewhere. Git is not asked: an installed package has none.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import sys
import sysconfig
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

from pfslam.errors import DataError

PACKAGE = Path(__file__).resolve().parents[1]
LIBRARIES = {Path(sysconfig.get_path(kind)) for kind in ("stdlib", "platstdlib", "purelib", "platlib")}
LIBRARIES.add(Path(sysconfig.get_path("purelib", sysconfig.get_preferred_scheme("user"))))


@cache
def digest_of_sources(run: Callable | None = None) -> str:
    """Return the SHA-256 of the sources of a study that measures with ``run``, or with the filter; once a process."""
    files = {path.relative_to(PACKAGE.parent).as_posix(): path for path in PACKAGE.rglob("*.py")}
    if run is not None:
        files |= modules_behind(run.__module__)
    found = hashlib.sha256() if run is None else hashlib.sha256(run.__qualname__.encode())
    for name, path in sorted(files.items()):
        content = path.read_bytes()
        found.update(f"{name} {len(content)}\n".encode() + content)
    return found.hexdigest()


def modules_behind(start: str) -> dict[str, Path]:
    """Find a module and all modules of its project that it imports, at its top or inside a function, with their files.

    Of libraries only the module's own package is followed, and the book, which comes in one wheel with this package.
    """
    followed, found, todo = {start.partition(".")[0], "pfslam_book"}, dict[str, Path](), [start]
    while todo:
        file = None if (name := todo.pop()) in found else _file(name)
        if file and (name.partition(".")[0] in followed or LIBRARIES.isdisjoint(file.parents)):
            found[name] = file
            todo += _imports(name, file)
    if not found:
        raise DataError(
            "study", "run", f"a function of {start}", "one in a file, which other processes can import"
        )
    return found


def _file(name: str) -> Path | None:
    """Return the Python file of a module; None if it has none, or if there is no such module."""
    with suppress(ImportError, ValueError):
        module = sys.modules.get(name)
        spec = importlib.util.find_spec(name) if module is None else None
        file = getattr(module, "__file__", None) or (spec and spec.origin)
        return Path(file) if file and file.endswith(".py") else None
    return None


def _imports(name: str, file: Path) -> Iterator[str]:
    """Yield the dotted names that a module may import, those of the packages around them included."""
    package = name if file.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(ast.parse(file.read_bytes())):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = "." * node.level + (node.module or "")
            base = importlib.util.resolve_name(base, package) if node.level else base
            names = [f"{base}.{alias.name}" for alias in node.names]
        for parts in (dotted.split(".") for dotted in names):
            yield from (".".join(parts[:n]) for n in range(1, len(parts) + 1))
