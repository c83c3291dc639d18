"""How an exercise is checked: the reader's function runs beside a right one, and a mistake is answered in words.

1. ``compare(theirs, right, cases, mistakes=[...], praise="...")`` calls both functions on every tuple of arguments in
   ``cases``: one or two generic ones (no round angle, nothing symmetric, every branch taken) and two random ones.
2. Lists, tuples, generators and arrays, loops and array code, float32 and answers to four digits count alike. A pose
   has a heading in its last column: ``same=same_poses`` compares it on the circle.
3. ``mistakes`` pairs a wrong function, or the error that a wrong one raises, with the words for it; it is named where
   it answers *every* case as the reader's does. Units, signs and transposed arrays are tried without being asked for.
4. What changes its input, returns nothing or raises an error is told so. No hint prints two equal numbers.
5. The result is a ``Check``: it shows its words and is true if the answer is right: ``assert ch03.check_predict(f)``.

>>> from pfslam_book.show.checks import compare
>>> def check_hypotenuse(theirs):
...     return compare(theirs, lambda a, b: (a * a + b * b) ** 0.5, [(3.1, 4.7), (0.2, 9.0)],
...         mistakes=[(lambda a, b: a + b, "You walked around the corner.")], praise="That is Pythagoras.")
>>> check_hypotenuse(lambda a, b: ...)
Not answered yet: edit the cell above, run it, then run this one.
>>> check_hypotenuse(lambda a, b: a + b)
Not yet. You walked around the corner.
>>> check_hypotenuse(lambda a, b: -abs(a + 1j * b))
Not yet. Your answers are right but for their sign.
>>> check_hypotenuse(lambda a, b: abs(a + 1j * b))
Right. That is Pythagoras.
"""

from __future__ import annotations

import copy
import inspect
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pfslam.poses import wrap_angle
from pfslam_book.show.pictures import output_mode


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
    """The stub is as the book printed it, and what to do about it where the reader can run it."""
    where_to = "" if output_mode() == "static" else ": edit the cell above, run it, then run this one"
    return Check("unanswered", f"Not answered yet{where_to}.")


def is_unanswered(answer) -> bool:
    """Whether an answer is still ``None`` or ``...``, or holds one of them."""
    if isinstance(answer, tuple | list):
        return any(is_unanswered(part) for part in answer)
    return answer is None or answer is ...


def attempt(function: Callable, *arguments):
    """What a student's function returns; a ``Check`` that quotes the error where it raises one."""
    try:
        return function(*arguments)
    except NotImplementedError:
        return ...
    except Exception as error:
        return hint(f"Your function stops with {type(error).__name__}: {error}")


def in_full(answer):
    """The answer itself, or the list of all that a generator yields."""
    return list(answer) if isinstance(answer, Iterator) else answer


# ---- a function beside a right one


def compare(
    theirs: Callable,
    right: Callable,
    cases: Sequence[tuple],
    *,
    mistakes: Sequence[tuple[Any, str]] = (),
    praise: str = "",
    same: Callable[[Any, Any], bool] | None = None,
) -> Check:
    """The verdict on a function that should return what ``right`` does for every tuple of arguments in ``cases``.

    ``mistakes`` are pairs of a wrong function, or a type of error, and the words for it, the most particular first.
    ``same(found, expected)`` decides when two answers agree; by default `same_numbers`.
    """
    same = same or same_numbers
    expected = [right(*copy.deepcopy(case)) for case in cases]
    errors = dict(m for m in mistakes if isinstance(m[0], type))
    answers = []
    for case, wanted in zip(cases, expected, strict=True):
        answer = answer_to(theirs, case, wanted, errors, in_shape=False)
        if isinstance(answer, Check):
            return answer
        answers.append(answer)
    wrong = [k for k in range(len(cases)) if not _alike(answers[k], expected[k], same)]
    if not wrong:
        return passed(praise)
    for mistake, words in mistakes:
        if not isinstance(mistake, type) and _agrees(mistake, cases, answers, same):
            return hint(words)
    k = wrong[0]
    return hint(
        _no_truth_value(answers[k], expected[k])
        or _other_shape(answers[k], expected[k])
        or _usual_suspect(answers, expected, same)
        or _side_by_side(_arguments(theirs, cases[k]), answers[k], expected[k], same)
    )


def answer_to(
    theirs: Callable, case: tuple, wanted: Any, errors: dict[type, str] | None = None, in_shape: bool = True
) -> Any:
    """What a function returns for a case, as an array if numbers are ``wanted``; a ``Check`` if it is of no use.

    ``errors`` are words for errors that it may raise; a shape other than that of ``wanted`` is let pass on request.
    """
    given = copy.deepcopy(case)
    try:
        answer = in_full(theirs(*given))
    except NotImplementedError:
        return unanswered()
    except Exception as error:
        words = next((words for kind, words in (errors or {}).items() if isinstance(error, kind)), "")
        return hint(words or f"Your function stops with {type(error).__name__}: {error}")
    if answer is ... or (isinstance(answer, tuple | list) and any(part is ... for part in answer)):
        return unanswered()
    if answer is None and wanted is not None:
        word = f"The word {wanted!r} was asked for. " if isinstance(wanted, str) and wanted else ""
        return hint(f"Your function returns nothing. {word}Is a return missing at its end?")
    if not _unchanged(given, case):
        return hint(
            "Your function changes what it is given. Make a new array: others may still need the old one."
        )
    if in_shape and (words := _no_truth_value(answer, wanted)):
        return hint(words)
    if isinstance(wanted, str | bool | None):
        return answer
    numbers = _as_wanted(answer, wanted)
    words = "" if isinstance(numbers, Check) or not in_shape else _other_shape(numbers, wanted)
    return hint(words) if words else numbers


def _no_truth_value(answer: Any, wanted: Any) -> str:
    """Words for an answer that is neither True nor False where one of them is wanted."""
    if not isinstance(wanted, bool) or (np.isscalar(answer) and answer in (False, True)):
        return ""
    return f"Here your function returns {_short(answer)}; expected True or False."


def same_numbers(found: Any, expected: Any) -> bool:
    """Whether two answers agree to about four digits; NaN and infinity only with themselves."""
    if isinstance(expected, str | bool | None):
        return not isinstance(found, list | tuple) and np.ndim(found) == 0 and bool(found == expected)
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    if found.shape != expected.shape:
        return False
    finite = np.abs(expected[np.isfinite(expected)])
    scale = float(finite.max()) if finite.size else 0.0
    return bool(np.allclose(found, expected, rtol=5e-4, atol=1e-4 * scale, equal_nan=True))


def same_poses(found: Any, expected: Any) -> bool:
    """Whether poses (..., 3) agree to a few millimetres and milliradians, headings on the circle."""
    found, expected = np.asarray(found, dtype=float), np.asarray(expected, dtype=float)
    if found.shape != expected.shape or not np.isfinite(found).all():
        return False
    apart = found - expected
    return bool(
        np.abs(apart[..., :2]).max(initial=0.0) < 3e-3 and np.abs(wrap_angle(apart[..., 2])).max() < 3e-3
    )


def numbers_apart(found: float, expected: float) -> tuple[str, str]:
    """Two different numbers with so many digits, four or more, that they look different."""
    for digits in range(4, 18):
        pair = f"{found:.{digits}g}", f"{expected:.{digits}g}"
        if pair[0] != pair[1]:
            break
    return pair


def _agrees(mistake: Callable, cases: Sequence[tuple], answers: Sequence, same: Callable) -> bool:
    """Whether a wrong function gives these answers to these cases."""
    try:
        with np.errstate(all="ignore"):
            pairs = zip(answers, (mistake(*copy.deepcopy(case)) for case in cases), strict=True)
            return all(_alike(*pair, same) for pair in pairs)
    except Exception:
        return False


def _alike(found: Any, expected: Any, same: Callable) -> bool:
    """Whether two answers have one shape and are the same."""
    in_shape = isinstance(expected, str | bool | None) or np.shape(found) == np.shape(expected)
    return in_shape and bool(same(found, expected))


def _unchanged(given: tuple, case: tuple) -> bool:
    """Whether the arrays and lists that a function was given still are what they were."""
    kept = (np.ndarray, list)
    pairs = [(a, b) for a, b in zip(given, case, strict=True) if isinstance(b, kept)]
    return all(np.array_equal(a, b, equal_nan=np.asarray(b).dtype.kind == "f") for a, b in pairs)


def _as_wanted(answer: Any, wanted: Any) -> Any:
    """The answer as an array of numbers, or a ``Check`` that says what it is instead."""
    try:
        numbers = np.asarray(answer)
        if numbers.dtype.kind in "US":
            raise TypeError("text")
        if numbers.dtype.kind not in "biuf":
            numbers = numbers.astype(float)
    except (TypeError, ValueError):
        return hint(f"{_asked(wanted)} asked for; your function returns {_short(answer)}.")
    return numbers.reshape(np.shape(wanted)) if numbers.size == 1 == np.size(wanted) else numbers


def _other_shape(found: Any, wanted: Any) -> str:
    """The words for an answer of another shape than the one that is wanted, or nothing."""
    if isinstance(wanted, str | bool | None) or np.shape(found) == np.shape(wanted):
        return ""
    return f"{_asked(wanted)} asked for; yours has the shape {np.shape(found)}."


def _asked(wanted: Any) -> str:
    shape = np.shape(wanted)
    return "One number is" if shape == () else f"Numbers of the shape {shape} are"


def _short(answer: Any) -> str:
    text = " ".join(repr(answer).split())
    return text if len(text) <= 60 else text[:57] + "..."


FACTORS = {
    180.0 / np.pi: "in degrees; radians are asked for.",
    57.3: "in degrees; radians are asked for.",
    np.pi / 180.0: "in radians; degrees are asked for.",
    1.0 / 57.3: "in radians; degrees are asked for.",
    1000.0: "a thousand times too large: are they in millimetres or milliseconds?",
    0.001: "a thousand times too small: are they in kilometres, or is one length in millimetres?",
    100.0: "a hundred times too large: are they in centimetres, or in percent?",
    0.01: "a hundred times too small.",
    (180.0 / np.pi) ** 2: "turned from radians into degrees twice, or from degrees where they were degrees.",
    (np.pi / 180.0)
    ** 2: "turned from degrees into radians where they were radians: rad2deg and deg2rad are swapped.",
    2.0: "twice as large as they should be.",
    0.5: "half as large as they should be.",
}


def _usual_suspect(answers: Sequence, expected: Sequence, same: Callable) -> str:
    """The words for a slip that any exercise may meet, or nothing."""
    if not all(
        np.asarray(e).dtype.kind in "iuf" and np.asarray(a).dtype.kind in "iuf"
        for a, e in zip(answers, expected, strict=True)
    ):
        return ""
    pairs = [
        (np.asarray(a, dtype=float), np.asarray(e, dtype=float))
        for a, e in zip(answers, expected, strict=True)
    ]
    if all(same(-a, e) for a, e in pairs):
        return "Your answers are right but for their sign."
    for factor, words in FACTORS.items():
        if all(same(a / factor, e) for a, e in pairs):
            return f"Your answers are {words}"
    if all(a.ndim == 2 and a.shape[0] == a.shape[1] and same(a.T, e) for a, e in pairs):
        return "Your array is transposed: rows and columns have changed places."
    if all(a.ndim > 0 and same(a[::-1], e) for a, e in pairs):
        return "Your answers are right, in the opposite order."
    # To the last digit: an exercise whose answers may scatter would find many answers one off.
    if all(a.shape == e.shape and np.allclose(np.abs(a - e), 1.0, rtol=0, atol=1e-6) for a, e in pairs):
        return "Each of your answers is off by one."
    return ""


def _blamed(found: np.ndarray, wanted: np.ndarray, same: Callable) -> tuple:
    """The place of the largest gap that makes an answer wrong by itself: no heading that is a whole turn away."""
    gap = np.abs(found - wanted)
    places = np.argsort(-np.where(np.isnan(gap), np.inf, gap), axis=None)[:200]
    for place in places:
        alone = wanted.copy()
        alone.flat[place] = found.flat[place]
        if not same(alone, wanted):
            return np.unravel_index(place, gap.shape)
    return np.unravel_index(places[0], gap.shape)


def _side_by_side(arguments: str, answer: Any, expected: Any, same: Callable) -> str:
    """One case that goes wrong, with one number of the answer beside the right one."""
    if isinstance(expected, str | bool | None):
        return f"For {arguments} your function returns {answer!r}; expected {expected!r}."
    found, wanted = np.asarray(answer, dtype=float), np.asarray(expected, dtype=float)
    at = _blamed(found, wanted, same)
    yours, right = numbers_apart(float(found[at]), float(wanted[at]))
    place = f" at index {[int(i) for i in at]}" if at else ""
    return f"For {arguments} your function returns {yours}{place}; expected {right}."


def _arguments(theirs: Callable, case: tuple) -> str:
    """The arguments of a case by name: in numbers where they are few, by their shape where they are many."""
    try:
        names = list(inspect.signature(theirs).parameters)
    except (TypeError, ValueError):  # some builtins have no signature
        names = []
    if len(names) != len(case):
        names = [f"argument {k + 1}" for k in range(len(case))]
    return ", ".join(f"{name} {_value(value)}" for name, value in zip(names, case, strict=True))


def _value(value: Any) -> str:
    """A number, a short list, or what it is in words; a function may bring its own."""
    if callable(value):
        return getattr(value, "words", "(a function)")
    if isinstance(value, np.random.Generator):
        return "as given"
    if np.size(value) > 6:
        return f"of the shape {np.shape(value)}"
    return f"= {_short(_rounded(np.asarray(value).tolist() if isinstance(value, np.ndarray) else value))}"


def _rounded(value: Any) -> Any:
    """Floats to three digits after the point, in lists as well."""
    if isinstance(value, list | tuple):
        return type(value)(_rounded(part) for part in value)
    return round(value, 3) if isinstance(value, float) else value
