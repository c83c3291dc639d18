"""What makes a simulated drive hard, each hazard against a slow and obvious way to compute it."""

import hashlib
from dataclasses import fields, replace

import cv2
import numpy as np
import pytest
from drives import BEAMS, simulated, slow_range
from rooms import distance_to_walls

from pfslam.errors import DataError
from pfslam.poses import compose, rotation_matrix
from pfslam.sensors import LidarModel, RobotModel
from pfslam.simulator import HALL, Hazards, simulate
from pfslam.simulator.clocks import START_OF_TIME
from pfslam.simulator.drive import episodes
from pfslam.simulator.lidar import true_ranges
from pfslam.simulator.world import WALL_KINDS

EVERYTHING = {"people": 5, "doors": 4, "glass": 0.1, "bumps": 6, "slip": 3}
DOOR = WALL_KINDS.index("door")


def drive(name="hall", seed=3, exact=True, **hazards):
    return simulated(name, seed, exact, **hazards)


def seconds(simulation):
    return simulation.recording.lidar.t - START_OF_TIME


# --- everything off, everything on ----------------------------------------------------------------


BUILT_IN = {  # sha256 of encoders, IMU, LiDAR and truth
    "hall": ("32d2cc71f5f3", "feb651d74260", "ebf8c4b8af90", "6a7eb33cfcb1"),
    "ramp": ("e0fc3a0f5a5e", "a03cecc2ab8f", "88230df042d4", "7483227d14c3"),
}


@pytest.mark.parametrize("name", BUILT_IN)
def test_without_hazards_the_built_in_drives_are_what_they_were(name):
    assert {getattr(Hazards(), field.name) for field in fields(Hazards)} == {0}
    recording = simulate(name, hazards=Hazards()).recording
    for stream, expected in zip(("encoders", "imu", "lidar", "truth"), BUILT_IN[name], strict=True):
        content = b"".join(values.tobytes() for values in vars(getattr(recording, stream)).values())
        assert hashlib.sha256(content).hexdigest().startswith(expected), stream


def parts(simulation):
    """What each hazard alone changes."""
    world, recording = simulation.world, simulation.recording
    return {
        "people": tuple(person.centres for person in world.people),
        "doors": (world.walls[world.wall_kind == DOOR], world.closed[world.wall_kind == DOOR]),
        "glass": (world.glass,),
        "bumps": (simulation.pitch, recording.imu.angular_velocity),
        "slip": (recording.encoders.counts,),
        "ranges": (recording.lidar.ranges,),
        "path": (recording.truth.poses,),
    }


NIGHTLY = {"doors", "glass", "slip"}


@pytest.mark.parametrize(
    "hazard", [pytest.param(h, marks=[pytest.mark.nightly] * (h in NIGHTLY)) for h in EVERYTHING]
)
def test_one_hazard_leaves_the_numbers_of_the_others_alone(hazard):
    everything = drive(exact=False, **EVERYTHING)
    without = drive(exact=False, **{k: v for k, v in EVERYTHING.items() if k != hazard})
    # Who climbs a bump drives a little farther, so that a count falls into the next reading; slip leaves scans alone.
    touched = {hazard} | {"bumps": {"ranges", "slip"}, "slip": set()}.get(hazard, {"ranges"})
    for name, there in parts(everything).items():
        gone = parts(without)[name]
        same = len(there) == len(gone) and all(map(np.array_equal, there, gone))
        assert same == (name not in touched), name


def test_the_same_seed_gives_the_same_hazards():
    first, again = (parts(s(exact=False, **EVERYTHING)) for s in (simulated, simulated.__wrapped__))
    assert all(all(map(np.array_equal, first[name], again[name])) for name in first)


# --- people ---------------------------------------------------------------------------------------


MANY = [("hall", 3), *(pytest.param("hall", k, marks=pytest.mark.nightly) for k in (1, 2, 4))]
MANY += [pytest.param("ring", 1, marks=pytest.mark.nightly)]


@pytest.mark.parametrize(("name", "seed"), MANY)
def test_people_meet_the_robot_and_never_touch_it(name, seed):
    simulation = drive(name, seed, people=6)
    world, t = simulation.world, simulation.drive.t[::10]
    robot = compose(world.pose_pw, simulation.drive.at(t)[0])[:, :2]
    circle = 0.184 * np.column_stack([np.cos(np.arange(64)), np.sin(np.arange(64))])
    for person in world.people:
        away = np.hypot(*(person.at(t) - robot).T)
        assert 0.54 < np.nanmin(away) < 3.0
        assert world.is_floor(
            (person.at(t[::20])[:, None] + circle)[np.isfinite(away[::20])].reshape(-1, 2)
        ).all()
        assert (np.hypot(*np.diff(person.centres, axis=0).T) < 0.25).all()  # no jumps: at most 2.5 m/s
    ahead = np.hypot(*(world.people[0].at(t) - robot).T)
    assert (ahead < 2.0).sum() * 0.02 > 14.0  # s during which the first walks just ahead


def test_people_come_and_go_where_the_robot_does_not_see_them():
    simulation = drive(people=6)
    world, lidar, cut = simulation.world, simulation.recording.robot.lidar, 0
    for person in world.people:
        without = replace(world, people=tuple(other for other in world.people if other is not person))
        for t in (person.t[0], person.t[-1]):
            if 0.0 < t < simulation.drive.duration:
                one, other = (
                    true_ranges(w, simulation.drive, lidar, np.array([t])) for w in (world, without)
                )
                np.testing.assert_array_equal(one, other)
                cut += 1
    assert cut > 3


def test_a_beam_at_a_person_ends_on_the_disc():
    simulation, empty = drive(people=6), drive()
    ranges, t = simulation.recording.lidar.ranges, seconds(simulation)
    shorter = ranges < empty.recording.lidar.ranges - 1e-3
    assert shorter.any(axis=1).mean() > 0.2
    assert not (ranges > empty.recording.lidar.ranges + 1e-6).any()
    rng = np.random.default_rng(0)
    for k, beam in rng.permutation(np.argwhere(shorter))[:60]:
        angle = simulation.recording.robot.lidar.angles[beam]
        assert ranges[k, beam] == pytest.approx(slow_range(simulation, t[k], angle), abs=1e-5)


# --- doors ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "seed"), MANY)
def test_a_door_never_changes_in_view(name, seed):
    simulation = drive(name, seed, doors=4)
    world, lidar = simulation.world, simulation.recording.robot.lidar
    doors = np.flatnonzero(world.wall_kind == DOOR)
    changes = [(d, t) for d in doors for t in world.closed[d] if np.isfinite(t)]
    assert len({tuple(world.walls[d].ravel()) for d in doors}) == 4
    for door, change in changes:
        t = change + np.linspace(-0.4, 0.4, 33)
        closed = world.closed.copy()
        closed[door] = [-np.inf, np.inf]
        shut = true_ranges(replace(world, closed=closed), simulation.drive, lidar, t)
        closed[door] = [np.inf, np.inf]
        np.testing.assert_array_equal(
            shut, true_ranges(replace(world, closed=closed), simulation.drive, lidar, t)
        )


def test_a_door_is_closed_for_all_beams_between_its_changes():
    simulation, empty = drive(doors=4), drive()
    world, t = simulation.world, seconds(simulation)
    ranges, without = simulation.recording.lidar.ranges, empty.recording.lidar.ranges
    shut = (world.closed[:, :1] <= t) & (t <= world.closed[:, 1:]) & (world.wall_kind == DOOR)[:, None]
    np.testing.assert_array_equal(ranges[~shut.any(axis=0)], without[~shut.any(axis=0)])
    changed = np.abs(ranges - without) > 1e-3
    assert changed.any()
    rng = np.random.default_rng(0)
    for k, beam in rng.permutation(np.argwhere(changed))[:40]:
        angle = simulation.recording.robot.lidar.angles[beam]
        assert ranges[k, beam] == pytest.approx(slow_range(simulation, t[k], angle), abs=1e-5)


# --- glass ----------------------------------------------------------------------------------------


def test_a_share_of_the_walls_is_glass():
    world = drive(glass=0.2).world
    length = np.hypot(*(world.glass[:, 1] - world.glass[:, 0]).T)
    walls = world.walls[world.wall_kind == WALL_KINDS.index("wall")]
    assert length.sum() / np.hypot(*(walls[:, 1] - walls[:, 0]).T).sum() == pytest.approx(0.2, abs=0.02)
    assert distance_to_walls(world.glass.reshape(-1, 2), walls).max() < 1e-9
    assert length.max() <= 1.5 + 1e-9


@pytest.mark.parametrize("more", [{}, {"bumps": 6, "people": 4}])
def test_half_of_the_beams_at_glass_return_nothing_and_half_the_largest_range(more):
    simulation, plain = drive(glass=0.1, **more), drive(**more)
    lidar, world = simulation.recording.robot.lidar, simulation.world
    found, exact = simulation.recording.lidar.ranges, plain.recording.lidar.ranges
    largest, nothing = found == lidar.range_max, ~lidar.valid(found)
    assert largest.sum() / (largest | nothing).sum() == pytest.approx(0.5, abs=0.01)
    glass = largest | nothing
    np.testing.assert_array_equal(found[~glass], exact[~glass])
    some = slice(0, None, 97)
    _, z, pitch, roll = simulation.drive.at(seconds(simulation)[some])
    poses_p = compose(world.pose_pw, simulation.recording.truth.poses[some])
    for k, (x, y, yaw) in enumerate(poses_p):
        R = rotation_matrix(roll[k], pitch[k], yaw)
        beams = np.stack([np.cos(lidar.angles), np.sin(lidar.angles), np.zeros(lidar.beams)])
        points = np.array([x, y, z[k]])[:, None] + R @ (
            np.array(lidar.position_b)[:, None] + exact[some][k] * beams
        )
        off = distance_to_walls(points[:2].T, world.glass)
        assert (off[glass[some][k]] < 1e-4).all()
        assert (off[~glass[some][k]] > 1e-9).mean() > 0.999  # but for feet of walls and people who touch them


# --- the sweep ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("sweep", "beams"), [(0.025, 1081), (1 / 6, 360), (1.0, 61)])
def test_every_beam_of_a_sweep_is_cast_from_its_own_place(sweep, beams):
    simulation = drive(people=5, doors=4, bumps=6)
    lidar = replace(simulation.recording.robot.lidar, sweep=sweep, beams=beams)
    rng = np.random.default_rng(0)
    turning = np.abs(np.gradient(np.unwrap(simulation.drive.poses[:, 2]), simulation.drive.t)) > 0.5
    t = np.concatenate([rng.choice(simulation.drive.t[turning], 20), rng.uniform(10.0, 110.0, 20)])
    ranges = true_ranges(simulation.world, simulation.drive, lidar, t)
    at_once = true_ranges(simulation.world, simulation.drive, replace(lidar, sweep=0.0), t)
    for k, beam in zip(np.repeat(np.arange(40), 2), rng.integers(0, beams, 80), strict=True):
        own_time = t[k] + sweep * (beam / (beams - 1) - 0.5)
        slow = slow_range(simulation, own_time, lidar.angles[beam])
        assert ranges[k, beam] == pytest.approx(slow, abs=2e-3), (k, beam)
    assert (
        np.median(np.abs(ranges - at_once)[:20, [0, -1]]) > 0.1 * sweep
    )  # m; the test above has something to find
    if beams % 2:
        np.testing.assert_allclose(ranges[:, beams // 2], at_once[:, beams // 2], atol=1e-9)


def test_a_sweep_is_stated_in_the_recording():
    corridor = replace(HALL, layout="corridor", robot=RobotModel(lidar=LidarModel(beams=21, sweep=0.01)))
    assert simulate(corridor, 3, hazards=Hazards(sweep=0.02)).recording.robot.lidar.sweep == 0.02
    assert simulate(corridor, 3).recording.robot.lidar.sweep == 0.01


# --- bumps and slip -------------------------------------------------------------------------------


def test_bumps_tilt_the_robot_for_seconds():
    simulation, flat = drive(bumps=6), drive()
    np.testing.assert_array_equal(simulation.recording.truth.poses, flat.recording.truth.poses)
    tilt = np.rad2deg(np.abs(simulation.drive.pitch) + np.abs(simulation.drive.roll))
    edges = np.flatnonzero(np.diff((tilt > 0).astype(int)))
    assert len(edges) == 12
    for begin, end in edges.reshape(-1, 2):
        assert 1.5 <= tilt[begin:end].max() <= 3.0
        assert 0.98 < simulation.drive.t[end] - simulation.drive.t[begin] < 4.02
    lifted = simulation.drive.z > 0
    np.testing.assert_array_equal(lifted, tilt > 0)
    assert simulation.drive.z.max() < 0.01


def test_lidar_gyro_and_accelerometer_notice_a_bump():
    simulation = drive(bumps=6)
    t, ranges = seconds(simulation), simulation.recording.lidar.ranges
    rng = np.random.default_rng(0)
    tilted = np.flatnonzero(np.abs(simulation.pitch) + np.abs(simulation.roll) > np.deg2rad(1.5))
    for k, beam in zip(rng.choice(tilted, 60), rng.integers(0, BEAMS, 60), strict=True):
        slow = slow_range(simulation, t[k], simulation.recording.robot.lidar.angles[beam])
        assert ranges[k, beam] == pytest.approx(slow, abs=2e-3)
    imu = simulation.recording.imu
    poses, _, pitch, roll = simulation.drive.at(imu.t - START_OF_TIME)
    R = rotation_matrix(roll[0], pitch[0], poses[0, 2])
    for k, dt in enumerate(np.diff(imu.t), start=1):
        R = R @ cv2.Rodrigues(imu.angular_velocity[k] * dt)[0]
        if abs(pitch[k]) + abs(roll[k]) > np.deg2rad(1.5) and k % 50 == 0:
            up = rotation_matrix(roll[k], pitch[k], poses[k, 2])[2]
            assert np.arccos(np.clip(R[2] @ up, -1.0, 1.0)) < np.deg2rad(0.3)
    still = np.abs(np.gradient(simulation.drive.travelled)) < 1e-9
    assert not (still & (simulation.drive.z > 0)).any()  # bumps are met while driving


def test_slip_changes_the_counts_and_not_the_truth():
    slipping, plain = drive(slip=4), drive()
    np.testing.assert_array_equal(slipping.recording.truth.poses, plain.recording.truth.poses)
    np.testing.assert_array_equal(
        slipping.recording.imu.angular_velocity, plain.recording.imu.angular_velocity
    )
    counts, true = slipping.recording.encoders.counts, plain.recording.encoders.counts
    wrong = np.flatnonzero((np.abs(counts - true) > 1e-9).any(axis=1))
    moments = np.split(wrong, np.flatnonzero(np.diff(wrong) > 4) + 1)
    assert len(moments) == 4
    for rows in moments:
        inside = rows[2:-2]
        assert 0.2 < len(rows) * 0.025 < 0.9
        locked, spun = (
            np.abs(counts[inside]).max() < 1e-9,
            np.allclose(counts[inside], 2 * true[inside], atol=1e-9),
        )
        assert locked != spun


def test_episodes_do_not_overlap():
    for count in (1, 3, 50):
        found = episodes(count, (1.0, 4.0), 120.0, HALL.timing, np.random.default_rng(0))
        assert found.shape == (count, 2)
        assert (np.diff(found.ravel()) > 0).all()
        assert found[0, 0] >= HALL.timing.still_start
        assert found[-1, 1] <= 120.0 - HALL.timing.still_end


# --- the ring -------------------------------------------------------------------------------------


def test_the_ring_has_its_measures_and_closes():
    simulation = drive("ring", 1)
    truth, world = simulation.recording.truth.poses, simulation.world
    corners = world.plan.areas[[kind == "corridor" for kind in world.plan.kinds]]
    np.testing.assert_allclose(np.ptp(corners.reshape(-1, 2), axis=0), [60.0, 40.0])
    np.testing.assert_allclose(np.min(corners[:, 2:] - corners[:, :2], axis=1), 2.0)
    assert np.hypot(*truth[-1, :2]) < 0.5  # the weaving path ends where it began, but for a hand's breadth
    assert abs(truth[-1, 2]) < 0.1
    assert np.unwrap(truth[:, 2])[-1] == pytest.approx(2 * np.pi, abs=0.1)
    assert distance_to_walls(truth[::20, :2], world.walls_w).min() > 0.35
    alcoves = world.plan.areas[[kind == "alcove" for kind in world.plan.kinds]]
    depth = np.min(alcoves[:, 2:] - alcoves[:, :2], axis=1)
    assert 0.11 < depth.min() < depth.max() < 0.21
    assert (alcoves[:, 0] > -1.0 - 1e-9).all()  # the fourth corridor, at the left, is bare


def test_the_rings_scanner_wheels_and_gyro_are_off_as_its_settings_say():
    simulation = drive("ring", 1, exact=False)
    recording = simulation.recording
    assert recording.robot.lidar.range_max == 20.0
    wheels = recording.encoders.counts.mean(axis=1).sum() * recording.robot.encoders.metres_per_count
    assert wheels / simulation.drive.travelled[-1] == pytest.approx(1.02, abs=0.003)
    rest = recording.imu.t < recording.imu.t[0] + 9.0
    late = rest & (recording.imu.t > recording.imu.t[0] + 2.0)
    assert recording.imu.angular_velocity[late, 2].mean() == pytest.approx(np.deg2rad(0.1), abs=0.0014)
    assert simulation.config.number == 95


# --- what cannot be ------------------------------------------------------------------------------


def test_bad_hazards_are_named():
    for name, value in (
        ("people", -1),
        ("people", 1.5),
        ("glass", 1.1),
        ("sweep", 2.0),
        ("slip", None),
        ("bumps", True),
    ):
        with pytest.raises(DataError, match=f"Hazards: {name}: found {value!r}, expected"):
            Hazards(**{name: value})
    with pytest.raises(DataError, match="doors: found 99, expected at most 16: the alcoves that go out"):
        simulate(HALL, 3, hazards=Hazards(doors=99))
    with pytest.raises(DataError, match="doors: found 1, expected at most 0"):
        simulate(replace(HALL, layout="corridor"), 3, hazards=Hazards(doors=1))
