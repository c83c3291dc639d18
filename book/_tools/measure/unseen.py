"""Public logs on which nothing was tuned: does what the command says of a run agree with its map?

The logs are not part of the book. ``python -m measure.unseen HOST`` clones with git, from a host whose address is
given, the repositories that hold them, and writes each log to ``unseen`` in ``$PFSLAM_DATA``: a bag as it is, a text
log in CARMEN's format. The robots were parted into two halves by the alphabet before any log was looked at, and the
second half was run once, after the last change of the program. Each map was judged by eye before what the run said
was read.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pfslam_book.show.tables import read_table, stored_studies

import pfslam
from measure import cases
from pfslam.cli.commands import MOSTLY
from pfslam.cli.parser import DOUBTED, SPOILED
from pfslam.evaluation.corrections import find_corrections
from pfslam.io.datasets import data_folder
from pfslam.io.files import write_csv, write_text
from pfslam.io.selection import select as corrected
from pfslam.refined.health import in_doubt
from pfslam.refined.run import RefinedResult, judged
from pfslam.run import run_slam
from pfslam.study import Case, Study
from pfslam.study.table import Table

TABLES = Path(__file__).resolve().parents[2] / "tables"
TUNING, UNTOUCHED = "first half", "second half"


class Source(NamedTuple):
    """Who recorded logs with which robot and LiDAR, and where they are: repository, licence, commit, and their files.

    ``files`` has the name here and the path there. ``read`` makes a CARMEN log of a text; a bag needs none.
    """

    robot: str
    lidar: str
    half: str
    repository: str
    licence: str
    commit: str
    files: dict[str, str]
    read: Callable[[str], str] | None = None


def wean(text: str) -> str:
    """Translate lines of ``L x y theta laser_x laser_y laser_theta 180 ranges stamp``, in cm and rad."""
    lines = []
    for words in (line.split() for line in text.splitlines() if line.startswith("L ")):
        values = np.array(words[1:], dtype=float)
        robot, laser = (pose / [100.0, 100.0, 1.0] for pose in (values[:3], values[3:6]))
        ranges = " ".join(f"{cm / 100:.2f}" for cm in values[6:-1])
        poses = " ".join(f"{value:.4f}" for value in [*laser, *robot])
        lines.append(f"FLASER {len(values) - 7} {ranges} {poses} {values[-1]:.6f} host {values[-1]:.6f}")
    return "\n".join(lines) + "\n"


def mines(text: str) -> str:
    """Translate lines of a stamp (us), counts of the left and the right wheel in columns 2 and 3, and ranges (mm).

    Wheels of 77 mm radius and 2,000 counts a turn, 165 mm from the middle; the scanner looks from -120 to 120 degrees.
    """
    rows = [np.array(line.split()[:-1], dtype=float) for line in text.splitlines()]
    t, counts = np.array([row[0] / 1e6 for row in rows]), np.array([row[2:4] for row in rows])
    left, right = (np.diff(counts, axis=0) * 2.0 * np.pi * 0.077 / 2000.0).T
    angles = np.radians(np.linspace(-120.0, 120.0, len(rows[0]) - 24))
    ranges = np.array([row[24:] for row in rows]) / 1000.0
    return carmen(t, 0.5 * (left + right), (right - left) / 0.33, ranges, angles, 4.04, 0.145)


def broombot(text: str) -> str:
    """Translate lines of the way, the turn and the time since the last one, and ranges (m) all around.

    The repository does not say in which units: they are taken for cm, degrees and s. A scan has some 600 beams, their
    number changes, and most see nothing.
    """
    rows = [np.array(line.strip(" ,").split(","), dtype=float) for line in text.splitlines() if line.strip()]
    way, turn, elapsed = np.array([row[:3] for row in rows[1:]]).T
    scans = np.zeros((len(way), 720))
    for scan, row in zip(scans, rows[1:], strict=True):
        seen = (row[3:] >= 0.12) & (row[3:] <= 10.0)
        scan[(np.arange(len(row) - 3) * 720 // (len(row) - 3))[seen]] = row[3:][seen]
    angles = np.radians(np.arange(720) / 2.0)
    return carmen(1.0 + np.cumsum(elapsed), way[1:] / 100.0, np.radians(turn[1:]), scans, angles, 10.1, 0.0)


def carmen(
    t: np.ndarray,
    way: np.ndarray,
    turn: np.ndarray,
    ranges: np.ndarray,
    angles: np.ndarray,
    farthest: float,
    ahead: float,
) -> str:
    """Write stamps ``(K,)`` (s), ways ``(K - 1,)`` (m), turns (rad) and ranges ``(K, B)`` as lines of a CARMEN log."""
    heading = np.append(0.0, np.cumsum(turn))
    place = np.append(0.0, np.cumsum(way * np.exp(1j * (heading[:-1] + 0.5 * turn))))
    lines = [f"PARAM robot_frontlaser_offset {ahead} 0 host 0"]
    view = f"{angles[0]:.7f} {np.ptp(angles):.7f} {angles[1] - angles[0]:.9f} {farthest} 0.01 0 {len(angles)}"
    for stamp, at, theta, scan in zip(t, place, heading, ranges, strict=True):
        end = f"{stamp:.6f} host {stamp:.6f}"
        lines.append(f"ODOM {at.real:.5f} {at.imag:.5f} {theta:.6f} 0 0 0 {end}")
        lines.append(f"RAWLASER1 0 {view} {' '.join(f'{r:.3f}' for r in scan)} 0 {end}")
    return "\n".join(lines) + "\n"


SOURCES = (
    Source(
        "Broombot",
        "YDLIDAR X4, 7.5 Hz",
        TUNING,
        "BradleyWood/Lidar-Dataset",
        "none stated",
        "ddafe8dac01717f45d55130e166cc5091c675583",
        {
            f"broombot-{k}.log": f"data/2019-05-03-19%3A{at}.dat"
            for k, at in enumerate(("38%3A28", "39%3A14", "42%3A50", "44%3A15"), start=1)
        },
        broombot,
    ),
    Source(
        "rover of Mines ParisTech",
        "Hokuyo URG-04LX, 10 Hz",
        TUNING,
        "simondlevy/BreezySLAM",
        "LGPL 3",
        "1170285cd42a88300eddd275fc3df36e642e3a2e",
        {f"mines-{k}.log": f"examples/exp{k}.dat" for k in (1, 2)},
        mines,
    ),
    Source(
        "Neato robot vacuum, Olin College",
        "Neato LDS, 5 Hz",
        TUNING,
        "ksoltan/robot_localization",
        "none stated",
        "f04adec9fc2feef93a5e29a5dbc52d46ddbe153c",
        {f"neato-{k}.bag": f"robot_localizer/bags/{k}.bag" for k in ("left_side", "middle", "right_side")},
    ),
    Source(
        "Pioneer 3-DX",
        "726 beams, 10 Hz",
        UNTOUCHED,
        "LCCZK/MOB_Coursework_2",
        "MIT",
        "57c512aaaa12dbe421d2afe807b2b20fc8289c96",
        {
            f"pioneer-{k}/{name}": f"src/pf_localisation/data/real_data/trace{k}/{name}"
            for k in (0, 1)
            for name in (f"trace{k}.db3", "metadata.yaml")
        },
    ),
    Source(
        "TurtleBot 4, Olin College",
        "RPLIDAR A1, 7.7 Hz",
        UNTOUCHED,
        "Moampane/robot_localization",
        "none stated",
        "3862738e6082efb4f33ec90385e5559d20a2d1e7",
        {
            f"turtlebot4/{name}": f"bags/macfirst_floor_take_2/{name}"
            for name in ("macfirst_floor_take_2_0.db3", "metadata.yaml")
        },
    ),
    Source(
        "robot in Wean Hall, Carnegie Mellon University",
        "180 beams, 5 to 9 Hz",
        UNTOUCHED,
        "deanhgit/16-831_Lab1",
        "none stated",
        "d99a7691615fbe683e9c0c1f70e74f2066b478c3",
        {f"wean-{k}.log": f"log/robotdata{k}.log" for k in range(1, 6)},
        wean,
    ),
)
LOGS = {name.partition("/")[0]: source for source in SOURCES for name in source.files}
"""The source of each log."""
MAPS = {
    "broombot-1.log": (False, "walls are drawn two to four times"),
    "broombot-2.log": (False, "walls are drawn two to four times"),
    "broombot-3.log": (False, "walls are drawn as circles"),
    "broombot-4.log": (False, "one wall is drawn three times"),
    "mines-1.log": (True, "walls once; two rounds meet; both wings parallel to 3 degrees"),
    "mines-2.log": (False, "walls once, but the two wings are turned by 6 degrees against each other"),
    "neato-left_side.bag": (True, "a rectangle, of the same size as in the two other drives"),
    "neato-middle.bag": (True, "a rectangle, of the same size as in the two other drives"),
    "neato-right_side.bag": (True, "a rectangle, of the same size as in the two other drives"),
    "pioneer-0": (True, "walls once, rooms square"),
    "pioneer-1": (True, "walls once, rooms square"),
    "turtlebot4": (False, "a corridor is bent by 12 degrees, and one of its walls drawn twice"),
    "wean-1.log": (True, "walls once, the corridor straight there and back"),
    "wean-2.log": (True, "walls once, the corridor straight there and back"),
    "wean-3.log": (True, "walls once, the corridor straight there and back"),
    "wean-4.log": (True, "walls once, the corridor straight there and back"),
    "wean-5.log": (True, "walls once, the corridor straight there and back"),
}
"""Whether the map of each log's run is right, and what tells."""


def load(name: str) -> pfslam.Recording:
    """Load a log."""
    return pfslam.load(data_folder() / "unseen" / name)


def run(log: pfslam.Recording) -> RefinedResult:
    """Run what is corrected of a log as the command does."""
    rng = np.random.default_rng(0)
    return judged(log, run_slam(log, pfslam.SlamConfig.refined(), rng=rng, keep_particles=False))


def said(case: Case) -> dict[str, Any]:
    """Run one log as the command does, and tell what it says."""
    log = load(case.label)
    found, lines, findings = find_corrections(log)
    failed = [f for f in findings if f.severity in ("warning", "stop")]
    told: dict[str, Any] = {
        "seconds": float(np.ptp(log.scans().t)),
        "scans": len(log.scans().t),
        "corrected": "; ".join(line.partition(": ")[0] for line in lines),
        "notes": "; ".join(f"{f.question} {f.found}" for f in findings if f.severity == "note"),
        "failed": len(failed),
        "complaints": "; ".join(f"{f.question} {f.found}" for f in failed),
    }
    if any(finding.severity == "stop" for finding in findings):
        return told | {"exit": SPOILED}
    result = run(corrected(log, **found))
    doubted = in_doubt(result.distrust, result.trajectory.t).mean()
    return told | {
        "metres": np.hypot(*np.diff(result.trajectory.poses[:, :2], axis=0).T).sum(),
        "second_look": int(result.second_look),
        "doubted": doubted,
        "reasons": "; ".join(str(stretch["reason"]) for stretch in result.distrust),
        "exit": DOUBTED if doubted > MOSTLY else 0,
    }


STUDIES = [
    Study(
        "unseen",
        "Public logs on which nothing was tuned, run as the command runs them: what was said.",
        cases("log", log=LOGS),
        run=said,
    )
]


def write_tables() -> None:
    """Write the tables of the page: the sources, what was said of each log, and how often it agrees with the map."""
    if "unseen" in stored_studies():
        table = read_table("unseen")
        write_csv(TABLES / "unseen_sources.csv", sources())
        write_csv(TABLES / "unseen.csv", by_log(table))
        write_csv(TABLES / "unseen_counts.csv", counts(table))


def sources() -> list[tuple[str, ...]]:
    """One line for each robot: where its logs are, and under which licence."""
    rows = [("robot", "LiDAR", "logs", "repository and commit", "licence")]
    for source in SOURCES:
        logs = ", ".join(name for name, of in LOGS.items() if of is source)
        place = f"`{source.repository}` `{source.commit[:10]}`"
        rows.append((source.robot, source.lidar, logs, place, source.licence))
    return rows


def by_log(table: Table) -> list[tuple[str, ...]]:
    """One line for each log: the judgement of its map, and what the run said."""
    rows = [("log", "way (m)", "map", "what tells", "put right", "warnings", "in doubt (%)", "exit")]
    for k, name in enumerate(table["label"].tolist()):
        right, why = MAPS[name]
        way, doubted = (table[column][k] for column in ("metres", "doubted"))
        words = put_right(table["corrected"][k]), table["complaints"][k] or "none"
        shares = ("" if np.isnan(way) else f"{way:.0f}", "" if np.isnan(doubted) else f"{100 * doubted:.0f}")
        rows.append(
            (
                name,
                shares[0],
                "right" if right else "wrong",
                why,
                *words,
                shares[1],
                f"{table['exit'][k]:.0f}",
            )
        )
    return rows


def put_right(corrected: str) -> str:
    """Say what was corrected, and count the sectors of beams that were left out."""
    lines = corrected.split("; ") if corrected else []
    others = [line for line in lines if not line.startswith("beams")]
    if own := len(lines) - len(others):
        others.insert(0, f"beams that see the robot, in {own} sector{'s' * (own > 1)}")
    return "; ".join(others) or "nothing"


def counts(table: Table) -> list[tuple[str, ...]]:
    """One line for each half and one for both: how many maps are right or wrong, and how many were told of."""
    right = np.array([MAPS[name][0] for name in table["label"].tolist()])
    half = np.array([LOGS[name].half for name in table["label"].tolist()])
    stopped = table["exit"] == SPOILED
    told = stopped | (table["failed"] > 0) | (np.nan_to_num(table["doubted"]) > 0)
    rows = [("logs", "right maps", "with a word", "stopped", "wrong maps", "with a word")]
    for name in (TUNING, UNTOUCHED, "all"):
        of = (half == name) | (name == "all")
        some = (right, right & told, right & stopped, ~right, ~right & told)
        rows.append((name, *(str(np.count_nonzero(mask & of)) for mask in some)))
    return rows


def fetch(host: str) -> None:
    """Clone each repository from a host, an address to which ``/owner/name`` is added, and write its logs."""
    for source in SOURCES:
        with tempfile.TemporaryDirectory() as clone:
            git = partial(subprocess.run, check=True, capture_output=True)
            git(["git", "clone", "--no-checkout", f"{host}/{source.repository}", clone])
            for name, path in source.files.items():
                content = git(["git", "-C", clone, "show", f"{source.commit}:{path}"]).stdout
                out = data_folder() / "unseen" / name
                out.parent.mkdir(parents=True, exist_ok=True)
                if source.read is None:
                    out.write_bytes(content)
                else:
                    write_text(out, source.read(content.decode()))


if __name__ == "__main__":
    fetch(*sys.argv[1:])
