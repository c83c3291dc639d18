"""Chapter 11: what closing loops did on simulated drives, stored, and pictures of one long drive before and after.

``python book/_tools/loops.py DATA`` made the tables and the arrays.
"""

from __future__ import annotations

import csv
import io
from functools import cache
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.io.files import read_text
from pfslam.poses import Trajectory
from pfslam_book.show.figures import draw_map
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, new_figure
from pfslam_book.show.tables import Shown

TABLE, STORED = Path(__file__).parent / "loops.csv", Path(__file__).parent / "ring.npz"
COLUMNS = (
    "drive",
    "seed",
    "seconds",
    "before_m",
    "after_m",
    "candidates",
    "accepted",
    "false",
    "run_s",
    "loops_s",
)
GIVEN = Path(__file__).parent / "given.csv"
GIVEN_COLUMNS = ("drive", "seconds", "before_m", "after_m", "accepted", "run_s", "loops_s")
FALSE = 5.0
"""A loop is false if its error is greater than so many of its own standard deviations."""


@cache
def _stored() -> dict[str, np.ndarray]:
    with np.load(STORED, allow_pickle=False) as file:
        return dict(file)


def rows() -> list[dict[str, str]]:
    """Return the stored table, one row for each drive."""
    return list(csv.DictReader(io.StringIO(read_text(TABLE))))


def numbers(column: str, drive: str | None = None) -> np.ndarray:
    """Return one column of the table as numbers, of all drives or of one kind."""
    return np.array([float(row[column]) for row in rows() if drive in (None, row["drive"])])


def drives_table() -> Shown:
    """Return for each kind of drive the errors before and after, and how many loops were found, true and false."""
    kinds, body = dict.fromkeys(row["drive"] for row in rows()), []
    for kind in kinds:
        errors = (f"{100 * np.median(numbers(c, kind)):.1f}" for c in ("before_m", "after_m"))
        counts = (f"{numbers(c, kind).sum():.0f}" for c in ("candidates", "accepted", "false"))
        share = 100 * numbers("loops_s", kind).sum() / numbers("seconds", kind).sum()
        body.append((kind, f"{len(numbers('seed', kind))}", *errors, *counts, f"{share:.0f}"))
    head = ("drive", "runs", "before [cm]", "after [cm]", "tried", "kept", "false", "time [%]")
    return Shown(head, body)


def given(drive: str, column: str) -> float:
    """Return one number of the two recordings that are not stored: "another ring" and "Intel, all relations"."""
    (row,) = (row for row in csv.DictReader(io.StringIO(read_text(GIVEN))) if row["drive"] == drive)
    return float(row[column])


def given_table() -> Shown:
    """Return for each recording that is not stored its errors before and after, and the processor's time that it took.

    The time is that of the run and of all that closes its loops, as a share of the time that the robot drove.
    """
    body = []
    for row in csv.DictReader(io.StringIO(read_text(GIVEN))):
        before, after, seconds, run, loops = (
            float(row[c]) for c in ("before_m", "after_m", "seconds", "run_s", "loops_s")
        )
        shares = (f"{100 * s / seconds:.1f}" for s in (run, loops))
        body.append((row["drive"], f"{100 * before:.2f}", f"{100 * after:.2f}", row["accepted"], *shares))
    head = ("recording", "before [cm]", "after [cm]", "kept", "run [%]", "loops [%]")
    return Shown(head, body)


def path(which: str) -> Trajectory:
    """Return a path of the stored drive: "before", "after" or "truth"."""
    found = _stored()["truth" if which == "truth" else f"{which}_path"]
    return Trajectory(_stored()["t"], found.astype(float))


def error(which: str) -> float:
    """Return the error (m, root mean square) of the stored drive "before" or "after"."""
    return trajectory_error(path(which), path("truth")).ate_rmse_m


def grid(which: str) -> OccupancyGrid:
    """Return a map of the stored drive: "before" or "after"."""
    signs, (x, y, resolution) = _stored()[f"{which}_map"], _stored()[f"{which}_corner"]
    return OccupancyGrid(GridSpec((float(x), float(y)), float(resolution), signs.shape), signs.astype(float))


def ring_picture() -> Picture:
    """Draw the stored drive before and after the revision, the true path beside the estimated one."""
    figure, axes = new_figure(6.8, 6.4, rows=2)
    for ax, which in zip(axes, ("before", "after"), strict=True):
        draw_map(ax, grid(which), f"{which}: {100 * error(which):.0f} cm from the truth")
        _paths(ax, which)
    axes[0].legend(loc="center")
    alt = f"""A ring of four corridors, 60 m by 40 m, driven twice. Before, {100 * error("before"):.0f} cm off: the
    second lap draws its walls beside those of the first. After, {100 * error("after"):.0f} cm: every wall is drawn
    once, and the estimated path lies on the true one."""
    return Picture(figure, alt)


def _paths(ax, which: str) -> None:
    first = path("truth").poses[0]
    c, s = np.cos(first[2]), np.sin(first[2])
    truth = (path("truth").poses[:, :2] - first[:2]) @ [[c, -s], [s, c]]
    ax.plot(*truth.T, color=COLOURS["truth"], linewidth=2.5, alpha=0.4, label="truth")
    ax.plot(*path(which).poses[:, :2].T, color=COLOURS["estimate"], linewidth=1.0, label="estimate")


def corner_picture() -> Picture:
    """Draw one corner of the ring before and after, so that single walls can be seen."""
    figure, axes = new_figure(6.8, 3.6, columns=2)
    far = path("before").poses[:, :2]
    x, y = far[np.argmax(far @ [1.0, 1.0])]
    for ax, which in zip(axes, ("before", "after"), strict=True):
        draw_map(ax, grid(which), which)
        ax.set(xlim=(x - 7.0, x + 3.0), ylim=(y - 7.0, y + 3.0))
    alt = """The far corner of the ring. Before, its walls stand twice, a lap apart. After, once."""
    return Picture(figure, alt)


def scale_picture() -> Picture:
    """Draw what the graph found about the wheels along the drive, beside the errors that were put into them."""
    keys, scale = _stored()["keys"], _stored()["scale"]
    seconds = _stored()["t"][keys] - _stored()["t"][0]
    figure: Figure
    figure, ax = new_figure(6.8, 3.0)
    third = seconds[-1] / 3.0
    for k, true in enumerate((1 / 1.02, 1 / 0.98, 1 / 1.01)):
        ends = [k * third, (k + 1) * third]
        label = "true" if k == 0 else None
        ax.plot(ends, [100 * (true - 1)] * 2, color=COLOURS["truth"], linewidth=3, alpha=0.4, label=label)
    ax.plot(seconds, 100 * scale, color=COLOURS["estimate"], label="found")
    ax.set(xlabel="time [s]", ylabel="scale $s_k$ [%]")
    ax.legend(loc="upper right")
    alt = f"""The scale of the wheels along the drive: put in were -2, +2 and -1 %, one third of the drive each; the
    graph found between {100 * scale.min():.1f} and {100 * scale.max():.1f} %, following the steps."""
    return Picture(figure, alt)
