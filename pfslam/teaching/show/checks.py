"""What every exercise check answers with: one verdict and one sentence for the student.

A check never raises for what a student wrote. A stub returns ``...`` (or is ``None``) until it is answered.

>>> from pfslam.teaching.show.checks import hint, is_unanswered, passed, unanswered
>>> def check_distance(answer):
...     if is_unanswered(answer):
...         return unanswered()
...     if abs(answer - 2.2) < 0.01:
...         return hint("That is the sum of the four wheels. The chassis travels their mean.")
...     return passed("0.55 m.") if abs(answer - 0.55) < 0.01 else hint("Not yet: look at the unit.")
>>> check_distance(...)
Not answered yet: edit the cell above, run it, then run this one.
>>> check_distance(0.55)
Right. 0.55 m.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Check:
    """A verdict, "passed", "wrong" or "unanswered", and the words that a notebook shows."""

    verdict: str
    message: str

    def __repr__(self) -> str:
        return self.message

    def __bool__(self) -> bool:
        return self.verdict == "passed"


def passed(message: str = "") -> Check:
    """The answer is right; the message may say what it means."""
    return Check("passed", f"Right. {message}".strip())


def hint(message: str) -> Check:
    """The answer is wrong; the message names the misconception behind it."""
    return Check("wrong", f"Not yet. {message}")


def unanswered() -> Check:
    """The stub is as the book printed it."""
    return Check("unanswered", "Not answered yet: edit the cell above, run it, then run this one.")


def is_unanswered(answer) -> bool:
    """Whether an answer is still ``None`` or ``...``, or holds one of them."""
    if isinstance(answer, tuple | list):
        return any(is_unanswered(part) for part in answer)
    return answer is None or answer is ...


def is_number(answer) -> bool:
    """Whether an answer is one finite number, of Python or of NumPy."""
    return np.ndim(answer) == 0 and np.asarray(answer).dtype.kind in "fiu" and bool(np.isfinite(answer))


def attempt(function: Callable, *arguments):
    """What a student's function returns; a ``Check`` that quotes the error where it raises one."""
    try:
        return function(*arguments)
    except NotImplementedError:
        return ...
    except Exception as error:
        return hint(f"Your function stops with {type(error).__name__}: {error}")


def not_a_number(answer, unit: str) -> Check | None:
    """The verdict on an answer that is no number at all: unanswered, an error, or a hint; None if it is one."""
    if is_unanswered(answer):
        return unanswered()
    if isinstance(answer, Check):
        return answer
    if not is_number(answer):
        return hint(f"One number is asked for, in {unit}; your function returns {answer!r}.")
    return None
