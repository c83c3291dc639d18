"""Outside the cage: the book's own checks, fresh from the project, call a student's answers and hear only data."""

from __future__ import annotations

import ast
import inspect
import json
import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

from copies import CHECK, EXERCISE, SOLUTION, exercises, source

from grading.cage import MEMORY, Cage, Process
from grading.pieces import needed, run, statements
from grading.wire import Gone, TooSlow, Wire

RIGHT, WRONG, UNANSWERED, SLOW, CRASHED = "right", "wrong", "unanswered", "too slow", "crashed"
UNREADABLE = "unreadable"
STATES = (RIGHT, WRONG, UNANSWERED, UNREADABLE, SLOW, CRASHED)
FIRST_SECONDS, TIMES = 20.0, 10.0
"""An answer may take so many seconds, and besides so many times what the printed solution takes on this machine."""


@dataclass(frozen=True)
class Grade:
    """What became of one exercise of a copy, in a word and in words."""

    state: str
    words: str


@dataclass
class Task:
    """An exercise: the name that it asks for, its stub, its check, and what the check needs beside the answer."""

    number: str
    name: str
    stub: str
    check: str
    solution: str
    space: dict = field(repr=False)
    known: dict = field(repr=False)  # what the check is given beside the answer
    seconds: float = float("inf")


class Chapter:
    """The exercises of a chapter of the book, ready to judge copies of it."""

    def __init__(self, path: Path):
        self.name = path.stem
        notebook = json.loads(path.read_text(encoding="utf-8"))
        self.cells = [source(cell).strip() for cell in notebook["cells"] if cell["cell_type"] == "code"]
        stubs, checks, solved = (exercises(notebook, tag) for tag in (EXERCISE, CHECK, SOLUTION))
        self.tasks = [self._task(n, source(stubs[n]), source(checks[n]), source(solved[n])) for n in stubs]

    def _task(self, number: str, stub: str, check: str, solution: str) -> Task:
        used = {node.id for node in ast.walk(ast.parse(check)) if isinstance(node, ast.Name)}
        (name,) = used & {name for statement in statements(stub) for name in statement.makes}
        above = [s for cell in self.cells[: self.cells.index(check.strip())] for s in statements(cell)]
        space = run(needed([s for s in above if name not in s.makes], used - {name}), ModuleType("chapter"))
        known = {n: space[n] for n in used - {name} if not isinstance(space[n], ModuleType)}
        call = ast.parse(solution).body[-1].value  # what the printed solution hands to the same check
        printed = call.args[[ast.unparse(a) for a in ast.parse(check).body[-1].value.args].index(name)]
        answer = f"{solution}\n{name} = {ast.unparse(printed)}"
        return Task(number, name, stub.strip(), check, answer, space, known)

    def solved(self) -> list[dict]:
        """A copy in which every answer is the printed solution."""
        answers = {task.stub: task.solution for task in self.tasks}
        return [{"source": answers.get(cell, cell), "check": ""} for cell in self.cells]

    def measure(self, cage: Cage, scratch: Path) -> list[Grade]:
        """Judge the printed solutions, and from their time set how long an answer may take."""
        grades = []
        for task in self.tasks:
            begin, desk = time.monotonic(), Desk(cage, scratch)
            try:
                grades.append(self._judge(task, self.solved(), desk))
            finally:
                desk.end()
            task.seconds = FIRST_SECONDS + TIMES * (time.monotonic() - begin)
        return grades

    def judge(self, cells: list[dict], cage: Cage, scratch: Path) -> list[Grade]:
        """A grade for each exercise of a copy, whatever the copy does."""
        desk = Desk(cage, scratch)
        try:
            return [self._judge(task, cells, desk) for task in self.tasks]
        finally:
            desk.end()

    def _judge(self, task: Task, cells: list[dict], desk: Desk) -> Grade:
        above = self._above(task, cells)
        if not any(own and task.name in text for text, own in above):
            return Grade(UNANSWERED, "The stub is as it was." if task.stub in [c["source"] for c in cells] else
                         f"Nothing with the name {task.name} was found.")  # fmt: skip
        try:
            grade = desk.verdict(task, above)
            if grade.state == CRASHED:  # who knows what is left in there
                desk.end()
            return grade
        except TooSlow:
            desk.end()
            return Grade(SLOW, f"No answer within {task.seconds:.0f} s: is there a loop that never ends?")
        except Gone:
            return Grade(CRASHED, reason(desk.end()))
        except Exception as error:  # what comes from a copy must stop none of the others
            desk.end()
            return Grade(CRASHED, f"{type(error).__name__}: {error}"[:500])

    def _above(self, task: Task, cells: list[dict]) -> list[tuple[str, bool]]:
        """The cells above the last copy of the check, ``(source, own)``, without stubs; all if none has an answer."""
        printed = set(self.cells)
        pairs = [
            (cell["source"], cell["source"] not in printed) for cell in cells if cell["source"] != task.stub
        ]
        ends = [
            k for k, cell in enumerate(c for c in cells if c["source"] != task.stub)
            if cell["check"] == task.number or cell["source"] == task.check.strip()
        ]  # fmt: skip
        above = pairs[: ends[-1]] if ends else pairs
        return above if any(own and task.name in text for text, own in above) else pairs


class Desk:
    """Where a copy is judged: its process in a cage, started anew when it has ended."""

    def __init__(self, cage: Cage, scratch: Path):
        self.cage, self.scratch = cage, scratch
        self.process: Process | None = None
        self.user = 100_000 + os.getpid() % 500_000
        self.wire: Wire

    def verdict(self, task: Task, cells: list[tuple[str, bool]]) -> Grade:
        """What the check says of the answer in these cells."""
        if self.process is None:
            self.process = Process(self.cage, self.scratch, self.user)
            self.wire = Wire(self.process.reading, self.process.writing, trusts=False)
            self.wire.call(0, [], "", {})  # until Python is there: its start is not the student's time
        wire = self.wire
        wire.functions.clear()
        wire.deadline = time.monotonic() + task.seconds
        try:
            made = wire.call(0, cells, task.name, task.known)
        except Exception as error:
            return Grade(CRASHED, f"The cells stop with {type(error).__name__}: {error}")
        if not isinstance(made, dict) or "missing" in made:
            return Grade(UNANSWERED, f"Nothing with the name {task.name} was found.")
        answer = made.get("value")
        if "function" in made:
            answer = wire.function(made["function"])
            if len(names := [n for n in made["names"] if str(n).isidentifier()]) == len(set(names)):
                kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
                answer.__signature__ = inspect.Signature([inspect.Parameter(n, kind) for n in names])
        wire.failed = ""
        verdict = eval(task.check, dict(task.space) | {task.name: answer})
        if verdict:
            return Grade(RIGHT, verdict.message)
        if verdict.verdict == "unanswered":
            return Grade(UNANSWERED, "The stub is as it was.")
        return Grade(CRASHED if wire.failed else WRONG, verdict.message)

    def end(self) -> int:
        """End the process and all that it started."""
        process, self.process = self.process, None
        return process.end() if process else 0


def reason(code: int) -> str:
    """Words for a process that has ended by itself."""
    return f"Python itself ended, with the code {code}: by an exit, a full memory ({MEMORY} MB), or a signal."
