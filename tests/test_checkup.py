"""The check-up: nothing to complain about on good drives, and each fault found by the question meant for it."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from box_recording import START, box_camera, box_recording
from drives import simulated
from measure.robots import loose
from pfslam_book.show.faults import clockwise, late_scans, scaled_gyro, scaled_ranges, silent_gyro

import pfslam
from pfslam.__main__ import main
from pfslam.evaluation.checkup import check_overlap, check_place, check_scene, check_up
from pfslam.evaluation.mounting import fit_mounting
from pfslam.io.selection import select
from pfslam.poses import Trajectory
from pfslam.recording import Encoders, Imu, LidarScans, Recording, chosen
from pfslam.study.disturbances import first_seconds, missing_beams, range_noise, start_time

HEALTHY = "none"


def with_counts(recording, counts):
    encoders, _ = recording.wheels_and_gyro()
    return replace(recording, encoders=Encoders(encoders.t, counts))


def totals(recording):
    return np.cumsum(recording.wheels_and_gyro()[0].counts, axis=0)


def wrapped(recording, bits=8):
    """The increments that careless differences make of a counter of so many bits, jumps included."""
    readings = totals(recording) % 2**bits
    return np.diff(readings, axis=0, prepend=readings[:1])


TURNS = "Do wheels and gyro turn the same way?"
SCANS_TURN = "Do scans turn as the gyro does?"
FASTEST = "How fast was a wheel at most?"
FAULTS = {
    HEALTHY: (lambda r: r, set()),
    "running totals": (lambda r: with_counts(r, totals(r)), {FASTEST}),
    "8-bit counter": (lambda r: with_counts(r, wrapped(r)), {FASTEST}),
    "gyro in degrees": (lambda r: scaled_gyro(r, float(np.rad2deg(1.0))), {TURNS, SCANS_TURN}),
    "gyro flipped": (lambda r: scaled_gyro(r, -1.0), {TURNS, SCANS_TURN}),
    "beams backwards": (clockwise, {SCANS_TURN}),
    "both mirrored": (lambda r: clockwise(scaled_gyro(r, -1.0)), {TURNS}),
    "scans 150 ms late": (lambda r: late_scans(r, 0.15), {"Do scans and gyro share a clock?"}),
    "gyro silent for 3 s": (lambda r: silent_gyro(r, 30.0, 33.0), {"How long is the longest gap?"}),
    "60 % of beams lost": (
        lambda r: missing_beams(r, 0.6, np.random.default_rng(0)),
        {"How many beams return?"},
    ),
    "noise of 5 cm": (
        lambda r: range_noise(r, 0.05, np.random.default_rng(0)),
        {"How far do ranges scatter?"},
    ),
}


@pytest.fixture(scope="module")
def drive():
    return first_seconds(simulated("hall", None).recording, 45.0)


def complaints(recording):
    return {finding.question for finding in check_up(recording) if finding.ok is False}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hall", "ramp"])
def test_good_drives_give_nothing_to_complain_about(name):
    findings = check_up(simulated(name, None).recording)
    assert [finding.ok for finding in findings] == [True] * len(findings)


@pytest.mark.parametrize("folder", ["corridor20", "ece276a"])
def test_real_wheels_and_gyro_pass(real_data, folder):
    assert complaints(pfslam.load(20, real_data / folder)) == set()


def test_a_log_of_odometry_poses_is_checked_as_far_as_it_goes(real_data):
    findings = {f.question: f for f in check_up(pfslam.load(real_data / "intel" / "intel.log"))}
    assert findings["How many beams return?"].ok
    assert findings["What does the gyro show at rest?"].ok is None


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found(drive, fault):
    change, expected = FAULTS[fault]
    found = complaints(change(drive))
    assert expected <= found
    assert bool(found) == (fault != HEALTHY)


LONG = box_recording(30.0, images=0)


def logged(imu=(-1.0, 31.0), lidar=(-1.0, 31.0), camera=None):
    """Thirty seconds in the box, with each stream from and until when the recorder had it, in seconds of the drive."""

    def during(stream, begin, end):
        return chosen(stream, (stream.t >= START + begin) & (stream.t <= START + end))

    images = camera and box_camera(START + camera[0], round(2 * (camera[1] - camera[0])))
    return replace(LONG, imu=during(LONG.imu, *imu), lidar=during(LONG.lidar, *lidar), camera=images)


BEGINNING, END = {"until": 8.0}, {"start": 22.0}


@pytest.mark.parametrize(
    ("spans", "part"),
    [
        ({"imu": (2.0, 31.0)}, BEGINNING),
        ({"imu": (-1.0, 28.0)}, END),
        ({"lidar": (-1.0, 28.0)}, END),
        ({"camera": (2.4, 30.0)}, BEGINNING),
        ({"camera": (0.3, 28.3)}, END),
    ],
    ids=["gyro late", "gyro gone early", "lidar gone early", "camera late", "camera gone early"],
)
def test_a_part_of_a_good_drive_overlaps_as_the_drive_does(spans, part):
    """A recorder begins and ends its streams two seconds apart, which is a fourth of eight seconds."""
    whole = logged(**spans)
    cut = select(whole, **part)
    assert check_overlap(whole, whole).ok
    assert check_overlap(cut, whole).ok
    brief = replace(cut, dropped={})
    assert check_overlap(brief, brief).ok is False  # so a recording of eight seconds is still told


@pytest.mark.parametrize(
    ("spans", "bad", "good"),
    [
        ({"imu": (-1.0, 15.0)}, {"start": 10.0, "until": 20.0}, BEGINNING),
        ({"imu": (15.0, 31.0)}, {"start": 10.0, "until": 20.0}, END),
        ({"camera": (0.5, 15.0)}, {"start": 10.0, "until": 20.0}, {"start": 1.0, "until": 8.0}),
        ({"camera": (15.0, 30.0)}, {"start": 10.0, "until": 20.0}, {"start": 22.0, "until": 29.0}),
    ],
    ids=["gyro breaks off", "gyro begins", "camera breaks off", "camera begins"],
)
def test_streams_that_miss_one_another_are_told_and_where_all_are_there_they_are_not(spans, bad, good):
    whole = logged(**spans)
    assert not check_overlap(whole, whole).ok
    assert not check_overlap(select(whole, **bad), whole).ok
    assert check_overlap(select(whole, **good), whole).ok


@pytest.mark.parametrize(("spans", "word"), [((2.0, 31.0), "ok"), ((5.0, 31.0), "warning")])
def test_check_asks_the_whole_drive_whether_its_streams_overlap(tmp_path, capsys, spans, word):
    pfslam.save(logged(imu=spans), tmp_path / "drive.npz")
    main(["check", str(tmp_path / "drive.npz"), "--until", "8"])
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "streams overlap" in line]
    assert line.split()[0] == word


@pytest.mark.parametrize(("spans", "asked"), [({"imu": (2.0, 31.0)}, None), ({}, True)])
def test_a_file_of_a_part_is_not_blamed_for_what_the_whole_drive_would_tell(tmp_path, capsys, spans, asked):
    """The gyro began two seconds late, as recorders do: the file of eight seconds does not know of thirty."""
    whole, part = str(tmp_path / "drive.npz"), str(tmp_path / "part.npz")
    pfslam.save(logged(**spans), whole)
    assert main(["convert", whole, part, "--until", "8"]) == 0
    recording = pfslam.load(part)
    assert check_overlap(recording, recording).ok is asked
    capsys.readouterr()
    main(["check", part])
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "streams overlap" in line]
    assert line.split()[0] == ("ok" if asked else "-")
    assert ("of a part of the drive" in line) == (asked is None)


def turned(recording, degrees):
    """State another yaw of the LiDAR than it has."""
    lidar, yaw = recording.robot.lidar, np.radians(degrees)
    lidar = replace(lidar, angle_min=lidar.angle_min + yaw, angle_max=lidar.angle_max + yaw)
    return replace(recording, robot=replace(recording.robot, lidar=lidar))


def by_the_metre(pause, metres, what="poses"):
    """A log of a pose and a scan each second and metre, one of which comes ``pause`` s and ``metres`` m late."""
    t, x = np.arange(60.0), np.arange(60.0)
    t[30:] += pause - 1.0
    x[30:] += metres - 1.0
    box = box_recording(images=0)
    odometry = Trajectory(t, np.column_stack([x, np.zeros((60, 2))]))
    lidar = LidarScans(t, np.repeat(box.lidar.ranges[:1], 60, axis=0))
    if what == "increments":
        counts = np.full((60, 4), 400, dtype=np.int16)
        turning, gravity = np.zeros((60, 3)), np.tile([0.0, 0.0, 1.0], (60, 1))
        return replace(box, encoders=Encoders(t, counts), imu=Imu(t, turning, gravity), lidar=lidar)
    return Recording("log", box.robot, odometry=odometry, lidar=lidar)


@pytest.mark.parametrize(
    ("log", "ok", "found"),
    [
        (by_the_metre(2.5, 9.0), True, "2.50 s (odometry)"),
        (by_the_metre(40.0, 0.0), True, "40.00 s (odometry), no farther than usual"),
        (by_the_metre(40.0, 1.9), True, "40.00 s (odometry), no farther than usual"),
        (by_the_metre(40.0, 2.1), False, "40.00 s (odometry)"),
        (by_the_metre(4000.0, 0.0), False, "4000.00 s (odometry)"),
        (by_the_metre(40.0, 0.0, "increments"), False, "40.00 s (lidar)"),
    ],
)
def test_a_pause_in_which_a_log_of_poses_went_no_farther_than_usual_lost_nothing(log, ok, found):
    """A pause of three times the usual counts, unless poses say that no way was lost. Increments cannot say it."""
    finding = {f.question: f for f in check_up(log)}["How long is the longest gap?"]
    assert (finding.ok, finding.found, finding.expected) == (ok, found, "below 3.0 s")
    assert bool(finding.remedy) == ("4000" in found)


@pytest.mark.parametrize("degrees", [-135, 0, 90, 180])
def test_a_lidar_that_is_mounted_otherwise_is_told_by_how_much(drive, degrees):
    """What is stated is too much by so many degrees, so the LiDAR is mounted at as many less."""
    found = fit_mounting(turned(drive, degrees))
    off = (np.rad2deg(found.yaw.value) + degrees + 180) % 360 - 180
    assert abs(off) < 3 * np.rad2deg(found.yaw.error) < 0.3
    assert abs(found.ways.value - 1.0) < 0.015
    finding = check_scene(found)
    assert (finding.ok, bool(finding.remedy)) == (degrees == 0, degrees != 0)


def test_a_gyro_that_never_turns_is_contradicted_by_scans_that_do(drive):
    """And where the robot goes straight on, no turn is missed."""
    finding = {f.question: f for f in check_up(scaled_gyro(drive, 0.0))}["Do scans turn as the gyro does?"]
    assert (finding.ok, finding.found) == (False, "factor +0.00")
    assert fit_mounting(by_the_metre(1.0, 1.0)).turns.within(1.0, 0.2) is None


def with_metres(recording, scale):
    """State so many times the metres per count."""
    encoders = recording.robot.encoders
    encoders = replace(encoders, metres_per_count=scale * encoders.metres_per_count)
    return replace(recording, robot=replace(recording.robot, encoders=encoders))


def still(recording):
    """The first scan again and again, wherever the robot goes."""
    scans = recording.lidar
    return replace(recording, lidar=LidarScans(scans.t, np.repeat(scans.ranges[:1], len(scans.t), 0)))


STRAIGHT = r"turned by \+0 deg"
ANOTHER_SCENE = {
    "counts half as long": (lambda r: with_metres(r, 0.5), 2.0, STRAIGHT),
    "counts a little shorter": (lambda r: with_metres(r, 0.9), 1 / 0.9, STRAIGHT),
    "counts a little longer": (lambda r: with_metres(r, 1.1), 1 / 1.1, STRAIGHT),
    "counts twice as long": (lambda r: with_metres(r, 2.0), 0.5, STRAIGHT),
    # Both maps are as sharp, and one of the two is a twentieth too large: only the wheels can contradict.
    "ranges a twentieth too short": (lambda r: scaled_ranges(r, 0.95), 0.95, STRAIGHT),
    "ranges a twentieth too long": (lambda r: scaled_ranges(r, 1.05), 1.05, STRAIGHT),
    "loose by a degree": (lambda r: loose(1.0, r), 1.0, r"turned by \+0 deg, swaying by \d\.\d deg"),
    "loose by three degrees": (lambda r: loose(3.0, r), 1.0, r"turned by \+0 deg, swaying by \d\.\d deg"),
    "a scene that stands still": (still, 0.0, STRAIGHT),
}


@pytest.mark.parametrize("name", ANOTHER_SCENE)
def test_a_scene_that_moves_otherwise_than_the_robot_is_told_and_a_run_may_go_on(drive, name):
    change, factor, words = ANOTHER_SCENE[name]
    finding = check_scene(fit_mounting(change(drive)))
    said, _, rest = finding.found.partition(", ")
    assert float(said.removeprefix("factor ")) == pytest.approx(factor, rel=0.02)
    assert re.fullmatch(words, rest)
    assert (finding.ok, finding.remedy) == (False, "")


def shifted(recording, x, y):
    """State another place of the LiDAR than it has."""
    lidar = recording.robot.lidar
    lidar = replace(lidar, position_b=tuple(np.add(lidar.position_b, [x, y, 0.0])))
    return replace(recording, robot=replace(recording.robot, lidar=lidar))


def ahead_only(recording, degrees):
    """See only what lies within an angle about ahead."""
    lidar = recording.robot.lidar
    k = np.flatnonzero(np.abs(lidar.angles) <= np.radians(degrees / 2))
    lidar = replace(lidar, beams=len(k), angle_min=lidar.angles[k[0]], angle_max=lidar.angles[k[-1]])
    scans = LidarScans(recording.lidar.t, recording.lidar.ranges[:, k])
    return replace(recording, robot=replace(recording.robot, lidar=lidar), lidar=scans)


@pytest.mark.parametrize(
    ("view", "x", "y"),
    [(270, 0.0, 0.0), (270, 0.2, 0.0), (180, 0.0, 0.0), (180, 0.0, -0.3), (180, -0.4, 0.2)],
)
def test_a_lidar_that_sits_elsewhere_is_told_where(drive, view, x, y):
    """What is stated lies too far ahead or to the left, so the LiDAR sits as much further back or to the right."""
    found = fit_mounting(shifted(ahead_only(drive, view), x, y))
    assert (found.ahead.value, found.left.value) == pytest.approx((-x, -y), abs=0.02)
    finding = check_place(found)
    right = x == y == 0.0
    assert (finding.ok, bool(finding.remedy)) == (right, not right)
    assert finding.found == f"x {-x + 0.0:+.1f} m, y {-y + 0.0:+.1f} m"


def test_a_place_is_not_asked_for_while_scans_turn_the_other_way(drive):
    """Mirrored scenes lie on each other nowhere, so that any place would be as wrong."""
    findings = {f.question: f for f in check_up(clockwise(drive))}
    assert findings["Does the LiDAR sit where stated?"].ok is None


@pytest.mark.parametrize(("every", "close"), [(10, True), (80, False)])
def test_scans_that_lie_far_apart_are_told(drive, every, close):
    """Two that share few walls are matched in the wrong place, and fit there; a run may go on."""
    scans = LidarScans(drive.lidar.t[::every], drive.lidar.ranges[::every])
    finding = {f.question: f for f in check_up(replace(drive, lidar=scans))}["Are the scans all there?"]
    assert (finding.ok, finding.remedy) == (close, "")
    assert ("one every" in finding.found) != close


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["hall", "ramp", "ring"])
@pytest.mark.parametrize("seed", range(10))
def test_a_sound_mounting_is_never_doubted_and_a_wrong_one_always(name, seed):
    recording = simulated(name, seed).recording
    found, back = fit_mounting(recording), fit_mounting(turned(recording, 180))
    assert check_scene(found).ok is check_place(found).ok is True
    assert abs(back.yaw.value) == pytest.approx(np.pi, abs=0.01)
    shift = fit_mounting(shifted(recording, 0.2, 0.0)).ahead.value - found.ahead.value
    assert shift == pytest.approx(-0.2, abs=0.02)


@pytest.mark.slow
def test_a_sound_mounting_is_not_doubted_among_hazards():
    found = fit_mounting(simulated("hall", 7, people=8, slip=8, bumps=8).recording)
    assert check_scene(found).ok is check_place(found).ok is True


def test_most_scans_with_the_stamp_of_another_are_no_drive(drive):
    lost = replace(drive, dropped={"scans with the stamp of another": 3 * len(drive.lidar.t)})
    assert complaints(lost) == {"Are the scans all there?"}
    assert complaints(replace(drive, dropped={"scans with the stamp of another": 30})) == set()


def halved(recording):
    """Set the clock back by half a minute in mid drive, as a simulation that starts again does."""
    counts, begin = recording.wheels_and_gyro()[0].counts * 40, start_time(recording)
    return with_counts(recording, np.where(recording.encoders.t[:, None] > begin + 20, counts, counts // 40))


SPOILT = {
    "counts times forty": (halved, "is the odometry in m"),
    "a day later": (
        lambda r: replace(
            r, lidar=LidarScans(r.lidar.t + 9e4 * (r.lidar.t > r.lidar.t[300]), r.lidar.ranges)
        ),
        "did the clock jump?",
    ),
}


@pytest.mark.parametrize("name", SPOILT)
def test_a_run_stops_at_what_makes_it_impossible_and_goes_on_if_asked_to(drive, name, tmp_path, capsys):
    spoil, words = SPOILT[name]
    pfslam.save(spoil(first_seconds(drive, 30.0)), tmp_path / "drive.npz")
    line = ["run", str(tmp_path / "drive.npz"), "--out", str(tmp_path / "out"), "--quiet"]
    line += ["--particles", "2", "--every", "40"]
    assert main(line) == 3
    said = capsys.readouterr()
    assert (said.out, words in said.err, "--anyway" in said.err) == ("", True, True)
    assert not (tmp_path / "out" / "summary.json").exists()
    assert main([*line, "--anyway"]) == 4
    distrust = json.loads((tmp_path / "out" / "summary.json").read_text())["distrust"]
    assert [d["to"] for d in distrust if words in d["reason"]][-1] is None


def test_the_clock_offset_comes_out_in_milliseconds(drive):
    for late in (-0.1, 0.06, 0.2):
        shifted = replace(drive, lidar=LidarScans(drive.lidar.t + late, drive.lidar.ranges))
        assert fit_mounting(shifted).late.value == pytest.approx(late, abs=0.003)


@pytest.mark.parametrize("every", [4, 20])
def test_sparse_scans_tell_the_clock_as_well(drive, every):
    """Ten scans a second do, and so do two: each of them is matched, however far the next one is."""
    thin = replace(drive, lidar=LidarScans(drive.lidar.t[::every], drive.lidar.ranges[::every]))
    clock = {f.question: f for f in check_up(thin)}["Do scans and gyro share a clock?"]
    assert (clock.ok, clock.found.endswith("late")) == (True, True)


def test_a_drive_in_a_circle_says_nothing_about_the_clock():
    """It looks the same a moment later, so no shift of the scans fits better than another. Nor can a drift be told
    from a factor of the turns."""
    findings = {f.question: f for f in check_up(box_recording(images=0))}
    assert findings["Do scans turn as the gyro does?"].ok is None
    clock = findings["Do scans and gyro share a clock?"]
    assert (clock.ok, clock.found) == (None, "too even or too sparse to tell")


@pytest.mark.parametrize("poses", [1, 2, 3])
@pytest.mark.parametrize("scans", [0, 1, 2])
def test_the_shortest_recordings_are_answered(poses, scans):
    box = box_recording(images=0)
    lidar = LidarScans(box.lidar.t[:scans], box.lidar.ranges[:scans]) if scans else None
    odometry = Trajectory(box.truth.t[:poses], box.truth.poses[:poses])
    findings = check_up(Recording("short", box.robot, odometry=odometry, lidar=lidar))
    found = {f.question: (f.ok, f.found) for f in findings}
    assert len(found) == 13
    assert found["Do wheels and gyro turn the same way?"] == (None, "no gyro")
    assert found["What does the gyro show at rest?"] == (None, "no gyro")


def test_a_robot_that_hardly_turns_or_never_rests_is_not_judged_by_it():
    """The box's drive turns 0.4 rad/s for 5.6 s from its first moment; a tenth of it is too little to tell."""
    turning = box_recording(images=0)
    slow = replace(turning, imu=replace(turning.imu, angular_velocity=0.1 * turning.imu.angular_velocity))
    found = {f.question: (f.ok, f.found) for f in check_up(slow)}
    assert found["Do wheels and gyro turn the same way?"] == (None, "too few turns")
    assert found["What does the gyro show at rest?"] == (None, "only 0 s at rest")


@pytest.mark.parametrize(
    ("factor", "ok"), [(1.01, True), (1.15, True), (1.8, False), (-1.0, False), (1.0, None)]
)
def test_odometry_and_gyro_are_compared_too(factor, ok):
    """A log that stands for 8 s and weaves for a minute, with a gyro that shows 0.02 rad/s at rest."""
    t = np.arange(0.0, 68.0, 0.05)
    rate = np.where(t < 8, 0.0, 0.5 * np.sin(0.4 * (t - 8)))
    heading = factor * np.concatenate([[0.0], np.cumsum(rate[1:] * 0.05)])
    odometry = Trajectory(t, np.column_stack([np.where(t < 8, 0.0, t - 8), np.zeros(len(t)), heading]))
    gyro = Imu(t, np.outer(rate + 0.02, [0, 0, 1]), np.tile([0.0, 0.0, 1.0], (len(t), 1)))
    log = replace(box_recording(images=0), encoders=None, imu=gyro, odometry=odometry, lidar=None)
    found = {f.question: (f.ok, f.found) for f in check_up(log)}
    words = f"factor {factor:+.2f}" if ok is not None else "the odometry turns by the gyro"
    assert found["Do wheels and gyro turn the same way?"] == (ok, words)
    assert found["What does the gyro show at rest?"] == (False, "+0.0200 rad/s in 8 s")


@pytest.mark.parametrize("kind", ["wheels", "poses"])
def test_the_answers_do_not_depend_on_the_order_of_the_gyros_columns(drive, kind):
    """Columns z, x, y in the place of x, y, z, against encoders, and against an odometry's poses."""
    path = pfslam.dead_reckoning(drive)
    drive = drive if kind == "wheels" else replace(drive, odometry=path, encoders=None)
    gyro = Imu(
        drive.imu.t, *(v[:, [2, 0, 1]] for v in (drive.imu.angular_velocity, drive.imu.acceleration_g))
    )
    robot = replace(drive.robot, imu=replace(drive.robot.imu, yaw_axis=0))
    assert check_up(replace(drive, imu=gyro, robot=robot)) == check_up(drive)


def test_an_odometry_in_centimetres_is_all_jumps_which_are_left_out_and_spoil_a_run(tmp_path):
    """At 20 Hz and 10 m/s or more a step is a jump; the odometry that is left stands still, and is not to be run."""
    t = np.arange(0.0, 30.0, 0.05)
    straight = Trajectory(t, np.column_stack([100.0 * 0.4 * t, 0.0 * t, 0.0 * t]))
    pfslam.save(Recording("log", odometry=straight), tmp_path / "log.npz")
    for log in (Recording("log", odometry=straight), pfslam.load(tmp_path / "log.npz")):
        (found,) = [f for f in check_up(log) if f.question == "How fast was a wheel at most?"]
        assert (found.ok, bool(found.remedy)) == (False, True)
    assert found.found == f"0.0 m/s and {len(t) - 1} jumps of the odometry"
