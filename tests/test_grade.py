"""A class of hostile copies is graded: each has its line, and none counts more than it deserves or stops the rest."""

import csv
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from html import unescape
from pathlib import Path

import grade
import numpy as np
import pytest
from copies import CHECK, SOLUTION, exercises, source
from grading import cage, copies_of, judge, pages, pieces
from grading.wire import Gone, TooSlow, Wire

ROOT = Path(__file__).resolve().parents[1]
CHAPTER = ROOT / "notebooks" / "02_occupancy_grid.ipynb"
pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="grading needs Linux or macOS")

# ---- the wire


@pytest.fixture
def wires():
    """The judge's end of a wire, and the student's, which is served by a thread."""
    there, writing = os.pipe()
    reading, back = os.pipe()
    student, ours = Wire(there, back, trusts=True), Wire(reading, writing, trusts=False)
    ours.deadline = time.monotonic() + 5.0

    def serve():
        with suppress(Gone):
            while True:
                student.serve(*student.receive())

    thread = threading.Thread(target=serve)
    thread.start()
    yield ours, student
    os.close(writing)
    thread.join()
    for end in (there, reading, back):
        os.close(end)


def called(wires, function, *arguments):
    """What a student's function answers across the wire."""
    ours, student = wires
    student.functions[:] = [function]
    return ours.call(0, *arguments)


VALUES = [
    None,
    ...,
    True,
    3,
    2.5,
    np.inf,
    "ü",
    (1, [2.0, "a"]),
    {"A": "healthy", 1: None},
    np.float32(1.5),
    np.int64(-2),
]


@pytest.mark.parametrize("value", VALUES, ids=str)
def test_values_cross_the_wire_as_they_are(wires, value):
    found = called(wires, lambda x: x, value)
    assert found == value
    assert type(found) is type(value)


def test_arrays_lists_and_generators_are_the_callers_own(wires):
    maps, rng = [np.arange(6.0).reshape(2, 3)[:, ::-1], np.zeros(0, dtype=bool)], np.random.default_rng(4)

    def changing(maps, rng):
        maps[0][0] = rng.random(3)
        maps.append("new")
        return [maps[0], rng.random()]

    first, array, twin = maps[0], None, np.random.default_rng(4)
    array, drawn = called(wires, changing, maps, rng)
    assert array is first
    assert np.array_equal(first, [twin.random(3), [5, 4, 3]])
    assert drawn == twin.random()
    assert rng.random() == twin.random()
    assert maps[2] == "new"


def test_functions_are_called_back_and_errors_keep_their_names(wires):
    assert called(wires, lambda f: f(2) + f(3), lambda x: 10 * x) == 50
    with pytest.raises(ZeroDivisionError, match="division"):
        called(wires, lambda: 1 / 0)
    with pytest.raises(Exception, match="later") as error:
        called(wires, lambda: sys.exit("later"))
    assert type(error.value).__name__ == "SystemExit"


def test_objects_of_the_book_go_into_the_cage_and_none_comes_out(wires):
    from pfslam.grid import GridSpec

    spec = GridSpec((0.0, 1.0), 0.05, (3, 4))
    assert called(wires, lambda s: (s.shape, type(s).__name__), spec) == ((3, 4), "GridSpec")
    assert repr(called(wires, lambda s: s, spec)).startswith("GridSpec")
    assert not isinstance(called(wires, lambda s: s, spec), GridSpec)


@pytest.mark.parametrize(
    "answer",
    [
        {"import": ["os", "system"]},
        {"object": ["subprocess", "Popen"], "content": {}},
        {"function": 0},
        {"array": 7},
        {"seen": 9},
        {"rng": {"bit_generator": "x"}},
        {},
    ],
    ids=str,
)
def test_forged_answers_are_refused(answer):
    """What only the judge may send, and what is no message."""
    reading, back = os.pipe()
    aside, writing = os.pipe()
    forger, ours = Wire(aside, back, trusts=True), Wire(reading, writing, trusts=False)
    forger.send({"answer": answer, "changed": [], "arrays": []}, [])
    with pytest.raises(Gone):
        ours.call(0)
    forger.send({"answer": 1, "changed": [], "arrays": [["O", 8, [1]]]}, [])
    with pytest.raises(Gone):
        ours.call(0)
    os.write(back, b"no message at all, and much longer than eight bytes")
    with pytest.raises(Gone):
        ours.call(0)
    for end in (reading, back, aside, writing):
        os.close(end)


def test_a_call_without_an_answer_ends_in_time(wires):
    ours, student = wires
    student.functions[:] = [lambda: time.sleep(0.6)]
    ours.deadline = time.monotonic() + 0.2
    with pytest.raises(TooSlow):
        ours.call(0)
    ours.deadline = time.monotonic() + 5
    assert ours.receive()[0]["answer"] is None


def test_who_does_not_read_does_not_hold_up_the_judge():
    there, writing = os.pipe()
    reading, back = os.pipe()
    ours = Wire(reading, writing, trusts=False)
    ours.deadline = time.monotonic() + 0.2
    with pytest.raises(TooSlow):
        ours.call(0, np.zeros(10**6))
    for end in (there, writing, reading, back):
        os.close(end)


# ---- the statements that an answer needs

CELLS = """
import numpy as np
%matplotlib inline
K = 2
slow = expensive(K)
table = []
for k in range(3):
    table.append(k)
def helper(x):
    return np.sum(x) + K + len(table)
K = 7
poses = another_thing()
poses = np.zeros(3)
if K > 3:
    scale = 2.0
def answer(x):
    slow = 3
    print(slow)
    return helper(x) * scale + slow + poses[0]
answer.words = "b"
print(slow)
show(answer)
"""


def test_only_what_an_answer_needs_is_run():
    from types import ModuleType

    program = pieces.needed(pieces.statements(CELLS), {"answer"})
    names = set().union(*(s.makes for s in program))
    assert names == {"np", "K", "table", "k", "helper", "poses", "scale", "answer"}
    assert len(program) == 9  # neither the first K nor the first poses, and nothing that is only shown
    assert pieces.run(program, ModuleType("cells"))["answer"](np.ones(4)) == (4 + 7 + 3) * 2.0 + 3


# ---- what is handed in


def notebook(answers: dict[str, str], *, by=lambda cells: cells) -> str:
    """A copy of the chapter in which some exercises are answered, changed by ``by``."""
    cells = json.loads(CHAPTER.read_text(encoding="utf-8"))["cells"]
    kept = [cell for cell in cells if not SOLUTION.search(" ".join(cell["metadata"].get("tags", [])))]
    for number, cell in exercises({"cells": kept}).items():
        cell["source"] = answers.get(number, source(cell))
    return json.dumps({"cells": by(kept), "metadata": {}, "nbformat": 4, "nbformat_minor": 5})


def right_answers() -> dict[str, str]:
    book = json.loads(CHAPTER.read_text(encoding="utf-8"))
    stubs, found = exercises(book), {}
    for number, cell in exercises(book, SOLUTION).items():
        name = source(stubs[number]).split("(")[0].removeprefix("def ")
        found[number] = source(cell).partition("\n\n\n")[0].replace(f"{name}_solution", name)
    return found


def test_copies_are_found_under_any_names_and_what_is_none_says_why(tmp_path):
    top = tmp_path / "handed in" / "course"
    good = notebook({})
    for place, text in {
        "Jörg Müller_123_assign/deep/er/02.ipynb": good,
        "Ada.ipynb": good,
        "renamed/my work.ipynb.txt": good,
        "word/report.docx": "no notebook",
        "empty.ipynb": "",
        "broken.ipynb": good[:-100],
        "merged.ipynb": good.replace("\n", "") + "\n<<<<<<< HEAD\n",
        "shape.ipynb": '{"cells": [3, {"cell_type": "code"}]}',
        "other.ipynb": '{"cells": []}',
        "__MACOSX/Ada.ipynb": good,
        "old/.ipynb_checkpoints/x.ipynb": good,
    }.items():
        file = top / place
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    (top / "linked.ipynb").symlink_to("/etc/passwd")
    with open(top / "huge.ipynb", "wb") as file:
        file.truncate(2 * 2**30)
    copies = {copy.student: copy for copy in copies_of.find(tmp_path)}
    chapters = {name: copies_of.chapter_of(copy, ROOT / "notebooks") for name, copy in copies.items()}
    found = {"Jörg Müller_123_assign", "Ada", "renamed"}
    assert {name for name, chapter in chapters.items() if chapter == CHAPTER.stem} == found
    words = {name: copies[name].grades[0].words for name in copies.keys() - found}
    told = {
        "word": "no notebook",
        "empty": "empty",
        "broken": "broken",
        "merged": "merged",
        "shape": "broken",
    }
    told |= {"other": "No cell", "old": "nothing in this folder", "linked": "link", "huge": "2048 MB"}
    assert words.keys() == told.keys()
    assert all(told[name] in words[name] for name in told), words


def test_a_name_that_a_spreadsheet_would_compute_stays_a_name():
    assert pages.plain('=HYPERLINK("x")').startswith("'=")
    assert pages.plain("Zoë") == "Zoë"


# ---- a class


@pytest.fixture(scope="session")
def chapter():
    return judge.Chapter(CHAPTER)


def test_every_exercise_of_the_book_can_be_asked_for():
    """The check of each calls one name of its stub, and a solution stands for it."""
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        cells = json.loads(path.read_text(encoding="utf-8"))
        assert exercises(cells).keys() == exercises(cells, CHECK).keys() == exercises(cells, SOLUTION).keys()


def test_a_patched_check_counts_nothing_and_the_printed_solutions_count(chapter, tmp_path):
    """In the simplest cage, which works everywhere: what it keeps apart is the check."""
    limits = cage.Cage("limits")
    patch = "import pfslam_book.ch02, pfslam_book.show.checks as c\npfslam_book.ch02.check_cell_of = lambda f: True\n"
    patch += "c.Check.__bool__ = lambda self: True\nc.compare = lambda *a, **k: c.passed()\n"
    stubs = {t.stub: patch + t.stub + "\n" for t in chapter.tasks}
    cells = [{"source": stubs.get(cell, cell).strip(), "check": ""} for cell in chapter.cells]
    assert [g.state for g in chapter.judge(cells, limits, tmp_path)] == [judge.UNANSWERED] * 5
    assert [g.state for g in chapter.measure(limits, tmp_path)] == [judge.RIGHT] * 5


STARTS_A_COPY = """import subprocess, sys
from pathlib import Path
sys.path[:0] = sys.argv[2:]
from grading.cage import Cage, started
cage, loop = Cage("room"), "import time\\ntime.sleep(600)  # " + sys.argv[1]
subprocess.run(cage.command(sys.argv[1], [sys.executable, "-c", loop], 65000), **started(cage, 65000))"""


def test_who_kills_the_grading_ends_the_copies(tmp_path):
    """A copy is a process with another user's rights in a world of its own; it must not live longer than its judge."""
    if cage.best_cage(tmp_path).kind != "room":
        pytest.skip("no user namespaces here")
    room = tmp_path / "room"
    room.mkdir()

    def alive():
        lines = (path.read_bytes() for path in Path("/proc").glob("[0-9]*/cmdline") if path.exists())
        return sum(str(room).encode() in line and b"time.sleep(600)" in line for line in lines)

    judge = subprocess.Popen([sys.executable, "-c", STARTS_A_COPY, str(room), *sys.path])
    deadline = time.monotonic() + 60.0
    while alive() < 2 and time.monotonic() < deadline:  # what makes the room, and the copy in it
        time.sleep(0.1)
    judge.kill()
    judge.wait()
    while alive() and time.monotonic() < deadline:
        time.sleep(0.1)
    assert alive() == 0


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP", "SIGINT"])
def test_a_grading_that_is_stopped_ends_its_judges_and_leaves_nothing(tmp_path, name):
    """With a copy in an endless loop, to which the judge would listen for 20 s more."""
    handed_in, scratch = tmp_path / "handed_in", tmp_path / "scratch"
    for folder in (handed_in, scratch):
        folder.mkdir(mode=0o755)
    scratch.chmod(0o711)
    text = notebook(right_answers() | {"1": FIRST.format(before=BEFORE["endless loop"][0])})
    (handed_in / "Ada.ipynb").write_text(text, encoding="utf-8")
    words = [sys.executable, str(ROOT / "teachers" / "grade.py"), str(handed_in), str(tmp_path / "out")]
    grading = subprocess.Popen(words, env=os.environ | {"TMPDIR": str(scratch)}, start_new_session=True)

    def alive():
        with suppress(ProcessLookupError):
            os.killpg(grading.pid, 0)
            return True
        return False

    deadline = time.monotonic() + 120.0
    while not list(scratch.glob("pfslam-grade-*/tmp*/leader")) and time.monotonic() < deadline:
        time.sleep(0.1)  # until the copy of a student runs; the printed solutions have run before
    grading.send_signal(getattr(signal, name))
    assert grading.wait(10.0) != 0
    assert not alive()  # neither the grading nor a judge
    assert list(scratch.iterdir()) == []
    assert not (tmp_path / "out").exists()


@pytest.mark.nightly
@pytest.mark.parametrize("path", sorted((ROOT / "notebooks").glob("*.ipynb")), ids=lambda path: path.stem)
def test_the_printed_solutions_of_each_chapter_are_right(path, tmp_path):
    """Arguments and answers of every exercise of the book cross the wire, whole programs among them."""
    grades = judge.Chapter(path).measure(cage.best_cage(tmp_path), tmp_path)
    assert grades
    assert [grade for grade in grades if grade.state != judge.RIGHT] == []


FIRST = """def cell_of(points, origin, resolution):
    import os, socket, subprocess, sys
    {before}
    return np.floor((points - np.array(origin)) / resolution).astype(int)[:, ::-1]
"""
BEFORE = {
    "endless loop": ("while True: pass", judge.SLOW),
    "exit": ("sys.exit()", judge.CRASHED),
    "interrupt": ("raise KeyboardInterrupt", judge.CRASHED),
    "closed pipes": ("os.closerange(0, 256)", judge.CRASHED),
    "equal to everything": ("return type('E', (), {'__eq__': lambda *a: True})()", judge.WRONG),
    "unprintable error": ("raise type('E', (Exception,), {'__str__': lambda e: 1 / 0})", judge.CRASHED),
    "thread": (
        "import threading, time; threading.Thread(target=time.sleep, args=[600]).start()",
        judge.RIGHT,
    ),
    "dead kernel": ("os._exit(3)", judge.CRASHED),
    "segmentation fault": ("import ctypes; ctypes.string_at(0)", judge.CRASHED),
    "fork bomb": ("while True: os.fork()", judge.CRASHED),
    "memory": ("x = [np.ones(10**7) for _ in range(10**4)]", judge.CRASHED),
    "disk": ("f = open('x', 'wb'); [f.write(bytes(2**20)) for _ in range(2048)]", judge.CRASHED),
    "input": ("input('who are you?')", judge.CRASHED),
    "long answer": ("return np.zeros((10**8, 2), dtype=int)", judge.CRASHED),
    "deep answer": ("x = []\n    for _ in range(10**5): x = [x]\n    return x", judge.CRASHED),
    "odd answer": ("return {object(): print, 'a': [b'b']}", judge.WRONG),
    "forged answer": ("[os.write(k, b'x' * 2000) for k in range(3, 9) if not os.isatty(k)]", judge.CRASHED),
    "output": ("print('x' * 20_000_000)", judge.RIGHT),
    "leaves a process": ("subprocess.Popen(['sleep', '98765.25'], start_new_session=True)", judge.RIGHT),
    "umlauts": ("größe = 'Wörter'", judge.RIGHT),
    "merged": ("\n<<<<<<< HEAD\n", judge.CRASHED),
    "patched numpy": ("np.allclose = np.array_equal = lambda *a, **k: True; return points", judge.WRONG),
}
"""What the first exercise of a copy does before it answers, and what it deserves; the other four are right."""
SPY = """assert not os.path.exists({folder!r}) and not os.path.exists({home!r})
    assert "SECRET_OF_THE_TEACHER" not in os.environ
    with socket.socket() as s: assert s.connect_ex(("127.0.0.1", {port})) != 0
    assert os.getpid() < 20 and not os.access("/usr", os.W_OK) and not os.access({book!r}, os.W_OK)"""


def twice(cells):
    return [cell for cell in cells for _ in range(2)]


def bare(cells):
    """Without ids, tags and outputs, under another kernel's rules of names."""
    return [{"cell_type": cell["cell_type"], "source": source(cell), "metadata": {}} for cell in cells]


def stub_below(cells):
    (k,) = [k for k, cell in enumerate(cells) if "exercise-1" in cell["metadata"].get("tags", [])]
    book = json.loads(CHAPTER.read_text(encoding="utf-8"))
    return [*cells[: k + 1], exercises(book)["1"], *cells[k + 1 :]]


@pytest.fixture(scope="module")
def graded(tmp_path_factory):
    """The class as it comes out: state of each exercise by student, and the folder."""
    folder, out = (tmp_path_factory.mktemp(name) for name in ("handed_in", "out"))
    right, stubs = right_answers(), {"1": FIRST.format(before="pass")}
    hostile = {who: (right | {"1": FIRST.format(before=before)}, {}) for who, (before, _) in BEFORE.items()}
    with socket.create_server(("127.0.0.1", 0)) as server, pytest.MonkeyPatch.context() as patch:
        spy = SPY.format(folder=str(folder), home=str(ROOT / "Makefile"), port=server.getsockname()[1],
                         book=str(ROOT / "pfslam" / "__init__.py"))  # fmt: skip
        hostile["spy"] = right | {"1": FIRST.format(before=spy)}, {}
        copies = hostile | {
            "right": (right, {}),
            "untouched": ({}, {}),
            "copied cells": (right, {"by": twice}),
            "bare cells": (right | stubs, {"by": bare}),
            "stub below": (right, {"by": stub_below}),
            "backwards": (right, {"by": lambda cells: cells[::-1]}),
            "renamed": (right | {"1": right["1"].replace("cell_of", "cell_off")}, {}),
            "wrong": (right | {"1": right["1"].replace("[:, ::-1]", "")}, {}),
            "=formula": (right, {}),
        }
        for who, (answers, changes) in copies.items():
            (folder / f"{who}.ipynb").write_text(notebook(answers, **changes), encoding="utf-8")
        (folder / "empty.ipynb").write_text("")
        patch.setenv("SECRET_OF_THE_TEACHER", "1")
        assert grade.main([str(folder), str(out)]) == 0
    with open(out / "grades.csv", newline="", encoding="utf-8-sig") as file:
        rows = {row["student"]: row for row in csv.DictReader(file)}
    return {who: [row[f"exercise {n}"] for n in range(1, 6)] for who, row in rows.items()}, out


ALL = [judge.RIGHT] * 5
FAIR = {who: [state, *ALL[1:]] for who, (_, state) in BEFORE.items()} | {
    "right": ALL,
    "spy": ALL,
    "untouched": [judge.UNANSWERED] * 5,
    "copied cells": ALL,
    "bare cells": ALL,
    "stub below": ALL,
    "backwards": ALL,
    "renamed": [judge.UNANSWERED, *ALL[1:]],
    "wrong": [judge.WRONG, *ALL[1:]],
    "'=formula": ALL,
    "empty": [judge.UNREADABLE] * 5,
}


@pytest.mark.nightly
@pytest.mark.parametrize("who", FAIR)
def test_each_copy_of_a_hostile_class_gets_what_it_deserves(graded, who):
    states, out = graded
    if who == "spy" and cage.KINDS["room"] not in unescape((out / "index.html").read_text(encoding="utf-8")):
        pytest.skip("no name spaces here")
    assert states[who] == FAIR[who]


@pytest.mark.nightly
def test_nothing_of_a_class_is_left_behind_and_each_has_a_page(graded):
    states, out = graded
    assert states.keys() == FAIR.keys()
    running = [path.read_bytes() for path in Path("/proc").glob("[0-9]*/cmdline")]
    assert not any(b"98765.25" in line for line in running)
    links = re.findall(r'href="(students/[^"]+)"', (out / "index.html").read_text(encoding="utf-8"))
    assert len(links) == len(FAIR)
    assert all((out / link).is_file() for link in links)
    assert "the row comes from y" in (out / "index.html").read_text(encoding="utf-8")
