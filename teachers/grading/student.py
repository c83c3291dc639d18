"""Within the cage: sets its own limits, runs what an exercise needs of a copy, and lets the judge call the answer."""

from __future__ import annotations

import inspect
import os
import sys
from contextlib import suppress
from types import ModuleType


def limit(memory: int, processes: int) -> None:
    """Bound memory (MB), files, and how many processes there may be. A process cannot raise its limits again."""
    import resource

    for name, most in {
        "RLIMIT_AS": memory * 2**20,
        "RLIMIT_FSIZE": 64 * 2**20,
        "RLIMIT_NOFILE": 256,
        "RLIMIT_NPROC": processes,
        "RLIMIT_CORE": 0,
    }.items():
        with suppress(ValueError, OSError):  # macOS knows no bound of memory
            resource.setrlimit(getattr(resource, name), (most, most))


class Copy:
    """The cells of a copy above the check of an exercise; gives the answer to the judge."""

    def __init__(self, wire):
        self.wire = wire

    def prepare(self, cells: list, name: str, known: dict) -> dict:
        """Make the answer ``name`` from cells ``(source, own)``: its value, or the number of its function.

        What the judge has already computed with the book's cells is ``known``: they are not run again.
        """
        from grading.pieces import needed, run, statements

        program, broken = [], None
        for source, own in cells:
            try:
                program += statements(source, own)
            except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
                broken = error if name in source else broken
        answers = [k for k, s in enumerate(program) if s.own and name in s.makes]
        if not answers:
            if broken is not None:
                raise broken
            return {"missing": True}
        program = [s for k, s in enumerate(program) if s.own or k < answers[-1] or name not in s.makes]
        program = [s for s in program if s.own or not s.makes or not s.makes <= known.keys()]
        module = sys.modules["notebook"] = ModuleType("notebook")
        vars(module).update(known)
        answer = run(needed(program, {name}), module)[name]
        if not callable(answer):
            return {"value": answer}
        self.wire.functions.append(answer)
        try:
            names = [p.name for p in inspect.signature(answer).parameters.values()]
        except (TypeError, ValueError):
            names = []
        return {"function": len(self.wire.functions) - 1, "names": names}


def main() -> None:
    """Serve the judge at the other ends of two pipes until it closes them."""
    reading, writing, memory, processes = map(int, sys.argv[1:5])
    os.chdir(sys.argv[5])
    sys.path[0] = sys.argv[6]
    from grading.wire import Gone, Wire

    wire = Wire(reading, writing, trusts=True)
    wire.functions.append(Copy(wire).prepare)
    limit(memory, processes)
    with suppress(Gone):
        while True:
            wire.serve(*wire.receive())


if __name__ == "__main__":
    main()
