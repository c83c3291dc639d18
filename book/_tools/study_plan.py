"""What many runs take: time, memory, disk and messages, reckoned from the stored measurements."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pfslam.study.table import Table

OVERHEAD = Path(__file__).resolve().parents[2] / "book" / "tables" / "studies.csv"
BLOCK = 4096
"""The least room that a file takes on most disks (bytes)."""


@dataclass(frozen=True)
class Plan:
    """What ``runs`` runs on ``cores`` cores take."""

    runs: int
    cores: int
    core_hours: float
    hours: float
    start_hours: float
    """Core hours spent on starting workers, each once."""
    memory_gb: float
    """Memory of all workers together, one for each core."""
    runs_per_second: float
    """How fast results come in."""
    dispatch_share: float
    """Share of the time that handing out runs keeps its one process busy."""
    cases_gb: float
    """Memory of that process for the list of cases."""
    disk_gb: float
    """Disk for the kept runs, a block each at least."""
    table_gb: float
    check_minutes: float
    """Time until a study that is taken up again knows what is missing."""


def read_overhead(path: Path = OVERHEAD) -> dict[str, float]:
    """What a study costs besides its runs, as ``make study-costs`` measured it."""
    with open(path, encoding="utf-8", newline="") as file:
        return {row["what"]: float(row["value"]) for row in csv.DictReader(file)}


def plan(runs: int, cores: int, seconds: float, peak_mb: float, overhead: dict[str, float]) -> Plan:
    """The plan for runs of ``seconds`` processor seconds and ``peak_mb`` MB each."""
    work = runs * seconds
    start = cores * overhead["start of a worker"]
    duration = (work + start) / cores
    hand_out = overhead["handing out a run, Dask"] / 1e3
    return Plan(
        runs,
        cores,
        core_hours=work / 3600,
        hours=duration / 3600,
        start_hours=start / 3600,
        memory_gb=cores * peak_mb / 1e3,
        runs_per_second=runs / duration,
        dispatch_share=runs * hand_out / duration,
        cases_gb=runs * overhead["a case waiting"] / 1e9,
        disk_gb=runs * max(overhead["a kept run"], BLOCK) / 1e9,
        table_gb=runs * overhead["a row of the table"] / 1e9,
        check_minutes=runs * overhead["check whether a run is kept"] / 6e4,
    )


def cost_lines(table: Table) -> str:
    """Cost of each method as a Markdown table: processor seconds, steps a second, peak of memory, error."""
    lines = [
        "| method | particles | processor time [s] | per used scan [ms] | peak memory [MB] | error [m] |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for i, label in enumerate(table["label"]):
        particles = "-" if np.isnan(table["particles"][i]) else f"{table['particles'][i]:.0f}"
        seconds, scans = table["cpu_seconds"][i], table["scans"][i]
        cells = [label, particles, f"{seconds:.3g}", f"{float(f'{1e3 * seconds / scans:.2g}'):g}"]
        cells += [f"{table['peak_mb'][i]:.0f}", f"{table['ate_rmse_m'][i]:.3f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def plan_lines(plans: list[Plan]) -> str:
    """Plans side by side as a Markdown table."""
    rows = {
        "runs": [f"{p.runs:,}" for p in plans],
        "cores": [f"{p.cores:,}" for p in plans],
        "core hours": [f"{p.core_hours:,.1f}" for p in plans],
        "hours on the clock": [f"{p.hours:.2f}" for p in plans],
        "core hours for starting workers": [f"{p.start_hours:.2f}" for p in plans],
        "memory of all workers [GB]": [f"{p.memory_gb:,.1f}" for p in plans],
        "results a second": [f"{p.runs_per_second:.2f}" for p in plans],
        "handing out: share of one core": [f"{100 * p.dispatch_share:.1f} %" for p in plans],
        "list of cases in memory [GB]": [f"{p.cases_gb:.2g}" for p in plans],
        "kept runs on disk [GB]": [f"{p.disk_gb:.2g}" for p in plans],
        "the table [GB]": [f"{p.table_gb:.2g}" for p in plans],
        "taking it up again: check [min]": [f"{p.check_minutes:.1f}" for p in plans],
    }
    head = "| | " + " | ".join(rows.pop("runs")) + " |\n|---|" + "--:|" * len(plans)
    return "\n".join(
        [head.replace("| |", "| runs |", 1), *(_line(name, cells) for name, cells in rows.items())]
    )


def _line(name: str, cells: list[str]) -> str:
    return f"| {name} | " + " | ".join(cells) + " |"
