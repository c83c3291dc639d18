"""Exercises of chapter 03: right answers in many styles, wrong ones and the words for each; and its pictures."""

import math
import random
from collections import deque
from fractions import Fraction

import numpy as np
import pytest
from pfslam_book import ch03
from pfslam_book.ch03 import mean as ch03_mean
from pfslam_book.ch03 import models as ch03_models
from pfslam_book.ch03.cloud import fan
from pfslam_book.ch03.corridor import STEP, corridor_walk, predict_belief, update_belief

from pfslam.motion import Controls, motion_model, motion_model_arc
from pfslam.particles import ControlNoise, Particles, predict
from pfslam.poses import wrap_angle

# ---- right answers: loops, lists, float32, four digits, other containers, complex numbers


def spread_by_variances(sigma_omega, rate, seconds):
    variance = sum((sigma_omega / rate) ** 2 for _ in range(round(rate * seconds * 1000))) / 1000
    return [57.3 * variance**0.5]


def move_in_a_loop(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    moved = []
    for x, y, theta in poses.tolist():
        a, b = v + rng.normal(0, sigma_v), omega + rng.normal(0, sigma_omega)
        moved.append((x + dt * a * np.cos(theta), y + dt * a * np.sin(theta), theta + dt * b))
    return moved


def move_float32(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    noise = rng.standard_normal((len(poses), 2), dtype=np.float32) * np.float32([sigma_v, sigma_omega])
    poses = poses.astype(np.float32)
    return motion_model(poses, (v + noise[:, 0]), (omega + noise[:, 1]), dt).astype(np.float32)


def move_complex(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    a, b = rng.normal([[v], [omega]], [[sigma_v], [sigma_omega]], (2, len(poses)))
    z = poses[:, 0] + 1j * poses[:, 1] + dt * a * np.exp(1j * poses[:, 2])
    return np.stack([z.real, z.imag, poses[:, 2] + dt * b], axis=1)


def move_by_matrices(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    moved = deque()
    for x, y, theta in poses:
        a, b = v + sigma_v * rng.standard_normal(), omega + sigma_omega * rng.standard_normal()
        c, s = np.cos(theta), np.sin(theta)
        place = np.array([[c, -s, x], [s, c, y], [0, 0, 1]]) @ [a * dt, 0, 1]
        moved.append([*place[:2], theta + b * dt])
    return moved


def move_by_the_standard_library(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    own, moved = random.Random(int(rng.integers(2**31))), []
    for x, y, theta in poses.tolist():
        a, turn = own.gauss(v, sigma_v) * dt, own.gauss(omega, sigma_omega) * dt
        turned = (theta + turn) % (2 * math.pi)
        moved.append([x + a * math.cos(theta), y + a * math.sin(theta), turned])
    return moved


def move_with_a_covariance(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    u = rng.multivariate_normal([v, omega], np.diag([sigma_v**2, sigma_omega**2]), len(poses))
    return np.round(motion_model(poses, u[:, 0], u[:, 1], dt), 5)


def track_by_fourier(belief, looks, step):
    kernel = np.zeros(len(belief))
    for cells, chance in step.items():
        kernel[cells % len(belief)] += chance
    for k, look in enumerate(looks):
        if k:
            belief = np.fft.ifft(np.fft.fft(belief) * np.fft.fft(kernel))
        belief = belief * look / (belief @ look)
    return belief.real


def track_by_logarithms(belief, looks, step):
    logs = np.log(belief) + np.log(looks[0])
    for look in looks[1:]:
        moved = [math.log(p) + np.roll(logs, cells) for cells, p in step.items()]
        logs = np.logaddexp.reduce(moved) + np.log(look)
    return np.exp(logs - np.logaddexp.reduce(logs))


def track_in_fractions(belief, looks, step):
    belief, n = [Fraction(float(b)) for b in belief], len(belief)
    for k, look in enumerate(looks):
        if k:
            belief = [sum(Fraction(p) * belief[i - cells] for cells, p in step.items()) for i in range(n)]
        belief = [b * Fraction(float(seen)) for b, seen in zip(belief, look, strict=True)]
    return deque(float(b / sum(belief)) for b in belief)


def track_in_loops(belief, looks, step):
    belief = list(belief)
    for k, look in enumerate(looks):
        if k:
            moved = [0.0] * len(belief)
            for i, p in enumerate(belief):
                for cells, chance in step.items():
                    moved[(i + cells) % len(belief)] += p * chance
            belief = moved
        belief = [a * b for a, b in zip(belief, look, strict=True)]
        belief = [b / sum(belief) for b in belief]
    return tuple(belief)


def track_by_matrix(belief, looks, step):
    move = sum(p * np.roll(np.eye(len(belief)), cells, axis=0) for cells, p in step.items())
    for k, look in enumerate(looks):
        belief = np.float32(look * (move @ belief if k else belief))
    return belief / belief.sum()


@pytest.mark.parametrize(
    ("check", "answer"),
    [
        (ch03.check_heading_spread, lambda s, rate, t: round(float(np.rad2deg(s * (t / rate) ** 0.5)), 4)),
        (ch03.check_heading_spread, lambda s, rate, t: np.float32(s * 180 / np.pi) * np.sqrt(t / rate)),
        (ch03.check_heading_spread, lambda s, rate, t: np.array([57.3 * s * (t / rate) ** 0.5])),
        (ch03.check_heading_spread, lambda s, rate, t: math.degrees(s * math.sqrt(t / rate))),
        (ch03.check_heading_spread, lambda s, rate, t: abs(1j * s * 180 / np.pi) * (t / rate) ** 0.5),
        (
            ch03.check_heading_spread,
            lambda s, rate, t: deque([math.degrees(s) * math.hypot((t / rate) ** 0.5)]),
        ),
        (ch03.check_predict, move_by_matrices),
        (ch03.check_predict, move_by_the_standard_library),
        (ch03.check_predict, move_with_a_covariance),
        (ch03.check_predict, move_in_a_loop),
        (ch03.check_predict, move_float32),
        (ch03.check_predict, move_complex),
        (ch03.check_track, track_by_fourier),
        (ch03.check_track, track_by_logarithms),
        (ch03.check_track, track_in_fractions),
        (ch03.check_track, track_in_loops),
        (ch03.check_track, track_by_matrix),
        (ch03.check_track, lambda b, looks, s: np.round(track_by_matrix(b, looks, s), 5)),
    ],
)
def test_the_same_in_another_style_is_right_too(check, answer):
    assert check(answer), check(answer)


# ---- wrong answers


def moving(
    noise_v=1.0,
    noise_omega=1.0,
    v=1.0,
    omega=1.0,
    draw="both",
    model=motion_model,
    jitter=0.0,
    shape="normal",
):
    """A prediction with one thing wrong: factors on noise and controls, another draw, model or shape of noise."""

    def wrong(poses, v_, omega_, dt, sigma_v, sigma_omega, rng):
        n = {"one for all": 1, "one for both": len(poses)}.get(draw, len(poses))
        draws = rng.standard_normal((2, n)) if shape == "normal" else rng.uniform(-(3**0.5), 3**0.5, (2, n))
        a, b = (draws[0], draws[0]) if draw == "one for both" else draws
        sigma_v = noise_v(sigma_v, v_, dt) if callable(noise_v) else noise_v * sigma_v
        sigma_omega = (
            noise_omega(sigma_omega, omega_, dt) if callable(noise_omega) else noise_omega * sigma_omega
        )
        moved = model(poses, v * v_ + sigma_v * a, omega * omega_ + sigma_omega * b, dt)
        return moved + jitter * dt * np.array([sigma_v, sigma_v, sigma_omega]) * rng.standard_normal(
            poses.shape
        )

    return wrong


def into_the_input(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    poses += 1.0
    return poses


def from_the_global_state(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    own = np.random.RandomState()
    return motion_model(poses, v + sigma_v * own.normal(size=len(poses)), omega, dt)


def two_draws_of_v(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    a, b = rng.normal(v, sigma_v, (2, len(poses)))
    x, y, theta = poses.T
    turned = theta + dt * rng.normal(omega, sigma_omega, len(poses))
    return np.column_stack([x + dt * a * np.cos(theta), y + dt * b * np.sin(theta), turned])


def with_one_sign(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    a, b = np.abs(rng.standard_normal((2, len(poses))))
    return motion_model(poses, v + sigma_v * a, omega + sigma_omega * b, dt)


def with_heavy_tails(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    a, b = rng.laplace(0, 0.5**0.5, (2, len(poses)))
    return motion_model(poses, v + sigma_v * a, omega + sigma_omega * b, dt)


def draws_shared_by_two(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    a, b = np.repeat(rng.standard_normal((2, len(poses) // 2)), 2, axis=1)
    return motion_model(poses, v + sigma_v * a, omega + sigma_omega * b, dt)


def with_a_seed_of_its_own(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    return moving()(poses, v, omega, dt, sigma_v, sigma_omega, np.random.default_rng(0))


def along_x(poses, v, omega, dt):
    return poses + dt * np.stack([v, 0 * v, omega], axis=-1)


def turn_first(poses, v, omega, dt):
    turned = poses + dt * np.stack([0 * v, 0 * v, omega], axis=-1)
    return motion_model(turned, v, 0.0, dt)


def without_return(*arguments):
    pass


WRONG_SPREADS = [
    (lambda s, rate, t: np.rad2deg(s * t), "a bias"),
    (lambda s, rate, t: np.rad2deg(s * np.sqrt(t)), "where is the sample rate"),
    (lambda s, rate, t: s * np.sqrt(t / rate), "in radians"),
    (lambda s, rate, t: np.rad2deg(np.sqrt(s * t / rate)), "for a variance"),
    (lambda s, rate, t: np.rad2deg(s**2 * t / rate), "That is the variance"),
    (lambda s, rate, t: np.rad2deg(s * np.sqrt(t * rate)), "left out tau"),
    (lambda s, rate, t: np.rad2deg(s * np.sqrt(t) / rate), "outside it"),
    (lambda s, rate, t: -np.rad2deg(s * np.sqrt(t / rate)), "sign"),
    (lambda s, rate, t: np.deg2rad(s * np.sqrt(t / rate)), "are swapped"),
    (lambda s, rate, t: 1000 * np.rad2deg(s * np.sqrt(t / rate)), "thousand times too large"),
    (lambda s, rate, t: 2.5 * np.sqrt(t / rate), "your function returns 1; expected 4.584"),
    (lambda s, rate, t: "wide", "One number"),
    (lambda s, rate, t: [1.0, 2.0], "One number"),
    (without_return, "returns nothing"),
    (lambda s, rate, t: np.rad2deg(s * np.sqrt(rate / t)), "change them"),
    (lambda s, rate, t: np.rad2deg(s * rate * t), "yaw rates of all samples"),
    (lambda s, rate, t: np.rad2deg(np.sqrt(t / rate)), "Where is sigma_omega"),
    (lambda s, rate, t: np.rad2deg(s / np.sqrt(rate * t)), "mean* yaw rate"),
    (lambda s, rate, t: np.rad2deg(s * t / rate), "under a root"),
]


def never_backwards(poses, v, omega, dt, sigma_v, sigma_omega, rng):
    v = np.maximum(v + sigma_v * rng.standard_normal(len(poses)), 0.0)
    return motion_model(poses, v, omega + sigma_omega * rng.standard_normal(len(poses)), dt)


WRONG_MOVES = [
    (moving(draw="one for all"), "one number for the whole cloud"),
    (moving(draw="one for both"), "Draw two"),
    (moving(jitter=1.0), "sideways"),
    (moving(noise_v=lambda s, v, dt: s**2, noise_omega=lambda s, w, dt: s**2), "sigma squared"),
    (moving(noise_v=lambda s, v, dt: s**0.5), "taken for a variance"),
    (moving(noise_v=lambda s, v, dt: s * v), "in proportion to the control"),
    (moving(noise_omega=lambda s, w, dt: s * abs(w)), "in proportion to the control"),
    (moving(noise_v=lambda s, v, dt: s / dt), "1/dt times too wide"),
    (moving(noise_v=lambda s, v, dt: s / dt**0.5), "per root second"),
    (moving(noise_omega=0.0), "is missing"),
    (never_backwards, "ever moves backwards"),
    (moving(noise_v=0.0, noise_omega=0.0), "dead reckoning"),
    (moving(v=0.95), "where v leads"),
    (moving(omega=0.6), "where omega leads"),
    (moving(shape="uniform"), "wrong shape"),
    (moving(model=motion_model_arc), "exact arc"),
    (moving(model=turn_first), "turn first"),
    (moving(model=along_x), "own old heading"),
    (lambda p, v, w, dt, sv, sw, rng: moving()(p, v, w, dt, sw, sv, rng), "the other way round"),
    (lambda p, v, w, dt, sv, sw, rng: moving()(p[:1], v, w, dt, sv, sw, rng), "shape"),
    (from_the_global_state, "rng that is given"),
    (into_the_input, "changes what it is given"),
    (lambda poses, v: poses, "TypeError"),
    (two_draws_of_v, "v twice"),
    (with_one_sign, "only one sign"),
    (with_heavy_tails, "far draws are too common"),
    (draws_shared_by_two, "share one draw"),
    (with_a_seed_of_its_own, "a seed of your own"),
    (moving(v=-1.0), "the sign of v"),
    (moving(omega=-1.0), "the sign of omega"),
    (lambda p, *rest: moving()(p, *rest) - p, "the steps alone"),
    (lambda p, v, w, dt, *rest: moving()(p, v, w, 1.0, *rest), "1/dt times too wide"),
    (lambda p, v, w, dt, sv, sw, rng: moving()(p, v, w, dt, np.rad2deg(sv), sw, rng), "in degrees"),
    (lambda *arguments: moving()(*arguments).mean(axis=0), "shape"),
]


def tracking(move=predict_belief, look=update_belief):
    def wrong(belief, looks, step):
        for k, seen in enumerate(looks):
            belief = look(move(belief, step) if k else belief, seen)
        return belief

    return wrong


WRONG_TRACKS = [
    (tracking(look=lambda b, seen: b * seen), "do not sum to 1"),
    (tracking(look=lambda b, seen: (b + seen) / (b + seen).sum()), "expected"),
    (tracking(look=lambda b, seen: seen / seen.sum()), "The look replaces"),
    (tracking(move=lambda b, step: np.roll(b, 1)), "always moves by one cell"),
    (tracking(move=lambda b, step: predict_belief(b, {-k: p for k, p in step.items()})), "the wrong way"),
    (tracking(move=lambda b, step: b), "never moves"),
    (lambda b, looks, step: predict_belief(tracking()(b, looks, step), step), "One move too many"),
    (lambda b, looks, step: tracking()(predict_belief(b, step), looks, step), "before the first look"),
    (lambda b, looks, step: int(np.argmax(tracking()(b, looks, step))), "shape"),
    (lambda b, looks, step: tracking()(b, looks, step)[::-1], "opposite order"),
]


def in_place(belief, looks, step):
    belief *= looks[0]
    return tracking()(belief / belief.sum(), looks, step)


WRONG_TRACKS += [
    (in_place, "changes what it is given"),
    (lambda b, looks, step: tracking()(np.full(15, 1 / 15), looks, step), "plays no part"),
    (lambda b, looks, step: tracking()(b, looks, step) / tracking()(b, looks, step).max(), "greatest number"),
    (lambda b, looks, step: tracking()(b, looks[:1], step), "Only the first look"),
    (lambda b, looks, step: tracking()(b, looks[-1:], step), "Only the last look"),
    (lambda b, looks, step: tracking()(b, looks[:-1], step), "last look is left out"),
    (lambda b, looks, step: tracking()(b, looks[::-1], step), "from the last to the first"),
    (lambda b, looks, step: tracking()(b, looks**2, step), "counts twice"),
    (tracking(look=lambda b, seen: b), "never looks"),
    (tracking(move=lambda b, step: predict_belief(np.eye(15)[b.argmax()], step)), "most probable cell"),
    (lambda b, looks, step: [b] * len(looks), "shape"),
]


@pytest.mark.parametrize(
    ("check", "answer", "words"),
    [(ch03.check_heading_spread, *pair) for pair in WRONG_SPREADS]
    + [(ch03.check_predict, *pair) for pair in WRONG_MOVES]
    + [(ch03.check_track, *pair) for pair in WRONG_TRACKS],
)
def test_a_wrong_answer_is_refused_by_name(check, answer, words):
    verdict = check(answer)
    assert verdict.verdict == "wrong"
    assert words in verdict.message


def test_noise_models_differ_where_the_chapter_says_so():
    spread = {
        (drive, model): ch03_models.widths(ch03_models.model_cloud(drive, model)[-1], np.zeros(3))
        for drive in ch03_models.DRIVES
        for model in ch03_models.MODELS
    }
    assert spread["straight", "own share"]["heading"] == pytest.approx(0.0, abs=1e-9)
    assert spread["standing", "with motion"]["ahead"] == pytest.approx(0.0, abs=1e-9)
    expected = np.rad2deg(ch03_models.SIGMA_OMEGA * np.sqrt(ch03_models.TAU * 60.0))
    assert spread["standing", "constant"]["heading"] == pytest.approx(expected, rel=0.15)
    assert spread["standing", "on x and y"]["across"] == pytest.approx(0.04 * np.sqrt(600), rel=0.15)


def test_the_mean_of_two_corridors_is_in_neither():
    poses, weights = ch03_mean.two_corridors()
    middle = weights @ poses[:, 1]
    assert min(abs(middle - y) for y in ch03_mean.CORRIDOR_Y) > 1.0


@pytest.mark.parametrize("per_root_second", [False, True])
def test_the_fan_is_predict_control_after_control(per_root_second):
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.005, 0.02, 301))
    inputs = Controls(t, rng.uniform(0, 1, 300), rng.uniform(-1, 1, 300))
    noise = ControlNoise(0.3, 0.2, per_root_second)
    paths = fan(inputs, noise, 4, np.random.default_rng(0))
    particles, rng = Particles.at(np.zeros(3), 4), np.random.default_rng(0)
    for v, omega, dt in zip(inputs.v, inputs.omega, np.diff(inputs.t), strict=True):
        particles = predict(particles, v, omega, dt, noise, rng)
    np.testing.assert_allclose(paths[-1, :, :2], particles.poses[:, :2], atol=1e-9)
    np.testing.assert_allclose(wrap_angle(paths[-1, :, 2] - particles.poses[:, 2]), 0.0, atol=1e-9)


def test_a_belief_stays_a_probability():
    for moment in corridor_walk():
        assert moment.belief.sum() == pytest.approx(1.0)
        assert (moment.belief >= 0).all()


def test_bayes_by_hand_on_three_cells():
    moved = predict_belief(np.array([1.0, 0.0, 0.0]), STEP)
    np.testing.assert_allclose(moved, [0.1, 0.8, 0.1])
    np.testing.assert_allclose(update_belief(moved, np.array([0.5, 0.0, 1.0])), [1 / 3, 0.0, 2 / 3])
