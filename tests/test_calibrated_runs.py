"""What a drive says of its robot is put right before a run: clock, direction, scale, and beams that see the robot."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from box_recording import box_recording
from drives import simulated
from measure.robots import loose
from pfslam_book.show.faults import clockwise, late_scans

import pfslam
from pfslam.__main__ import main
from pfslam.beyond.localization import (
    EXPLAINED_SHARE,
    LocalizationConfig,
    LocalizationInfo,
    LocalizationResult,
)
from pfslam.cli.words import closing_words_of_search
from pfslam.errors import DataError
from pfslam.evaluation.checkup import check_up
from pfslam.evaluation.corrections import find_corrections, self_seen
from pfslam.io.selection import select
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory
from pfslam.recording import LidarScans, Recording
from pfslam.study.disturbances import disturb, first_seconds

BOX = box_recording(images=0)


@pytest.fixture(scope="module")
def drive():
    return first_seconds(simulated("hall", None).recording, 45.0)


def with_ranges(recording, ranges):
    return replace(recording, lidar=LidarScans(recording.lidar.t, ranges.astype(np.float32)))


def bumper(recording, low, high, metres=0.3):
    """Let the beams between two angles (degrees) end at the robot's own bumper, to within a centimetre."""
    angles = np.degrees(recording.robot.lidar.angles)
    own, ranges = (angles >= low) & (angles <= high), recording.lidar.ranges.copy()
    noise = np.random.default_rng(0).normal(0.0, 0.01, (len(ranges), own.sum()))
    ranges[:, own] = metres + noise
    return with_ranges(recording, ranges)


def turned(recording, degrees):
    """State the LiDAR's yaw too small by so many degrees: it looks as far to the left of what is stated."""
    lidar, yaw = recording.robot.lidar, np.radians(degrees)
    lidar = replace(lidar, angle_min=lidar.angle_min - yaw, angle_max=lidar.angle_max - yaw)
    return replace(recording, robot=replace(recording.robot, lidar=lidar))


def shorter(recording, factor):
    """State a wheel so small that the robot drives ``factor`` times as far as it says."""
    wheels = recording.robot.encoders
    wheels = replace(wheels, metres_per_count=wheels.metres_per_count / factor)
    return replace(recording, robot=replace(recording.robot, encoders=wheels))


# ---- beams that see the robot


@pytest.mark.parametrize("width", [30, 60])
def test_beams_that_see_a_bumper_are_found_and_no_others(width):
    ((low, high),) = self_seen(bumper(BOX, -90, width - 90))
    assert (low, high) == pytest.approx((-90, width - 90), abs=0.3)


def test_two_posts_are_two_sectors_and_the_last_beam_counts():
    sectors = self_seen(bumper(bumper(BOX, -135, -120), 125, 135))
    np.testing.assert_allclose(sectors, [[125.0, -120.0]], atol=0.3)  # nothing looks back between the two
    sectors = self_seen(bumper(bumper(BOX, -40, -30), 60, 65))
    np.testing.assert_allclose(sectors, [[-40, -30], [60, 65]], atol=0.3)


def straight(recording):
    """State an odometry that never turns."""
    t = dead_reckoning(recording).t
    poses = np.column_stack([0.4 * (t - t[0]), np.zeros((len(t), 2))])
    return replace(recording, encoders=None, imu=None, odometry=Trajectory(t, poses))


NO_BUMPER = {
    "nothing": BOX,
    "a wall beside a robot that never turns": straight(bumper(BOX, 80, 100)),
    "people ahead for a while": with_ranges(
        BOX,
        np.where(
            (BOX.lidar.t > BOX.lidar.t[0] + 2)[:, None] & (np.abs(BOX.robot.lidar.angles) < 0.8),
            0.8,
            BOX.lidar.ranges,
        ),
    ),
    "the same scan everywhere": with_ranges(BOX, np.repeat(BOX.lidar.ranges[:1], len(BOX.lidar.t), axis=0)),
    "what is always far away": bumper(BOX, -20, 20, metres=9.0),
    "no scans": replace(BOX, lidar=None),
}


@pytest.mark.parametrize("name", NO_BUMPER)
def test_what_else_stays_the_same_is_no_part_of_the_robot(name):
    assert self_seen(NO_BUMPER[name]) == []


# ---- clock, direction and scale

WRONG = {
    "late": (
        lambda r: late_scans(r, 0.15),
        {"delay": 0.15},
        "scans are 0.150 s late: shifted; --scan-delay 0",
    ),
    "early": (lambda r: late_scans(r, -0.1), {"delay": -0.1}, "scans are 0.100 s early: shifted"),
    "turned": (lambda r: turned(r, 60.0), {"yaw": 60.0}, "looks 60.0 deg to the left of what is stated"),
    "small wheels": (lambda r: shorter(r, 1.1), {"scale": 1.1}, "times as far as its odometry says"),
    "all": (
        lambda r: bumper(late_scans(turned(r, -60.0), 0.15), 170, 195),
        {"delay": 0.15, "yaw": -60.0, "masks": [[170.0, -165.0]]},
        "see the robot itself: left out; --no-mask",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_with_confidence_is_found_and_put_right(drive, name):
    spoil, expected, words = WRONG[name]
    found, lines, findings = find_corrections(spoil(drive))
    assert found.keys() == expected.keys()
    for key, tolerance in (("delay", 0.003), ("yaw", 0.3), ("scale", 0.02)):
        assert found.get(key) == pytest.approx(expected.get(key), abs=tolerance)
    assert len(lines) == len(found)
    assert any(words in line for line in lines)
    assert {f.severity for f in findings} <= {"ok", "note", "-"}
    np.testing.assert_allclose(found.get("masks", []), expected.get("masks", []), atol=0.3)
    assert find_corrections(spoil(drive), known=found)[:2] == ({}, [])


def noisy(recording, metres, sigma, seed):
    """See no farther than so many metres, with noise of ``sigma`` (m)."""
    ranges = disturb(recording, {"range_noise": sigma}, seed).lidar.ranges
    return with_ranges(recording, np.where(ranges < metres, ranges, np.inf))


NOISY = {
    "two things at once": (3.0, 0.08, 0, 60.0),
    "one that the first fit cannot tell": (3.0, 0.08, 1, 180.0),
    "in three tries": (3.0, 0.08, 4, 60.0),
}


@pytest.mark.parametrize("name", NOISY)
def test_a_correction_is_improved_until_the_fit_finds_it_right(drive, name):
    """Where ranges are short and noisy, the first fit takes the ways for 4 to 6 % shorter than they are."""
    *scanner, seed, yaw = NOISY[name]
    found, lines, findings = find_corrections(turned(noisy(drive, *scanner, seed), yaw))
    assert found.keys() == {"yaw", "scale"}
    assert abs((found["yaw"] - yaw + 180.0) % 360.0 - 180.0) < 0.5
    assert found["scale"] == pytest.approx(1.0, abs=0.02)
    assert "stop" not in {finding.severity for finding in findings}
    assert len(lines) == 2


SOUND = {
    "sound": lambda r: r,
    "mirrored": lambda r: late_scans(clockwise(r), 0.15),
    "loose by three degrees": lambda r: loose(3.0, turned(r, 5.0)),
    "the same scan everywhere": lambda r: with_ranges(
        r, np.repeat(r.lidar.ranges[:1], len(r.lidar.t), axis=0)
    ),
}


@pytest.mark.parametrize("name", SOUND)
def test_what_is_right_or_beyond_help_is_left_alone(drive, name):
    assert find_corrections(SOUND[name](drive))[:2] == ({}, [])


def test_a_number_is_taken_as_it_is():
    late, left, longer = (select(BOX, **{name: 0.5}) for name in ("delay", "yaw", "scale"))
    np.testing.assert_array_equal(late.lidar.t, BOX.lidar.t - 0.5)
    np.testing.assert_allclose(np.degrees(left.robot.lidar.angles - BOX.robot.lidar.angles), 0.5)
    assert longer.robot.encoders.metres_per_count == 0.5 * BOX.robot.encoders.metres_per_count
    log = Recording("log", odometry=BOX.truth)
    np.testing.assert_allclose(select(log, scale=2.0).odometry.poses, BOX.truth.poses * [2.0, 2.0, 1.0])
    for name, value in (("delay", np.nan), ("yaw", 400.0), ("scale", 0.0), ("scale", np.inf)):
        with pytest.raises(DataError, match=r"--(scan-delay|lidar-yaw|odometry-scale): found"):
            select(BOX, **{name: value})


# ---- the commands


def run(recording, folder, *options):
    """Run a drive with few particles; return the exit code and the summary."""
    path = folder / "drive.npz"
    pfslam.save(recording, path)
    line = ["run", str(path), "--out", str(folder / "out"), "--particles", "4", "--every", "10", "--quiet"]
    code = main([*line, *options])
    return code, json.loads((folder / "out" / "summary.json").read_text())


def test_a_run_puts_right_what_it_finds_and_keeps_it_in_its_summary(drive, tmp_path, capsys):
    """As good as the sound drive, once more from its summary, and not where it is refused."""
    sound, part = {}, first_seconds(drive, 30.0)
    wrong = bumper(late_scans(turned(part, 60.0), 0.15), -135 - 60, -115 - 60)
    code, sound = run(part, tmp_path)
    assert (code, sound["selection"], sound["notes"]) == (0, [], [])
    code, mended = run(wrong, tmp_path, "--until", "25")
    assert (code, len(mended["notes"]), mended["checks_failed"]) == (0, 3, [])
    assert mended["slam"]["ate_rmse_m"] < sound["slam"]["ate_rmse_m"] + 0.02
    assert mended["selection"][::2][:2] == ["--until", "--mask"]
    path = (tmp_path / "out" / "trajectory.tum").read_bytes()
    kept = tmp_path / "kept.json"
    kept.write_text(json.dumps(mended))
    code, again = run(wrong, tmp_path, "--config", str(kept))
    assert (again["selection"], again["notes"]) == (mended["selection"], [])
    assert (tmp_path / "out" / "trajectory.tum").read_bytes() == path
    refused = ["--no-mask", "--scan-delay", "0", "--lidar-yaw", "0", "--odometry-scale", "1"]
    _, kept_wrong = run(wrong, tmp_path, *refused)
    assert kept_wrong["selection"] == refused
    assert kept_wrong["slam"]["ate_rmse_m"] > 3 * mended["slam"]["ate_rmse_m"]
    assert main(["check", str(tmp_path / "drive.npz")]) == 0
    assert "note: scans are 0.150 s late: shifted; --scan-delay 0 keeps them" in capsys.readouterr().out
    assert main(["check", str(tmp_path / "drive.npz"), *refused]) == 1


# ---- how bad it is


def speed_of(recording):
    return {f.question: f for f in check_up(recording)}["How fast was a wheel at most?"]


def test_stamps_that_are_late_by_a_step_do_not_make_a_robot_fast():
    """Readings 0.7 ms apart with a way of 4 cm between them would be 57 m/s."""
    t = np.arange(0.0, 60.0, 0.05)
    poses = np.column_stack([0.8 * t, np.zeros((len(t), 2))])
    t[7::50] = t[8::50] - 0.0007
    finding = speed_of(Recording("log", odometry=Trajectory(t, poses)))
    assert (finding.ok, finding.severity) == (True, "ok")
    fast = speed_of(Recording("log", odometry=Trajectory(t, poses * [20.0, 1.0, 1.0])))
    assert (fast.ok, fast.severity) == (False, "stop")


def test_a_wrong_answer_is_a_note_a_warning_or_a_stop(drive, tmp_path, capsys):
    log = replace(BOX, encoders=None, imu=None, odometry=BOX.truth)
    noisy = with_ranges(
        log, BOX.lidar.ranges + np.random.default_rng(0).normal(0, 0.06, BOX.lidar.ranges.shape)
    )
    assert {f.severity for f in check_up(noisy) if f.ok is False} == {"note"}
    seldom = np.where(np.arange(BOX.lidar.ranges.shape[1]) % 3, np.inf, BOX.lidar.ranges)
    few, empty = with_ranges(log, seldom), with_ranges(log, np.full_like(seldom, np.inf))
    said = [
        {f.question: f.severity for f in check_up(r)}["How many beams return?"] for r in (log, few, empty)
    ]
    assert said == ["ok", "note", "warning"]
    mirrored = check_up(clockwise(drive))
    assert "warning" in {f.severity for f in mirrored if f.ok is False}
    assert {f.severity for f in mirrored if f.ok} == {"ok"}
    assert {f.severity for f in mirrored if f.ok is None} <= {"-"}
    pfslam.save(noisy, tmp_path / "noisy.npz")
    assert main(["check", str(tmp_path / "noisy.npz"), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    severities = {check["question"]: check["severity"] for check in answer["checks"]}
    assert (answer["failed"], severities["How far do ranges scatter?"]) == (0, "note")


# ---- where in a known map


def searched(explained):
    """A search that agrees on one place from its fifth second on, and how much of each scan the map explains."""
    infos = [
        LocalizationInfo(float(t), np.zeros(3), float(t >= 5), None, 500, explained=share)
        for t, share in enumerate(explained)
    ]
    path = Trajectory(np.arange(float(len(infos))), np.zeros((len(infos), 3)))
    return LocalizationResult(path, tuple(infos), LocalizationConfig(), {})


def test_a_place_is_judged_by_the_path_since_it_was_found():
    """A few bad seconds at the end do not count more than others, and those of the search do not count."""
    good, bad = EXPLAINED_SHARE + 0.05, EXPLAINED_SHARE - 0.08
    changed_at_the_end = searched([0.2] * 5 + [good] * 50 + [bad] * 10)
    assert changed_at_the_end.found
    assert changed_at_the_end.explained == pytest.approx((50 * good + 10 * bad) / 60)
    fits_at_the_end = searched([0.2] * 5 + [bad] * 50 + [good] * 10)
    assert not fits_at_the_end.found
    words = closing_words_of_search(BOX, fits_at_the_end, Path("out"))
    share, needed = int(100 * fits_at_the_end.explained), round(100 * EXPLAINED_SHARE)
    assert f"explains {share} % of the beams on the way, and {needed} % are needed" in words
    assert searched([good] * 4).explained == 0.0
