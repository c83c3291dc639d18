"""What made a table: the code, the libraries and the machine."""

from __future__ import annotations

import hashlib
import json
import platform
import subprocess
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import scipy

import pfslam
from pfslam.study.sources import PACKAGE, digest_of_sources


@cache
def libraries() -> dict[str, str]:
    """Return the versions of what a run computes with, beside the sources."""
    python = platform.python_version()
    return {"numpy": np.__version__, "opencv": cv2.__version__, "scipy": scipy.__version__, "python": python}


@cache
def versions() -> dict[str, str]:
    """Return the versions of all that computes, for readers; ``commit`` ends in "+" if files have changed since."""
    commit = _git("log", "-1", "--format=%h")
    changed = "+" if commit and _git("status", "--porcelain") else ""
    return {"pfslam": pfslam.__version__, "commit": commit + changed} | libraries()


def _git(*words: str) -> str:
    """Ask git about the package; the answer is empty without git, or outside a repository."""
    command = ["git", "-C", str(PACKAGE), *words, "--", "."]
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


def version_key(run: Callable | None = None) -> str:
    """Return twelve hexadecimal digits for the sources of a study that measures with ``run``, libraries and machine.

    Results of others are not mixed with ours, nor those of an edited program with those from before.
    """
    return _digest(json.dumps([digest_of_sources(run), libraries(), machine()], sort_keys=True))[:12]


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
