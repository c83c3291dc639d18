"""Questions to ask of a recording before a filter runs: each takes a second, and each finds a fault that costs days.

A check compares two instruments that must agree, or one with what is possible. It proves nothing, but it shows where to
look. A wrong answer is a note where a run can do with it, a warning where the run may suffer, and a stop where it would
be impossible; the command ``run`` stops only then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from pfslam.evaluation.calibration import gyro_bias
from pfslam.evaluation.mounting import Estimate, Mounting, fit_mounting
from pfslam.evaluation.scenes import STANDING
from pfslam.io.headings import LEAST_SECONDS, compare_turns
from pfslam.io.jumps import JUMPS
from pfslam.io.selection import PART
from pfslam.motion import dead_reckoning
from pfslam.poses import between
from pfslam.recording import Recording, image_pairs
from pfslam.refined.health import LONGEST_PAUSE
from pfslam.refined.outliers import NOISY
from pfslam.refined.scan_odometry import FARTHEST_APART

FASTEST = 10.0
"""Speed (m/s) that no wheel of a robot indoors reaches."""
LEAST_SPAN = 0.2
"""Seconds over which poses tell a speed: stamps are often wrong by some milliseconds."""
LARGEST_REST_RATE = 0.01
"""Yaw rate at rest (rad/s) above which a gyro's bias is worth taking off: a third of a degree in half a second."""
SAME_TURN = 1e-3
"""Two instruments never agree to this (rad) in every second: one of them was taken for the other."""
LONGEST_GAP = 0.5
"""Seconds without a reading that a filter should not have to bridge."""
OFTEN = 0.01
"""Share of impossible speeds from which they are no single reading that went wrong."""
LATE = 0.02
"""Offset (s) between two clocks that a run can do with: a fast robot turns by a degree meanwhile."""
WIDEST_YAW = 10.0
"""Degrees: so far a direction may seem off, where wheels slide sideways, without anything being mounted otherwise."""
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
    """What to do about a wrong answer, where that is known."""
    severity: str = "warning"
    """How bad a wrong answer is, ``note``, ``warning`` or ``stop``; ``ok`` or ``-`` where it is not wrong."""

    def __post_init__(self):
        if self.ok is not False:
            object.__setattr__(self, "severity", "ok" if self.ok else "-")


def check_up(
    recording: Recording, mounting: Mounting | None = None, whole: Recording | None = None
) -> list[Finding]:
    """Ask all questions, in the order in which to mend what they find.

    ``mounting`` is its fit, if there is one, and ``whole`` the recording of which this is a part.
    """
    mounting = mounting or fit_mounting(recording)
    turns, clock = check_scans(recording, mounting)
    scene = check_scene(mounting)
    return [
        check_overlap(recording, whole or recording),
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
        check_place(mounting, after=[turns, scene]),
        check_images(recording),
    ]


def check_overlap(recording: Recording, whole: Recording) -> Finding:
    """Check how much of the time all streams cover: the shortest common time over the longest stream.

    A recorder starts and stops its streams seconds apart. So a part is in order where the ``whole`` is, however short
    the part. Where the whole is not, because a stream broke off, a part in which all streams are there still may be.
    A file that holds a part does not tell how long the drive was: there, a small share says nothing.
    """
    share = max(_common_share(recording), _common_share(whole))
    ok = bool(share >= 0.9) or (None if PART in whole.dropped else False)
    found = f"{100 * share:.0f} %" + (" of a part of the drive" if ok is None else "")
    return Finding("Do the streams overlap?", ok, found, "90 % or more")


def _common_share(recording: Recording) -> float:
    begin, end = np.array([t[[0, -1]] for t in _stamps(recording).values()]).T
    return max(end.min() - begin.max(), 0.0) / max(float((end - begin).max()), 1e-9)


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
    severity = "stop" if jumped else "warning"
    return Finding("How long is the longest gap?", ok, found, f"below {limit:.1f} s", remedy, severity)


def _lost(recording: Recording, t: np.ndarray) -> np.ndarray:
    """Return the gaps (s) between stamps across which something may be lost.

    Increments that are missing tell nothing. Where the odometry has poses, they tell how far the robot moved meanwhile.
    If it stood, or went no farther than usual, nothing is missing. A radian counts as a metre.
    """
    gaps = np.diff(t)
    if recording.odometry is None:
        return gaps
    poses = recording.odometry.at(np.clip(t, *recording.odometry.t[[0, -1]]))
    steps = np.linalg.norm(between(poses[:-1], poses[1:]), axis=1)
    return gaps[(steps > 2.0 * np.median(steps)) | (gaps > LONGEST_PAUSE)] if len(gaps) else gaps


def check_speed(recording: Recording) -> Finding:
    """Check the largest count of any wheel as a speed: running totals and counters that wrap give impossible ones.

    Jumps that were left out when the recording was loaded were impossible, too. A few impossible speeds are a warning,
    since scans bridge them. Of a path that scans have made it says nothing.
    """
    if recording.scan_matched:
        return Finding("How fast was a wheel at most?", None, "no odometry", f"below {FASTEST:.0f} m/s")
    if (odometry := recording.odometry) is not None:
        second = np.searchsorted(odometry.t, odometry.t[:-1] + LEAST_SPAN).clip(max=len(odometry.t) - 1)
        poses, t = odometry.poses, odometry.t
        span = np.maximum(t[second] - t[:-1], LEAST_SPAN)
        speed = np.abs(between(poses[:-1], poses[second])[:, 0]) / span
    else:
        encoders, _ = recording.wheels_and_gyro()
        way = np.abs(encoders.counts).max(axis=1) * recording.robot.encoders.metres_per_count
        speed = way / np.median(np.diff(encoders.t))
    fastest, left_out = float(speed.max(initial=0.0)), recording.dropped.get(JUMPS, 0)
    often = (speed > FASTEST).sum() + left_out > OFTEN * len(speed)
    found, expected = f"{fastest:.1f} m/s", f"below {FASTEST:.0f} m/s"
    found += f" and {left_out} {JUMPS}" if left_out else ""
    remedy = "is the odometry in m, each reading of its own, and its clock never set back?" if often else ""
    ok, severity = fastest <= FASTEST and not left_out, "stop" if often else "warning"
    return Finding("How fast was a wheel at most?", ok, found, expected, remedy, severity)


def check_rest(recording: Recording) -> Finding:
    """Check what the gyro shows while the robot stands; a filter can do with it, because scans mend the heading."""
    answer = partial(Finding, "What does the gyro show at rest?", severity="note")
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
    """Check the share of beams that measured something, and count scans in which hardly any did.

    A small share is a note, because a scan is matched by the beams that it has. Empty scans cannot be matched.
    """
    answer = partial(Finding, "How many beams return?")
    if recording.lidar is None:
        return answer(None, "no LiDAR", "half or more")
    valid = recording.robot.lidar.valid(recording.lidar.ranges).mean(axis=1)
    matched = bool((valid < 0.1).mean() < 0.01)
    found = f"{100 * valid.mean():.0f} %, {np.count_nonzero(valid < 0.1)} empty scans"
    severity = "note" if matched else "warning"
    return answer(matched and bool(valid.mean() >= 0.5), found, "half or more", severity=severity)


def check_scatter(recording: Recording) -> Finding:
    """Check that the ranges of neighbouring beams on a wall agree: noise smears walls, and bends the heading.

    A run takes robust settings where they do not.
    """
    answer = partial(Finding, "How far do ranges scatter?", severity="note")
    expected = f"{100 * NOISY:.1f} cm or less"
    if recording.lidar is None:
        return answer(None, "no LiDAR", expected)
    scatter = recording.range_scatter()
    return answer(scatter <= NOISY, f"{100 * scatter:.1f} cm", expected)


def check_scans(recording: Recording, mounting: Mounting) -> list[Finding]:
    """Check that successive scans turn as the gyro says, or the odometry, and at the same time by both clocks.

    An upside-down LiDAR or a flipped gyro gives a factor of -1.
    """
    other = "gyro" if recording.odometry is None else "odometry"
    tolerance = clock_tolerance(recording)
    turns, clock = same_turns(mounting), mounting.late.within(0.0, tolerance)
    turned = "too few scans in turns" if turns is None else f"factor {mounting.turns.value:+.2f}"
    late = f"scans {1000 * mounting.late.value:+z.0f} ms late"
    late = "too even or too sparse to tell" if clock is None else late
    return [
        Finding(f"Do scans turn as the {other} does?", turns, turned, "a factor of 0.8 to 1.2"),
        Finding(f"Do scans and {other} share a clock?", clock, late, f"within {tolerance:.2f} s"),
    ]


def clock_tolerance(recording: Recording) -> float:
    """Return the offset (s) of clocks that is no fault: far readings set no clock better than to half their period."""
    odometry = recording.odometry or recording.encoders
    period = float(np.median(np.diff(odometry.t))) if odometry is not None and len(odometry.t) > 1 else 0.0
    return max(LATE, 0.5 * period)


def same_turns(mounting: Mounting) -> bool | None:
    """Tell whether scans turn as the odometry does."""
    return mounting.turns.within(1.0, 0.2)


def same_ways(mounting: Mounting) -> bool | None:
    """Tell whether scans move as far as the odometry does."""
    return mounting.ways.within(1.0, 0.03)


def same_direction(mounting: Mounting) -> bool | None:
    """Tell whether scans move in the direction of the odometry; None where they sway, whose mean direction is chance.

    Degrees are judged as they are printed.
    """
    if same_ways(mounting) is None or np.rad2deg(mounting.sway) >= WIDEST_SWAY:
        return None
    return Estimate(*np.rad2deg(mounting.yaw).round().tolist()).within(0.0, WIDEST_YAW)


def check_kept(recording: Recording) -> Finding:
    """Check that most scans could be kept and lie close, and that a bag without any holds no other kind of them."""
    answer = partial(Finding, "Are the scans all there?")
    said = (f"{count} {reason}" for reason, count in recording.dropped.items())
    others = [line for line in said if "MultiEcho" in line]
    if recording.lidar is None:
        remedy = "make LaserScan messages of them, as laser_proc does"
        ok, remedy, found = (False, remedy, "; ".join(others)) if others else (None, "", "no LiDAR")
        return answer(ok, found, "LaserScan messages", remedy, "stop")
    kept, lost = len(recording.lidar.t), recording.dropped.get("scans with the stamp of another", 0)
    remedy = "record again with stamps that tell one message from the next" if lost > 2 * kept else ""
    found = f"{kept} kept, {lost} doubles"
    if far := (apart := _way_between_scans(recording)) > FARTHEST_APART:
        found += f", one every {apart:.1f} m"
    expected, severity = f"most kept, {FARTHEST_APART:.1f} m apart or less", "stop" if remedy else "warning"
    return answer(not (remedy or far), found, expected, remedy, severity)


def _way_between_scans(recording: Recording) -> float:
    """Return the median way (m) from one scan to the next, where the robot drove."""
    path, t = dead_reckoning(recording), recording.scans().t
    ways = np.hypot(*np.diff(path.at(t[path.covers(t)])[:, :2], axis=0).T)
    return float(np.median(ways[ways > STANDING])) if (ways > STANDING).any() else 0.0


def check_scene(mounting: Mounting) -> Finding:
    """Check that the scene moves as the odometry says: as far, in the direction of the mounting, without swaying."""
    answer = partial(Finding, "Does the scene move as odometry says?")
    expected = f"a factor of 0.97 to 1.03, within {WIDEST_YAW:.0f} deg, steady"
    if (ways := same_ways(mounting)) is None:
        return answer(None, "too few scans to compare", expected)
    ahead, (yaw, error) = same_direction(mounting), np.rad2deg(mounting.yaw).round().tolist()
    sway = float(np.rad2deg(mounting.sway))
    found = f"factor {mounting.ways.value:z.2f}, turned by {yaw if error <= WIDEST_YAW else 0.0:+z.0f} deg"
    if sway >= WIDEST_SWAY:  # which scans mend, one by one
        return answer(
            False, f"{found}, swaying by {sway:.1f} deg", expected, "", "note" if ways else "warning"
        )
    remedy = f"the LiDAR seems mounted {yaw:+.0f} deg from what is stated: correct its yaw"
    return answer(ways and ahead is not False, found, expected, remedy if ahead is False else "")


def check_place(mounting: Mounting, after: Sequence[Finding] = ()) -> Finding:
    """Check that the LiDAR sits where it is stated to be.

    A wrong answer of ``after``, about turns and ways, would make the right place look wrong: then it is not asked.
    """
    answer = partial(Finding, "Does the LiDAR sit where stated?")
    expected, (ahead, left) = f"within {FARTHEST_PLACE:.2f} m", (mounting.ahead, mounting.left)
    if any(finding.ok is False for finding in after):
        return answer(None, "to be asked when scans and odometry agree", expected)
    off = Estimate(float(np.hypot(ahead.value, left.value)), max(ahead.error, left.error))
    if (ok := off.within(0.0, FARTHEST_PLACE)) is None:
        return answer(None, "too few scans in turns", expected)
    found = f"x {ahead.value:+z.1f} m, y {left.value:+z.1f} m"
    remedy = f"the LiDAR seems to sit {found} from where it is stated to be: correct its place"
    return answer(ok, found, expected, "" if ok else remedy)


def check_images(recording: Recording) -> Finding:
    """Check how many colour images have a depth image within a tenth of a second."""
    answer = partial(Finding, "Do images have partners?", severity="note")
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
    path = dead_reckoning(recording)
    edges = np.arange(path.t[0], path.t[-1], 1.0)
    apart = np.diff(turned_by_wheels(recording, edges, track=1.0))
    turned = np.diff(np.interp(edges, path.t, np.unwrap(path.poses[:, 2])))
    return float(apart @ turned / (turned @ turned)) if np.abs(turned).sum() >= 1.0 else None


def turned_by_wheels(recording: Recording, t: np.ndarray, track: float) -> np.ndarray:
    """Return the heading (rad) at times ``t (K,)`` from right less left wheels that stand ``track`` m apart."""
    encoders, _ = recording.wheels_and_gyro()
    right, left = encoders.counts[:, [0, 2]].mean(axis=1), encoders.counts[:, [1, 3]].mean(axis=1)
    apart = np.cumsum(right - left) * recording.robot.encoders.metres_per_count
    return np.interp(t, encoders.t, (apart - apart[0]) / track)


def _stamps(recording: Recording) -> dict[str, np.ndarray]:
    """Collect the stamps of every stream that is there."""
    names = {"encoders": "encoders", "imu": "gyro", "odometry": "odometry", "lidar": "lidar"}
    found = {name: part.t for key, name in names.items() if (part := getattr(recording, key)) is not None}
    return found if recording.camera is None else found | {"camera": recording.camera.rgb_t}
