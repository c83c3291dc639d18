"""The command itself: load, measure section by section, print, write JSON."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2

from pfslam.bench.floor import texture
from pfslam.bench.growth import growth
from pfslam.bench.machine import THREADS, Machine, describe
from pfslam.bench.processes import memory, start_up, threads
from pfslam.bench.runs import per_particle_runs, whole_runs
from pfslam.bench.scoring import clouds, scoring
from pfslam.bench.setting import QUICK, Effort, Setting
from pfslam.bench.tables import Section
from pfslam.bench.update import profile
from pfslam.datasets import data_folder, load
from pfslam.io.files import check_writable, write_text
from pfslam.recording import Recording


def bench(quick: bool = False, json_file: Path | None = None, data: Path | None = None) -> None:
    """Measure everything on one thread and print it; raises ``SystemExit`` with the code of a failed child process."""
    if json_file is not None:
        check_writable(json_file.parent)
    if not _alone():
        code = _in_a_process_of_its_own(quick, json_file, data)
        if code:
            raise SystemExit(code)
        return
    cv2.setNumThreads(1)
    setting = Setting(recordings_for(data), QUICK if quick else Effort(), describe())
    print(setting.machine, "\n", flush=True)
    found = []
    for section in sections(quick):
        found.append(section(setting))
        print(found[-1], flush=True)
    if json_file is not None:
        write_text(json_file, json.dumps(as_dict(setting.machine, quick, found), indent=2) + "\n")


def sections(quick: bool) -> list[Callable[[Setting], Section]]:
    """What is measured, in order: functions from a setting to a section."""
    return [
        scoring,
        whole_runs,
        growth,
        clouds,
        per_particle_runs,
        partial(memory, texture=not quick),
        texture,
        profile,
        start_up,
        threads,
    ]


def recordings_for(data: Path | None) -> dict[str, Recording]:
    """``hall``, and set 20 if its files lie in ``data`` (None: ``$PFSLAM_DATA``, else ``data``)."""
    recordings = {"hall": load("hall")}
    if data is not None or any(data_folder().glob("Encoders20.npz")):
        recordings["20"] = load("20", data)
    return recordings


def as_dict(machine: Machine, quick: bool, found: list[Section]) -> dict:
    """Everything as plain numbers and texts, for JSON."""
    return {"machine": machine.as_dict(), "quick": quick, "sections": [s.as_dict() for s in found]}


def _alone() -> bool:
    """Whether this process was started with one thread for every library."""
    return all(os.environ.get(name) == "1" for name in THREADS)


def _in_a_process_of_its_own(quick: bool, json_file: Path | None, data: Path | None) -> int:
    """The same command where every library starts with one thread; its exit code."""
    options = ["--quick"] * quick
    options += ["--json", str(json_file)] if json_file is not None else []
    options += ["--data", str(data)] if data is not None else []
    command = [sys.executable, "-m", "pfslam", "bench", *options]
    return subprocess.run(command, env=os.environ | dict.fromkeys(THREADS, "1")).returncode
