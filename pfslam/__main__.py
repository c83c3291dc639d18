"""The command line: ``python -m pfslam``. See ``pfslam.cli.commands`` for what each command does."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from pfslam.errors import DataError

BAD_INPUT, INTERRUPTED, FAULT = 2, 130, 1
EPILOG = (
    "Exit codes: 0 all is well, 1 a check failed (or a fault in pfslam itself), 2 bad input, 130 interrupted."
)
LONGEST_LINE = 600
"""Characters of a complaint; an argument can be any length."""


class UsageError(Exception):
    """Arguments that the command line does not know."""


class Parser(argparse.ArgumentParser):
    """A parser whose complaints are one line; ``later`` adds options to it when its command is chosen."""

    later: Callable[[Parser], None] | None = None

    def error(self, message: str):
        raise UsageError(f"{message} (see {self.prog} --help)")

    def parse_known_args(self, args=None, namespace=None):
        add, self.later = self.later, None
        if add is not None:
            add(self)
        return super().parse_known_args(args, namespace)


def whole(lowest: int, highest: int):
    """Make a converter for whole numbers within limits."""

    def convert(text: str) -> int:
        if not (text.isascii() and text.isdigit() and len(text) < 20 and lowest <= int(text) <= highest):
            raise argparse.ArgumentTypeError(
                f"{text[:40]!r} is not a whole number from {lowest} to {highest}"
            )
        return int(text)

    return convert


def coordinate(text: str) -> float:
    """Convert a finite number of metres or radians."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not abs(value) < 1000.0:
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is not a number below 1000")
    return value


def number(text: str) -> int | float:
    """Convert text to a number; whether it is in range is for the settings to say."""
    for kind in (int, float):
        with suppress(ValueError):
            return kind(text)
    raise argparse.ArgumentTypeError(f"{text[:40]!r} is not a number")


SEED = whole(0, 2**63 - 1)


def build_parser() -> Parser:
    """Build the parser of all commands and their options."""
    parser = Parser(
        prog="pfslam",
        description="Particle-filter SLAM and floor texture mapping.",
        epilog=EPILOG,
        allow_abbrev=False,
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _add_simulate(commands)
    _add_dataset(_command(commands, "info", "what a data set holds, and what a run would use"), out=False)
    command = _command(commands, "check", "nine questions to ask of a data set before a run")
    command.epilog = "Exit codes: 0 no check failed, 1 at least one did, 2 the data set cannot be read."
    _add_dataset(command, out=False)
    _command(commands, "run", "trajectory, map and floor texture of a data set").later = _add_run
    _command(commands, "locate", "where a robot is in a known map, from its drive").later = _add_locate
    _add_dataset(_command(commands, "report", "the report's figures for a data set"))
    _add_convert(commands)
    command = _command(commands, "study", "many runs over parameters, seeds and data sets")
    command.add_argument("file", type=Path, metavar="FILE", help="what to run, in TOML")
    command.add_argument("--out", type=Path, metavar="DIR", help="folder to write to (default out/NAME)")
    command.add_argument("--jobs", type=whole(1, 10_000), default=-1, metavar="N", help="default: all cores")
    command = _command(commands, "lab", "the book's chapters as notebooks, in JupyterLab")
    command.add_argument("chapter", nargs="?", metavar="NN", help="the chapter to open, such as 05")
    folder = "where the chapters are copied to, unless they are there already (default pfslam-chapters)"
    command.add_argument("--folder", type=Path, default=Path("pfslam-chapters"), metavar="DIR", help=folder)
    command.add_argument("--copy-only", action="store_true", help="copy the chapters, and open nothing")
    return parser


def _add_simulate(commands) -> None:
    what = "write a simulated data set in the course format, with its truth"
    command = _command(commands, "simulate", what)
    which = "hall is flat, ramp has slopes, ring has long corridors"
    command.add_argument("name", choices=("hall", "ramp", "ring"), help=which)
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write to")
    command.add_argument("--seed", type=SEED, metavar="S", help="another building for each seed")
    images = "write every N-th image pair (default none)"
    command.add_argument("--images", type=whole(1, 10**6), metavar="N", help=images)
    hazards = command.add_argument_group("what makes a drive hard")
    people = "people who walk ahead of the robot, across its way and past it"
    hazards.add_argument("--people", type=number, metavar="N", help=people)
    sweep = "seconds from the first beam of a scan to the last, such as 0.025"
    hazards.add_argument("--sweep", type=number, metavar="S", help=sweep)
    for name, amount, what in (
        ("doors", 4, "four doors open or close while the robot does not see them"),
        ("glass", 0.1, "a tenth of the walls is glass"),
        ("bumps", 8, "the floor tilts the robot by up to 3 degrees, eight times"),
        ("slip", 3, "the wheels lock or spin three times"),
    ):
        hazards.add_argument(f"--{name}", action="store_const", const=amount, help=what)


def _add_convert(commands) -> None:
    command = _command(commands, "convert", "write a data set into one .npz file, which loads without ROS")
    _add_dataset(command, out=False)
    command.add_argument("out", type=Path, metavar="OUT", help="the file to write, NAME.npz")
    images = "keep the images (default: all that the data set offers)"
    command.add_argument("--images", action=argparse.BooleanOptionalAction, default=True, help=images)


def _add_run(command: Parser) -> None:
    from pfslam.particles import MAX_PARTICLES
    from pfslam.slam import MAX_EVERY, PRESETS

    _add_dataset(command)
    method = "which filter (default refined)"
    command.add_argument("--method", choices=tuple(PRESETS), default="refined", help=method)
    particles = "default 200; 30 with a map for each, 1 for matching"
    command.add_argument("--particles", type=whole(1, MAX_PARTICLES), metavar="N", help=particles)
    every = "use every K-th scan (default: about eight scans a second)"
    command.add_argument("--every", type=whole(1, MAX_EVERY), metavar="K", help=every)
    seed = "of the filter's random numbers (default 0)"
    command.add_argument("--seed", type=SEED, default=0, metavar="S", help=seed)
    loops = "revise the path where places are seen again; writes trajectory_revised.tum, map_revised.yaml"
    command.add_argument("--loops", action="store_true", help=loops)
    texture = "map the floor's texture (default: if there are images)"
    command.add_argument("--texture", action=argparse.BooleanOptionalAction, default=None, help=texture)


def _add_locate(command: Parser) -> None:
    from pfslam.particles import MAX_PARTICLES

    command.add_argument(
        "map", type=Path, metavar="MAP.yaml", help="a ROS map: the .yaml file beside its image"
    )
    _add_dataset(command, default="out/DATASET-located")
    particles = "the most after the first scan, which has ten times as many (default 10000)"
    command.add_argument("--particles", type=whole(1, MAX_PARTICLES), metavar="N", help=particles)
    seed = "of the filter's random numbers (default 0)"
    command.add_argument("--seed", type=SEED, default=0, metavar="S", help=seed)


def _command(commands, name: str, what: str) -> Parser:
    return commands.add_parser(
        name, help=what, description=what[0].upper() + what[1:] + ".", allow_abbrev=False
    )


_TOPICS = {
    "scan": "LaserScan",
    "odom": "Odometry",
    "imu": "Imu",
    "rgb": "colour Image",
    "depth": "depth Image",
}


def _add_dataset(command: Parser, out: bool = True, default: str = "out/DATASET") -> None:
    what = "hall, ramp, ring, a set's number, or the path of a ROS bag, an .npz recording, or a CARMEN log"
    command.add_argument("dataset", metavar="DATASET", help=what)
    command.add_argument(
        "--data", type=Path, metavar="DIR", help="folder of numbered sets (default $PFSLAM_DATA or data)"
    )
    if out:
        command.add_argument(
            "--out", type=Path, metavar="DIR", help=f"folder to write to (default {default})"
        )
    bags = command.add_argument_group("for ROS bags", "Topics are found by their type if they are not named.")
    for name, kind in _TOPICS.items():
        bags.add_argument(f"--{name}", metavar="TOPIC", help=f"the topic of {kind} to use")
    place = "place of the LiDAR in the robot's frame, m and rad (default: from /tf_static)"
    bags.add_argument("--lidar-at", type=coordinate, nargs=3, metavar=("X", "Y", "YAW"), help=place)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    0 if all is well, 1 if ``check`` found something; after one line, 2 for bad input, 130 for Ctrl-C, 1 for a fault.
    """
    try:
        arguments = build_parser().parse_args(argv)
        from pfslam.cli import commands

        code = commands.COMMANDS[arguments.command](arguments)
        sys.stdout.flush()
    except (DataError, UsageError) as error:
        return _complain(str(error), BAD_INPUT)
    except KeyboardInterrupt:
        return _complain("interrupted", INTERRUPTED)
    except BrokenPipeError:  # the reader of our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return INTERRUPTED
    except (OSError, MemoryError) as error:
        return _complain(f"the system refused: {str(error) or type(error).__name__}", BAD_INPUT)
    except Exception as error:
        if os.environ.get("PFSLAM_DEBUG"):
            raise
        message = f"a fault in pfslam itself ({type(error).__name__}: {error}); PFSLAM_DEBUG=1 shows where"
        return _complain(message, FAULT)
    return code or 0


def _complain(message: str, code: int) -> int:
    line = " ".join(message.removeprefix("pfslam: ").split())
    print("pfslam: " + (line if len(line) <= LONGEST_LINE else line[:LONGEST_LINE] + " ..."), file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
