"""An exercise is data: a right function, the cases on which it is tried, and the mistakes that learners make.

>>> from pfslam_book.show.exercise import Exercise
>>> check_hypotenuse = Exercise(
...     right=lambda a, b: (a * a + b * b) ** 0.5,
...     cases=[(3.1, 4.7), (0.2, 9.0)],
...     mistakes={"You walked around the corner.": lambda a, b: a + b},
...     praise="That is Pythagoras.")
>>> check_hypotenuse(lambda a, b: a + b)
Not yet. You walked around the corner.
>>> check_hypotenuse(lambda a, b: abs(a - b))
Not yet. For a = 3.1, b = 4.7 your function returns 1.6; expected 5.63.
>>> check_hypotenuse(lambda a, b: abs(a + 1j * b))
Right. That is Pythagoras.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pfslam.poses import wrap_angle
from pfslam_book.show.checks import Check, compare, hint, in_full, same_numbers


@dataclass(frozen=True)
class Exercise:
    """What is asked of the reader's function; called with one, it answers with a ``Check``.

    ``right`` is a solution and ``cases`` are the tuples of arguments on which the reader's function runs beside it:
    no round angle, nothing symmetric, every branch taken and its edge met, every argument varied. ``mistakes`` gives
    the words for each wrong function, or type of error, that learners really write: eight at most. A tuple holds
    functions that make one mistake in several ways. Whoever is wrong in another way hears what the function returned
    and what was expected. ``same(found, expected)`` decides when two answers agree, and ``also`` holds other right
    answers to a question that has several. ``besides(theirs, *case)`` looks at what the answers do not show, such as
    where the random numbers came from: it returns the words for it, or nothing.
    """

    right: Callable
    cases: Sequence[tuple]
    mistakes: Mapping[str, Callable | type | tuple[Callable, ...]] = field(default_factory=dict)
    praise: str = ""
    same: Callable[[Any, Any], bool] = same_numbers
    also: Sequence[Callable] = ()
    besides: Callable[..., str] = lambda theirs, *case: ""

    def __call__(self, theirs: Callable) -> Check:
        named = [
            (words, wrong if isinstance(wrong, tuple) else (wrong,)) for words, wrong in self.mistakes.items()
        ]
        pairs = [(wrong, words) for words, several in named for wrong in several]
        rest: dict[str, Any] = {"mistakes": pairs, "praise": self.praise, "same": self.same}
        with np.errstate(all="ignore"):
            verdicts = [compare(theirs, right, self.cases, **rest) for right in (self.right, *self.also)]
        verdict = next((verdict for verdict in verdicts if verdict), verdicts[0])
        if not verdict:
            return verdict
        words = self.besides(lambda *case: in_full(theirs(*case)), *copy.deepcopy(self.cases[0]))
        return hint(words) if words else verdict


def within(position: float, heading: float) -> Callable[[Any, Any], bool]:
    """Poses (..., 3) agree to so many metres and radians, headings on the circle."""

    def same(found, expected) -> bool:
        apart = np.abs(np.asarray(found, dtype=float) - np.asarray(expected, dtype=float))
        apart[..., 2] = np.abs(wrap_angle(apart[..., 2]))
        return bool(np.isfinite(apart).all() and (apart <= [position, position, heading]).all())

    return same
