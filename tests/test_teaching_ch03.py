"""What chapter 03 claims about noise, and what its check of Eq. 11 says to those who draw it in another way."""

import numpy as np
import pytest
from notebook_cells import run, source
from pfslam_book import ch03
from pfslam_book.exercises.ch03 import STEP, check_predict, moved, predict_belief, update_belief
from right_styles import MOVES, move_in_a_loop

from pfslam.motion import motion_model, motion_model_arc


def test_bayes_by_hand_on_three_cells():
    after_the_move = predict_belief(np.array([1.0, 0.0, 0.0]), STEP)
    np.testing.assert_allclose(after_the_move, [0.1, 0.8, 0.1])
    np.testing.assert_allclose(update_belief(after_the_move, np.array([0.5, 0.0, 1.0])), [1 / 3, 0.0, 2 / 3])


def noise_of_the_page():
    cell = source("03", "noise-models").split("\n\n\n")[0]
    names: dict = {}
    run(cell, names)
    return names["noise"]


def test_noise_models_differ_where_the_chapter_says_so():
    noise = noise_of_the_page()
    spread = {(d, m): ch03.ends(noise, d, m) for d in ch03.DRIVES for m in ch03.MODELS}
    assert spread["straight", "own share"]["heading"] == pytest.approx(0.0, abs=1e-9)
    assert spread["standing", "with motion"]["ahead"] == pytest.approx(0.0, abs=1e-9)
    expected = np.rad2deg(0.07 * np.sqrt(ch03.TAU * 60.0))
    assert spread["standing", "constant"]["heading"] == pytest.approx(expected, rel=0.15)
    assert spread["standing", "on x and y"]["across"] == pytest.approx(0.04 * np.sqrt(600), rel=0.15)


@pytest.mark.parametrize("move", MOVES)
def test_a_right_move_passes_with_its_own_generator(move):
    assert check_predict(move)


def driving(draw, model=motion_model, jitter=0.0):
    """Eq. 11 with its two noises drawn in another way, another model, or noise on the pose."""

    def wrong(poses, v, omega, dt, sigma_v, sigma_omega, rng):
        a, b = draw(rng, len(poses))
        shaken = jitter * rng.standard_normal(poses.shape)
        return model(poses, v + sigma_v * a, omega + sigma_omega * b, dt) + shaken

    return wrong


def usual(rng, n):
    return rng.standard_normal((2, n))


def tied(rng, n):
    return np.broadcast_to(rng.standard_normal(n), (2, n))


def by_pairs(rng, n):
    return np.repeat(rng.standard_normal((2, n // 2)), 2, axis=1)


def without_omega(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    return motion_model(poses, v + sigma_v * rng.standard_normal(len(poses)), omega, dt)


def never_backwards(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    v = np.maximum(v + sigma_v * rng.standard_normal(len(poses)), 0.0)
    return motion_model(poses, v, omega + sigma_omega * rng.standard_normal(len(poses)), dt)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (driving(lambda rng, n: rng.standard_normal((2, 1))), "all particles move alike"),
        (driving(lambda rng, n: np.zeros((2, n))), "all particles move alike"),
        (driving(tied), "one number for both"),
        (driving(by_pairs), "share one draw"),
        (driving(lambda rng, n: np.sqrt(3) * rng.uniform(-1, 1, (2, n))), "wrong shape"),
        (driving(lambda rng, n: rng.laplace(0, np.sqrt(0.5), (2, n))), "wrong shape"),
        (driving(usual, jitter=0.01), "moved sideways"),
        (driving(usual, model=motion_model_arc), "old heading: use motion_model"),
        (driving(lambda rng, n: np.random.default_rng(0).standard_normal((2, n))), "a seed of your own"),
        (driving(lambda rng, n: np.random.standard_normal((2, n))), "Twice the same rng"),  # noqa: NPY002
        (lambda p, *rest: move_in_a_loop(p, *rest) - p, "the steps alone"),
        (without_omega, "the spread of your cloud in heading is 0.0000 rad"),
        (never_backwards, "For v = 0, omega = 0.3, dt = 0.21 the mean of your cloud along the path"),
        (lambda p, v, w, *rest: move_in_a_loop(p, -v, w, *rest), "the mean of your cloud along the path"),
        (lambda p, *rest: move_in_a_loop(p, *rest)[:1], "shape"),
        (lambda poses, v: poses, "TypeError"),
    ],
)
def test_a_cloud_that_is_drawn_otherwise_hears_in_what_it_differs(wrong, words):
    verdict = check_predict(wrong)
    assert verdict.verdict == "wrong"
    assert words in verdict.message


def test_the_named_mistakes_keep_their_words_for_a_reader_with_a_generator():
    for words, mistake in moved.mistakes.items():

        def theirs(*arguments, mistake=mistake):
            return mistake(*arguments[:-1], int(arguments[-1].integers(1000)))

        assert check_predict(theirs).message == f"Not yet. {words}"


def test_an_unwritten_move_is_unanswered():
    assert check_predict(lambda *arguments: ...).verdict == "unanswered"
