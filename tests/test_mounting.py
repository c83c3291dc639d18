"""The fit of odometry and mounting, against robots whose every fault is known because it was made.

The robots drive along smooth paths through a room of straight walls. Their scans are cast here, wall by wall, and their
odometry is the true path, made wrong by known numbers.
"""

from dataclasses import replace

import numpy as np
import pytest

from pfslam.evaluation.mounting import Estimate, fit_mounting
from pfslam.poses import Trajectory, between, compose
from pfslam.recording import LidarScans, Recording
from pfslam.sensors import LidarModel, RobotModel

CORNERS = 9.0 * np.exp(1j * np.array([0.1, 0.9, 1.5, 2.6, 3.3, 4.4, 5.2]))
PILLARS = [(2 - 3j, 3 - 2.5j), (-4 + 1j, -3 + 3j), (1 + 5j, 2.5 + 4.5j), (-3 - 5j, -1 - 6j)]
WALLS = [*zip(CORNERS, np.roll(CORNERS, -1), strict=True), *PILLARS]
TRUE = {"turns": 1.06, "drift": 0.01, "late": 0.045, "ways": 1.04, "yaw": 0.2, "ahead": 0.08, "left": -0.05}
PLACE, VIEW = (0.2, -0.1), 1.5 * np.pi


def cast(poses, angles):
    """The distances from poses (x, y, heading) to the nearest wall along each angle: two lines meet, one by one."""
    ranges = np.full((len(poses), len(angles)), np.inf)
    origin, ray = (poses[:, 0] + 1j * poses[:, 1])[:, None], np.exp(1j * (poses[:, 2, None] + angles))
    for begin, end in WALLS:
        wall, gap = end - begin, begin - origin
        cross = (ray.conj() * wall).imag
        along, part = (gap.conj() * wall).imag / cross, (gap.conj() * ray).imag / cross
        ranges = np.where((along > 0) & (part > 0) & (part < 1) & (along < ranges), along, ranges)
    return ranges


def robot(seed, noise=0.01, seconds=60.0, sweep=0.0, **wrong):
    """A minute's drive on a loop of changing curvature, with the faults ``TRUE``, or others."""
    true, rng = TRUE | wrong, np.random.default_rng(seed)
    t, dt = np.arange(0.0, seconds, 0.02), 0.02
    phases = rng.uniform(0.0, 2 * np.pi, 3)
    rate = 0.25 + sum(
        a * np.sin(w * t + p) for a, w, p in zip((0.3, 0.25, 0.2), (0.5, 1.1, 1.9), phases, strict=True)
    )
    speed = 0.4 + 0.15 * np.sin(0.7 * t + phases[0])
    steps = np.column_stack([speed, np.zeros_like(t), rate]) * dt

    def path(steps):
        """Each step goes straight on, in the direction of the middle of its turn."""
        length, turn = steps[1:, 0], steps[1:, 2]
        heading = np.concatenate([[0.0], np.cumsum(turn)])
        middle = heading[:-1] + 0.5 * turn
        way = np.cumsum(length * np.exp(1j * middle))
        return np.column_stack([np.append(0.0, way.real), np.append(0.0, way.imag), heading])

    truth = Trajectory(t, path(steps))
    slip = 1.0 + 0.02 * rng.standard_normal((len(t), 2))
    shown = steps / [true["ways"], 1.0, true["turns"]]
    shown[:, 2] -= true["drift"] * dt / true["turns"]
    odometry = Trajectory(t, path(shown * np.column_stack([slip[:, 0], slip[:, 0], slip[:, 1]])))
    stamps, angles = np.arange(2.0, seconds - 2.0, 0.1), np.linspace(-0.5 * VIEW, 0.5 * VIEW, 180)
    sits = [PLACE[0] + true["ahead"], PLACE[1] + true["left"], true["yaw"]]
    ranges = cast(compose(truth.at(stamps), sits), angles)
    if sweep:  # each beam from where the LiDAR is at its own time
        times = np.linspace(-0.5 * sweep, 0.5 * sweep, len(angles))
        beams = zip(angles, times, strict=True)
        ranges = np.hstack([cast(compose(truth.at(stamps + late), sits), [angle]) for angle, late in beams])
    ranges += noise * rng.standard_normal((len(stamps), len(angles)))
    lidar = LidarModel(-0.5 * VIEW, 0.5 * VIEW, 180, 0.05, 30.0, (*PLACE, 0.3), sweep)
    scans = LidarScans(stamps + true["late"], ranges.astype(np.float32))
    return Recording("made", replace(RobotModel(), lidar=lidar), lidar=scans, odometry=odometry)


def values(found):
    return np.array([getattr(found, name) for name in TRUE])


def test_each_number_is_found_within_its_error_and_the_errors_are_honest():
    """Over twelve drives the numbers are off by about one standard error, root mean square."""
    away = []
    for seed in range(12):
        number, error = values(fit_mounting(robot(seed))).T
        np.testing.assert_array_less(error, [0.003, 0.002, 0.002, 0.004, 0.004, 0.006, 0.006])
        away.append((number - list(TRUE.values())) / error)
    typical = np.sqrt(np.mean(np.square(away), axis=0))
    assert (typical > 0.4).all(), typical
    assert (typical < 1.8).all(), typical


@pytest.mark.parametrize("seed", [0, 1])
def test_beams_that_come_one_after_the_other_bias_nothing(seed):
    """As long as it is known how long a sweep takes."""
    made = robot(seed, sweep=0.2)
    number, error = values(fit_mounting(made)).T
    assert (np.abs(number - list(TRUE.values())) < np.maximum(5.0 * error, 0.003)).all(), (number, error)
    lidar = replace(made.robot.lidar, sweep=0.0)
    at_once = values(fit_mounting(replace(made, robot=replace(made.robot, lidar=lidar))))
    assert (at_once[:3, 1] > 3.0 * error[:3]).all()


def test_a_sweep_is_taken_from_when_the_scans_were_made():
    """Motion from the time of the stamps, 0.3 s later, would make scans seem 2 ms too early, the mean of four."""
    made = (robot(seed, sweep=0.2, late=0.3) for seed in range(4))
    late = np.mean([fit_mounting(recording).late.value for recording in made])
    assert late == pytest.approx(0.3, abs=0.0015)


GROSS = {
    "backwards": {"yaw": np.pi - 0.1},
    "sideways": {"yaw": -0.5 * np.pi},
    "in millimetres": {"ways": 0.001},
    "half as far": {"ways": 2.0},
    "turns the other way": {"turns": -1.0},
    "late": {"late": 0.8},
    "early": {"late": -0.6},
    "far ahead": {"ahead": 0.7, "left": 0.5},
    "backwards, late and too far": {"yaw": -3.0, "late": 0.4, "ways": 0.5, "ahead": -0.4},
}


@pytest.mark.parametrize("name", GROSS)
def test_gross_faults_are_far_from_right_and_found_all_the_same(name):
    number, error = values(fit_mounting(robot(3, **GROSS[name]))).T
    off = np.abs(number - list((TRUE | GROSS[name]).values()))
    assert (off < np.maximum(5.0 * error, 0.005)).all(), (number, error)
    assert (error < 0.01).all()


def test_what_a_drive_does_not_show_has_a_large_error():
    """On a straight line nothing turns: neither the turns' scale nor the place shows, but the way does."""
    made = robot(0, seconds=40.0)
    straight = np.column_stack([0.1 * made.odometry.t, np.zeros((len(made.odometry), 2))])
    angles = np.linspace(-0.5 * VIEW, 0.5 * VIEW, 180)
    poses = compose(Trajectory(made.odometry.t, straight).at(made.lidar.t), [*PLACE, 0.0])
    scans = LidarScans(made.lidar.t, cast(poses, angles).astype(np.float32))
    found = fit_mounting(replace(made, odometry=Trajectory(made.odometry.t, straight), lidar=scans))
    assert (
        found.turns.within(1.0, 0.2) is found.late.within(0.0, 0.02) is found.ahead.within(0.0, 0.15) is None
    )
    assert found.ways.within(1.0, 0.03) is found.yaw.within(0.0, 0.1) is True


def test_a_robot_that_turns_at_one_rate_may_as_well_drift_at_that_rate():
    """Even where its odometry has lost a step, which turning less and drifting more would explain."""
    made = robot(0, noise=0.0)
    t = made.odometry.t
    circle = np.column_stack([np.sin(0.4 * t), 1.0 - np.cos(0.4 * t), 0.4 * t])
    poses = compose(Trajectory(t, circle).at(made.lidar.t), [*PLACE, 0.0])
    angles = np.linspace(-0.5 * VIEW, 0.5 * VIEW, 180)
    lost = compose(circle[0], circle)
    half = len(t) // 2
    lost[half:] = compose(circle[half - 1], between(circle[half], circle[half:]))
    for odometry in (circle, lost):
        scans = LidarScans(made.lidar.t, cast(poses, angles).astype(np.float32))
        found = fit_mounting(replace(made, odometry=Trajectory(t, odometry), lidar=scans))
        assert found.turns.within(1.0, 0.2) is found.ways.within(1.0, 0.03) is None


def test_a_number_is_wrong_beyond_the_tolerance_and_beyond_three_errors():
    assert Estimate(1.1, 0.01).within(1.0, 0.2) is True
    assert Estimate(1.3, 0.01).within(1.0, 0.2) is False
    assert Estimate(1.3, 0.15).within(1.0, 0.2) is True
    assert Estimate(1.3, 0.25).within(1.0, 0.2) is Estimate(1.0, np.nan).within(1.0, 0.2) is None
