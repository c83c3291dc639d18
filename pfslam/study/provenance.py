"""What made a table: the versions and the machine, and a fingerprint of the code.

Results of another version are never mixed with those of this one: the fingerprint is part of the name under which a
finished run is kept. Docstrings and comments do not count.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import platform
from functools import cache
from pathlib import Path

import cv2
import numpy as np

import pfslam

PACKAGE = Path(__file__).resolve().parents[1]
START = "pfslam.study.run"
"""The module that makes a run; what it imports, and what that imports, is the code that figures depend on."""


@cache
def code_fingerprint() -> str:
    """Sixteen hexadecimal digits for the code behind a run as it was when first asked for."""
    digest = hashlib.sha256()
    for name, path in sorted(_modules_behind(START).items()):
        digest.update(f"{name}\n{_without_docstrings(path)}\n".encode())
    return digest.hexdigest()[:16]


def _modules_behind(start: str) -> dict[str, Path]:
    """The package's modules that ``start`` needs, itself included, with their files."""
    found: dict[str, Path] = {}
    waiting = [start]
    while waiting:
        name = waiting.pop()
        path = _file_of(name)
        if path is not None and name not in found:
            found[name] = path
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and node.module:
                    waiting += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return found


def _file_of(name: str) -> Path | None:
    """The file of a module below ``pfslam``, None for all else."""
    if not name.startswith("pfslam."):
        return None
    path = PACKAGE.joinpath(*name.split(".")[1:])
    files = (path.with_suffix(".py"), path / "__init__.py")
    return next((file for file in files if file.is_file()), None)


def _without_docstrings(path: Path) -> str:
    """The syntax of a module as text, without strings that stand alone."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [s for s in body if not _is_text(s)]  # type: ignore[attr-defined]
    return ast.dump(tree)


def _is_text(statement: ast.stmt) -> bool:
    value = getattr(statement, "value", None)
    return (
        isinstance(statement, ast.Expr) and isinstance(value, ast.Constant) and isinstance(value.value, str)
    )


def versions() -> dict[str, str]:
    """Versions of all that computes."""
    return {
        "pfslam": pfslam.__version__,
        "numpy": np.__version__,
        "opencv": cv2.__version__,
        "python": platform.python_version(),
    }


def machine() -> dict[str, str]:
    """The kind of computer: system, architecture, processor."""
    return {"system": platform.system(), "architecture": platform.machine(), "processor": _processor()}


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor() or "unknown"
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or "unknown"


def processor_features() -> str:
    """Eight hexadecimal digits for what the processor can do, which decides how NumPy adds up; "" if unknown."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ""
    kind = sorted({line for line in lines if line.startswith(("cpu family", "model\t", "stepping", "flags"))})
    return hashlib.sha256("\n".join(kind).encode()).hexdigest()[:8] if kind else ""


def version_key() -> str:
    """Twelve hexadecimal digits for code, libraries and kind of machine."""
    about = json.dumps([code_fingerprint(), versions(), machine()], sort_keys=True)
    return hashlib.sha256(about.encode()).hexdigest()[:12]


def same_machine(provenance: dict) -> bool:
    """Whether a table was made with these libraries on this kind of processor: then numbers agree to the last bit."""
    here = machine() | {"features": processor_features()}
    there = {"features": processor_features()} | provenance.get("machine", {})
    names = ("numpy", "opencv", "python")
    made_with = provenance.get("versions", {})
    return all(there.get(key) == value for key, value in here.items()) and all(
        made_with.get(name) == versions()[name] for name in names
    )


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
