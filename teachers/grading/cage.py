"""The process in which a copy runs: what it may use, what it can see, and how it ends."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pfslam.simulator.cache import cache_folder

ROOT = Path(__file__).resolve().parents[2]
MEMORY, PROCESSES, DISK = 3000, 40, 256
"""What one copy may use: memory in MB, processes at once, and the disk of its scratch folder in MB."""
ROOM = r"""
set -e
room=$1; disk=$2; shift 2
mount -t tmpfs -o size="${disk}m",mode=755 none "$room"
mkdir -p "$room/scratch" "$room/tmp" "$room/dev"
chmod 1777 "$room/scratch" "$room/tmp"
while [ "$1" != -- ]; do
  if [ -L "$1" ]; then mkdir -p "$room/$(dirname "$1")"; cp -P "$1" "$room$1"
  elif [ -d "$1" ]; then mkdir -p "$room$1"; mount --bind "$1" "$room$1"; mount -o remount,bind,ro "$room$1"
  elif [ -e "$1" ]; then mkdir -p "$room/$(dirname "$1")"; : > "$room$1"; mount --bind "$1" "$room$1"
  fi
  shift
done
shift
exec chroot "$room" "$@"
"""
"""A root of its own with Python and the book, both for reading only; nothing else of the machine is in it."""
KINDS = {
    "room": "Each copy ran without network. It saw the system's programs, Python and the book, could change none of "
    "them, and saw no other file.",
    "user": "Each copy ran as a user without a name and without rights. It could read what everybody may read, "
    "and had a network if this machine has one.",
    "limits": "Each copy ran with limits of time, memory and disk alone, as you: it could read your files and had "
    "your network. Grade like this only copies that you trust; elsewhere use Linux or a container.",
}


@dataclass(frozen=True)
class Cage:
    """How copies are kept apart from the teacher here; the best kind that works."""

    kind: str

    @property
    def words(self) -> str:
        """What protects, in words."""
        return KINDS[self.kind]

    def command(self, room: str, words: list[str], user: int) -> list[str]:
        """What starts a program in the cage."""
        if self.kind != "room":
            return words
        root = os.geteuid() == 0
        program = Path(sys.executable)
        places = ["/usr", "/bin", "/lib", "/lib64", "/etc/ld.so.cache", "/dev/null", "/dev/urandom", *PATHS]
        places += [str(cache_folder())]
        places += [str(program.resolve().parents[1]), sys.base_prefix, sys.prefix]
        rights = ["setpriv", "--pdeathsig=KILL", "--no-new-privs", "--bounding-set=-all", "--inh-caps=-all"]
        rights += [f"--reuid={user}", f"--regid={user}", "--clear-groups"] if root else []
        # Who stops the grading, by Ctrl-C or otherwise, stops the copies too.
        spaces = ["setpriv", "--pdeathsig=KILL"]
        spaces += ["unshare", "--net", "--mount", "--ipc", "--pid", "--fork", "--kill-child"]
        spaces += [] if root else ["--map-root-user"]
        places = list(dict.fromkeys(place for place in places if os.path.lexists(place)))
        return [*spaces, "sh", "-c", ROOM, "sh", room, str(DISK), *places, "--", *rights, *words]


PATHS = [str(ROOT / part) for part in ("pfslam", "book/pfslam_book", "teachers/grading")]


def best_cage(scratch: Path) -> Cage:
    """The kind of cage that works on this machine."""
    for kind in ("room", "user"):
        cage = Cage(kind)
        if kind == "user" and os.geteuid() != 0:
            continue
        room = scratch / "trial"
        room.mkdir(exist_ok=True)
        words = [sys.executable, "-c", "import numpy"]
        try:
            done = subprocess.run(
                cage.command(str(room), words, 65534), capture_output=True, **started(cage, 65534)
            )
        except OSError:
            continue
        if done.returncode == 0:
            return cage
    return Cage("limits")


def started(cage: Cage, user: int) -> dict:
    """The arguments with which `subprocess` starts a program in a cage: environment, session and user."""
    kept = {key: os.environ[key] for key in ("LANG", "LC_ALL", "LD_LIBRARY_PATH") if key in os.environ}
    quiet = {
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
        "MPLBACKEND": "Agg",
        "PYTHONDONTWRITEBYTECODE": "1",
        # Each call makes maps and frees them. If the process keeps their memory, Linux need not clear it again.
        "MALLOC_MMAP_THRESHOLD_": str(2**30),
        "MALLOC_TRIM_THRESHOLD_": str(2**30),
    }
    path = {"PATH": "/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin"}
    book = {"PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "book")]), "HOME": "/scratch"}
    other = {"user": user, "group": user, "extra_groups": []} if cage.kind == "user" else {}
    cache = {"PFSLAM_CACHE": str(cache_folder())} if cage.kind == "room" else {}
    return {"env": kept | quiet | path | book | cache, "start_new_session": True, **other}


class Process:
    """A process in a cage with pipes to it; it and all that it started end with `end`."""

    def __init__(self, cage: Cage, scratch: Path, user: int):
        self.room = scratch / "room"
        self.room.mkdir()
        inside = "/scratch" if cage.kind == "room" else str(self.room)
        if cage.kind == "user":
            os.chown(self.room, user, user)
        there, self.writing = os.pipe()
        self.reading, back = os.pipe()
        for end in (there, back):
            with suppress(ImportError, OSError, AttributeError):  # only Linux has wider pipes, for maps
                import fcntl

                fcntl.fcntl(end, fcntl.F_SETPIPE_SZ, 2**20)
        words = [sys.executable, str(ROOT / "teachers" / "grading" / "student.py"), str(there), str(back)]
        words += [str(MEMORY), str(PROCESSES), inside, str(ROOT / "teachers")]
        start = started(cage, user)
        start["env"]["HOME"] = inside
        quiet = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.DEVNULL)
        self.process = subprocess.Popen(
            cage.command(str(self.room), words, user), cwd="/", pass_fds=(there, back), **quiet, **start
        )
        os.close(there)
        os.close(back)
        (scratch / "leader").write_text(str(self.process.pid))  # who ends it if the judge cannot

    def end(self) -> int:
        """Kill the whole group, delete the scratch folder; gives the exit code, negative for a signal."""
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(0.05)
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, signal.SIGKILL)
        code = self.process.wait()
        for end in (self.reading, self.writing):
            os.close(end)
        shutil.rmtree(self.room, ignore_errors=True)
        return code
