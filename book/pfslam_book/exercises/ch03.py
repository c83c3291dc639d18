"""Checks of the exercises of chapter 03: each takes the reader's function and says what is wrong in words."""

from __future__ import annotations

import numpy as np
from pfslam_book.ch03.corridor import CELLS, predict_belief, update_belief
from pfslam_book.show.checks import Check, answer_to, compare, hint, passed

from pfslam.motion import motion_model_arc
from pfslam.poses import wrap_angle

# ---- 1: how wide the headings are

SPREADS = [
    (0.2, 50.0, 8.0),
    (0.13, 33.0, 61.0),
    *np.random.default_rng(1).uniform(0.1, 90.0, (2, 3)).tolist(),
]


def heading_spread(sigma_omega: float, rate: float, seconds: float) -> float:
    """Standard deviation of the headings in degrees after white noise of ``sigma_omega`` (rad/s) per sample."""
    return np.rad2deg(sigma_omega * np.sqrt(seconds / rate))


SPREAD_MISTAKES = [
    (lambda s, rate, t: np.rad2deg(s * t), "That is a bias: the same error in every sample. Independent errors partly "
     "cancel; their variances add, not their sizes."),
    (lambda s, rate, t: np.rad2deg(s * np.sqrt(t)), "The root of time is right, but where is the sample rate? Each "
     "sample turns the robot by tau times its noise."),
    (lambda s, rate, t: np.rad2deg(s * np.sqrt(rate * t)), "Each of the rate * seconds samples adds its noise times "
     "tau, the time that it lasts. You left out tau."),
    (lambda s, rate, t: np.rad2deg(s * np.sqrt(t) / rate), "Variances add: tau^2 from each of rate * seconds samples "
     "makes tau * seconds under the root. Your tau stands outside it."),
    (lambda s, rate, t: np.rad2deg(s * t / rate), "tau * seconds is right, but it stands under a root: variances add."),
    (lambda s, rate, t: np.rad2deg(np.sqrt(s * t / rate)), "You took sigma_omega for a variance. It is a standard "
     "deviation."),
    (lambda s, rate, t: np.rad2deg(s**2 * t / rate), "That is the variance. The spread is its root."),
    (lambda s, rate, t: s**2 * t / rate, "That is the variance, in radians squared. The spread is its root."),
    (lambda s, rate, t: np.rad2deg(s * np.sqrt(rate / t)), "The rate stands above and the time below: change them."),
    (lambda s, rate, t: np.rad2deg(s * rate * t), "You add the yaw rates of all samples. Each sample turns the robot "
     "by tau times its noise, and it is the variances that add."),
    (lambda s, rate, t: np.rad2deg(np.sqrt(t / rate)), "Where is sigma_omega? Twice the noise makes twice the spread."),
    (lambda s, rate, t: np.rad2deg(s / np.sqrt(rate * t)), "That is the spread of the *mean* yaw rate. The heading is "
     "its sum, times tau."),
]  # fmt: skip


def check_heading_spread(spread_of_heading) -> Check:
    """Whether ``spread_of_heading(sigma_omega, rate, seconds)`` is right, in degrees."""
    praise = "The spread grows with the root of time, and with the root of the sample interval."
    return compare(spread_of_heading, heading_spread, SPREADS, mistakes=SPREAD_MISTAKES, praise=praise)


# ---- 2: Eq. 11

PER_POSE = 3000
START = np.repeat([[2.0, -1.0, 0.5], [-3.0, 0.7, 2.6]], PER_POSE, axis=0)
V, OMEGA, DT, SIGMA_V, SIGMA_OMEGA = 0.7, -0.4, 0.13, 0.3, 0.5
NEAR = 0.08
"""Share of a standard deviation by which an estimate from so many draws may be off."""


def check_predict(predict) -> Check:
    """Whether ``predict(poses, v, omega, dt, sigma_v, sigma_omega, rng)`` is Eq. 11."""
    clouds = [
        answer_to(predict, (START, V, OMEGA, DT, SIGMA_V, SIGMA_OMEGA, np.random.default_rng(seed)), START)
        for seed in (0, 0, 1)
    ]
    for answer in clouds:
        if isinstance(answer, Check):
            return answer
    moved, again, other = clouds
    step, heading = moved[:, :2] - START[:, :2], START[:, 2]
    ahead = step[:, 0] * np.cos(heading) + step[:, 1] * np.sin(heading)
    sideways = step[:, 1] * np.cos(heading) - step[:, 0] * np.sin(heading)
    turned = wrap_angle(moved[:, 2] - heading)
    problem = (
        _no_cloud(moved, again)
        or _sideways(ahead, sideways, turned, step)
        or _spread(ahead, turned)
        or _middle_and_shape(ahead, turned)
        or _draws(moved, other, ahead)
    )
    return hint(problem) if problem else passed("Every particle drives by its own noisy control.")


def _no_cloud(moved: np.ndarray, again: np.ndarray) -> str:
    """What makes the answer no cloud of new poses at all, or nothing."""
    if not np.isfinite(moved).all():
        return "Some of your poses are not finite numbers."
    if not np.array_equal(moved, again):
        return "Twice the same rng, two results: draw from the rng that is given, not from np.random."
    if np.abs(moved[:, :2]).max() < 1.0:
        return "You return the steps alone. Add them to the old poses."
    return ""


def _draws(moved: np.ndarray, other: np.ndarray, ahead: np.ndarray) -> str:
    """What is wrong with where the random numbers come from, or nothing."""
    if np.array_equal(moved, other):
        return "Two different rngs, one result: draw from the rng that is given, not from one with a seed of your own."
    pairs = np.array_split(ahead, 2), (ahead[::2], ahead[1::2])
    if max(np.corrcoef(a, b)[0, 1] for a, b in pairs) > 0.2:
        return "Several particles share one draw. Each needs numbers of its own."
    return ""


def _sideways(ahead: np.ndarray, sideways: np.ndarray, turned: np.ndarray, step: np.ndarray) -> str:
    """What the step gives away about how noise and motion model were joined, or nothing."""
    if np.ptp(ahead) < 1e-5 and np.ptp(turned) < 1e-5:
        if abs(ahead[0] - DT * V) < 1e-5:
            return "All particles moved alike, without any noise: that is dead reckoning."
        return "All particles moved alike: you drew one number for the whole cloud. Draw one for each."
    arc = motion_model_arc(np.zeros(3), ahead / DT, turned / DT, DT)
    if np.abs(sideways).max() > 1e-4 and np.corrcoef(sideways, arc[:, 1])[0, 1] > 0.99:
        if sideways.std() > 1.5 * arc[:, 1].std():  # an arc leaves the old heading by half of the turn
            return "You turn first and drive then. Eq. 5 drives along the old heading: compute x and y before theta."
        return "That is the exact arc. Eq. 5 drives straight along the old heading and turns then: use motion_model."
    speeds = (step / np.column_stack([np.cos(START[:, 2]), np.sin(START[:, 2])]) / DT).T
    if all(_near(speed.std(), SIGMA_V) for speed in speeds) and abs(np.corrcoef(speeds)[0, 1]) < 0.5:
        return (
            "You drew v twice, for x and for y. A particle has one noisy v, which moves it along its heading."
        )
    if sideways.std() > 0.3 * ahead.std():
        return "Particles moved sideways, which wheels cannot. Noise belongs on v and omega, not on the pose."
    if np.abs(sideways).max() > 1e-4:
        return (
            "Particles moved sideways. Eq. 5 drives along each particle's own old heading: use motion_model."
        )
    return ""


def _spread(ahead: np.ndarray, turned: np.ndarray) -> str:
    """What is wrong with the size of the noise, or nothing."""
    found = ahead.std() / DT, turned.std() / DT
    if any(abs(edge - DT * V) < 0.1 * DT * SIGMA_V for edge in (min(ahead), max(ahead))):
        return "Your noise on v has only one sign. Gaussian noise makes some particles too slow and others too fast."
    if _near(found[0], SIGMA_OMEGA) and _near(found[1], SIGMA_V):
        return "The noise on v has the size of sigma_omega, and the other way round."
    for where, value, sigma, control in (
        ("along the path", found[0], SIGMA_V, V), ("in heading", found[1], SIGMA_OMEGA, OMEGA)
    ):  # fmt: skip
        words = {
            sigma**0.5: "is that of a sigma taken for a variance",
            sigma**2: "is that of a sigma squared: rng.normal asks for a standard deviation",
            sigma
            / DT: "is 1/dt times too wide: add the noise to the control, which is then multiplied by dt",
            sigma / DT**0.5: "is that of noise per root second; the exercise asks for noise per sample",
            sigma * DT: "has dt in it twice",
            sigma
            * abs(
                control
            ): "is in proportion to the control. Eq. 11 adds noise of the same size at any speed",
            np.rad2deg(sigma): "is in degrees",
            0.0: "is missing: v and omega have noise each",
        }
        if _near(value, sigma):
            continue
        named = next((text for size, text in words.items() if _near(value, size)), "")
        return f"The spread {where} {named or f'is {value * DT:.4f}, expected about {sigma * DT:.4f}'}."
    return ""


def _near(value: float, size: float) -> bool:
    return abs(value - size) < NEAR * size + 1e-9


def _middle_and_shape(ahead: np.ndarray, turned: np.ndarray) -> str:
    """What is wrong with the middle, the shape or the independence of noise of the right size, or nothing."""
    for values, control, sigma, name in ((ahead, V, SIGMA_V, "v"), (turned, OMEGA, SIGMA_OMEGA, "omega")):
        middle, error = values.mean() - DT * control, DT * sigma / np.sqrt(len(values))
        if abs(values.mean() + DT * control) < 4.0 * error:
            return f"The cloud goes the wrong way: the sign of {name} is turned round."
        if abs(middle) > 4.0 * error:
            return f"The middle of the cloud is not where {name} leads: the noise must be added to {name} itself."
    if abs(np.corrcoef(ahead, turned)[0, 1]) > 0.1:
        return "A particle that drives too far also turns too much: you drew one number for both. Draw two."
    tails = [np.mean(((values - values.mean()) / values.std()) ** 4) for values in (ahead, turned)]
    if min(tails) < 2.5:
        return (
            "The noise has the right size and the wrong shape: it has edges. Eq. 11 asks for Gaussian noise."
        )
    if max(tails) > 4.0:
        return "The noise has the right size and the wrong shape: far draws are too common. Eq. 11 asks for a Gaussian."
    if ahead.min() > -1e-9:  # one draw in a hundred of v is negative
        return "No particle ever moves backwards: where the noise makes v negative, Eq. 11 drives backwards."
    return ""


# ---- 3: the Bayes filter


def tracked(belief, looks, step):
    """The belief after the first look, and then after each move and the look that follows it."""
    belief = update_belief(np.asarray(belief), np.asarray(looks[0]))
    for look in looks[1:]:
        belief = update_belief(predict_belief(belief, step), np.asarray(look))
    return belief


def _drive(rng: np.random.Generator, moves: int) -> tuple:
    """A belief, likelihoods ``(moves + 1, cells)`` and a step that overshoots more often than it slips."""
    belief, looks = rng.dirichlet(np.ones(CELLS)), rng.uniform(0.1, 0.9, (moves + 1, CELLS))
    return belief, looks, {0: 0.15, 1: 0.6, 2: 0.25}


def _joined(move=predict_belief, look=update_belief, first: bool = True, last: bool = False):
    """A filter with one thing wrong: its move, its look, no first look, or a move too many before it."""

    def wrong(belief, looks, step):
        for k, seen in enumerate(looks):
            if k or last:
                belief = move(belief, step)
            if k or first:
                belief = look(belief, seen)
        return belief

    return wrong


def _to_the_left(belief, step):
    return predict_belief(belief, {-cells: p for cells, p in step.items()})


def _past_the_end(belief, step):
    return sum(p * np.concatenate([np.zeros(c), belief[: len(belief) - c]]) for c, p in step.items())


def _only_the_best(belief, step):
    return predict_belief(np.eye(len(belief))[np.argmax(belief)], step)


def _all_looks_first(belief, looks, step):
    belief = update_belief(belief, np.prod(looks, axis=0))
    for _ in looks[1:]:
        belief = predict_belief(belief, step)
    return belief


def _even(belief):
    return np.full(len(belief), 1 / len(belief))


TRACK_MISTAKES = [
    (_joined(look=lambda belief, seen: belief * seen), "Right products, but they do not sum to 1. Divide by their sum "
     "at each look."),
    (lambda belief, looks, step: tracked(belief, looks, step) / tracked(belief, looks, step).max(), "You divide by the "
     "greatest number. Divide by the sum: a belief sums to 1."),
    (_joined(last=True), "You move before the first look. The robot looks first, then moves and looks in turn."),
    (lambda belief, looks, step: update_belief(belief, looks[0]), "Only the first look counts. Go through all."),
    (lambda belief, looks, step: update_belief(belief, looks[-1]), "Only the last look counts. Go through all."),
    (_joined(first=False), "The first look is left out."),
    (lambda belief, looks, step: tracked(belief, looks[:-1], step), "The last look is left out."),
    (lambda belief, looks, step: tracked(belief, looks[::-1], step), "You take the looks from the last to the first."),
    (_joined(move=_to_the_left), "Your robot moves the wrong way: what is in cell i comes to cell i + 1."),
    (_joined(move=_past_the_end), "Probability drops off the end. The corridor is a ring: np.roll."),
    (_joined(move=lambda belief, step: np.roll(belief, 1)), "Your robot always moves by one cell. Sometimes it slips "
     "or overshoots: add up all the steps, each times its probability."),
    (_joined(move=lambda belief, step: belief), "Your robot never moves: predict before each later look."),
    (_joined(move=_only_the_best), "You keep only the most probable cell and lose the others. Move the whole belief."),
    (_joined(look=lambda belief, seen: belief), "Your robot moves and never looks."),
    (_all_looks_first, "You look many times and move afterwards. The robot moves and looks in turn."),
    (_joined(look=lambda belief, seen: update_belief(belief, seen**2)), "Each look counts twice."),
    (lambda belief, looks, step: predict_belief(tracked(belief, looks, step), step), "One move too many: the walk ends "
     "with a look."),
    (_joined(look=lambda belief, seen: seen / seen.sum()), "The look replaces the belief. Multiply them."),
    (lambda belief, looks, step: tracked(_even(belief), looks, step), "The belief that you are given plays no part."),
    (lambda belief, looks, step: belief, "The belief comes back as it was."),
]  # fmt: skip


def check_track(track) -> Check:
    """Whether ``track(belief, looks, step)`` is the whole Bayes filter on the ring of cells."""
    cases = [_drive(np.random.default_rng(seed), moves) for seed, moves in ((1, 1), (2, 3), (3, 6))]
    praise = "Predict and update in turn: a whole Bayes filter."
    return compare(track, tracked, cases, mistakes=TRACK_MISTAKES, praise=praise)
