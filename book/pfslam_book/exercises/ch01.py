"""Exercises of chapter 01."""

from __future__ import annotations

from functools import partial

import numpy as np
from pfslam_book.show.exercise import Exercise, within

from pfslam.motion import motion_model, motion_model_arc

rngs = [np.random.default_rng(seed) for seed in range(4)]
METRES = (0.0022, 0.0031, 0.0017, 0.0022)

# ---- 1: the distance in raw counts


def count_case(rng, metres, reverses) -> tuple:
    """Counts of four wheels that differ, and the metres per count."""
    counts = rng.integers(3, 30, 9)[:, None] + rng.integers(0, 10, (9, 4))
    counts[5:7] *= -1 if reverses else 1
    return counts, metres


check_distance_ahead = Exercise(
    right=lambda c, m: c.mean(axis=1).sum() * m,
    cases=[count_case(rng, m, k > 1) for k, (rng, m) in enumerate(zip(rngs, METRES, strict=True))],
    mistakes={
        "Four times too long: you added the wheels. The chassis centre travels their mean.": (
            lambda c, m: c.sum() * m
        ),
        "You take the counts for a running total. Each is the increment since the one before: add them all.": (
            lambda c, m: (c[-1] - c[0]).mean() * m
        ),
        "That is the mean over the readings. The distance is their sum.": lambda c, m: c.mean() * m,
        "// drops the rest of a division, up to three quarters of a count in each reading. Divide with /.": (
            lambda c, m: (c.sum(axis=1) // 4).sum() * m
        ),
        "Right ahead, wrong backwards: a wheel that runs backwards counts down, and you dropped the sign.": (
            lambda c, m: np.abs(c).mean(axis=1).sum() * m
        ),
    },
    praise="The mean of the wheels, summed.",
)

# ---- 2: the bias of a gyro


def gyro_case(rng, bias, hertz) -> tuple:
    """Stamps, yaw rate and speed of 70 s with rests, creeping bends and bends in reverse; it warms up for 2.3 s."""
    t = 100.0 + np.cumsum(rng.uniform(0.8 / hertz, 1.2 / hertz, 70 * hertz))
    since = t - t[0]
    still = (since < 15) | ((since >= 35) & (since < 41)) | (since >= 58)
    creeping, reversing = (since >= 41) & (since < 50), (since >= 50) & (since < 58)
    rate = bias + np.where(still, 0.0, 0.4 + 0.3 * np.sin(since / 3.0)) + 0.1 * np.maximum(1 - since / 2.3, 0)
    speed = np.select([still, creeping, reversing], [0.0, 0.12, -0.7], 0.9)
    return t, rate + rng.normal(0.0, 0.006, len(t)), speed


def warm_rest(t, speed):
    return (speed == 0) & (t > t[0] + 3.0)


check_gyro_bias = Exercise(
    right=lambda t, w, v: w[warm_rest(t, v)].mean(),
    cases=[
        gyro_case(rng, bias, hertz)
        for rng, bias, hertz in zip(rngs, (0.004, -0.006, 0.005, 0.0045), (100, 400, 50, 200), strict=True)
    ],
    same=lambda found, expected: bool(abs(float(found) / float(expected) - 1.0) < 0.12),
    mistakes={
        "You average over the whole drive, and the turns are in it too.": lambda t, w, v: w.mean(),
        "The first seconds, while the gyro warms up, are still in your mean. Leave them out.": (
            lambda t, w, v: w[v == 0].mean()
        ),
        "You leave out 300 samples. That is 3 s of one gyro, and less than one of another: use the stamps.": (
            lambda t, w, v: w[300:][v[300:] == 0].mean()
        ),
        "A robot that creeps is not at rest: your limit for the speed lets slow bends in.": (
            lambda t, w, v: w[(np.abs(v) < 0.3) & (t > t[0] + 3.0)].mean(),
            lambda t, w, v: w[(v < 0.3) & (t > t[0] + 3.0)].mean(),
        ),
        "A speed below 0 is a robot that drives backwards, and it turns meanwhile. At rest the speed is 0.": (
            lambda t, w, v: w[(v <= 0) & (t > t[0] + 3.0)].mean()
        ),
        "The mean of absolute values counts the noise as well. Noise of both signs must be allowed to cancel.": (
            lambda t, w, v: np.abs(w[warm_rest(t, v)]).mean()
        ),
    },
    praise="The mean over the time when the robot stood still and the gyro was warm.",
)

# ---- 3: one step along an arc


def chord(length, part):
    """A step by ``length(half the turn) v dt``, in the old heading plus a part of the turn."""

    def step(pose, v, omega, dt):
        way, direction = v * dt * length(0.5 * omega * dt), pose[2] + part * omega * dt
        return pose + [way * np.cos(direction), way * np.sin(direction), omega * dt]

    return step


def small_steps(n):
    """So many Euler steps."""

    def walk(pose, v, omega, dt):
        for _ in range(n):
            pose = motion_model(pose, v, omega, dt / n)
        return pose

    return walk


def by_radius(pose, v, omega, dt):
    radius, new = np.float64(v) / omega, pose[2] + omega * dt
    return np.array([
        pose[0] + radius * (np.sin(new) - np.sin(pose[2])), pose[1] - radius * (np.cos(new) - np.cos(pose[2])), new
    ])  # fmt: skip


check_arc = Exercise(
    right=motion_model_arc,
    cases=[
        (np.array(pose), v, omega, dt)
        for pose, v, omega, dt in [
            ([1.0, 2.0, 0.5], 1.2, 0.8, 1.1),  # left
            ([-0.4, 1.7, 2.2], 0.9, -0.7, 1.3),  # right
            ([0.3, -2.0, -1.1], 1.5, 1.3, 3.9),  # most of a circle
            ([2.0, 0.6, -2.6], 0.7, 0.0, 1.6),  # straight on
            ([1.1, 0.2, 1.9], -0.8, 0.6, 0.9),  # backwards
            ([-1.3, 0.9, 0.8], 1.1, 0.04, 5.0),  # a long and gentle bend
        ]
    ],
    same=within(1e-3, 2e-4),  # ten thousand small steps are 0.3 mm off
    mistakes={
        "In bends you may be right. But straight on, with omega = 0, you divide by zero.": ZeroDivisionError,
        "In bends you may be right. But straight on, with omega = 0, your position is not a number, or stays.": (
            lambda *case: np.where(case[2] == 0.0, case[0], by_radius(*case))
        ),
        "That is the straight step of Eq. 5: it drives on, then turns.": motion_model,
        "Too short: NumPy's sinc(x) is sin(pi x) / (pi x). Divide its argument by pi.": chord(np.sinc, 0.5),
        "The direction is right, the length is not: v * dt is the length of the arc, and its chord is shorter.": (
            chord(lambda half: 1.0, 0.5)
        ),
        "That is a straight step along the new heading. On an arc the heading changes on the way.": (
            chord(lambda half: 1.0, 1.0)
        ),
        "Small straight steps come near to the arc, but yours are too few. Take ten thousand, or find one formula.": (
            small_steps(10),
            small_steps(100),
            small_steps(1000),
        ),
    },
    praise="One long arc ends where ten thousand small steps end, and straight on works too.",
)

# ---- 4: a path from the wheels alone


def wheel_case(rng, metres, track) -> tuple:
    """Counts (FR, FL, RR, RL) of a drive round several bends, the metres per count and the track width."""
    swing = 3.0 * np.sin(np.arange(60) / 6.0 + rng.uniform(0.0, 6.0)) + 1.0
    sides = np.rint(rng.uniform(9.0, 14.0) + np.array([1.0, -1.0, 1.0, -1.0]) * swing[:, None])
    return sides + rng.integers(-1, 2, (60, 4)), metres, track


def by_wheels(right=(0, 2), left=(1, 3), turn=1.0, along=0.0):
    """A path from the counts of both sides; each step heads ``along`` its own turn, 0 for Euler, 0.5 for arcs."""

    def path(counts, metres, track):
        s_R, s_L = (counts[:, side].mean(axis=1) * metres for side in (right, left))
        phi = turn * (s_R - s_L) / track
        heading = np.cumsum(phi) - (1.0 - along) * phi
        s = (s_L + s_R) / 2
        return np.cumsum(
            np.vstack([np.zeros(3), np.column_stack([s * np.cos(heading), s * np.sin(heading), phi])]), axis=0
        )

    return path


def either(**change):
    """A path with something changed, by Euler steps and by arcs."""
    return tuple(by_wheels(along=along, **change) for along in (0.0, 0.5))


check_reckon_by_wheels = Exercise(
    right=by_wheels(),
    also=[by_wheels(along=0.5)],
    cases=[wheel_case(rng, m, w) for rng, m, w in zip(rngs, METRES, (0.75, 0.6, 0.75, 0.9), strict=True)],
    same=within(1e-3, 1e-3),
    mistakes={
        "Your robot turns the wrong way. The columns are FR, FL, RR, RL, so the right side is columns 0 and 2.": (
            either(turn=-1.0)
        ),
        "You take the front wheels for one side and the rear wheels for the other. The columns are FR, FL, RR, RL.": (
            *either(right=(0, 1), left=(2, 3)),
            *either(right=(2, 3), left=(0, 1)),
        ),
        "Your robot turns twice as far as it should. Between its two sides lies the whole track width, not half "
        "of it.": either(turn=2.0),
        "Your robot turns twice as far as it should: take the mean of the two wheels of a side, not their sum.": tuple(
            lambda c, m, w, path=path: path(c, m, w) * [2.0, 2.0, 1.0] for path in either(turn=2.0)
        ),
        "You turn before you drive. An Euler step drives along the old heading, and turns then.": (
            by_wheels(along=1.0)
        ),
    },
    praise="From the counts of four wheels to a path, and no gyro was asked.",
)

# ---- 5: what wheels and gyro say of the time between two scans


def streams_case(rng, metres, shares=(0.31, 0.62)) -> tuple:
    """Two times within 3 s, stamps and counts of the wheels at some 40 Hz, and stamps and yaw rate at some 100 Hz."""
    t_wheels = 50.0 + np.cumsum(rng.uniform(0.004, 0.046, 120))
    t_gyro = 50.1 + np.cumsum(rng.uniform(0.008, 0.012, 250))
    counts, rate = rng.integers(6, 12, (120, 4)), rng.uniform(-0.9, 0.9, 250)
    begin, end = t_gyro[0] + np.array(shares) * (t_gyro[-1] - t_gyro[0])
    return begin, end, t_wheels, counts, t_gyro, rate, metres


def speeds(t_wheels, counts, t, metres, wheels=np.mean):
    """The speed in each interval between the times ``t``, from the sum of the distances."""
    return np.diff(np.interp(t, t_wheels, np.cumsum(wheels(counts, axis=1) * metres))) / np.diff(t)


def cut(shift=0, whole=False, speed=speeds):
    """Rows (v, omega, dt) between two times, with a yaw rate so many samples early or ends that are not cut."""

    def rows(begin, end, t_wheels, counts, t, rate, metres):
        first, last = np.searchsorted(t, begin, side="right") - 1, np.searchsorted(t, end)
        edges = t[first : last + 1]
        dt = np.diff(edges if whole else np.clip(edges, begin, end))
        v = speed(t_wheels, counts, t, metres)[first:last]
        return np.column_stack([v, rate[1 - shift : len(rate) - shift][first:last], dt])

    return rows


def by_edges(begin, end, t_wheels, counts, t, rate, metres):
    """The same with the speed of the pieces at both ends taken from the pieces themselves."""
    edges = np.concatenate([[begin], t[(t > begin) & (t < end)], [end]])
    v = speeds(t_wheels, counts, edges, metres)
    return np.column_stack([v, rate[np.searchsorted(t, edges[1:])], np.diff(edges)])


def nearest_reading(t_wheels, counts, t, metres):
    """The shortcut of the chapter: each reading over its own interval, and for each sample the nearest reading."""
    v = counts[1:].mean(axis=1) * metres / np.diff(t_wheels)
    return v[np.abs(t_wheels[1:] - t[1:, None]).argmin(axis=1)]


def same_rows(found, expected) -> bool:
    """Rows agree to 0.1 mm of way in each interval, and to 1e-4 in rad/s and s."""
    (v, *rest), (right, *others) = np.asarray(found, dtype=float).T, expected.T
    return bool(
        np.allclose(rest, others, atol=1e-4) and np.allclose(v * others[1], right * others[1], atol=1e-4)
    )


check_inputs_between = Exercise(
    right=cut(),
    also=[by_edges],
    cases=[streams_case(rng, metres) for rng, metres in zip(rngs, METRES, strict=True)],
    same=same_rows,
    mistakes={
        "Four times too fast: you added the wheels. The chassis centre travels their mean.": (
            cut(speed=partial(speeds, wheels=np.sum))
        ),
        "You divide each reading by its own interval. Where a stamp came late the speed has a spike. Interpolate the "
        "sum of the distances, and take differences of that.": cut(speed=nearest_reading),
        "A gyro sample tells about the interval that ends at its stamp. You took the one at its beginning.": (
            cut(shift=1)
        ),
        "The first and the last interval reach beyond the two scans. Cut them there, or the next scan counts this "
        "time again.": cut(whole=True),
        "The rows are right, but they come as (v, dt, omega). Asked is (v, omega, dt).": (
            lambda *case: cut()(*case)[:, [0, 2, 1]]
        ),
        "The pieces at both ends are missing, so some milliseconds are lost at each scan.": (
            lambda *case: cut()(*case)[1:-1]
        ),
    },
    praise="No count is lost and none is used twice, and the times add up.",
)
