"""The options of every command."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path

from pfslam import __version__
from pfslam.methods import METHODS

BAD_INPUT, INTERRUPTED, FAULT, SPOILED, DOUBTED = 2, 130, 1, 3, 4
CODES = (
    "Exit codes: 0 all is well, 1 a check, a search or every run of a study failed (or a fault of pfslam), "
    "2 bad input, 3 the data would spoil the run (--anyway runs all the same), "
    "4 most of the result is not to be trusted, 130 interrupted."
)
CHECK_CODES = "Exit codes: 0 no check failed, 1 at least one did, 2 the data set cannot be read."

IMAGES = {"rgb": "colour Image", "depth": "depth Image"}
TOPICS = {"scan": "LaserScan or PointCloud2", "odom": "Odometry", "imu": "Imu"} | IMAGES
HAZARDS = {
    "doors": (4, "four doors open or close while the robot does not see them"),
    "glass": (0.1, "a tenth of the walls is glass"),
    "bumps": (8, "the floor tilts the robot by up to 3 degrees, eight times"),
    "slip": (3, "the wheels lock or spin three times"),
}
"""Options of ``simulate`` without a value: the amount that each stands for, and its help."""


MENDED = {
    "--scan-delay": ("S", "scans were taken S s before their stamps; 0 keeps them"),
    "--lidar-yaw": ("DEG", "the LiDAR looks DEG degrees to the left of what is stated; 0 keeps its yaw"),
    "--odometry-scale": ("F", "the robot drives F times as far as its odometry says; 1 keeps its ways"),
}
"""Options whose numbers scans and odometry tell: the unit of each, and its help."""
FILES = {
    "bash": "_shtab_compgen_files",
    "zsh": "_files",
    "fish": "(__fish_complete_path (commandline -ct))",
}
"""What completes the name of a file in each shell that ``completion`` knows, as shtab calls it."""


class UsageError(Exception):
    """Arguments that the command line does not know."""


class Parser(argparse.ArgumentParser):
    """A parser whose complaints are one line, with the word that was probably meant."""

    def error(self, message: str):
        raise UsageError(f"{message} (see {self.prog} --help)")

    def parse_known_args(self, args=None, namespace=None):
        """Parse what is known, and complain of an option that is not: the commands know their own options best."""
        found, rest = super().parse_known_args(args, namespace)
        if unknown := [word for word in rest if word.startswith("-")]:
            options = list(self._option_string_actions)
            self.error(
                f"unrecognized arguments: {' '.join(rest)}{_meant(unknown[0].partition('=')[0], options)}"
            )
        return found, rest

    def add_argument(self, *names, **options):
        """Add an argument; where it takes a path, a shell completes that."""
        action = super().add_argument(*names, **options)
        if action.type is Path or action.dest == "dataset":
            vars(action)["complete"] = FILES
        return action

    def _check_value(self, action: argparse.Action, value) -> None:
        if action.choices is not None and value not in action.choices:
            choices = list(map(str, action.choices))
            said = (
                f"invalid choice: {value!r}{_meant(str(value), choices)} (choose from {', '.join(choices)})"
            )
            raise argparse.ArgumentError(action, said)


def _meant(word: str, words: Sequence[str]) -> str:
    """Ask whether the most similar of some words was meant; empty if none is similar."""
    close = get_close_matches(word, words, n=1)
    return f", did you mean {close[0]}?" if close else ""


def whole(lowest: int, highest: int):
    """Make a converter for whole numbers within limits."""

    def convert(text: str) -> int:
        if not (text.isascii() and text.isdigit() and len(text) < 20 and lowest <= int(text) <= highest):
            expected = f"a whole number from {lowest} to {highest}"
            raise argparse.ArgumentTypeError(f"{text[:40]!r} is not {expected}")
        return int(text)

    return convert


def number(text: str) -> int | float:
    """Convert text to a number; whether it is in range is for the settings to say."""
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    raise argparse.ArgumentTypeError(f"{text[:40]!r} is not a number")


def number_or_auto(text: str) -> int | float | str:
    """Convert text to a number, but for the word that leaves the number to be found."""
    return text if text == "auto" else number(text)


SEED = whole(0, 2**63 - 1)
YES_OR_NO = argparse.BooleanOptionalAction


def build_parser() -> Parser:
    """Build the parser of all commands and their options."""
    about = "Particle-filter SLAM and floor texture mapping."
    parser = Parser(prog="pfslam", description=about, epilog=CODES, allow_abbrev=False)
    parser.add_argument("-V", "--version", action="version", version=f"pfslam {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    dataset, out, force, as_json = _dataset(), *(Parser(add_help=False) for _ in range(3))
    out.add_argument("--out", type=Path, metavar="DIR", help="folder to write to (default out/DATASET)")
    replaces = "replace files that are there already and were not written by the last run"
    force.add_argument("--force", action="store_true", help=replaces)
    as_json.add_argument("--json", action="store_true", help="print the answer as JSON, and nothing else")

    def command(name: str, what: str, *parents: Parser, epilog: str | None = None):
        about = what[0].upper() + what[1:] + "."
        return commands.add_parser(
            name, help=what, description=about, parents=parents, epilog=epilog, allow_abbrev=False
        ).add_argument

    _add_simulate(
        command("simulate", "write a simulated data set in the course format, with its truth", force)
    )
    command("info", "what a data set holds, and what a run would use", dataset, as_json)
    command(
        "check", "thirteen questions to ask of a data set before a run", dataset, as_json, epilog=CHECK_CODES
    )
    _add_run(command("run", "trajectory, map and floor texture of a data set", dataset, out, force))
    known, what = Parser(add_help=False), "a ROS map: the .yaml file beside its image"
    known.add_argument("map", type=Path, metavar="MAP.yaml", help=what)
    _add_locate(
        command("locate", "where a robot is in a known map, from its drive", known, dataset, force, as_json)
    )
    command("report", "the report's figures for a data set", dataset, out, force)
    _add_convert(
        command("convert", "write a data set into one .npz file, which loads without ROS", dataset, force)
    )
    _add_study(command("study", "many runs over parameters, seeds and data sets", force))
    _add_lab(command("lab", "the book's chapters as notebooks, in JupyterLab"))
    add = command("completion", "a script with which a shell completes commands and options")
    add("shell", choices=tuple(FILES), help='`eval "$(pfslam completion bash)"` in ~/.bashrc')
    return parser


def _dataset() -> Parser:
    """Describe how a data set is named."""
    parser = selection_parser()
    what = "hall, ramp, ring, a set's number, or the path of a ROS bag, an .npz recording, or a CARMEN log"
    parser.add_argument("dataset", metavar="DATASET", help=what)
    folder = "folder of numbered sets (default $PFSLAM_DATA or data)"
    parser.add_argument("--data", type=Path, metavar="DIR", help=folder)
    return parser


def selection_parser() -> Parser:
    """Build the parser of what is used of a data set, and how."""
    parser = Parser(prog="pfslam", add_help=False, allow_abbrev=False)
    parts = parser.add_argument_group("for a part of the drive")
    parts.add_argument("--from", dest="start", type=number, metavar="S", help="from S s after the first scan")
    parts.add_argument("--until", type=number, metavar="S", help="until S s after the first scan")
    limits = "least and largest range (m) to use (default: as the LiDAR says)"
    parts.add_argument("--range", type=number, nargs=2, metavar=("MIN", "MAX"), help=limits)
    mask = (
        "leave out beams: a sector in degrees, as in `info`; may be given several times (default: the beams "
        "that see the robot itself, which `run`, `locate` and `check` find)"
    )
    parts.add_argument("--mask", type=number, nargs=2, action="append", metavar=("LOW", "HIGH"), help=mask)
    parts.add_argument("--no-mask", dest="mask", action="store_const", const=[], help="use all beams")
    mend = parser.add_argument_group(
        "to put right",
        "`run`, `locate` and `check` find these themselves (auto); a number is taken as it is.",
    )
    for option, (unit, what) in MENDED.items():
        mend.add_argument(option, type=number_or_auto, metavar=f"{unit}|auto", help=what)
    alone = "let scans alone tell how the robot moved (default: where there is no odometry)"
    mend.add_argument("--no-odometry", action="store_const", const=[], help=alone)
    bags = parser.add_argument_group("for ROS bags", "Topics are found by their type if they are not named.")
    for name, kind in TOPICS.items():
        bags.add_argument(f"--{name}", metavar="TOPIC", help=f"the topic of {kind} to use")
    place = "place of the LiDAR in the robot's frame, m and rad (default: from /tf_static)"
    frame = (
        "take the odometry from /tf, in this frame, such as odom_combined (default: from Odometry messages)"
    )
    heights = (
        "make scans of a PointCloud2, of what is LOW to HIGH m above the floor (default: from 0.1 m up to as far "
        "above the LiDAR)"
    )
    bags.add_argument("--slice", type=number, nargs=2, metavar=("LOW", "HIGH"), help=heights)
    bags.add_argument("--odom-frame", metavar="FRAME", help=frame)
    bags.add_argument("--lidar-at", type=number, nargs=3, metavar=("X", "Y", "YAW"), help=place)
    return parser


def _add_simulate(add) -> None:
    which = "hall is flat, ramp has slopes, ring has long corridors"
    add("name", choices=("hall", "ramp", "ring"), help=which)
    add("--out", type=Path, required=True, metavar="DIR", help="folder to write to")
    add("--seed", type=SEED, metavar="S", help="seed of the building: each seed gives another one")
    add("--images", type=whole(1, 10**6), metavar="N", help="write every N-th image pair (default none)")
    people = "number of people, who walk ahead of the robot, across its way and past it"
    add("--people", type=number, metavar="N", help=people)
    sweep = "seconds from the first beam of a scan to the last, such as 0.025"
    add("--sweep", type=number, metavar="S", help=sweep)
    for name, (amount, what) in HAZARDS.items():
        add(f"--{name}", action="store_const", const=amount, help=what)


def _add_run(add) -> None:
    add("--method", choices=METHODS, help="which filter (default refined)")
    add("--particles", type=number, metavar="N", help="how many (default 200; per-particle 30, matching 1)")
    add("--every", type=number, metavar="K", help="use every K-th scan (default: about eight scans a second)")
    _add_settings(add, "run", "search.sharpness=30 or lines=false")
    again = "take robust settings where people, glass or noise mislead the scans (default: yes)"
    add("--second-look", action=YES_OR_NO, help=again)
    anyway = "run even if a failed check would spoil the run; summary.json then says so under distrust"
    add("--anyway", action="store_true", help=anyway)
    add("--quiet", action="store_true", help="no progress and no closing words")
    add("--json", action="store_true", help="print summary.json, and nothing else")
    loops = "correct the path where a place is seen again; writes trajectory_revised.tum, map_revised.yaml"
    add("--loops", action="store_true", help=loops)
    add("--texture", action=YES_OR_NO, help="map the floor's texture (default: if there are images)")


def _add_settings(add, what: str, example: str) -> None:
    add("--seed", type=SEED, metavar="S", help="seed of the filter's random numbers (default 0)")
    config = (
        f"settings in TOML, named as in summary.json; or the summary.json of a {what} that is to be repeated"
    )
    add("--config", type=Path, metavar="FILE", help=config)
    one = f"one setting, such as {example}; may be given several times"
    add("--set", action="append", default=[], metavar="NAME=VALUE", help=one)


def _add_locate(add) -> None:
    add("--out", type=Path, metavar="DIR", help="folder to write to (default out/DATASET-located)")
    particles = "most particles after the first scan (default 10000); the first scan has ten times as many"
    add("--particles", type=number, metavar="N", help=particles)
    _add_settings(add, "search", "sigma=0.1 or inject=false")


def _add_convert(add) -> None:
    add("out", type=Path, metavar="OUT", help="the file to write, NAME.npz")
    add("--images", action=YES_OR_NO, default=True, help="keep the images (default: all that there are)")


def _add_study(add) -> None:
    add("file", type=Path, metavar="FILE", help="what to run, in TOML")
    add("--out", type=Path, metavar="DIR", help="folder to write to (default out/NAME)")
    jobs = "processes (default: one on each core)"
    add("--jobs", type=whole(1, 10_000), default=-1, metavar="N", help=jobs)


def _add_lab(add) -> None:
    add("chapter", nargs="?", metavar="NN", help="the chapter to open, such as 05")
    folder = "copy chapters that are not there yet to this folder (default pfslam-chapters)"
    add("--folder", type=Path, default=Path("pfslam-chapters"), metavar="DIR", help=folder)
    add("--copy-only", action="store_true", help="copy the chapters, and open nothing")
