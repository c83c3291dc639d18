"""What made a table: the code, the libraries and the machine."""

from __future__ import annotations

import hashlib
import json
import platform
import subprocess
from contextlib import suppress
from functools import cache
from pathlib import Path

import cv2
import numpy as np

import pfslam

PACKAGE = Path(__file__).resolve().parents[1]


@cache
def versions() -> dict[str, str]:
    """Return the versions of all that computes; ``commit`` ends in "+" if files have changed since."""
    commit = _git("log", "-1", "--format=%h")
    return {
        "pfslam": pfslam.__version__,
        "commit": commit + ("+" if commit and _git("status", "--porcelain") else ""),
        "numpy": np.__version__,
        "opencv": cv2.__version__,
        "python": platform.python_version(),
    }


def _git(*words: str) -> str:
    """Ask git about the code that results depend on; the answer is empty without git, or outside a repository."""
    command = ["git", "-C", str(PACKAGE), *words, "--", ".", ":!cli"]
    with suppress(OSError):
        return subprocess.run(command, capture_output=True, text=True).stdout.strip()
    return ""


@cache
def machine() -> dict[str, str]:
    """Describe the computer; ``features`` stands for what its processor can do, which decides how NumPy adds up."""
    cpus = Path("/proc/cpuinfo")
    lines = cpus.read_text(encoding="utf-8", errors="replace").splitlines() if cpus.is_file() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    kind = sorted({line for line in lines if line.startswith(("cpu family", "model\t", "stepping", "flags"))})
    return {
        "system": platform.system(),
        "architecture": platform.machine(),
        "processor": names[0] if names else platform.processor() or "unknown",
        "features": _digest("\n".join(kind))[:8] if kind else "",
    }


@cache
def version_key() -> str:
    """Return twelve hexadecimal digits for versions and machine, so that results of others are not mixed with ours."""
    return _digest(json.dumps([versions(), machine()], sort_keys=True))[:12]


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
