"""Questions to ask of a recording before a filter runs: each takes a second, and each finds a fault that costs days.

A check compares two instruments that must agree, or one with what is possible. It proves nothing, but it shows where to
look.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.evaluation.calibration import gyro_bias
from pfslam.evaluation.turns import LEAST_SECONDS, compare_turns
from pfslam.motion import Controls, controls
from pfslam.recording import LidarScans, Recording, image_pairs

FASTEST = 10.0
"""Speed (m/s) that no wheel of a robot indoors reaches, not even over one reading."""
LARGEST_REST_RATE = 0.01
"""Yaw rate at rest (rad/s) above which a gyro's bias is worth taking off: a third of a degree in half a second."""
SAME_TURN = 1e-3
"""Two instruments never agree to this (rad) in every second: one of them was taken for the other."""
LONGEST_GAP = 0.5
"""Seconds without a reading that a filter should not have to bridge."""
SCAN_STEP = 0.1
"""Time (s) between the scans that are compared with one another."""
WIDEST_TURN = 0.35
"""Largest turn (rad) between two scans that is looked for."""
MOST_PAIRS = 300
"""Pairs of scans that are compared: those in the strongest turns."""
LATEST = 0.3
"""Largest offset (s) between two clocks that is looked for."""
EVEN = 0.005
"""Where the correlation of turns varies by no more than this from offset to offset, it says nothing about a clock."""


@dataclass(frozen=True)
class Finding:
    """One question's answer: ``ok`` is None where the recording holds nothing to ask."""

    question: str
    ok: bool | None
    found: str
    expected: str


def check_up(recording: Recording) -> list[Finding]:
    """Ask all questions, in the order in which to mend what they find."""
    return [
        check_overlap(recording),
        check_gaps(recording),
        check_speed(recording),
        check_rest(recording),
        check_track(recording),
        check_beams(recording),
        *check_scans(recording),
        check_images(recording),
    ]


def check_overlap(recording: Recording) -> Finding:
    """Check how much of the time all streams cover: the shortest common time over the longest stream."""
    question, expected = "Do the streams overlap?", "90 % or more"
    spans = np.array([[t[0], t[-1]] for t in _stamps(recording).values()])
    common = max(spans[:, 1].min() - spans[:, 0].max(), 0.0)
    share = common / max(float((spans[:, 1] - spans[:, 0]).max()), 1e-9)
    return Finding(question, bool(share >= 0.9), f"{100 * share:.0f} %", expected)


def check_gaps(recording: Recording) -> Finding:
    """Check the longest time without a reading of encoders, gyro or LiDAR."""
    longest, name = max(
        (float(np.diff(t).max(initial=0.0)), name)
        for name, t in _stamps(recording).items()
        if name != "camera"
    )
    limit = max(
        LONGEST_GAP,
        3.0 * max((np.median(np.diff(t)) for t in _stamps(recording).values() if len(t) > 1), default=0.0),
    )
    found = f"{longest:.2f} s ({name})"
    return Finding("How long is the longest gap?", bool(longest <= limit), found, f"below {limit:.1f} s")


def check_speed(recording: Recording) -> Finding:
    """Check the largest count of any wheel as a speed: running totals and counters that wrap give impossible ones."""
    if recording.encoders is None:
        fastest = float(np.abs(controls(recording).v).max(initial=0.0))
    else:
        way = np.abs(recording.encoders.counts).max() * recording.robot.encoders.metres_per_count
        fastest = float(way / np.median(np.diff(recording.encoders.t)))
    found = f"{fastest:.1f} m/s"
    return Finding("How fast was a wheel at most?", fastest <= FASTEST, found, f"below {FASTEST:.0f} m/s")


def check_rest(recording: Recording) -> Finding:
    """Check what the gyro shows while the robot stands."""
    question, expected = "What does the gyro show at rest?", f"within {LARGEST_REST_RATE:.2f} rad/s of 0"
    if recording.imu is None or (recording.encoders is None and recording.odometry is None):
        return Finding(question, None, "no gyro", expected)
    if recording.odometry is None:
        bias, error, seconds = gyro_bias(recording)
        known = np.isfinite(error)
    else:
        turns = compare_turns(recording.odometry, recording.imu, recording.robot.imu.yaw_axis)
        bias, seconds, known = turns.bias, turns.still, turns.still >= LEAST_SECONDS
    if not known:
        return Finding(question, None, f"only {seconds:.0f} s at rest", expected)
    return Finding(
        question, abs(bias) <= LARGEST_REST_RATE, f"{bias:+.4f} rad/s in {seconds:.0f} s", expected
    )


def check_track(recording: Recording) -> Finding:
    """Check whether wheels and gyro measure the same turns: left and right with some effective track, or odometry."""
    question, expected = "Do wheels and gyro turn the same way?", "a track of 0.2 to 2 m"
    if recording.imu is None or (recording.encoders is None and recording.odometry is None):
        return Finding(question, None, "no gyro", expected)
    if recording.odometry is not None:
        expected = "a factor of 0.8 to 1.2"
        turns = compare_turns(recording.odometry, recording.imu, recording.robot.imu.yaw_axis)
        if not turns.enough:
            return Finding(question, None, "too few turns", expected)
        if np.abs(turns.by_odometry - turns.by_gyro).max() < SAME_TURN:
            return Finding(question, None, "the odometry turns by the gyro", expected)
        return Finding(question, 0.8 <= turns.factor <= 1.2, f"factor {turns.factor:+.2f}", expected)
    track = effective_track(recording)
    if track is None:
        return Finding(question, None, "too few turns", expected)
    return Finding(question, bool(0.2 <= track <= 2.0), f"effective track {track:.2f} m", expected)


def check_beams(recording: Recording) -> Finding:
    """Check the share of beams that measured something, and count scans in which hardly any did."""
    question, expected = "How many beams return?", "half or more"
    if recording.lidar is None:
        return Finding(question, None, "no LiDAR", expected)
    valid = recording.robot.lidar.valid(recording.lidar.ranges).mean(axis=1)
    found = f"{100 * valid.mean():.0f} %, {np.count_nonzero(valid < 0.1)} empty scans"
    return Finding(question, bool(valid.mean() >= 0.5 and (valid < 0.1).mean() < 0.01), found, expected)


def check_scans(recording: Recording) -> list[Finding]:
    """Check that successive scans turn as the gyro says, or the odometry, and at the same time by both clocks.

    An upside-down LiDAR or a flipped gyro gives a factor of -1. Late is by how much the turns agree best.
    """
    other = "gyro" if recording.odometry is None else "odometry"
    turn = f"Do scans turn as the {other} does?", "a factor of 0.8 to 1.2"
    clock = f"Do scans and {other} share a clock?", "within 0.03 s"
    fit = scan_turn_fit(recording)
    if fit is None:
        return [
            Finding(question, None, "no scans in turns", expected) for question, expected in (turn, clock)
        ]
    factor, late = fit
    shared = Finding(clock[0], bool(abs(late) <= 0.03), f"scans {1000 * late:+.0f} ms late", clock[1])
    if not np.isfinite(late):
        shared = Finding(clock[0], None, "turns too even to tell", clock[1])
    return [Finding(turn[0], bool(0.8 <= factor <= 1.2), f"factor {factor:+.2f}", turn[1]), shared]


def check_images(recording: Recording) -> Finding:
    """Check how many colour images have a depth image within a tenth of a second."""
    question, expected = "Do images have partners?", "95 % or more"
    if recording.camera is None or not len(recording.camera.rgb_index):
        return Finding(question, None, "no images", expected)
    pairs = image_pairs(recording.camera)
    share = len(pairs.rgb) / max(len(pairs.rgb) + pairs.unpaired, 1)
    return Finding(question, bool(share >= 0.95), f"{100 * share:.0f} % of {len(pairs.rgb)}", expected)


def effective_track(recording: Recording) -> float | None:
    """Fit the track (m) with which the wheels turn as the gyro does, over a second at a time; None without turns.

    Wheels that skid sideways make it wider than a ruler would. A negative one means that a sign is wrong, or that the
    sides are swapped.
    """
    inputs = controls(recording)
    edges = np.arange(inputs.t[0], inputs.t[-1], 1.0)
    apart = np.diff(turned_by_wheels(recording, edges, track=1.0))
    turned = np.diff(turned_by_gyro(inputs, edges))
    if np.abs(turned).sum() < 1.0:
        return None
    return float(apart @ turned / (turned @ turned))


def turned_by_wheels(recording: Recording, t: np.ndarray, track: float) -> np.ndarray:
    """Return the heading (rad) at times ``t (K,)`` from right less left wheels that stand ``track`` m apart."""
    encoders, _ = recording.wheels_and_gyro()
    right, left = encoders.counts[:, [0, 2]].mean(axis=1), encoders.counts[:, [1, 3]].mean(axis=1)
    apart = np.cumsum(right - left) * recording.robot.encoders.metres_per_count
    return np.interp(t, encoders.t, (apart - apart[0]) / track)


def turned_by_gyro(inputs: Controls, t: np.ndarray) -> np.ndarray:
    """Return the heading (rad) at times ``t (K,)`` from the yaw rates of the controls."""
    return np.interp(t, inputs.t, np.concatenate([[0.0], np.cumsum(inputs.omega * np.diff(inputs.t))]))


def scan_turn_fit(recording: Recording) -> tuple[float, float] | None:
    """Fit the turns seen by the LiDAR to those of the gyro: their ratio, and how many seconds the scans are late.

    None if there are no scans, or no turns to compare. The lateness is NaN if it hardly matters to the fit, as on a
    drive in a circle, which looks the same at any time. The odometry takes the gyro's place where there is none.
    """
    if recording.lidar is None or not recording.robot.lidar.increment:
        return None
    inputs, scans = controls(recording), recording.lidar
    first, second = _scan_pairs(inputs, scans)
    if len(first) < 20:
        return None
    seen = scan_turns(recording, first, second)
    good = np.isfinite(seen)
    t0, t1, seen = scans.t[first[good]], scans.t[second[good]], seen[good]
    shifts = np.arange(-LATEST, LATEST + 1e-9, 0.005)
    by_gyro = np.array(
        [turned_by_gyro(inputs, t1 - late) - turned_by_gyro(inputs, t0 - late) for late in shifts]
    )
    if len(seen) < 20 or np.abs(by_gyro).max() < 0.02 or not seen.any():
        return None
    likeness = (by_gyro @ seen) / np.sqrt((by_gyro**2).sum(axis=1) * (seen @ seen))
    best = int(np.argmax(np.abs(likeness)))
    late = float(shifts[best]) if np.ptp(likeness) > EVEN else np.nan
    return float(by_gyro[best] @ seen / (by_gyro[best] @ by_gyro[best])), late


def scan_turns(recording: Recording, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Measure the turn (rad) from scan ``first (P,)`` to ``second (P,)`` by how many beams the view moved, else NaN.

    The robot also moves a little in between, which blurs the answer and does not turn it.
    """
    lidar, scans = recording.robot.lidar, recording.scans()
    reach = min(int(WIDEST_TURN / lidar.increment) + 1, lidar.beams // 3)
    shifts = np.arange(-reach, reach + 1)
    turns = np.full(len(first), np.nan)
    inner = slice(reach, lidar.beams - reach)
    for k, (i, j) in enumerate(zip(first, second, strict=True)):
        before, after = (np.where(lidar.valid(r), r, np.nan) for r in (scans.ranges[i], scans.ranges[j]))
        moved = np.lib.stride_tricks.sliding_window_view(before, lidar.beams - 2 * reach)
        gap = np.abs(moved - after[inner])
        usable = np.isfinite(gap).sum(axis=1) > 0.3 * gap.shape[1]
        if usable.any():
            cost = np.where(usable, np.nanmean(np.minimum(gap, 0.5), axis=1), np.inf)
            turns[k] = shifts[int(np.argmin(cost))] * lidar.increment
    return turns


def _scan_pairs(inputs: Controls, scans: LidarScans) -> tuple[np.ndarray, np.ndarray]:
    """Choose pairs of scans about ``SCAN_STEP`` apart, with the strongest turns, inside the odometry's time."""
    second = np.searchsorted(scans.t, scans.t + SCAN_STEP)
    first = np.flatnonzero(second < len(scans.t))
    second = second[first]
    inside = (scans.t[first] > inputs.t[0] + LATEST) & (scans.t[second] < inputs.t[-1] - LATEST)
    inside &= scans.t[second] - scans.t[first] < 10 * SCAN_STEP
    first, second = first[inside], second[inside]
    turn = np.abs(turned_by_gyro(inputs, scans.t[second]) - turned_by_gyro(inputs, scans.t[first]))
    small = np.flatnonzero(turn < 0.8 * WIDEST_TURN)
    strongest = np.sort(small[np.argsort(-turn[small], kind="stable")[:MOST_PAIRS]])
    return first[strongest], second[strongest]


def _stamps(recording: Recording) -> dict[str, np.ndarray]:
    """Collect the stamps of every stream that is there."""
    streams = {"encoders": recording.encoders, "gyro": recording.imu, "odometry": recording.odometry}
    found = {name: stream.t for name, stream in streams.items() if stream is not None}
    if recording.lidar is not None:
        found["lidar"] = recording.lidar.t
    if recording.camera is not None:
        found["camera"] = recording.camera.rgb_t
    return found
