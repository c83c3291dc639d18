"""What makes a simulated drive hard, each hazard against a slow and obvious way to compute it."""

import hashlib
from dataclasses import fields, replace

import numpy as np
import pytest
from drives import BEAMS, simulated, slow_range
from rooms import distance_to_walls

from pfslam.poses import compose, transform_points
from pfslam.refined.events import tilted_points
from pfslam.sensors import LidarModel, RobotModel
from pfslam.simulator import HALL, Hazards, simulate
from pfslam.simulator.clocks import START_OF_TIME
from pfslam.simulator.lidar import true_ranges
from pfslam.simulator.world import WALL_KINDS

EVERYTHING = {"people": 5, "doors": 4, "glass": 0.1, "bumps": 6, "slip": 3}
MORE = {"bumps": 6, "people": 4}
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


@pytest.mark.slow
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


@pytest.mark.slow
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


# --- people ---------------------------------------------------------------------------------------


MANY = [("hall", 3), *(pytest.param("hall", k, marks=pytest.mark.nightly) for k in (1, 2, 4))]
MANY += [pytest.param("ring", 1, marks=pytest.mark.nightly)]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), MANY)
def test_people_meet_the_robot_and_never_touch_it(name, seed):
    simulation = drive(name, seed, people=6)
    world, t, lidar = simulation.world, simulation.drive.t[::10], simulation.recording.robot.lidar
    robot = compose(world.pose_pw, simulation.drive.at(t)[0])[:, :2]
    circle = 0.184 * np.column_stack([np.cos(np.arange(64)), np.sin(np.arange(64))])
    for person in world.people:
        away = np.hypot(*(person.at(t) - robot).T)
        assert 0.54 < np.nanmin(away) < 3.0
        assert world.is_floor(
            (person.at(t[::20])[:, None] + circle)[np.isfinite(away[::20])].reshape(-1, 2)
        ).all()
        assert (
            np.hypot(*np.diff(person.centres, axis=0).T) < 0.4
        ).all()  # no jumps; who passes outside a bend hurries
    # They come and go where the robot does not see them: with or without them it reads the same.
    for person in world.people:
        without = replace(world, people=tuple(other for other in world.people if other is not person))
        ends = np.clip([person.t[0], person.t[-1]], 0.0, simulation.drive.duration)
        ends = ends[(ends > 0.0) & (ends < simulation.drive.duration)]
        one, other = (true_ranges(w, simulation.drive, lidar, ends) for w in (world, without))
        np.testing.assert_array_equal(*(np.minimum(r, lidar.range_max - person.radius) for r in (one, other)))
    ahead = np.hypot(*(world.people[0].at(t) - robot).T)
    assert (ahead < 2.0).sum() * 0.02 > 14.0  # s during which the first walks just ahead


# --- doors ----------------------------------------------------------------------------------------


@pytest.mark.slow
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


# --- glass ----------------------------------------------------------------------------------------


def test_a_share_of_the_walls_is_glass():
    world = drive(glass=0.2, **MORE).world
    length = np.hypot(*(world.glass[:, 1] - world.glass[:, 0]).T)
    walls = world.walls[world.wall_kind == WALL_KINDS.index("wall")]
    assert length.sum() / np.hypot(*(walls[:, 1] - walls[:, 0]).T).sum() == pytest.approx(0.2, abs=0.02)
    assert distance_to_walls(world.glass.reshape(-1, 2), walls).max() < 1e-9
    assert length.max() <= 1.5 + 1e-9


@pytest.mark.slow
def test_half_of_the_beams_at_glass_return_nothing_and_half_the_largest_range():
    simulation, plain = drive(glass=0.2, **MORE), drive(**MORE)
    lidar, world = simulation.recording.robot.lidar, simulation.world
    found, exact = simulation.recording.lidar.ranges, plain.recording.lidar.ranges
    largest, nothing = found == lidar.range_max, ~lidar.valid(found)
    assert largest.sum() / (largest | nothing).sum() == pytest.approx(0.5, abs=0.01)
    glass = largest | nothing
    np.testing.assert_array_equal(found[~glass], exact[~glass])
    some = slice(0, None, 97)
    truth = simulation.recording.truth.poses[some], simulation.pitch[some], simulation.roll[some]
    for pose, pitch, roll, ranges, hit in zip(*truth, exact[some], glass[some], strict=True):
        placed = transform_points(
            compose(world.pose_pw, pose), tilted_points(ranges, lidar, pitch, roll)[:, :2]
        )
        off, hit = distance_to_walls(placed, world.glass), hit[lidar.valid(ranges)]
        assert (off[hit] < 1e-4).all()
        assert (off[~hit] > 1e-9).mean() > 0.999  # but for feet of walls and people who touch them


# --- every beam against the slow and obvious way --------------------------------------------------


def changed_by(hazard, times, rng):
    """Scan and beam ``(60, 2)`` of what a hazard changed; the empty building's scans are the same elsewhere."""
    ranges, empty = (drive(**h).recording.lidar.ranges for h in ({hazard: times}, {}))
    return rng.permutation(np.argwhere(np.abs(ranges - empty) > 1e-3))[:60]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "hazards", "tolerance"),
    [
        ("hall", {}, 1e-5),
        ("ramp", {}, 2e-3),
        ("hall", {"people": 6}, 1e-5),
        ("hall", {"doors": 4}, 1e-5),
        ("hall", {"bumps": 6}, 2e-3),
    ],
)
def test_beams_end_where_the_slow_way_ends(name, hazards, tolerance):
    simulation, rng = drive(name, **hazards), np.random.default_rng(0)
    angles, ranges = simulation.recording.robot.lidar.angles, simulation.recording.lidar.ranges
    some = np.column_stack([rng.integers(0, len(ranges), 60), rng.integers(0, BEAMS, 60)])
    tilted = np.flatnonzero(np.abs(simulation.pitch) + np.abs(simulation.roll) > np.deg2rad(1.5))
    if name == "ramp":
        some = np.vstack([some, np.column_stack([rng.choice(tilted, 60), rng.integers(0, BEAMS, 60)])])
    for hazard, times in hazards.items():
        some = np.vstack([some, changed_by(hazard, times, rng)])
    for k, beam in some:
        slow = slow_range(simulation, seconds(simulation)[k], angles[beam])
        assert ranges[k, beam] == pytest.approx(slow, abs=tolerance), (k, beam)


@pytest.mark.slow
@pytest.mark.parametrize(("sweep", "beams"), [(0.025, 1081), (1.0, 61)])
def test_every_beam_of_a_sweep_is_cast_from_its_own_place(sweep, beams):
    simulation = drive(**MORE)
    lidar = replace(simulation.recording.robot.lidar, sweep=sweep, beams=beams)
    rng = np.random.default_rng(0)
    turning = np.abs(np.gradient(np.unwrap(simulation.drive.poses[:, 2]), simulation.drive.t)) > 0.5
    t = np.concatenate([rng.choice(simulation.drive.t[turning], 20), rng.uniform(10.0, 110.0, 20)])
    ranges, at_once = (
        true_ranges(simulation.world, simulation.drive, replace(lidar, sweep=s), t) for s in (sweep, 0.0)
    )
    for k, beam in zip(np.repeat(np.arange(40), 2), rng.integers(0, beams, 80), strict=True):
        own_time = t[k] + sweep * (beam / (beams - 1) - 0.5)
        slow = slow_range(simulation, own_time, lidar.angles[beam])
        assert ranges[k, beam] == pytest.approx(slow, abs=2e-3), (k, beam)
    # The loop above has something to find (m), and the middle beam has the stamp's own time.
    assert np.median(np.abs(ranges - at_once)[:20, [0, -1]]) > 0.1 * sweep
    np.testing.assert_allclose(ranges[:, beams // 2], at_once[:, beams // 2], atol=1e-9)


def test_a_sweep_is_stated_in_the_recording():
    corridor = replace(HALL, layout="corridor", robot=RobotModel(lidar=LidarModel(beams=21, sweep=0.01)))
    assert simulate(corridor, 3, hazards=Hazards(sweep=0.02)).recording.robot.lidar.sweep == 0.02
    assert simulate(corridor, 3).recording.robot.lidar.sweep == 0.01


# --- bumps and slip -------------------------------------------------------------------------------


@pytest.mark.slow
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
        assert np.allclose(counts[inside], 0, atol=1e-9) != np.allclose(counts[inside], 2 * true[inside])


# --- the ring -------------------------------------------------------------------------------------


@pytest.mark.slow
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


@pytest.mark.slow
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
