"""Features that meet: a recording that is cut, masked, thinned, saved or repeated runs like the whole one.

Each feature has tests of its own. Faults have come from two of them that met for the first time.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rooms import SQUARE, drive

import pfslam
from pfslam.io.jumps import without_jumps
from pfslam.io.selection import select
from pfslam.poses import Trajectory, between
from pfslam.recording import LidarScans
from pfslam.study.disturbances import first_seconds

FEW = settings(max_examples=6)
METHODS = {
    "report": replace(pfslam.SlamConfig.report(), particles=20),
    "refined": replace(pfslam.SlamConfig.refined(), particles=20),
    "robust": replace(pfslam.SlamConfig.refined().robust(), particles=20),
    "matching": pfslam.SlamConfig.matching(),
    "per-particle": replace(pfslam.SlamConfig.per_particle(), particles=3),
}
METHOD = pytest.mark.parametrize("method", METHODS)


@cache
def circuit(odometry=False):
    """A drive of nine seconds; with ``odometry`` it has poses in the place of wheels and gyro."""
    whole = drive(SQUARE)
    if not odometry:
        return whole
    path = pfslam.dead_reckoning(whole)
    return replace(whole, encoders=None, imu=None, odometry=path, truth=None)


def run(recording, method, **changes):
    config = replace(METHODS[method], **{"every": 1} | changes)
    return pfslam.run_slam(recording, config, second_look=False)


def assert_same_run(found, expected):
    """All that a run gives is the same, to the last bit."""
    np.testing.assert_array_equal(found.trajectory.poses, expected.trajectory.poses)
    np.testing.assert_array_equal(found.grid.log_odds, expected.grid.log_odds)
    assert found.grid.spec == expected.grid.spec
    for a, b in zip(found.infos, expected.infos, strict=True):
        for name, value in vars(b).items():
            if name not in ("t", "particles"):
                np.testing.assert_array_equal(getattr(a, name), value, err_msg=name)


@METHOD
def test_to_use_every_nth_scan_is_to_have_recorded_no_other(method):
    whole, every = circuit(), 4
    few = LidarScans(whole.lidar.t[::every], whole.lidar.ranges[::every])
    assert_same_run(run(replace(whole, lidar=few), method), run(whole, method, every=every))


@METHOD
def test_a_masked_edge_is_a_scanner_that_ends_there(method):
    whole, lost = circuit(), 61
    lidar = whole.robot.lidar
    ends = np.degrees(lidar.angles[[lost - 1, 0]])
    masked = select(whole, masks=[(ends[1], ends[0])])
    assert np.isnan(masked.lidar.ranges[:, :lost]).all()
    assert not np.isnan(masked.lidar.ranges[:, lost:]).any()
    narrow = replace(lidar, angle_min=float(lidar.angles[lost]), beams=lidar.beams - lost)
    np.testing.assert_allclose(narrow.angles, lidar.angles[lost:], atol=1e-12)
    scans = LidarScans(whole.lidar.t, whole.lidar.ranges[:, lost:])
    other = run(replace(whole, robot=replace(whole.robot, lidar=narrow), lidar=scans), method)
    # The angles of a narrower scanner may differ in their last bit, and a filter makes more of it.
    apart = between(run(masked, method).trajectory.poses, other.trajectory.poses)
    assert np.abs(apart).max() < (0.25 if method == "report" else 0.01)
    assert {"ranges of the 61 beams under --mask": 61 * len(whole.lidar.t)}.items() <= masked.dropped.items()


@FEW
@given(start=st.integers(0, 50), scans=st.integers(12, 40), odometry=st.booleans())
def test_what_a_cut_recording_gives_to_a_filter_is_what_the_whole_one_does(start, scans, odometry):
    whole = circuit(odometry)
    config = replace(METHODS["refined"], every=1)
    events = list(config.used_scans(whole).events())
    t = [event.t - whole.lidar.t[0] for event in events]
    last = min(start + scans, len(t) - 1)
    cut = select(whole, start=t[start], until=t[last])
    found, expected = list(config.used_scans(cut).events()), events[start : last + 1]
    assert len(found) == len(expected)
    for k, (a, b) in enumerate(zip(found, expected, strict=True)):
        np.testing.assert_array_equal(a.points_b, b.points_b)
        np.testing.assert_array_equal(a.beams, b.beams)
        if k:  # the motion to the first scan is that of the drive before
            np.testing.assert_allclose(a.motion, b.motion, atol=1e-9)
            for of_cut, of_whole in zip(a.controls, b.controls, strict=True):
                np.testing.assert_allclose(of_cut, of_whole, atol=1e-9)


@METHOD
def test_what_is_recorded_after_the_last_scan_changes_nothing(method):
    """Encoders, gyro or odometry that go on longer, or begin earlier where no count falls, say nothing of the scans."""
    whole = circuit()
    shorter = LidarScans(whole.lidar.t[:30], whole.lidar.ranges[:30])
    longer = replace(whole, lidar=shorter)
    until_then = first_seconds(longer, shorter.t[-1] + 0.05)  # two counts and four readings of the gyro more
    assert_same_run(run(until_then, method), run(longer, method))


@pytest.mark.parametrize("method", ["refined", "robust", "matching", "per-particle"])
def test_where_the_frame_of_an_odometry_lies_is_nothing_to_the_run(method):
    whole = circuit(odometry=True)
    moved = pfslam.poses.compose(np.array([10_000.0, -10_000.0, np.pi]), whole.odometry.poses)
    elsewhere = replace(whole, odometry=Trajectory(whole.odometry.t, moved))
    found, expected = (run(r, method, every=4).trajectory.poses for r in (elsewhere, whole))
    assert np.abs(between(found, expected)).max() < 1e-6


@pytest.mark.parametrize(("speed", "rate"), [(2.5, 5.0), (4.0, 10.0), (1.0, 50.0)])
def test_a_jump_that_was_left_out_when_a_recording_was_loaded_costs_no_other_step(speed, rate):
    """The step that was left out is zero; the robot is fast again at the next, which is no jump."""
    t = np.arange(40) / rate
    poses = np.column_stack([speed * t, np.zeros((40, 2))])
    poses[20:, 0] += 7.0
    raw = replace(circuit(odometry=True), odometry=Trajectory(t, poses))
    scans = raw.lidar.t <= t[-1]
    raw = replace(raw, lidar=LidarScans(raw.lidar.t[scans], raw.lidar.ranges[scans]))
    once, config = without_jumps(raw), METHODS["refined"]
    twice = without_jumps(once)
    found = [config.used_scans(recording).odometry.poses[-1, 0] for recording in (raw, once, twice)]
    assert found == pytest.approx([38 * speed / rate] * 3)
    assert once.dropped == twice.dropped == {"jumps of the odometry": 1}
