"""Questions to ask of a recording before a filter runs: each takes a second, and each finds a fault that costs days.

A check compares two instruments that must agree, or one with what is possible. It proves nothing, but it shows where to
look. An answer that spoils a run comes with a remedy, and the command ``run`` stops at it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from pfslam.evaluation.calibration import gyro_bias
from pfslam.evaluation.scenes import place_fit, scene_fit
from pfslam.io.headings import LEAST_SECONDS, compare_turns
from pfslam.io.jumps import JUMPS
from pfslam.motion import Controls, controls, dead_reckoning
from pfslam.poses import between
from pfslam.recording import LidarScans, Recording, image_pairs
from pfslam.refined.health import LONGEST_PAUSE, farther_than_usual
from pfslam.refined.outliers import NOISY

FASTEST = 10.0
"""Speed (m/s) that no wheel of a robot indoors reaches, not even over one reading."""
LARGEST_REST_RATE = 0.01
"""Yaw rate at rest (rad/s) above which a gyro's bias is worth taking off: a third of a degree in half a second."""
SAME_TURN = 1e-3
"""Two instruments never agree to this (rad) in every second: one of them was taken for the other."""
LONGEST_GAP = 0.5
"""Seconds without a reading that a filter should not have to bridge."""
OFTEN = 0.01
"""Share of impossible speeds from which they are no single reading that went wrong."""
SCAN_STEP = 0.1
"""Time (s) between the scans that are compared with one another."""
WIDEST_TURN = 0.35
"""Largest turn (rad) between two scans that is looked for."""
MOST_PAIRS = 300
"""Pairs of scans that are compared: those in the strongest turns."""
STANDING = 0.02
"""Way (m) between two scans up to which a robot stands."""
NO_TURN, LEAST_TURNS = 0.02, 10
"""Turn (rad) between two scans up to which an instrument shows none, and turns that scans must see to contradict it."""
LATEST = 0.3
"""Largest offset (s) between two clocks that is looked for."""
SPARSE = 0.3
"""Seconds between readings from which turns in between are not known well enough to set a clock by."""
EVEN = 0.005
"""Where the correlation of turns varies by no more than this from offset to offset, it says nothing about a clock."""
WIDEST_YAW = 10.0
"""Degrees: so far a direction may seem off, where wheels slide sideways, without anything being mounted otherwise."""
FARTHEST_APART = 1.5
"""Metres from one scan to the next, by the median, up to which they share walls enough; logs keep one a metre."""
WIDEST_SWAY = 0.5
"""Degrees by which scenes may turn to and fro: a loose LiDAR, or an odometry whose headings are all noise."""
FARTHEST_PLACE = 0.15
"""Metres: a LiDAR that sits this far from where it is stated to be bends a run by some 0.3 m."""


@dataclass(frozen=True)
class Finding:
    """One question's answer: ``ok`` is None where the recording holds nothing to ask."""

    question: str
    ok: bool | None
    found: str
    expected: str
    remedy: str = ""
    """What to do about an answer that spoils a run; empty where a run can do with it."""


def check_up(recording: Recording) -> list[Finding]:
    """Ask all questions, in the order in which to mend what they find."""
    turns, clock = check_scans(recording)
    scene = check_scene(recording)
    return [
        check_overlap(recording),
        check_gaps(recording),
        check_speed(recording),
        check_rest(recording),
        check_track(recording),
        check_kept(recording),
        check_beams(recording),
        check_scatter(recording),
        turns,
        clock,
        scene,
        check_place(recording, after=[turns, scene]),
        check_images(recording),
    ]


def check_overlap(recording: Recording) -> Finding:
    """Check how much of the time all streams cover: the shortest common time over the longest stream."""
    begin, end = np.array([t[[0, -1]] for t in _stamps(recording).values()]).T
    share = max(end.min() - begin.max(), 0.0) / max(float((end - begin).max()), 1e-9)
    return Finding("Do the streams overlap?", bool(share >= 0.9), f"{100 * share:.0f} %", "90 % or more")


def check_gaps(recording: Recording) -> Finding:
    """Check the longest time without a reading of encoders, gyro or LiDAR.

    A pause that lost nothing is no fault: logs that keep a scan a metre pause wherever the robot does.
    """
    stamps = _stamps(recording)
    usual = max((float(np.median(np.diff(t))) for t in stamps.values() if len(t) > 1), default=0.0)
    limit = max(LONGEST_GAP, 3.0 * usual)
    stamps.pop("camera", None)
    longest, name = max((float(np.diff(t).max(initial=0.0)), name) for name, t in stamps.items())
    # Only where a gap is long does it matter what was lost in it: that takes a pose for each reading.
    ok = longest <= limit or all(_lost(recording, t).max(initial=0.0) <= limit for t in stamps.values())
    found = f"{longest:.2f} s ({name})" + (", no farther than usual" if ok and longest > limit else "")
    jumped = longest > LONGEST_PAUSE
    remedy = "did the clock jump? run the parts before and after it one by one" if jumped else ""
    return Finding("How long is the longest gap?", ok, found, f"below {limit:.1f} s", remedy)


def _lost(recording: Recording, t: np.ndarray) -> np.ndarray:
    """Return the gaps (s) between stamps across which something may be lost.

    Increments that are missing tell nothing. Where the odometry has poses, they tell how far the robot moved meanwhile.
    """
    gaps = np.diff(t)
    if recording.odometry is None:
        return gaps
    poses = recording.odometry.at(np.clip(t, *recording.odometry.t[[0, -1]]))
    return gaps[farther_than_usual(poses) | (gaps > LONGEST_PAUSE)]


def check_speed(recording: Recording) -> Finding:
    """Check the largest count of any wheel as a speed: running totals and counters that wrap give impossible ones.

    Jumps that were left out when the recording was loaded were impossible, too.
    """
    if (odometry := recording.odometry) is not None:
        speed = np.abs(between(odometry.poses[:-1], odometry.poses[1:])[:, 0]) / np.diff(odometry.t)
    else:
        encoders, _ = recording.wheels_and_gyro()
        way = np.abs(encoders.counts).max(axis=1) * recording.robot.encoders.metres_per_count
        speed = way / np.median(np.diff(encoders.t))
    fastest, left_out = float(speed.max(initial=0.0)), recording.dropped.get(JUMPS, 0)
    often = (speed > FASTEST).sum() + left_out > OFTEN * len(speed)
    found, expected = f"{fastest:.1f} m/s", f"below {FASTEST:.0f} m/s"
    found += f" and {left_out} {JUMPS}" if left_out else ""
    remedy = "is the odometry in m, each reading of its own, and its clock never set back?" if often else ""
    return Finding(
        "How fast was a wheel at most?", fastest <= FASTEST and not left_out, found, expected, remedy
    )


def check_rest(recording: Recording) -> Finding:
    """Check what the gyro shows while the robot stands."""
    answer = partial(Finding, "What does the gyro show at rest?")
    expected = f"within {LARGEST_REST_RATE:.2f} rad/s of 0"
    if recording.imu is None or (recording.encoders is None and recording.odometry is None):
        return answer(None, "no gyro", expected)
    if recording.odometry is None:
        bias, error, seconds = gyro_bias(recording)
        known = np.isfinite(error)
    else:
        turns = compare_turns(recording.odometry, recording.imu, recording.robot.imu)
        bias, seconds, known = turns.bias, turns.still, turns.still >= LEAST_SECONDS
    if not known:
        return answer(None, f"only {seconds:.0f} s at rest", expected)
    return answer(abs(bias) <= LARGEST_REST_RATE, f"{bias:+.4f} rad/s in {seconds:.0f} s", expected)


def check_track(recording: Recording) -> Finding:
    """Check whether wheels and gyro measure the same turns: left and right with some effective track, or odometry."""
    answer = partial(Finding, "Do wheels and gyro turn the same way?")
    track, factor = "a track of 0.2 to 2 m", "a factor of 0.8 to 1.2"
    if recording.imu is None or (recording.encoders is None and recording.odometry is None):
        return answer(None, "no gyro", track)
    if recording.odometry is None:
        metres = effective_track(recording)
        if metres is None:
            return answer(None, "too few turns", track)
        return answer(0.2 <= metres <= 2.0, f"effective track {metres:.2f} m", track)
    turns = compare_turns(recording.odometry, recording.imu, recording.robot.imu)
    if not turns.enough:
        return answer(None, "too few turns", factor)
    if np.abs(turns.by_odometry - turns.by_gyro).max() < SAME_TURN:
        return answer(None, "the odometry turns by the gyro", factor)
    return answer(0.8 <= turns.factor <= 1.2, f"factor {turns.factor:+.2f}", factor)


def check_beams(recording: Recording) -> Finding:
    """Check the share of beams that measured something, and count scans in which hardly any did."""
    answer = partial(Finding, "How many beams return?")
    if recording.lidar is None:
        return answer(None, "no LiDAR", "half or more")
    valid = recording.robot.lidar.valid(recording.lidar.ranges).mean(axis=1)
    ok = bool(valid.mean() >= 0.5 and (valid < 0.1).mean() < 0.01)
    found = f"{100 * valid.mean():.0f} %, {np.count_nonzero(valid < 0.1)} empty scans"
    return answer(ok, found, "half or more")


def check_scatter(recording: Recording) -> Finding:
    """Check that the ranges of neighbouring beams on a wall agree: noise smears walls, and bends the heading."""
    answer, expected = partial(Finding, "How far do ranges scatter?"), f"{100 * NOISY:.1f} cm or less"
    if recording.lidar is None:
        return answer(None, "no LiDAR", expected)
    scatter = recording.range_scatter()
    return answer(scatter <= NOISY, f"{100 * scatter:.1f} cm", expected)


def check_scans(recording: Recording) -> list[Finding]:
    """Check that successive scans turn as the gyro says, or the odometry, and at the same time by both clocks.

    An upside-down LiDAR or a flipped gyro gives a factor of -1. Late is by how much the turns agree best.
    """
    other, fit = "gyro" if recording.odometry is None else "odometry", scan_turn_fit(recording)
    if fit is None:
        turn = clock = None
        found = ["too few scans in turns"] * 2
    else:
        factor, late = fit
        unknown = not np.isfinite(late)
        turn, clock = 0.8 <= factor <= 1.2, None if unknown else abs(late) <= 0.03
        lateness = "too even or too sparse to tell" if unknown else f"scans {1000 * late:+.0f} ms late"
        found = [f"factor {factor:+.2f}", lateness]
    return [
        Finding(f"Do scans turn as the {other} does?", turn, found[0], "a factor of 0.8 to 1.2"),
        Finding(f"Do scans and {other} share a clock?", clock, found[1], "within 0.03 s"),
    ]


def check_kept(recording: Recording) -> Finding:
    """Check that most scans could be kept and lie close, and that a bag without any holds no other kind of them."""
    answer = partial(Finding, "Are the scans all there?")
    said = (f"{count} {reason}" for reason, count in recording.dropped.items())
    others = [line for line in said if "PointCloud2" in line or "MultiEcho" in line]
    if recording.lidar is None:
        remedy = "make LaserScan messages of them, as pointcloud_to_laserscan and laser_proc do"
        ok, remedy, found = (False, remedy, "; ".join(others)) if others else (None, "", "no LiDAR")
        return answer(ok, found, "LaserScan messages", remedy)
    kept, lost = len(recording.lidar.t), recording.dropped.get("scans with the stamp of another", 0)
    remedy = "record again with stamps that tell one message from the next" if lost > 2 * kept else ""
    found = f"{kept} kept, {lost} doubles"
    if far := (apart := _way_between_scans(recording)) > FARTHEST_APART:
        found += f", one every {apart:.1f} m"
    return answer(not (remedy or far), found, f"most kept, {FARTHEST_APART:.1f} m apart or less", remedy)


def _way_between_scans(recording: Recording) -> float:
    """Return the median way (m) from one scan to the next, where the robot drove."""
    path, t = dead_reckoning(recording), recording.scans().t
    step = np.diff(path.at(t[path.covers(t)])[:, :2], axis=0)
    ways = np.hypot(*step.T)
    return float(np.median(ways[ways > STANDING])) if (ways > STANDING).any() else 0.0


def check_scene(recording: Recording) -> Finding:
    """Check that the scene moves as the odometry says: as far, in the direction of the mounting, without swaying."""
    answer = partial(Finding, "Does the scene move as odometry says?")
    expected = f"a factor of 0.97 to 1.03, within {WIDEST_YAW:.0f} deg, steady"
    if (fit := scene_fit(recording)) is None:
        return answer(None, "too few scans to compare", expected)
    factor, yaw, sway = fit
    found, ok = f"factor {factor:.2f}, turned by {yaw:+.0f} deg", abs(yaw) <= WIDEST_YAW
    found += f", swaying by {sway:.0f} deg" if sway >= WIDEST_SWAY else ""
    remedy = f"the LiDAR seems mounted {yaw:+.0f} deg from what is stated: correct its yaw"
    return answer(ok and 0.97 <= factor <= 1.03 and sway < WIDEST_SWAY, found, expected, "" if ok else remedy)


def check_place(recording: Recording, after: Sequence[Finding] = ()) -> Finding:
    """Check that the LiDAR sits where it is stated to be.

    A wrong answer of ``after``, about turns and ways, would make the right place look wrong: then it is not asked.
    """
    answer = partial(Finding, "Does the LiDAR sit where stated?")
    expected = f"within {FARTHEST_PLACE:.2f} m"
    if any(finding.ok is False for finding in after):
        return answer(None, "to be asked when scans and odometry agree", expected)
    if (place := place_fit(recording)) is None:
        return answer(None, "too few scans in turns", expected)
    found, ok = "x {:+.1f} m, y {:+.1f} m".format(*place), bool(np.hypot(*place) <= FARTHEST_PLACE)
    remedy = f"the LiDAR seems to sit {found} from where it is stated to be: correct its place"
    return answer(ok, found, expected, "" if ok else remedy)


def check_images(recording: Recording) -> Finding:
    """Check how many colour images have a depth image within a tenth of a second."""
    answer = partial(Finding, "Do images have partners?")
    if recording.camera is None or not len(recording.camera.rgb_index):
        return answer(None, "no images", "95 % or more")
    pairs = image_pairs(recording.camera)
    share = len(pairs.rgb) / max(len(pairs.rgb) + pairs.unpaired, 1)
    return answer(share >= 0.95, f"{100 * share:.0f} % of {len(pairs.rgb)}", "95 % or more")


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

    None if there are no scans, or no turns to compare; a ratio of 0 where only the scans turn. The lateness is NaN if
    it hardly matters to the fit, as on a drive in a circle, which looks the same at any time, or if readings are far
    apart. The odometry takes the gyro's place where there is none.
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
    if len(seen) < 20 or not seen.any():
        return None
    if np.abs(by_gyro).max() < NO_TURN:
        return (0.0, np.nan) if np.count_nonzero(np.abs(seen) > 2 * NO_TURN) >= LEAST_TURNS else None
    likeness = (by_gyro @ seen) / np.sqrt((by_gyro**2).sum(axis=1) * (seen @ seen))
    best = int(np.argmax(np.abs(likeness)))
    sparse = max(np.median(np.diff(t)) for t in (inputs.t, scans.t)) > SPARSE
    late = np.nan if sparse or np.ptp(likeness) <= EVEN else float(shifts[best])
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
    if turn.max(initial=0.0) < NO_TURN:  # any pair is as good as another: take them from the whole drive
        small = small[:: len(small) // MOST_PAIRS + 1]
    strongest = np.sort(small[np.argsort(-turn[small], kind="stable")[:MOST_PAIRS]])
    return first[strongest], second[strongest]


def _stamps(recording: Recording) -> dict[str, np.ndarray]:
    """Collect the stamps of every stream that is there."""
    names = {"encoders": "encoders", "imu": "gyro", "odometry": "odometry", "lidar": "lidar"}
    found = {name: part.t for key, name in names.items() if (part := getattr(recording, key)) is not None}
    return found if recording.camera is None else found | {"camera": recording.camera.rgb_t}
