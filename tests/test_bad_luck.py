"""Faults of the machine: a kill, a full disk, a folder nobody may write to, too little memory, Ctrl-C, two at once.

Each ends in one line that says what happened, leaves nothing half-written under a final name, and the next run works.
What one process can fake is in ``test_cli``, ``test_datasets`` and ``test_study``; here the faults are real.
"""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from box_recording import box_recording

from pfslam.errors import DataError
from pfslam.io.course import save_course
from pfslam.io.files import atomic_write, write_npz
from pfslam.io.formats import read_tum
from pfslam.study import read_table

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.name == "nt", reason="signals and limits of POSIX"),
]
RUN = "run 7 --particles 5 --out o"
STUDY = """name = "s"
[common]
dataset = "7"
data_dir = {data!r}
particles = 2
seed = {{ count = 3 }}
[[variant]]
label = "few"
"""
KILOBYTE = 1024


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """The box recording as set 7, with images."""
    folder = tmp_path_factory.mktemp("data")
    save_course(box_recording(), 7, folder, image_every=1)
    return folder


@pytest.fixture
def work(tmp_path, data):
    """An empty folder to work in, but for a study of three short runs."""
    (tmp_path / "s.toml").write_text(STUDY.format(data=str(data)))
    return tmp_path


def begin(words, folder, data, limit=None):
    """The command line in a process of its own session, as a terminal starts it; ``limit`` is (name, bytes)."""
    lines = ["import sys", "from pfslam.__main__ import main"]
    if limit is not None:
        lines += ["import resource", f"resource.setrlimit(resource.{limit[0]}, ({limit[1]}, {limit[1]}))"]
    code = "; ".join([*lines, f"sys.exit(main({words.split()!r}))"])
    here = {"PFSLAM_DATA": str(data), "PFSLAM_CACHE": str(folder / "cache"), "OPENBLAS_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=folder,
        env=os.environ | here,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def finish(process):
    """(exit code, what it printed, what it complained)."""
    said, complained = process.communicate(timeout=240)
    return process.returncode, said, complained


def wait_for(folder, pattern, process):
    """Wait until the process has made a file; it must not end before."""
    while not any(folder.glob(pattern)):
        assert process.poll() is None, finish(process)
        time.sleep(0.005)


def files(folder):
    """What is there under its final name."""
    return sorted(p for p in folder.rglob("*") if p.is_file() and not p.name.startswith("."))


def works(words, folder, data):
    """The same command without the fault."""
    code, said, complained = finish(begin(words, folder, data))
    assert (code, complained) == (0, ""), complained
    return said


# ---- a disk that is full: the system refuses to let a file grow ----------------------------------


@pytest.mark.parametrize(
    ("words", "room"),
    [
        (RUN, 2 * KILOBYTE),
        ("simulate hall --out o --seed 3", 100 * KILOBYTE),
        ("study s.toml --out o --jobs 1", 100),
    ],
    ids=["run", "simulate", "study"],
)
def test_a_disk_that_fills_up(work, data, words, room):
    code, said, complained = finish(begin(words, work, data, ("RLIMIT_FSIZE", room)))
    assert (code, said) == (2, "")
    assert complained.startswith("pfslam: ")
    assert complained.count("\n") == 1
    assert "File too large" in complained
    assert "o/" in complained
    assert not any(p.name.endswith(".tmp") for p in work.rglob("*"))
    works(words, work, data)


def test_a_cache_without_room_costs_time_but_nothing_else(work, data):
    """The scans of hall are 20 MB; a file may have one. The run goes on without keeping them, and says so."""
    words = "run hall --method matching --every 400 --no-texture --out o"
    code, said, complained = finish(begin(words, work, data, ("RLIMIT_FSIZE", 1024 * KILOBYTE)))
    assert code == 0
    assert "results are in o" in said
    lines = [line for line in complained.replace("\r", "\n").splitlines() if line.startswith("pfslam")]
    assert len(lines) == 1
    assert "not kept for the next time" in lines[0]
    assert not files(work / "cache")
    first = (work / "o" / "trajectory.tum").read_bytes()
    code, _, complained = finish(begin(words, work, data))
    assert (code, (work / "o" / "trajectory.tum").read_bytes()) == (0, first)
    assert len(files(work / "cache")) == 1


# ---- folders that cannot be written --------------------------------------------------------------


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="no /proc")
@pytest.mark.parametrize(
    "words",
    ["run 7 --particles 2", "simulate hall", "study s.toml --jobs 1", "report 7"],
    ids=lambda w: w.split()[0],
)
def test_a_folder_nobody_may_write_to(work, data, words):
    """Not even root makes a folder in /proc. The refusal comes at once, before any work is done."""
    code, said, complained = finish(begin(f"{words} --out /proc/results", work, data))
    assert (code, said) == (2, "")
    assert complained.count("\n") == 1
    assert "/proc/results" in complained
    assert files(work) == [work / "s.toml"]


# ---- memory --------------------------------------------------------------------------------------


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps to RLIMIT_AS")
@pytest.mark.parametrize("method", ["refined", "matching"])
@pytest.mark.parametrize("leap", [5e4, 1e7])
def test_odometry_that_leaps_ends_in_one_line_and_takes_no_more_than_two_gigabytes(work, data, leap, method):
    """Fifty kilometres in a second, or ten thousand: the cloud spreads over a country, the map over a continent."""
    ranges = " ".join(["2.5"] * 90)
    lines = [
        f"FLASER 90 {ranges} {x} 0 0 {x} 0 0 {k} robot {k}" for k, x in enumerate([0, 0.1, leap, leap], 1)
    ]
    (work / "leap.log").write_text("\n".join(lines) + "\n")
    limit = ("RLIMIT_AS", 2 * 2**30)
    words = f"run leap.log --out o --method {method} --particles {20 if method == 'refined' else 1}"
    code, _, complained = finish(begin(words, work, data, limit))
    assert code == 2
    assert complained.count("\n") == 1
    assert "Traceback" not in complained
    assert files(work / "o") == []
    if leap == 1e7:  # over fifty kilometres by fifteen metres a map may be drawn, where there is room for it
        who = "map" if method == "matching" else "particles"
        assert complained.startswith(f"pfslam: leap, scan at 3.000 s, {who}: cells: found ")
        assert complained.endswith("at most 400000000 cells: look for a leap in odometry or ranges\n")


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps to RLIMIT_AS")
def test_a_hundred_thousand_particles_fit_into_two_gigabytes(work, data):
    words = "run 7 --particles 100000 --every 20 --no-texture --out o"
    assert finish(begin(words, work, data, ("RLIMIT_AS", 2 * 2**30)))[0] == 0
    assert len(read_tum(work / "o" / "trajectory.tum")) > 1


# ---- Ctrl-C: the terminal sends it to the process and all its workers ----------------------------


@pytest.mark.parametrize(
    ("words", "begun"),
    [
        ("run hall --every 1 --particles 2000 --out o", "o"),
        ("simulate hall --seed 3 --images 20 --out o", "o/*.npz"),
        ("study long.toml --out o --jobs 2", "o/runs/*/*.json"),
    ],
    ids=["run", "simulate", "study"],
)
def test_ctrl_c(work, data, words, begun):
    (work / "long.toml").write_text(
        STUDY.format(data=str(data)).replace("count = 3", "count = 2000").replace("= 2\n", "= 200\n")
    )
    process = begin(words, work, data)
    wait_for(work, begun, process)
    os.killpg(process.pid, signal.SIGINT)
    code, said, complained = finish(process)
    assert (code, said) == (130, "")
    assert complained.replace("\r", "\n").rstrip("\n").splitlines()[-1] == "pfslam: interrupted"
    assert "Traceback" not in complained
    for path in (p for p in files(work) if p.suffix == ".npz"):
        with np.load(path) as whole:
            assert whole.files


# ---- kill -9 -------------------------------------------------------------------------------------


def test_what_a_kill_leaves_is_hidden_and_stands_in_nobodys_way(work, data):
    """Killed in the middle of writing, a process cannot tidy up: a hidden file stays, which nobody reads."""
    code = "import os, signal; from pfslam.io.files import atomic_write\nwith atomic_write('o/odometry.tum') as f: {}"
    work_in_vain = code.format("f.write(b'x' * 5000); f.flush(); os.kill(os.getpid(), signal.SIGKILL)")
    killed = subprocess.run([sys.executable, "-c", work_in_vain], cwd=work)
    assert killed.returncode == -signal.SIGKILL
    (left,) = (work / "o").iterdir()
    assert left.name.startswith(".odometry.tum.")
    assert left.name.endswith(".tmp")
    works(RUN, work, data)
    assert left not in files(work)
    assert len(read_tum(work / "o" / "odometry.tum")) > 10


def test_a_study_killed_with_all_its_workers_goes_on_where_it_was(work, data):
    words = "study s.toml --out o --jobs 2"
    process = begin(words, work, data)
    wait_for(work, "o/runs/*/*.json", process)
    os.killpg(process.pid, signal.SIGKILL)
    finish(process)
    before = {path: path.stat().st_mtime_ns for path in work.glob("o/runs/*/*.json")}
    assert before
    works(words, work, data)
    table = read_table(work / "o" / "s.csv")
    assert list(table["error"]) == ["", "", ""]
    assert all(path.stat().st_mtime_ns == when for path, when in before.items())  # nothing was run twice


# ---- two at once ---------------------------------------------------------------------------------


def test_two_runs_into_one_folder_leave_whole_files(work, data):
    both = [begin(RUN, work, data) for _ in range(2)]
    results = [finish(process) for process in both]
    assert [(code, complained) for code, _, complained in results] == [(0, "")] * 2
    found = {path.name: path.read_bytes() for path in files(work / "o")}
    works(RUN, work, data)
    again = {path.name: path.read_bytes() for path in files(work / "o")}
    assert found.keys() == again.keys()
    for name in found.keys() - {"summary.json"}:  # which holds seconds
        assert found[name] == again[name], name


def test_two_writers_of_one_file_never_mix(tmp_path):
    """Each has a hidden file of its own; the last to finish wins, whole."""
    path = tmp_path / "a"
    with atomic_write(path) as first:
        with atomic_write(path) as second:
            second.write(b"second")
            first.write(b"first")
        assert path.read_bytes() == b"second"
    assert path.read_bytes() == b"first"
    assert list(tmp_path.iterdir()) == [path]


def test_a_failure_while_writing_leaves_the_old_file_as_it_was(tmp_path):
    path = tmp_path / "a.npz"
    write_npz(path, x=np.arange(3))
    old = path.read_bytes()

    def fail_half_way():
        with atomic_write(path) as file:
            file.write(b"half")
            raise OSError(28, "No space left on device")

    with pytest.raises(DataError, match=r"a\.npz.*No space left on device"):
        fail_half_way()
    assert path.read_bytes() == old
    assert list(tmp_path.iterdir()) == [path]
