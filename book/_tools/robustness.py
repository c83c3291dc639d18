"""The page about robustness: the hour's drive and the mutants, from the tables that are stored with the book."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from pfslam import grid, limits
from pfslam.io import carmen, carmen_lines, files, images
from pfslam.search import boxes
from pfslam.simulator import drive as drives
from pfslam.teaching.show.pictures import Picture
from pfslam.teaching.show.style import COLOURS, new_figure

TABLES = Path(__file__).resolve().parents[2] / "book" / "tables"
BEAM_BYTES = 4 * 1081
"""One scan in memory: 1081 ranges of four bytes."""


def endurance(folder: Path = TABLES) -> dict[str, np.ndarray]:
    """The stored table of the long drive by column, one value for each minute driven."""
    with open(folder / "endurance.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def memory_picture(drive: dict[str, np.ndarray]) -> Picture:
    """Memory of the process beside the scans that it has been through."""
    figure, axes = new_figure(6.4, 3.8)
    minutes, scans = drive["minutes"], drive["scans"] * BEAM_BYTES / 1e6
    axes.plot(minutes, scans, "--", color=COLOURS["odometry"], label="scans driven through")
    axes.plot(minutes, drive["private_mb"], color=COLOURS["estimate"], label="memory of the process")
    axes.set(xlabel="minutes of the drive", ylabel="MB", ylim=(0, 1.15 * scans[-1]))
    axes.legend(loc="upper left")
    mb = drive["private_mb"]
    return Picture(
        figure,
        f"After {minutes[-1]:.0f} minutes {scans[-1]:.0f} MB of scans have gone through the filter. The memory of the "
        f"process stays between {mb.min():.0f} and {mb.max():.0f} MB.",
    )


def endurance_lines(drive: dict[str, np.ndarray]) -> str:
    """What the long drive came to, and what ten hours would, as Markdown."""
    rows = [
        ("time driven", f"{drive['minutes'][-1]:.0f} min"),
        ("scans recorded, updates made", f"{drive['scans'][-1]:,.0f}, {drive['updates'][-1]:,.0f}"),
        (
            "error, root mean square and largest",
            f"{1e3 * drive['ate_rmse_m'][-1]:.1f} mm, {1e3 * drive['ate_max_m'][-1]:.1f} mm",
        ),
        (
            "memory of the process, first and last minute",
            f"{drive['private_mb'][0]:.0f} MB, {drive['private_mb'][-1]:.0f} MB",
        ),
        (
            "cells of the map, first and last minute",
            f"{drive['map_cells'][0]:,.0f}, {drive['map_cells'][-1]:,.0f}",
        ),
        (
            "cells with hits, first and last minute",
            f"{drive['hit_cells'][0]:,.0f}, {drive['hit_cells'][-1]:,.0f}",
        ),
    ]
    return "\n".join(
        ["| quantity | value |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows)]
    )


def ten_hours(drive: dict[str, np.ndarray]) -> str:
    """Memory and time after ten hours, from straight lines through the second half of the table."""
    half = len(drive["minutes"]) // 2
    minutes = drive["minutes"][half:]
    memory = np.polyfit(minutes, drive["private_mb"][half:], 1)
    work = np.polyfit(minutes, drive["seconds"][half:] / 60.0, 1)
    setup = 9.0 * drive["private_mb"][0]
    first = drive["private_mb"][0]
    return (
        f"In the second half of the drive the memory grew by {60 * memory[0]:.1f} MB an hour: the poses and the notes "
        f"on each step. Ten hours of the same would add {600 * memory[0]:.0f} MB to the run, and take "
        f"{10 * work[0]:.1f} hours on a machine as busy as this one was. The truth, the wheels and the gyro are held "
        f"whole. For an hour they are most of the {first:.0f} MB of the first minute, so allow "
        f"{setup / 1e3:.1f} GB more for ten."
    )


def limit_lines() -> str:
    """The limits that the package states, from the constants that it keeps to, as Markdown."""
    metres = 0.05 * np.sqrt(grid.MAX_CELLS)
    rows = [
        (
            "cells of a map, of a piece cut out of one, or from one end of the cloud to the other",
            f"{grid.MAX_CELLS:,}: {metres:,.0f} m by {metres:,.0f} m of 5 cm",
        ),
        ("an array in an archive", f"{files.MAX_FIELD_BYTES / 2**30:.0f} GiB"),
        ("a text file other than a log", f"{files.MAX_TEXT_BYTES / 2**30:.0f} GiB"),
        ("a line of a log", f"{carmen_lines.MAX_LINE_BYTES / 2**20:.0f} MiB"),
        ("an image file", f"{images.MAX_PNG_BYTES / 2**20:.0f} MiB"),
        ("beams of a scan", f"{limits.MAX_BEAMS:,}"),
        ("the reach of a scanner", f"{limits.MAX_RANGE:,.0f} m"),
        ("particles", f"{limits.MAX_PARTICLES:,}"),
        ("poses in the window of one particle", f"{boxes.MAX_SCORES:,}"),
        ("length of a simulated drive", f"{drives.MAX_HOURS} hours"),
        ("ranges of a simulated drive that are not streamed", f"{files.MAX_FIELD_BYTES / 2**30:.0f} GiB"),
        ("coordinates of a log's odometry", f"{carmen.MAX_COORDINATE:,.0f} m"),
    ]
    return "\n".join(["| what | at most |", "|---|---|", *(f"| {name} | {most} |" for name, most in rows)])


def mutant_lines(folder: Path = TABLES) -> str:
    """The stored table of the mutants, as Markdown."""
    with open(folder / "mutants.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    lines = ["| equation | functions | changes | noticed |", "|---|---|---|---|"]
    for row in rows:
        names = ", ".join(f"`{name}`" for name in row["functions"].split())
        lines.append(f"| {row['equation']} | {names} | {row['mutants']} | {row['noticed']} |")
    made, noticed = (sum(int(row[name]) for row in rows) for name in ("mutants", "noticed"))
    return "\n".join([*lines, f"| all | | {made} | {noticed} |"])


def core_lines(folder: Path = TABLES) -> str:
    """The stored tables of the core by module, as Markdown: what the tests run, and what they notice of a sample."""
    with open(folder / "coverage.csv", encoding="utf-8") as file:
        run = {row["module"]: row for row in csv.DictReader(file)}
    with open(folder / "mutants_core.csv", encoding="utf-8") as file:
        spoilt = {row["module"]: row for row in csv.DictReader(file)}
    tried, noticed = (sum(int(row[name]) for row in spoilt.values()) for name in ("tried", "noticed"))
    spoilt["all"] = {"tried": tried, "noticed": noticed}
    lines = [
        "| module | lines | branches | run by the tests | changes tried | noticed |",
        "|---|---|---|---|---|---|",
    ]
    for name, row in run.items():
        sample = spoilt.get(name, {"tried": "", "noticed": ""})
        lines.append(
            f"| {name if name == 'all' else f'`{name}`'} | {row['lines']} | {row['branches']} | {row['share']} % | "
            f"{sample['tried']} | {sample['noticed']} |"
        )
    return "\n".join(lines)


def core_words(folder: Path = TABLES) -> str:
    """What the sample of changes says: noticed at first, with its standard error, and after tests for the survivors."""
    with open(folder / "mutants_core.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    made, tried, now, first = (
        sum(int(row[name]) for row in rows) for name in ("mutants", "tried", "noticed", "at_first")
    )
    share = first / tried
    error = np.sqrt(share * (1.0 - share) / tried * (1.0 - tried / made))
    return (
        f"Of {made:,} possible changes, {tried} were tried, evenly spread. {first} were noticed at once: "
        f"{100 * share:.1f} %, with a standard error of {100 * error:.1f} % for all changes. Then tests were written "
        f"for those that were missed, and as large a sample, most of it the same, was tried again: {now} are noticed "
        f"now, {100 * now / tried:.1f} %. That is no estimate for changes outside the sample."
    )
