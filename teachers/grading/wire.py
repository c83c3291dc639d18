"""Calls between two processes that do not trust each other: arguments and answers travel as data.

A message is a line of JSON and the bytes of its arrays. Numbers, text, arrays and lists are sent as they are, a random
generator as its state, and a function as a number under which its owner can be asked to call it. Whatever a call
changes in the arrays, lists and generators that it was given is sent back with the answer, so that it looks like a
call within one process. Objects of the book go into the cage only: what comes out of it is data, or is refused.
"""

from __future__ import annotations

import builtins
import dataclasses
import importlib
import json
import os
import select
import struct
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

LARGEST = 256 * 2**20
"""No message may be longer (bytes): the greatest map of an exercise has a twentieth of it."""
KINDS = "biufc"


class TooSlow(BaseException):
    """The other process has not answered in time. No check may take it for a mistake of the function."""


class Gone(BaseException):
    """The other process has ended, or answers with what is no message."""


class Opaque:
    """An answer that is no data; it shows what it was."""

    def __init__(self, text: str):
        self.text = text

    def __repr__(self) -> str:
        return self.text


class Wire:
    """One end of two pipes. ``trusts`` the other end: only then are its objects built, and its modules imported."""

    def __init__(self, reading: int, writing: int, trusts: bool):
        self.reading, self.writing, self.trusts = reading, writing, trusts
        os.set_blocking(writing, False)  # who does not read must not hold up who writes
        self.functions: list[Callable] = []
        self.deadline = float("inf")
        self.failed = ""  # what the last call across the wire stopped with

    # ---- messages

    def _wait(self, end: int, write: bool) -> None:
        left = self.deadline - time.monotonic()
        ends: tuple[list[int], list[int]] = ([], [end]) if write else ([end], [])
        if left <= 0 or not any(select.select(*ends, [], min(left, 1e6))):
            raise TooSlow

    def _read(self, size: int) -> bytearray:
        data = bytearray(size)
        rest = memoryview(data)
        while rest:
            self._wait(self.reading, write=False)
            if not (count := os.readv(self.reading, [rest])):
                raise Gone
            rest = rest[count:]
        return data

    def send(self, message: dict, arrays: list[np.ndarray]) -> None:
        """Send a message and its arrays."""
        head = json.dumps(message).encode()
        size = len(head) + sum(a.nbytes for a in arrays)
        if size > LARGEST:
            raise ValueError(f"an answer of {size / 2**20:.0f} MB is too long")
        for part in (struct.pack("<Q", len(head)), head, *(np.ascontiguousarray(a).data for a in arrays)):
            rest = memoryview(part).cast("B") if len(part) else memoryview(b"")
            while rest:
                self._wait(self.writing, write=True)
                try:
                    rest = rest[os.write(self.writing, rest[: 2**20]) :]
                except BrokenPipeError:
                    raise Gone from None

    def receive(self) -> tuple[dict, list[np.ndarray]]:
        """The next message and its arrays."""
        (size,) = struct.unpack("<Q", self._read(8))
        if size > LARGEST // 16:
            raise Gone
        try:
            message, arrays = json.loads(self._read(size)), []
            for kind, width, shape in message["arrays"]:
                count = int(np.prod([int(n) for n in shape], dtype=object)) if shape else 1
                if kind not in KINDS or not 0 <= count * int(width) <= LARGEST - size:
                    raise Gone
                size += count * int(width)
                data = self._read(count * int(width))
                arrays.append(np.frombuffer(data, dtype=f"{kind}{int(width)}").reshape(shape))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            raise Gone from None
        return message, arrays

    # ---- calls

    def call(self, function: int, *arguments: Any, **named: Any) -> Any:
        """Let the other end call one of its functions, and serve it meanwhile."""
        code = Encoder(self)
        self.send(
            {"call": function, "given": code([list(arguments), named]), "arrays": code.heads}, code.arrays
        )
        while "call" in (received := self.receive())[0]:
            self.serve(*received)
        message, arrays = received
        self.failed = ""
        try:
            if "error" in message:
                error = error_of(*message["error"])
                self.failed = f"{type(error).__name__}: {error}"
                raise error
            decode = Decoder(self, arrays, code.seen)
            for k, new in message["changed"]:
                put(decode.seen[k], decode(new))
            return decode(message["answer"])
        except (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError):
            if self.failed:
                raise
            raise Gone from None

    def serve(self, message: dict, arrays: list[np.ndarray]) -> None:
        """Call a function for the other end, and send its answer or its error."""
        decode = Decoder(self, arrays, [])
        try:
            function = self.functions[message["call"]]
            arguments, named = decode(message["given"])
            before = [snapshot(thing) for thing in decode.seen]
            answer = function(*arguments, **named)
            code = Encoder(self, decode.seen)
            changed = [
                (k, code(thing, anew=True))
                for k, thing in enumerate(list(decode.seen))
                if snapshot(thing) != before[k]
            ]
            reply = {"answer": code(answer), "changed": changed, "arrays": code.heads}
            self.send(reply, code.arrays)
        except (Gone, TooSlow):
            raise
        except BaseException as error:
            names = [kind.__name__ for kind in type(error).__mro__]
            self.send({"error": [names, str(error)[:500]], "arrays": []}, [])

    def function(self, number: int) -> Callable:
        """A function of the other end, as one of this end."""
        return lambda *arguments, **named: self.call(number, *arguments, **named)


def error_of(names: list[str], text: str) -> Exception:
    """An error with the name and words that it had at the other end, of the nearest kind that Python has itself."""
    kinds = [getattr(builtins, str(name), None) for name in names]
    kind = next((k for k in kinds if isinstance(k, type) and issubclass(k, Exception)), Exception)
    name = names[0][:60] if str(names[0]).isidentifier() else "Error"
    words = str(text)[:500]
    made = type(name, (kind,), {"__str__": lambda self: words})
    return made.__new__(made)


def snapshot(thing: Any) -> Any:
    """Something that is equal to what it was before if the thing has not changed."""
    if isinstance(thing, np.ndarray):
        return thing.tobytes()  # arrays may be large, and NaN is unlike itself
    return list(map(id, thing)) if isinstance(thing, list) else thing.bit_generator.state


def put(thing: Any, new: Any) -> None:
    """Change an array, a list or a generator to what it has become at the other end."""
    if isinstance(thing, list):
        thing[:] = new
    elif isinstance(thing, np.ndarray):
        thing[...] = new
    else:
        thing.bit_generator.state = new.bit_generator.state


class Encoder:
    """Turns values into JSON and arrays; an array, list or generator that was ``seen`` is sent as its number."""

    def __init__(self, wire: Wire, seen: list | None = None):
        self.wire, self.seen = wire, list(seen or [])
        self.numbers = {id(thing): k for k, thing in enumerate(self.seen)}
        self.arrays: list[np.ndarray] = []
        self.heads: list[tuple] = []

    def __call__(self, value: Any, anew: bool = False) -> Any:
        if value is None or isinstance(value, bool | int | float | str):
            return value if not isinstance(value, float) else float(value)
        if not anew and id(value) in self.numbers:
            return {"seen": self.numbers[id(value)]}
        if isinstance(value, Iterator):
            value = list(value)
        if isinstance(value, np.ndarray) and value.dtype.kind not in KINDS:
            value = value.tolist()  # text stays text, and objects become opaque
            return self(value)
        if isinstance(value, np.ndarray | list | np.random.Generator):
            self.numbers.setdefault(id(value), len(self.seen))
            self.seen.append(value)
        if isinstance(value, np.ndarray | np.generic) and np.asarray(value).dtype.kind in KINDS:
            array = np.asarray(value)
            self.arrays.append(array.astype(array.dtype.newbyteorder("="), copy=False))
            self.heads.append((array.dtype.kind, array.dtype.itemsize, array.shape))
            return {"number" if isinstance(value, np.generic) else "array": len(self.arrays) - 1}
        if isinstance(value, list | tuple):
            return {"list" if isinstance(value, list) else "tuple": [self(part) for part in value]}
        if isinstance(value, dict):
            return {"dict": [[self(k), self(v)] for k, v in value.items()]}
        if isinstance(value, np.random.Generator):
            return {"rng": plain(value.bit_generator.state)}
        return {"ellipsis": 0} if value is ... else self._object(value)

    def _object(self, value: Any) -> dict:
        known = callable(value) or dataclasses.is_dataclass(value) or hasattr(value, "__dict__")
        if self.wire.trusts or not known:  # only data leaves the cage
            return {"opaque": repr(value)[:60]}
        home, name = (getattr(value, key, "") for key in ("__module__", "__qualname__"))
        if callable(value):
            if home in sys.modules and getattr(sys.modules[home], name, None) is value:
                return {"import": [home, name]}
            self.wire.functions.append(value)
            return {"function": len(self.wire.functions) - 1}
        kind = type(value)
        names = (
            [f.name for f in dataclasses.fields(value)] if dataclasses.is_dataclass(value) else vars(value)
        )
        content = {name: self(getattr(value, name)) for name in names}
        return {"object": [kind.__module__, kind.__qualname__], "content": content}


def plain(state: Any) -> Any:
    """The state of a generator with plain numbers in the place of arrays."""
    if isinstance(state, dict):
        return {key: plain(value) for key, value in state.items()}
    return state.tolist() if isinstance(state, np.ndarray) else state


class Decoder:
    """Turns JSON and arrays into values; notes arrays, lists and generators as ``seen``, in the encoder's order."""

    def __init__(self, wire: Wire, arrays: list[np.ndarray], seen: list):
        self.wire, self.arrays, self.seen = wire, arrays, seen

    def __call__(self, code: Any) -> Any:
        if not isinstance(code, dict):
            return code
        ((kind, value), *rest) = code.items()
        if kind in ("array", "list"):
            found: Any = self.arrays[value] if kind == "array" else []
            self.seen.append(found)
            if kind == "list":
                found += [self(part) for part in value]
            return found
        if kind == "rng":
            self.seen.append(rng := np.random.default_rng())
            rng.bit_generator.state = value
            return rng
        if kind in ("object", "import", "function"):
            return self._object(kind, value, rest)
        simple: dict[str, Callable] = {
            "seen": lambda: self.seen[value],
            "number": lambda: self.arrays[value][()],
            "tuple": lambda: tuple(self(part) for part in value),
            "dict": lambda: {self(k): self(v) for k, v in value},
            "ellipsis": lambda: ...,
            "opaque": lambda: Opaque(str(value)[:60]),
        }
        return simple[kind]()

    def _object(self, kind: str, value: Any, rest: list) -> Any:
        if not self.wire.trusts:
            raise ValueError(f"{kind} from the cage")
        if kind == "function":
            return self.wire.function(value)
        made = getattr(importlib.import_module(value[0]), value[1])
        if kind == "object":
            made = made.__new__(made)
            content = {name: self(part) for name, part in rest[0][1].items()}
            made.__dict__.update(content)
        return made
