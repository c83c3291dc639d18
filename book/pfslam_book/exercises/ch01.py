"""Checks of the exercises of chapter 01: each takes the reader's function and says in words what is wrong with it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from pfslam_book.show.checks import Check, compare

from pfslam.motion import Controls, integrate, motion_model, motion_model_arc
from pfslam.poses import wrap_angle

# ---- exercise 1: the distance in raw counts


def _counts_case(seed: int) -> tuple:
    """Return counts of four wheels that differ, and the metres per count."""
    rng = np.random.default_rng(seed)
    counts = rng.integers(3, 30, 9)[:, None] + rng.integers(0, 10, (9, 4))
    return counts, (0.0022, 0.0031, 0.0017, 0.0022)[seed]


def path_length(counts, metres_per_count) -> float:
    """Solve exercise 1."""
    return float(np.mean(counts, axis=1).sum() * metres_per_count)


def _wheels(one: Callable) -> Callable:
    """Return a wrong length, with another way to make one number of four wheels."""
    return lambda counts, metres: one(np.asarray(counts)).sum() * metres


LENGTH_MISTAKES = [
    (
        _wheels(lambda c: c.sum(axis=1)),
        "Four times too long: you added the wheels. The chassis centre travels their mean.",
    ),
    (lambda c, m: path_length(c, 1.0), "That is in counts. Each count is worth metres_per_count metres."),
    (
        _wheels(lambda c: c[-1:].mean(axis=1)),
        "You take the last reading for a running total. Each reading is the increment "
        "since the one before: add them all.",
    ),
    (
        lambda c, m: (c[-1] - c[0]).mean() * m,
        "You take counts for a running total, by difference. Each reading is already "
        "the increment since the one before.",
    ),
    (
        _wheels(lambda c: c.mean(axis=1).mean()),
        "That is the mean over the readings. The distance is their sum.",
    ),
    (
        _wheels(lambda c: c[1:].mean(axis=1)),
        "The first reading is left out, and it belongs to the drive too.",
    ),
    (
        _wheels(lambda c: c[:, :2].mean(axis=1)),
        "You use the front wheels only; the mean of all four is asked for.",
    ),
    *(
        (
            _wheels(lambda c, pair=pair: c[:, pair].mean(axis=1)),
            "You use two wheels only; the mean of all four is asked for.",
        )
        for pair in ([2, 3], [0, 2], [1, 3], [0, 3], [1, 2])
    ),
    *(
        (
            _wheels(lambda c, wheel=wheel: c[:, wheel]),
            "You use one wheel only; the mean of all four is asked for.",
        )
        for wheel in range(4)
    ),
    (
        _wheels(lambda c: c[:-1].mean(axis=1)),
        "The last reading is left out, and it belongs to the drive too.",
    ),
    (
        lambda c, m: path_length(c, 0.0022),
        "You take 0.0022 m per count whatever you are given. Another robot has another metres_per_count.",
    ),
    (
        lambda c, m: path_length(c, 1.0) / m,
        "You divide by metres_per_count. Counts times metres per count are metres.",
    ),
    (
        _wheels(lambda c: np.rint(c.mean(axis=1))),
        "You round the mean of the wheels to whole counts. Up to half a count is lost in each reading.",
    ),
    (
        _wheels(lambda c: np.median(c, axis=1)),
        "That is the median of the wheels. The chassis centre travels their mean.",
    ),
    (
        _wheels(lambda c: 0.5 * (c.min(axis=1) + c.max(axis=1))),
        "That is the middle between the slowest and the fastest wheel. The mean of all four is asked for.",
    ),
    (
        _wheels(lambda c: c.sum(axis=1) // 4),
        "// drops the rest of a division, up to three quarters of a count in each reading. Divide with /.",
    ),
    (lambda c, m: c.sum() // 4 * m, "// drops the rest of a division. Divide with /."),
]


def check_path_length(theirs: Callable) -> Check:
    """Check whether ``path_length(counts, metres_per_count)`` adds up the mean of the four wheels."""
    cases = [_counts_case(seed) for seed in range(4)]
    return compare(
        theirs, path_length, cases, mistakes=LENGTH_MISTAKES, praise="The mean of the wheels, summed."
    )


# ---- exercise 2: the bias of a gyro

WARM = 3.0  # s after which the made-up gyro has warmed up
RESTS = ((0.0, 15.0), (35.0, 41.0), (58.0, 80.0))


def _gyro_case(seed: int) -> tuple:
    """Return stamps, yaw rate and speed of 70 s with three rests; the gyro has a bias, noise, and 2.3 s to warm up."""
    rng = np.random.default_rng(seed)
    t = 100.0 + np.cumsum(rng.uniform(0.008, 0.012, 7000))
    since = t - t[0]
    still = np.any([(since >= a) & (since < b) for a, b in RESTS], axis=0)
    bias = (0.004, -0.006, 0.005, 0.0045)[seed]
    turns = np.where(still, 0.0, 0.4 + 0.3 * np.sin(since / 3.0))
    rate = bias + turns + 0.1 * np.maximum(1.0 - since / 2.3, 0.0) + rng.normal(0.0, 0.006, len(t))
    return t, rate, np.where(still, 0.0, 0.9)


def gyro_bias(t, yaw_rate, speed, warm: float = WARM) -> float:
    """Solve exercise 2."""
    return float(yaw_rate[(speed == 0) & (t > t[0] + warm)].mean())


def _same_bias(found, expected) -> bool:
    """Tell whether two biases agree as well as the noise of the gyro allows."""
    return bool(abs(float(found) - float(expected)) < 0.12 * abs(float(expected)))


BIAS_MISTAKES = [
    (lambda t, w, v: w.mean(), "You average over the whole drive, and the turns are in it too."),
    (
        lambda t, w, v: w[t > t[0] + WARM].mean(),
        "You average over the whole drive, and the turns are in it too.",
    ),
    (lambda t, w, v: np.median(w), "You take the median of the whole drive, and the turns are in it too."),
    (
        lambda t, w, v: w[v > 0].mean(),
        "You average while the robot drives. The bias is what the gyro shows at rest.",
    ),
    (
        lambda t, w, v: w[v == 0].mean(),
        "The first seconds, while the gyro warms up, are still in your mean. Leave them out.",
    ),
    (
        lambda t, w, v: w[(v == 0) & (t > t[0] + 1.0)].mean(),
        "You leave out one second, and the gyro needs two or three to warm up.",
    ),
    (
        lambda t, w, v: np.median(w[v == 0]),
        "The first seconds, while the gyro warms up, are still in your median. Leave them out.",
    ),
    (
        lambda t, w, v: w[t < t[0] + RESTS[0][1]].mean(),
        "You use the first rest with the seconds in which the gyro warms up. Leave them out.",
    ),
    (
        lambda t, w, v: np.deg2rad(gyro_bias(t, w, v)),
        "The rates are in rad/s already; there is nothing to convert.",
    ),
    (
        lambda t, w, v: w[t < t[0] + 1.0].mean(),
        "You trust the first second, while the gyro warms up. Use all the time at rest that comes later.",
    ),
    (
        lambda t, w, v: -gyro_bias(t, w, v),
        "The sign: the bias is what the gyro shows at rest; it is subtracted later.",
    ),
    (
        lambda t, w, v: w.min(),
        "That is the least single reading. One reading is mostly noise: take the mean of many.",
    ),
    (
        lambda t, w, v: w[-1],
        "That is the last single reading. One reading is mostly noise: take the mean of many.",
    ),
    (
        lambda t, w, v: w[(v == 0) & (t > t[0] + WARM)][0],
        "That is one single reading, and mostly noise: take the mean of many.",
    ),
    (
        lambda t, w, v: np.abs(w[(v == 0) & (t > t[0] + WARM)]).mean(),
        "The mean of absolute values counts the noise as "
        "well. Noise of both signs must be allowed to cancel.",
    ),
    (
        lambda t, w, v: w[(v == 0) & (t > t[0] + WARM)].std(),
        "That is the spread of the readings at rest, not their mean.",
    ),
    (
        lambda t, w, v: np.sqrt((w[(v == 0) & (t > t[0] + WARM)] ** 2).mean()),
        "The root of the mean square counts the noise as well. Noise of both signs must be allowed to cancel.",
    ),
    (
        lambda t, w, v: w.max(),
        "That is the greatest single reading, in a turn. Take the mean of many at rest.",
    ),
    (
        lambda t, w, v: w[(v == 0) & (t > t[0] + WARM)].sum(),
        "That is the sum of the readings at rest, not their mean.",
    ),
]


def check_gyro_bias(theirs: Callable) -> Check:
    """Check whether ``gyro_bias(t, yaw_rate, speed)`` averages a noisy gyro at rest, once it is warm."""
    cases = [_gyro_case(seed) for seed in range(4)]
    praise = "The mean over the time when the robot stood still and the gyro was warm."
    return compare(theirs, gyro_bias, cases, mistakes=BIAS_MISTAKES, same=_same_bias, praise=praise)


# ---- exercise 3: one step along an arc


def _arc(pose, v, omega, dt) -> np.ndarray:
    """Solve exercise 3."""
    return motion_model_arc(np.asarray(pose, dtype=float), v, omega, dt)


ARC_CASES = [
    (np.array([1.0, 2.0, 0.5]), 1.2, 0.8, 1.1),
    (np.array([-0.4, 1.7, 2.2]), 0.9, -0.7, 1.3),
    (np.array([0.3, -2.0, -1.1]), 1.5, 1.3, 3.9),
    (np.array([2.0, 0.6, -2.6]), 0.7, 0.0, 1.6),
    (np.array([1.1, 0.2, 1.9]), -0.8, 0.6, 0.9),
    (np.array([-1.3, 0.9, 0.8]), 1.1, 0.04, 5.0),
]
"""Left, right, most of a circle, straight on, backwards, and a long and gentle bend."""


def _same_arc(found, expected) -> bool:
    """Tell whether two poses agree to a fifth of a millimetre, headings on the circle; NaN only with itself."""
    apart = np.asarray(found, dtype=float) - np.asarray(expected, dtype=float)
    apart[2] = wrap_angle(apart[2])
    both = np.isnan(found) & np.isnan(expected)
    return bool((both | (np.abs(apart) < 2e-4)).all())


def _chord(length: Callable, part: float) -> Callable:
    """Return a step by ``length(half) v dt`` in the direction of the old heading plus ``part`` of the turn."""

    def step(pose, v, omega, dt):
        half = 0.5 * omega * dt
        way, direction = v * dt * length(half), pose[2] + 2 * part * half
        return pose + np.array([way * np.cos(direction), way * np.sin(direction), 2 * half])

    return step


def _sine_over(half: float) -> float:
    return float(np.sinc(half / np.pi))


def _by_radius(pose, v, omega, dt, sign: float = 0.0) -> np.ndarray:
    """Return the arc with its radius, which is NaN straight on; ``sign`` 1 takes the radius without its sign."""
    radius = np.float64(v) / (abs(omega) if sign else omega)
    old, new = pose[2], pose[2] + omega * dt
    return np.array(
        [pose[0] + radius * (np.sin(new) - np.sin(old)), pose[1] - radius * (np.cos(new) - np.cos(old)), new]
    )


def _small_steps(pose, v, omega, dt, n: int, model=motion_model) -> np.ndarray:
    """Return the end of ``n`` small steps of Eq. 5."""
    steps = Controls(np.linspace(0.0, dt, n + 1), np.full(n, v), np.full(n, omega))
    return integrate(steps, start=pose, model=model).poses[-1]


def _swapped(pose, v, omega, dt) -> np.ndarray:
    """Return the exact step with sine and cosine exchanged."""
    step = _arc(pose, v, omega, dt) - pose
    return pose + step[[1, 0, 2]]


def _only_in_bends(pose, v, omega, dt, straight: tuple) -> np.ndarray:
    """Return the exact step in bends, and the pose moved by ``straight`` (in units of v dt) where there is no bend."""
    return _arc(pose, v, omega, dt) if omega else pose + v * dt * np.array(straight)


STRAIGHT = "In bends you may be right. But straight on, with omega = 0, you divide by zero."
ARC_MISTAKES = [
    (ZeroDivisionError, STRAIGHT),
    (motion_model, "That is the straight step of Eq. 5: it drives on, then turns."),
    (
        _chord(lambda half: np.sinc(half), 0.5),
        "Too short: NumPy's sinc(x) is sin(pi x) / (pi x). Divide its argument by pi.",
    ),
    (
        _chord(lambda half: 1.0, 0.5),
        "The direction is right, the length is not: v * dt is the length of the arc, and its "
        "chord is shorter.",
    ),
    (
        _chord(_sine_over, 0.0),
        "The chord is right, its direction is not: it points half way between old and new heading.",
    ),
    (
        _chord(_sine_over, 1.0),
        "The chord is right, its direction is not: it points half way between old and new heading.",
    ),
    (_chord(lambda half: 1.0, 1.0), "You turn first and then drive straight. The robot does both at once."),
    (lambda *a: np.append(_arc(*a)[:2], a[0][2]), "The position is right, but the heading did not change."),
    (
        lambda *a: np.append(_arc(*a)[:2], a[0][2] + 0.5 * a[2] * a[3]),
        "The position is right, but the heading has turned by half of omega * dt only.",
    ),
    (_by_radius, STRAIGHT),
    (
        lambda *a: np.nan_to_num(_by_radius(*a)),
        STRAIGHT,
    ),
    (
        partial(_only_in_bends, straight=(1.0, 0.0, 0.0)),
        "Right in bends. Straight on, with omega = 0, the robot drives along its heading; yours drives along x.",
    ),
    (
        _chord(lambda half: np.sinc(2.0 * half / np.pi), 0.5),
        "Too short: the chord needs the sine of half the turn, over half the turn.",
    ),
    (
        _chord(lambda half: np.tan(half) / half if half else 1.0, 0.5),
        "Too long: the chord needs the sine of half the turn, and not its tangent.",
    ),
    (
        lambda p, v, w, dt: _arc(p, v, -w, dt),
        "Your robot turns the wrong way: a positive omega is a left turn.",
    ),
    (
        lambda p, v, w, dt: _arc(p, abs(v), w, dt),
        "Right ahead, wrong backwards: the speed has a sign, and you dropped it.",
    ),
    (
        lambda *a: _arc(*a) - a[0],
        "That is the change of the pose. The new pose is asked for: add the old one.",
    ),
    (
        lambda p, v, w, dt: _arc(p, v, w, 1.0),
        "You take dt for one second. Multiply both speeds by dt.",
    ),
    (
        _swapped,
        "Sine and cosine have changed places: x goes with the cosine of the direction.",
    ),
    (
        lambda *a: _arc(*a) * [1.0, 1.0, 180.0 / np.pi],
        "The heading is in degrees; radians are asked for.",
    ),
    (
        lambda p, v, w, dt: _arc(p, v, np.deg2rad(w), dt),
        "omega is in rad/s already; there is nothing to convert.",
    ),
    (
        lambda p, v, w, dt: _by_radius(p, v, w, dt) if w else np.array(p),
        "Right in bends. Straight on, with omega = 0, the "
        "robot should come v * dt further; yours stays where it is.",
    ),
    (
        partial(_by_radius, sign=1.0),
        "Left bends are right, right bends are not: the radius v / omega has a sign, and you dropped it.",
    ),
    (
        lambda p, v, w, dt: _by_radius(p, v, w, dt, 1.0) if w else _arc(p, v, w, dt),
        "Left bends are right, right bends are not: the radius v / omega has a sign, and you dropped it.",
    ),
    (
        lambda p, v, w, dt: _small_steps(p, v, w, dt, n=1) if abs(w) < 0.05 else _arc(p, v, w, dt),
        "Right in sharp bends; in a gentle one, with omega = 0.04, yours drives straight on.",
    ),
    *(
        (
            partial(_small_steps, n=n),
            "Many small straight steps come close, but only close. The arc has a formula that needs "
            "one step.",
        )
        for n in (10, 50, 100, 500, 1000, 10_000)
    ),
]


def check_arc(theirs: Callable) -> Check:
    """Check whether ``arc_step(pose, v, omega, dt)`` drives an exact arc, straight on and backwards as well."""
    praise = "One long arc ends where ten thousand small steps end, and straight on works too."
    with np.errstate(all="ignore"):
        return compare(theirs, _arc, ARC_CASES, mistakes=ARC_MISTAKES, same=_same_arc, praise=praise)


# ---- exercise 4: from raw readings to a path


def _drive_case(seed: int) -> tuple:
    """Return encoder stamps and counts, gyro stamps and rates of five seconds, and the metres per count."""
    rng = np.random.default_rng(seed)
    t_enc = 50.0 + np.cumsum(rng.uniform(0.004, 0.046, 220))
    bend = rng.uniform(0.5, 1.5)
    counts = np.rint(18.0 + 5.0 * np.sin(bend * t_enc))[:, None] + rng.integers(-2, 6, (220, 4))
    t_gyro = t_enc[3] + np.cumsum(rng.uniform(0.006, 0.014, 430))
    t_gyro = t_gyro[t_gyro < t_enc[-3]]
    return (
        t_enc,
        counts,
        t_gyro,
        1.2 * np.sin(bend * t_gyro + 1.0) + 0.2,
        (0.0022, 0.0027, 0.0022, 0.0019)[seed],
    )


def _controls(t_enc, counts, t_gyro, yaw_rate, metres: float) -> Controls:
    travelled = np.cumsum(np.asarray(counts).mean(axis=1) * metres)
    v = np.diff(np.interp(t_gyro, t_enc, travelled)) / np.diff(t_gyro)
    return Controls(np.asarray(t_gyro), v, np.asarray(yaw_rate)[1:])


def dead_reckon(*case, model=motion_model) -> np.ndarray:
    """Solve exercise 4, by Euler steps or along arcs."""
    inputs = _controls(*case)
    theta = np.concatenate([[0.0], np.cumsum(inputs.omega * np.diff(inputs.t))])
    return np.column_stack([integrate(inputs, model=model).poses[:, :2], theta])


def _same_path(found, expected) -> bool:
    """Tell whether two paths agree to a millimetre and a milliradian, headings on the circle."""
    apart = np.asarray(found, dtype=float) - np.asarray(expected, dtype=float)
    apart[:, 2] = wrap_angle(apart[:, 2])
    return bool(np.isfinite(apart).all() and np.abs(apart).max() < 1e-3)


def _otherwise(change: Callable) -> Callable:
    """Return a wrong path, made of the right controls with something changed: ``change(inputs, *case)``."""

    def path(*case):
        return integrate(change(_controls(*case), *case)).poses

    return path


def _nearest(t, query) -> np.ndarray:
    return np.abs(np.subtract.outer(query, t)).argmin(axis=1)


def _per_interval(inputs: Controls, t_enc, counts, *rest) -> Controls:
    """Return the speed by the nearest reading, divided by its own interval."""
    speed = np.asarray(counts).mean(axis=1)[1:] * rest[-1] / np.diff(t_enc)
    return Controls(inputs.t, speed[_nearest(t_enc[1:], inputs.t[1:])], inputs.omega)


def _with_counts(change: Callable) -> Callable:
    """Return a wrong path, made of other counts."""
    return lambda te, c, tg, w, m: dead_reckon(te, change(np.asarray(c)), tg, w, m)


def _read_off(t_enc, counts, t_gyro, yaw_rate, metres, side: str) -> np.ndarray:
    """Return a wrong path: the sum at the reading nearest to, before or after each gyro sample, not in between."""
    after = np.searchsorted(t_enc, t_gyro)
    at = {"nearest": _nearest(t_enc, t_gyro), "before": after - 1, "after": after}[side]
    v = np.diff(np.cumsum(counts.mean(axis=1) * metres)[at]) / np.diff(t_gyro)
    return integrate(Controls(t_gyro, v, yaw_rate[1:])).poses


def _turn_first(*case) -> np.ndarray:
    """Return a wrong path: each step along the heading that it ends with."""
    u = _controls(*case)
    dt = np.diff(u.t)
    theta = np.cumsum(u.omega * dt)
    steps = np.column_stack([u.v * dt * np.cos(theta), u.v * dt * np.sin(theta)])
    return np.vstack([np.zeros(3), np.column_stack([np.cumsum(steps, axis=0), theta])])


PATH_MISTAKES = [
    (
        _otherwise(_per_interval),
        "You give each gyro sample the nearest reading, divided by that reading's own interval. "
        "Readings are used twice or never: add up the counts, and interpolate the sum.",
    ),
    (
        _otherwise(
            lambda u, te, c, *r: Controls(u.t, (c.mean(axis=1) * r[-1])[_nearest(te, u.t[1:])], u.omega)
        ),
        "You take the formula of Eq. 19 as a speed. It is a distance per reading: add it up, and divide "
        "differences of the "
        "sum by the time between them.",
    ),
    (
        _otherwise(lambda u, te, c, tg, w, m: Controls(u.t, u.v, np.asarray(w)[:-1])),
        "Each rate is used one interval too late: a rate belongs to the interval that ends at its stamp.",
    ),
    (
        _otherwise(lambda u, *r: Controls(u.t, 4 * u.v, u.omega)),
        "Four times too long: the chassis centre travels the mean of its wheels.",
    ),
    *(
        (
            _with_counts(lambda c, some=some: c[:, some]),
            "You use some of the wheels only; the mean of all four is asked for.",
        )
        for some in ([0, 1], [2, 3], [0], [1], [2], [3])
    ),
    *(
        (
            partial(_read_off, side=side),
            "The sum is right, but you read it off at a reading near the gyro's stamp. Between two readings the robot "
            "moves on: interpolate.",
        )
        for side in ("nearest", "before", "after")
    ),
    (
        _otherwise(lambda u, *r: Controls(u.t, u.v / np.diff(u.t), u.omega)),
        "The positions are out of all proportion: a speed must be multiplied by the time, and a distance must not.",
    ),
    (
        _otherwise(lambda u, *r: Controls(u.t, u.v, u.omega / np.diff(u.t))),
        "You add up yaw rates as if they were angles. Multiply each by the time of its interval.",
    ),
    (
        _otherwise(lambda u, te, c, tg, w, m: Controls(u.t, u.v, 0.5 * (w[1:] + w[:-1]))),
        "You take the mean of two rates. Here a rate belongs to the interval that ends at its stamp.",
    ),
    (
        _turn_first,
        "You turn before you drive. An Euler step drives along the old heading, and turns then.",
    ),
    (
        lambda *case: dead_reckon(*case) * [1, -1, 1],
        "y has the wrong sign: it is positive to the left.",
    ),
    (
        lambda *case: dead_reckon(*case)[:, [1, 0, 2]],
        "x and y have changed places: x goes with the cosine of the heading.",
    ),
    (
        lambda *case: dead_reckon(*case)[:, [2, 0, 1]],
        "The columns are x, y and heading, in this order.",
    ),
    (
        _otherwise(lambda u, *r: Controls(u.t, u.v / r[-1], u.omega)),
        "The positions are in counts. Each count is worth metres_per_count metres.",
    ),
    (
        _otherwise(lambda u, *r: Controls(u.t, u.v, 0 * u.omega)),
        "Your robot never turns: add up the yaw rate times the time.",
    ),
    (
        _otherwise(lambda u, *r: Controls(u.t, u.v, -u.omega)),
        "Your robot turns the wrong way: a positive rate is a left turn.",
    ),
    (
        lambda *case: dead_reckon(*case) * [1, 1, 180 / np.pi],
        "The headings are in degrees; radians are asked for.",
    ),
    (
        lambda te, c, tg, w, m: dead_reckon(te, c, tg, np.rad2deg(w), m),
        "The rates are in rad/s already; there is nothing to convert.",
    ),
    (
        lambda te, c, tg, w, m: dead_reckon(te, c, tg, np.deg2rad(w), m),
        "The rates are in rad/s already; there is nothing to convert.",
    ),
    (
        _otherwise(lambda u, *r: Controls(0.01 * np.arange(len(u.t)), u.v, u.omega)),
        "You give every interval 10 ms. Use the stamps.",
    ),
    (
        lambda te, c, tg, w, m: (
            integrate(
                Controls(
                    0.01 * np.arange(len(tg)),
                    np.diff(np.interp(tg, te, np.cumsum(c.mean(axis=1) * m))) / 0.01,
                    w[1:],
                )
            ).poses
        ),
        "You give every interval 10 ms: the distances are right, the headings are not. Use the stamps.",
    ),
    (
        _otherwise(
            lambda u, te, c, *r: Controls(
                u.t, np.diff(np.interp(u.t, te, c.mean(axis=1) * r[-1])) / np.diff(u.t), u.omega
            )
        ),
        "You interpolate the increments. Add them up first, and interpolate the sum.",
    ),
]


def check_dead_reckon(theirs: Callable) -> Check:
    """Check whether ``dead_reckon(...)`` turns raw readings into a path, by Euler steps or along arcs."""
    cases, praise = (
        [_drive_case(seed) for seed in range(4)],
        "From raw readings to a path: this is dead reckoning.",
    )
    along_arcs = partial(dead_reckon, model=motion_model_arc)
    verdicts = [
        compare(theirs, right, cases, mistakes=PATH_MISTAKES, same=_same_path, praise=praise)
        for right in (dead_reckon, along_arcs)
    ]
    return next((verdict for verdict in verdicts if verdict), verdicts[0])
