"""The shared way to check an exercise: what counts as the same answer, and which slips are named unasked."""

import numpy as np
import pytest
from pfslam_book.show.checks import compare, numbers_apart, same_numbers, same_poses

CASES = [(np.array([[0.3, 1.7], [-2.2, 0.4]]), 1.3), (np.array([[5.0, -0.1], [0.2, 3.3]]), 0.7)]


def right(matrix, factor):
    return factor * matrix


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda m, f: -f * m, "sign"),
        (lambda m, f: (f * m).T, "transposed"),
        (lambda m, f: (f * m)[::-1], "opposite order"),
        (lambda m, f: np.rad2deg(f * m), "radians are asked for"),
        (lambda m, f: 57.3 * f * m, "radians are asked for"),
        (lambda m, f: f * m / 57.3, "degrees are asked for"),
        (lambda m, f: 1000 * f * m, "thousand times too large"),
        (lambda m, f: f * m / 1000, "thousand times too small"),
        (lambda m, f: 2 * f * m, "twice as large"),
        (lambda m, f: f * m + 1, "off by one"),
        (lambda m, f: None, "Is a return missing"),
        (lambda m, f: np.multiply(m, f, out=m), "changes what it is given"),
        (lambda m, f: "seven", "asked for"),
        (lambda m, f: (f * m).astype(str), "asked for"),
        (lambda m, f: [[1.0], [1.0, 2.0]], "asked for"),
        (lambda m, f: {"a": 1}, "asked for"),
        (lambda m, f: m[0], "shape (2,)"),
        (lambda m, f: np.full((2, 2), np.nan), "returns nan"),
        (lambda m, f: m + f, "For m = [[0.3, 1.7], [-2.2, 0.4]], f = 1.3 your function returns"),
        (lambda m, f: undefined, "NameError"),  # noqa: F821
    ],
)
def test_the_usual_suspects_are_named(answer, words):
    verdict = compare(answer, right, CASES)
    assert verdict.verdict == "wrong"
    assert words in verdict.message


def test_a_stub_is_unanswered_and_an_assertion_fails_on_it():
    assert compare(lambda m, f: ..., right, CASES).verdict == "unanswered"
    with pytest.raises(AssertionError):
        assert compare(lambda m, f: ..., right, CASES)


def test_a_mistake_is_named_only_where_it_explains_every_case():
    mistakes = [(lambda m, f: m, "You forgot the factor."), (ZeroDivisionError, "Nothing is divided here.")]
    assert "forgot" in compare(lambda m, f: m, right, CASES, mistakes=mistakes).message
    assert (
        "forgot" not in compare(lambda m, f: m if f > 1 else 3.0 * m, right, CASES, mistakes=mistakes).message
    )
    assert (
        "divided"
        in compare(lambda m, f: m / 0 if f is None else 1 / 0, right, CASES, mistakes=mistakes).message
    )


@pytest.mark.parametrize("pair", [(-3.0231, -3.0232), (1.0, 1.0 + 1e-9), (4.584, 4.58399), (1e-7, 2e-7)])
def test_a_hint_never_prints_two_equal_numbers(pair):
    found, expected = numbers_apart(*pair)
    assert found != expected


def test_headings_are_the_same_on_the_circle_and_nan_is_not():
    assert same_poses([1.0, 2.0, np.pi], np.array([1.0, 2.0, -np.pi]))
    assert not same_poses([1.0, 2.0, 0.0], np.array([1.0, 2.0, 0.02]))
    assert not same_poses([1.0, np.nan, 0.0], np.array([1.0, 2.0, 0.0]))
    assert same_numbers([np.nan, 1.0], np.array([np.nan, 1.00001]))
    assert not same_numbers([1.0, 1.0], np.array([np.nan, 1.0]))


def test_a_heading_that_is_right_but_for_a_turn_is_not_what_a_hint_blames():
    cases = [(np.array([1.0, 2.0, -3.0]),)]
    turned = compare(lambda p: p + [0.4, 0.0, 2 * np.pi], lambda p: p, cases, same=same_poses)
    assert "returns 1.4 at index [0]; expected 1." in turned.message
    backwards = compare(
        lambda p: p + [0.0, 0.0, 2 * np.pi], lambda p: p, cases
    )  # where the circle does not count
    assert "returns 3.283 at index [2]; expected -3." in backwards.message


def test_arguments_are_named_in_numbers_where_they_are_few():
    flags = [(np.array([True, False]), 1.0)]
    assert "For a = [True, False], b = 1.0 your" in compare(lambda a, b: 3.3, lambda a, b: 7.1, flags).message
    many = [(np.arange(100.0), np.sin)]
    words = compare(lambda counts, f: 3.3, lambda counts, f: 7.1, many).message
    assert "For counts of the shape (100,), f (a function) your function returns 3.3; expected 7.1" in words
    assert "argument 1" in compare(lambda *a: 3.3, lambda a, b: 7.1, flags).message


def test_a_mistake_may_have_another_shape():
    mistakes = [(lambda m, f: m, "All rows are still there.")]
    assert "still there" in compare(lambda m, f: m, lambda m, f: m[1:], CASES, mistakes=mistakes).message
    assert "shape (1, 2)" in compare(lambda m, f: m[0], lambda m, f: m[1:], CASES).message
