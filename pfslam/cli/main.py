"""From a command line to a command, and what becomes of errors: one line and an exit code.

Nothing but the parser is imported before a command is known, so that ``--help`` and mistyped options are answered at
once.
"""

from __future__ import annotations

import os
import re
import shlex
import sys
from collections.abc import Sequence
from contextlib import suppress

from pfslam.cli.parser import BAD_INPUT, FAULT, INTERRUPTED, UsageError, build_parser
from pfslam.errors import DataError, printable

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""What users set who want linear algebra in several threads: on matrices as small as ours they only wait."""
LONGEST_LINE = 600
"""Characters of a complaint; an argument can have any length."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    0 if all is well, 1 if ``check`` found something or ``locate`` did not find the robot, 4 if most of a run is in
    doubt; after one line, 2 for bad input, 3 for data that would spoil a run, 130 for Ctrl-C, 1 for a fault.
    """
    _make_streams_safe()
    try:
        arguments = build_parser().parse_args(argv)
        arguments.line = shlex.join(["pfslam", *(sys.argv[1:] if argv is None else argv)])
        if not any(name in os.environ for name in THREADS):
            os.environ |= dict.fromkeys(THREADS, "1")  # in time: NumPy is imported with the commands
        from pfslam.cli import commands

        code = getattr(commands, f"{arguments.command}_command")(arguments)
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
        if reason := _unmet(error):
            return _complain(f"{reason}; install pfslam again, which brings what it needs", BAD_INPUT)
        message = f"a fault in pfslam itself ({type(error).__name__}: {error}); PFSLAM_DEBUG=1 shows where"
        return _complain(message, FAULT)
    return code or 0


def _unmet(error: Exception) -> str:
    """Say which package is missing or too old, if that may be why something failed; empty if all is as it should be."""
    name = (getattr(error, "name", None) or "").partition(".")[0]
    if isinstance(error, ImportError) and name != "pfslam":
        return f"the package {name} is missing or too old ({error})"
    from importlib import metadata

    with suppress(metadata.PackageNotFoundError):  # a checkout that is not installed
        for need in metadata.requires("pfslam") or ():
            package, _, least = need.partition(";")[0].partition(">=")
            with suppress(metadata.PackageNotFoundError):  # of an extra, or one with other limits
                if _numbers(found := metadata.version(package.strip())) < _numbers(least):
                    return f"the package {package} is too old: found {found}, expected {least} or newer"
    return ""


def _numbers(version: str) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", version)]


def _make_streams_safe() -> None:
    """Let a closed stream drop what is written to it, and one with few characters write the others as numbers."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 - it stays open
        with suppress(AttributeError):  # a stream that somebody put in its place
            getattr(sys, name).reconfigure(errors="backslashreplace")


def _complain(message: str, code: int) -> int:
    line = printable(" ".join(message.removeprefix("pfslam: ").split()))
    print("pfslam: " + (line if len(line) <= LONGEST_LINE else line[:LONGEST_LINE] + " ..."), file=sys.stderr)
    return code
