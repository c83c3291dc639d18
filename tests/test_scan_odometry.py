"""Drives without odometry: the path that scans alone tell, and what a run over it says of its doubts."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from bag_files import rows_of, write_bag
from box_recording import START, box_recording
from rooms import LIDAR, ROOM, box, ray_cast, sensor_position

import pfslam
from pfslam.__main__ import main
from pfslam.errors import DataError
from pfslam.evaluation.checkup import check_up
from pfslam.evaluation.corrections import find_corrections
from pfslam.io.bags import BagOptions
from pfslam.io.recordings import save
from pfslam.io.selection import select
from pfslam.poses import between, compose
from pfslam.recording import LidarScans, Recording
from pfslam.refined.scan_odometry import FARTHEST_APART, reach, scan_odometry, unaided
from pfslam.sensors import RobotModel

BOX = box_recording(images=0)
ALONE = replace(BOX, encoders=None, imu=None)


def seen(poses, walls=ROOM, period=0.1, lidar=LIDAR):
    """A recording of scans alone, one every ``period`` s at each of ``poses (K, 3)``, by exact geometry."""
    t = START + period * np.arange(len(poses))
    ranges = [
        ray_cast(walls, sensor_position(p, lidar), p[2] + lidar.angles, lidar.range_max + 1.0) for p in poses
    ]
    return Recording("seen", RobotModel(lidar=lidar), lidar=LidarScans(t, np.array(ranges, np.float32)))


def driven(steps):
    """Poses ``(K + 1, 3)`` from the origin on, each a step ``(3,)`` farther than the one before."""
    poses = [np.zeros(3)]
    for step in steps:
        poses.append(compose(poses[-1], np.asarray(step, dtype=float)))
    return np.array(poses)


def off(path, poses):
    """How far (m, rad) a path is at most from true poses, both from their first."""
    apart = np.abs(between(between(poses[0], poses), path.poses))
    return float(np.hypot(*apart[:, :2].T).max()), float(apart[:, 2].max())


def doubts(recording):
    found = pfslam.with_scan_odometry(recording)
    return unaided(found, pfslam.run_slam(found).infos)


# ---- the path ----------------------------------------------------------------------------------


def test_scans_alone_tell_the_path_and_a_run_over_it_is_right():
    found = pfslam.with_scan_odometry(ALONE)
    assert (ALONE.motion, found.motion, found.scan_matched) == ("scans", "scans", True)
    np.testing.assert_array_equal(found.odometry.t, ALONE.lidar.t)
    assert max(off(found.odometry, BOX.truth.poses)) < 1e-3
    assert max(off(pfslam.run_slam(found).trajectory, BOX.truth.poses)) < 1e-3
    assert unaided(found, pfslam.run_slam(found).infos) == []


def test_what_odometry_there_is_is_not_looked_at():
    """The same path, to the last bit, with wheels, with wrong wheels, and without any."""
    wrong = replace(BOX, encoders=replace(BOX.encoders, counts=-BOX.encoders.counts))
    paths = [scan_odometry(recording).poses for recording in (ALONE, BOX, wrong)]
    np.testing.assert_array_equal(paths[0], paths[1])
    np.testing.assert_array_equal(paths[0], paths[2])
    assert pfslam.with_scan_odometry(BOX).encoders is None


def test_as_many_scans_are_matched_as_a_filter_uses_and_the_last():
    scans = LidarScans(BOX.lidar.t[0] + 0.03 * np.arange(55), BOX.lidar.ranges)
    fast = replace(ALONE, lidar=scans)
    assert fast.default_every == 4
    np.testing.assert_array_equal(scan_odometry(fast).t, scans.t[[*range(0, 55, 4), 54]])


def test_a_slow_scanner_is_matched_as_far_as_two_scans_share_walls():
    """Where a scan comes every two seconds, the robot turns by a radian more or less than it did before."""
    poses = driven([(0.5, 0.0, 0.8), (0.4, 0.0, -0.2), (0.0, 0.0, 0.7), (-0.6, 0.0, 0.0), (0.4, 0.0, 0.5)])
    assert max(off(scan_odometry(seen(poses, period=2.0)), poses)) < 0.02


def test_a_match_is_looked_for_as_far_as_friction_lets_a_robot_come():
    assert reach(0.1) == pytest.approx(0.049, abs=1e-3)  # half of g times the square of the time
    assert reach(0.6) == reach(60.0) == FARTHEST_APART


def test_beams_of_a_sweep_are_put_right_by_the_motion_that_scans_tell():
    """The robot turns by 0.6 rad a second while its scanner takes 0.1 s for a turn."""
    lidar, poses = replace(LIDAR, sweep=0.1), driven([(0.03, 0.0, 0.06)] * 40)
    share = np.linspace(-0.5, 0.5, lidar.beams)
    ranges = []
    for pose in poses:
        each = compose(pose, np.outer(share, [0.03, 0.0, 0.06]))
        ranges.append(
            [
                ray_cast(ROOM, sensor_position(p, lidar), np.array([p[2] + angle]))[0]
                for p, angle in zip(each, lidar.angles, strict=True)
            ]
        )
    swept = seen(poses)
    swept = replace(swept, lidar=LidarScans(swept.lidar.t, np.array(ranges, np.float32)))
    stated = replace(swept, robot=RobotModel(lidar=lidar))
    assert off(scan_odometry(stated), poses)[0] < 0.5 * off(scan_odometry(swept), poses)[0]
    assert max(off(scan_odometry(stated), poses)) < 0.01


# ---- doubts ------------------------------------------------------------------------------------


def test_a_motion_that_ends_where_nobody_looks_any_farther_is_doubted():
    """A robot that stood is 0.18 m ahead a tenth of a second later: 36 m/s^2."""
    poses = driven([(0.0, 0.0, 0.0)] * 20 + [(0.18, 0.0, 0.0)] + [(0.0, 0.0, 0.0)] * 5)
    (doubt,) = doubts(seen(poses))
    assert (doubt["from"], doubt["to"]) == (pytest.approx(START + 2.1), None)
    assert re.search(r"moved \+0\.1[78] m and \+0 deg in 0\.10 s: without odometry", doubt["reason"])
    assert doubt["reason"].endswith("scan matching looks no farther")


def test_a_corridor_without_ends_is_doubted_from_where_nothing_shows_the_way():
    """Its walls are longer than the scanner sees: behind a pillar nothing tells whether the robot moves."""
    walls = np.vstack([box(-9.0, -1.03, 60.0, 1.02)[[0, 2]], box(2.0, 0.62, 2.5, 1.02)])
    poses = driven([(0.1, 0.0, 0.0)] * 80)
    lidar = replace(LIDAR, range_max=4.0)
    (doubt,) = doubts(seen(poses, walls, lidar=lidar))
    assert "no wall shows the way along for more than 2 s, and no odometry tells it" in doubt["reason"]
    assert 2.0 < doubt["from"] - START < 5.0


def test_with_odometry_nothing_of_this_is_doubted():
    assert unaided(BOX, pfslam.run_slam(BOX).infos) == []


# ---- what reads it -----------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["ros1", "mcap"])
def test_a_bag_without_odometry_is_read_as_one_whose_odometry_is_not_wanted(tmp_path, form):
    rows = rows_of(BOX, form.startswith("ros1"))
    bare = pfslam.load(write_bag(tmp_path / "bare", form, [row for row in rows if row[0] != "/odom"]))
    unwanted = pfslam.load(write_bag(tmp_path / "whole", form, rows), odometry=False)
    assert (bare.odometry, unwanted.odometry, bare.motion) == (None, None, "scans")
    np.testing.assert_array_equal(bare.lidar.ranges, BOX.lidar.ranges)
    np.testing.assert_array_equal(unwanted.lidar.ranges, BOX.lidar.ranges)
    assert bare.robot == unwanted.robot
    assert bare.notes == ("odometry: found none, looked for nav_msgs/Odometry, or odom -> base_link on /tf",)
    assert sum(unwanted.dropped.values()) == sum(row[0] == "/odom" for row in rows)


def test_a_bag_of_nothing_but_scans_tells_the_path_of_the_lidar(tmp_path):
    rows = [row for row in rows_of(BOX) if row[0] == "/scan"]
    found = pfslam.load(write_bag(tmp_path / "drive", "mcap", rows))
    assert found.robot.lidar.position_b[:2] == (0.0, 0.0)
    assert (
        "no fixed chain of frames from base_link to laser: the path is that of the LiDAR itself"
        in found.notes
    )
    x, y, _ = BOX.robot.lidar.position_b
    poses = compose(BOX.truth.poses, np.array([x, y, 0.0]))
    assert max(off(scan_odometry(found), poses)) < 2e-3


def test_a_frame_for_the_odometry_that_is_asked_for_must_be_there(tmp_path):
    rows = [row for row in rows_of(BOX) if row[0] != "/odom"]
    with pytest.raises(DataError, match="odometry: found none, expected chassis -> base_link on /tf"):
        pfslam.load(write_bag(tmp_path / "drive", "mcap", rows), bag=BagOptions(odom_frame="chassis"))


def test_a_log_of_laser_messages_alone_has_no_odometry(tmp_path):
    scan = "RAWLASER1 0 -1.0 2.0 1.0 81.9 0.01 0 3 1 2 3 0"
    (tmp_path / "drive.log").write_text(f"{scan} 1.0 robot 1.0\n{scan} 1.1 robot 1.1\n")
    found = pfslam.load(tmp_path / "drive.log")
    assert (found.odometry, found.motion, len(found.lidar.t)) == (None, "scans", 2)


def test_a_recording_of_scans_alone_goes_through_a_file(tmp_path):
    save(ALONE, tmp_path / "alone.npz")
    again = pfslam.load(tmp_path / "alone.npz")
    assert (again.odometry, again.encoders, again.motion) == (None, None, "scans")
    np.testing.assert_array_equal(again.lidar.ranges, ALONE.lidar.ranges)


def test_whoever_runs_a_filter_without_odometry_is_told_what_makes_one():
    for use in (pfslam.run_slam, pfslam.dead_reckoning):
        with pytest.raises(DataError, match="with_scan_odometry makes an odometry of scans"):
            use(ALONE)
    with pytest.raises(DataError, match="expected one of the two, or scans alone"):
        replace(ALONE, lidar=None)


# ---- the command line --------------------------------------------------------------------------


@pytest.fixture
def drive(tmp_path):
    save(BOX, tmp_path / "drive.npz")
    return str(tmp_path / "drive.npz")


def summary_in(folder):
    return json.loads((folder / "summary.json").read_text())


OPTIONS = {
    "refined": "--particles 5",
    "report": "--method report --particles 5",
    "per-particle": "--method per-particle --particles 3 --every 2",
    "matching": "--method matching --from 1 --until 5 --mask 120 135",
    "loops": "--particles 5 --loops --every 3",
}


@pytest.mark.parametrize("name", OPTIONS)
def test_a_run_without_odometry_is_right_and_is_repeated_to_the_bit(tmp_path, drive, name):
    line = ["run", drive, "--quiet", "--no-odometry"]
    assert main([*line, *OPTIONS[name].split(), "--out", str(tmp_path / "one")]) == 0
    first = summary_in(tmp_path / "one")
    assert (first["motion"], first["distrust"], "--no-odometry" in first["selection"]) == ("scans", [], True)
    assert first["slam"]["ate_max_m"] < (0.3 if name == "report" else 0.01)
    again = ["run", drive, "--quiet", "--config", str(tmp_path / "one" / "summary.json")]
    again += ["--loops"] * (name == "loops")
    assert main([*again, "--out", str(tmp_path / "two")]) == 0
    assert first["files"] == summary_in(tmp_path / "two")["files"]
    for file in {*first["files"]} - {"summary.json", "index.html"}:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()


def test_check_and_info_say_what_is_not_known(tmp_path, drive, capsys):
    assert main(["check", drive, "--no-odometry"]) == 0
    said = capsys.readouterr().out
    assert said.count("no odometry: scans alone tell how the robot moved, and nothing can check") == 1
    assert said.endswith("no check failed\n")
    assert main(["info", drive, "--no-odometry"]) == 0
    assert "motion: from scans\n" in capsys.readouterr().out


def test_the_checks_that_compare_with_odometry_are_not_asked():
    answers = {finding.question: finding.ok for finding in check_up(pfslam.with_scan_odometry(ALONE))}
    asked = {question for question, ok in answers.items() if ok is not None}
    assert asked == {
        "Do the streams overlap?",
        "How long is the longest gap?",
        "Are the scans all there?",
        "How many beams return?",
        "How far do ranges scatter?",
    }


def test_beams_that_see_the_robot_are_found_without_odometry():
    """The bumper seems to stand still; it is left out, and the path made anew without it."""
    angles, ranges = np.degrees(ALONE.robot.lidar.angles), ALONE.lidar.ranges.copy()
    ranges[:, angles > 95.0] = 0.3
    spoiled = replace(ALONE, lidar=LidarScans(ALONE.lidar.t, ranges))
    found, lines, _ = find_corrections(pfslam.with_scan_odometry(spoiled))
    assert list(found) == ["masks"]
    assert "see the robot itself" in lines[0]
    assert max(off(scan_odometry(select(spoiled, **found)), BOX.truth.poses)) < 2e-3


BAD_LINES = {
    "run DRIVE --no-odometry --odom /odom": "--no-odometry: found /odom as well, expected one of the two",
    "run DRIVE --no-odometry --odom-frame odom": "--no-odometry: found odom as well, expected one of the two",
    "run DRIVE --no-odometry --odometry-scale 1.1": "--odometry-scale: found 1.1, expected a drive with odometry",
    "run BLIND --no-odometry": "odometry: found neither encoders with IMU nor odometry poses",
}


@pytest.mark.parametrize("line", BAD_LINES)
def test_what_does_not_go_together_is_one_line(tmp_path, drive, line, capsys):
    save(replace(BOX, lidar=None), tmp_path / "blind.npz")
    words = line.replace("DRIVE", drive).replace("BLIND", str(tmp_path / "blind.npz")).split()
    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert BAD_LINES[line] in said
    assert not (tmp_path / "out").exists()
