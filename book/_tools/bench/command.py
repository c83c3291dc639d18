"""The command itself: load, measure section by section, print, write JSON."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import cv2

from bench.measure import THREADS, Section
from bench.sections import QUICK, Effort, growth, memory, runs, scoring, update
from pfslam.io.datasets import data_folder, load
from pfslam.io.files import check_writable, write_text
from pfslam.recording import Recording
from pfslam.study.provenance import machine, versions

FRAME_TIME = Path("book", "_tools", "frame_time.py")
"""In the current folder: the laboratories belong to the book, and the book to a checkout."""


def bench(quick: bool = False, json_file: Path | None = None, data: Path | None = None) -> None:
    """Measure everything on one thread and print it; raises ``SystemExit`` with the code of a failed child process."""
    if json_file is not None:
        check_writable(json_file.parent)
    if any(os.environ.get(name) != "1" for name in THREADS):
        code = _on_one_thread(quick, json_file, data)
        if code:
            raise SystemExit(code)
        return
    cv2.setNumThreads(1)
    about = machine() | {"cores": os.cpu_count()} | versions()
    print(", ".join(f"{name} {value}" for name, value in about.items()), "\n", flush=True)
    found = []
    for section in measured(recordings_for(data), QUICK if quick else Effort(), quick):
        found.append(asdict(section))
        print(section, flush=True)
    if not quick:
        print(laboratories(), flush=True)
    if json_file is not None:
        everything = {"machine": about, "quick": quick, "sections": found}
        write_text(json_file, json.dumps(everything, indent=2) + "\n")


def measured(recordings: dict[str, Recording], effort: Effort, quick: bool) -> Iterator[Section]:
    """Measure section after section; all but the runs are measured on the first recording."""
    for name, recording in recordings.items():
        yield runs(name, recording, effort)
    first = next(iter(recordings.values()))
    yield scoring(first, effort)
    yield update(first, effort)
    yield growth(first, effort)
    yield memory(("--no-texture",) if quick else ("--no-texture", "--texture"))


def recordings_for(data: Path | None) -> dict[str, Recording]:
    """Load ``hall``, and set 20 if its files lie in ``data`` (None: ``$PFSLAM_DATA``, else ``data``)."""
    recordings = {"hall": load("hall")}
    if data is not None or any(data_folder().glob("Encoders20.npz")):
        recordings["20"] = load("20", data)
    return recordings


def laboratories(tool: Path = FRAME_TIME) -> str:
    """Measure how long the book's laboratories work on a frame, in a Chromium slowed down to a phone; else say why not.

    The tool and the browser's driver belong to a checkout of the project; the figures stay out of the JSON.
    """
    if not tool.exists():
        return "laboratories: measured in the folder of a checkout only"
    done = subprocess.run([sys.executable, str(tool)], capture_output=True, text=True)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        return f"laboratories: not measured ({last})"
    return f"laboratories, {done.stdout.rstrip()}"


def _on_one_thread(quick: bool, json_file: Path | None, data: Path | None) -> int:
    """Run the same command where every library starts with one thread, and return its exit code."""
    options = ["--quick"] * quick
    options += ["--json", str(json_file)] if json_file is not None else []
    options += ["--data", str(data)] if data is not None else []
    command = [sys.executable, "-m", "pfslam", "bench", *options]
    return subprocess.run(command, env=os.environ | dict.fromkeys(THREADS, "1")).returncode
