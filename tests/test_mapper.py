"""A mapper that is fed scan by scan is the run over all scans, and one that was saved is one that was not."""

from dataclasses import replace
from zipfile import ZipFile

import numpy as np
import pytest
from breaking import lines_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from rooms import ROOM, SQUARE, drive, scan

import pfslam
from pfslam.errors import DataError
from pfslam.poses import Trajectory, between, compose
from pfslam.recording import LidarScans, Recording
from pfslam.refined.mapper import LAYERS, STEPS
from pfslam.refined.step import RefinedConfig
from pfslam.slam import SlamConfig


def with_poses(sweep=0.0):
    """A drive whose odometry is a pose at each scan, in a frame of its own, with wheels that count too much."""
    square = drive(SQUARE)
    inside = square.truth.covers(square.lidar.t)
    t, ranges = square.lidar.t[inside], square.lidar.ranges[inside]
    poses = compose(np.array([3.0, 4.0, 1.0]), square.truth.at(t) * [1.02, 1.02, 1.0])
    robot = replace(square.robot, lidar=replace(square.robot.lidar, sweep=sweep))
    parts = {"odometry": Trajectory(t, poses), "lidar": LidarScans(t, ranges), "truth": None}
    return replace(square, robot=robot, encoders=None, imu=None, **parts)


DRIVE = with_poses()
CONFIGS = {
    "refined": SlamConfig.refined(),
    "robust": SlamConfig.refined().robust(),
    "report": RefinedConfig.of(SlamConfig.report()),
    "matching": replace(SlamConfig.matching(), draw_metres=0.5, draw_radians=float("inf")),
}


def samples(recording=DRIVE):
    return [*zip(recording.lidar.t, recording.lidar.ranges, recording.odometry.poses, strict=True)]


def mapped(count=None, config=None):
    mapper = pfslam.Mapper(DRIVE.robot.lidar, config)
    for sample in samples()[:count]:
        mapper.add(*sample)
    return mapper


def assert_same(found, expected):
    """Steps, map and what the random numbers have come to, to the last bit."""
    assert len(found.steps) == len(expected.steps)
    for a, b in zip(found.steps, expected.steps, strict=True):
        for name, value in vars(b).items():
            np.testing.assert_array_equal(getattr(a, name), value, err_msg=name)
    np.testing.assert_array_equal(found.grid.log_odds, expected.grid.log_odds)
    np.testing.assert_array_equal(found.belief.particles.poses, expected.belief.particles.poses)
    np.testing.assert_array_equal(found.belief.particles.log_weights, expected.belief.particles.log_weights)
    assert found.grid.spec == expected.grid.spec
    assert found.rng.bit_generator.state == expected.rng.bit_generator.state
    assert (found.config, found.doubt) == (expected.config, expected.doubt)


@pytest.mark.slow
@pytest.mark.parametrize("name", CONFIGS)
def test_a_mapper_is_the_run_to_the_last_bit(name):
    config = CONFIGS[name]
    whole = pfslam.run_slam(DRIVE, replace(RefinedConfig.of(config), every=1), second_look=False)
    mapper = mapped(config=config)
    np.testing.assert_array_equal([step.estimate for step in mapper.steps], whole.trajectory.poses)
    np.testing.assert_array_equal(mapper.grid.log_odds, whole.grid.log_odds)
    if whole.covariances is not None:
        np.testing.assert_array_equal(mapper.covariance, whole.covariances[-1])
    assert mapper.doubt == next((d["reason"] for d in whole.distrust if d["to"] is None), None)


def eventful():
    """The drive as a node gets it, with a sample at, before and after each scan: ("odometry" or "scan", arguments).

    Odometry is set back to zero on the way, and for some scans no beam returns.
    """
    t, path, blind = DRIVE.lidar.t, DRIVE.odometry, np.full(361, np.nan)
    for k in range(1, len(t) - 1):
        for stamp in (t[k] - 0.03, t[k], t[k] + 0.03):
            yield "odometry", (stamp, path.at(stamp) if k < 30 else between(path.poses[30], path.at(stamp)))
        yield "scan", (t[k], blind if 40 <= k < 50 else DRIVE.lidar.ranges[k])


def feed(mapper, what, arguments):
    return mapper.add(*arguments) if what == "scan" else mapper.add_odometry(*arguments)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["robust", "report"])
def test_a_mapper_that_is_saved_and_loaded_on_its_way_is_one_that_was_not(name, tmp_path):
    """Before the first scan, while no beam returns, after a jump of the odometry, and with samples that wait.

    After each of the first samples, and then of five, which is not how many there are to a scan.
    """
    config = replace(CONFIGS[name], particles=20)
    resumed, whole = (pfslam.Mapper(DRIVE.robot.lidar, config) for _ in range(2))
    for k, (what, arguments) in enumerate(eventful()):
        if k < 30 or k % 5 == 0:
            resumed.save(tmp_path / "belief.npz")
            resumed = pfslam.Mapper.load(tmp_path / "belief.npz")
        for one in (resumed, whole):
            feed(one, what, arguments)
    assert_same(resumed, whole)
    assert resumed.odometer.jumps == whole.odometer.jumps == 1
    assert sum(not step.matched for step in whole.steps[1:]) == 10


WHEN = st.floats(-0.5, 9.5)


@pytest.mark.slow
@settings(max_examples=25)
@given(
    name=st.sampled_from(list(CONFIGS)),
    stamps=st.one_of(
        st.sampled_from([0.02, 0.125, 0.5, 1.3]).map(lambda step: np.arange(0.0, 9.0, step)),
        st.sets(WHEN, min_size=2, max_size=40).map(sorted).map(np.array),
    ),
    scans=st.sets(WHEN, min_size=1, max_size=12),
    on_samples=st.sets(st.integers(0, 400), max_size=6),
    sweep=st.sampled_from([0.0, 0.05, -0.05]),
    jump=st.sampled_from([0.0, 2.0]),
    last=st.booleans(),
)
def test_a_mapper_fed_with_every_sample_is_the_run_to_the_last_bit(
    name, stamps, scans, on_samples, sweep, jump, last
):
    """Scans come before, between, on and after samples. With a sweep, those at the end wait for what never comes."""
    assume((np.diff(stamps) > 1e-6).all())
    truth = drive(SQUARE).truth
    config = replace(CONFIGS[name], every=1, particles=1 if name == "matching" else 10)
    poses = compose(np.array([3.0, 4.0, 1.0]), truth.at(np.clip(stamps, 0.0, 9.0)) * [1.02, 1.02, 1.0])
    poses[len(poses) // 2 :] = compose([jump, 0.0, 0.5 * jump], poses[len(poses) // 2 :])
    on_samples |= {len(stamps) - 1} if last else set()
    at = sorted(scans | {float(stamps[k % len(stamps)]) for k in on_samples})
    at = np.array([t for t in at if t + 0.5 * abs(sweep) <= stamps[-1] or not sweep])
    assume(len(at) and (np.diff(at) > 1e-6).all() and (at >= stamps[0]).any() and (at <= stamps[-1]).any())
    assume(Trajectory(stamps, poses).covers(at).any())
    ranges = np.array([scan(ROOM, truth.at(np.clip(t, 0.0, 9.0))) for t in at])
    robot = replace(DRIVE.robot, lidar=replace(DRIVE.robot.lidar, sweep=sweep))
    log = Recording("log", robot, odometry=Trajectory(stamps, poses), lidar=LidarScans(at, ranges))
    whole = pfslam.run_slam(log, config, second_look=False)
    mapper, waiting, steps = pfslam.Mapper(robot.lidar, config), list(zip(at, ranges, strict=True)), []
    for sample in zip(stamps, poses, strict=True):
        mapper.add_odometry(*sample)
        while waiting and mapper.reaches(waiting[0][0]):
            t, values = waiting.pop(0)
            steps += [mapper.add(t, values)] if mapper.covers(t) else []
    assert len(steps) == len(whole.infos)
    for found, expected in zip(steps, whole.infos, strict=True):
        for part in ("estimate", "covariance", "score", "effective_sample_size"):
            np.testing.assert_array_equal(getattr(found, part), getattr(expected, part), err_msg=part)
        np.testing.assert_array_equal(found.particles.poses, expected.particles.poses)
        np.testing.assert_array_equal(found.particles.log_weights, expected.particles.log_weights)
    np.testing.assert_array_equal(mapper.grid.log_odds, whole.grid.log_odds)
    assert mapper.odometer.jumps == whole.dropped.get("jumps of the odometry", 0)
    assert all(t > stamps[-1] for t, _ in waiting)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("before", "fed"),
    [(0, False), (1, True), (35, True), (35, False), (45, True)],
    ids=["first", "second", "after a jump", "after a jump, handed over", "blind"],
)
def test_a_step_that_is_interrupted_at_any_line_leaves_everything_as_it_was(before, fed, tmp_path):
    config = replace(CONFIGS["robust"], particles=10)
    samples = [*eventful()]
    at = [k for k, (what, _) in enumerate(samples) if what == "scan"][before]
    mappers = [pfslam.Mapper(DRIVE.robot.lidar, config) for _ in range(2)]
    for mapper in mappers:
        for what, arguments in samples[:at]:
            feed(mapper, what, arguments)
    bad, good = mappers
    t, ranges = samples[at][1]
    scan_of = (t, ranges) if fed else (t + 0.04, ranges, samples[at - 1][1][1])
    good.save(tmp_path / "good.npz")
    last = 1
    while lines_of(lambda: bad.add(*scan_of), last) == last:
        bad.save(tmp_path / "bad.npz")
        assert (tmp_path / "bad.npz").read_bytes() == (tmp_path / "good.npz").read_bytes()
        last += 25
    assert last > 300
    for mapper in (pfslam.Mapper.load(tmp_path / "good.npz"), good):
        mapper.add(*scan_of)
    again = pfslam.Mapper.load(tmp_path / "bad.npz")
    again.add(*scan_of)
    assert_same(again, good)


@pytest.mark.parametrize("after", [0, 20])
def test_a_range_that_no_map_can_hold_leaves_everything_as_it_was(after):
    """Nor is the motion that led to that scan forgotten."""
    lidar = replace(DRIVE.robot.lidar, range_max=1e4)
    bad, good = (pfslam.Mapper(lidar, replace(SlamConfig.refined(), particles=10)) for _ in range(2))
    for k, (t, ranges, pose) in enumerate(samples()[:40]):
        ranges = np.where(ranges < 60.0, ranges, np.nan)
        if k == after:
            spoilt = ranges.copy()
            spoilt[5] = spoilt[200] = 9999.0
            with pytest.raises(DataError, match="at most 400000000 cells"):
                bad.add(t, spoilt, pose)
            continue
        for mapper in (bad, good):
            mapper.add(t, ranges, pose)
    assert_same(bad, good)


def test_a_file_of_a_mapper_is_the_same_whenever_it_is_written(tmp_path):
    mapper, (first, second) = mapped(5), (tmp_path / "first.npz", tmp_path / "second.npz")
    mapper.save(first)
    pfslam.Mapper.load(first).save(second)
    assert first.read_bytes() == second.read_bytes()
    assert [*tmp_path.iterdir()] == [first, second]


@pytest.mark.parametrize("sweep", [0.08, -0.08])
def test_beams_after_the_last_pose_are_deskewed_as_if_the_robot_went_on(sweep):
    """Straight on at constant speed that is what it does, so the node that waits for later poses sees the same."""
    robot = replace(DRIVE.robot, lidar=replace(DRIVE.robot.lidar, sweep=sweep))
    at_once, later = pfslam.Odometer(robot), pfslam.Odometer(robot)
    for t in (0.0, 0.1, 0.2):
        later.add_pose(t, (5.0 * t, 0.0, 0.0))
    for t in (0.0, 0.1):
        at_once.add_pose(t, (5.0 * t, 0.0, 0.0))
    assert later.reaches(0.1)
    assert not at_once.reaches(0.1)
    found, expected = (one.event(0.1, RANGES).points_b for one in (at_once, later))
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert np.ptp(found - pfslam.sensors.scan_points(RANGES, robot.lidar), axis=0) == pytest.approx(
        [0.4, 0.0]
    )


RANGES = np.full(361, 2.0)
BAD = {
    "too few ranges": (
        (2.0, RANGES[1:], (0.0, 0.0, 0.0)),
        r"ranges: found shape \(360,\), expected \(361,\)",
    ),
    "words": ((2.0, RANGES, ("here", "or", "there")), "expected numbers"),
    "nothing": ((2.0, None, (0.0, 0.0, 0.0)), "ranges"),
    "a pose of two": ((2.0, RANGES, (0.0, 0.0)), r"finite numbers of shape \(3,\)"),
    "a pose that is no number": ((2.0, RANGES, (0.0, np.nan, 0.0)), "finite numbers"),
    "a pose without end": ((2.0, RANGES, (np.inf, 0.0, 0.0)), "finite numbers"),
    "no stamp": ((np.nan, RANGES, (0.0, 0.0, 0.0)), "finite numbers"),
    "an earlier stamp": ((0.5, RANGES, (0.0, 0.0, 0.0)), "stamp: found 0.5 after 1.0, expected increasing"),
    "the same stamp": ((1.0, RANGES, (0.0, 0.0, 0.0)), "stamp: found 1.0 after 1.0, expected increasing"),
    "the same scan without a pose": ((1.0, RANGES), "stamp: found 1.0 after 1.0, expected increasing"),
    "no odometry as far": ((2.0, RANGES), r"found \[1.0+, 1.0+\] s, expected samples on both sides of 2.0"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_used_is_refused_and_changes_nothing(name):
    sample, words = BAD[name]
    mapper, other = (pfslam.Mapper(DRIVE.robot.lidar) for _ in range(2))
    for one in (mapper, other):
        one.add(1.0, RANGES, (0.0, 0.0, 0.0))
    with pytest.raises(DataError, match=words):
        mapper.add(*sample)
    for one in (mapper, other):
        one.add(3.0, RANGES, (0.1, 0.0, 0.0))
    assert_same(mapper, other)


def test_beams_that_met_nothing_are_left_out_whatever_the_scanner_writes():
    mapper = pfslam.Mapper(replace(DRIVE.robot.lidar, range_max=5.6))
    ranges = np.full(361, 2.0, dtype=np.float32)
    ranges[:5] = np.nan, np.inf, -np.inf, 0.0, 60.0
    assert mapper.add(1.0, ranges, (0.0, 0.0, 0.0)).beams == 356
    ranges[:] = np.nan
    step = mapper.add(2.0, ranges, (1.0, 0.0, 0.0))
    assert (step.beams, step.matched, mapper.pose.tolist()) == (0, False, [1.0, 0.0, 0.0])
    mapper.add(5.0, ranges, (1.0, 0.0, 0.0))
    assert "no scan with enough beams" in mapper.doubt
    np.testing.assert_array_equal(mapper.covariance, mapper.steps[-1].covariance)


def test_a_map_for_each_particle_and_other_generators_are_refused(tmp_path):
    with pytest.raises(DataError, match="config: found PerParticleConfig, expected settings of one map"):
        pfslam.Mapper(DRIVE.robot.lidar, SlamConfig.per_particle())
    rng = np.random.Generator(np.random.Philox(1))
    with pytest.raises(DataError, match="rng: found Philox"):
        pfslam.Mapper(DRIVE.robot.lidar, rng=rng).save(tmp_path / "belief.npz")
    assert not [*tmp_path.iterdir()]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("belief") / "belief.npz"
    mapped(5, CONFIGS["robust"]).save(path)
    return path


@pytest.mark.parametrize("name", ["told", "seal", *LAYERS, *STEPS])
@pytest.mark.parametrize("how", ["cut", "absent", "objects", "one bit", "another type"])
def test_a_damaged_file_gives_one_clear_error(written, tmp_path, name, how):
    with np.load(written) as archive:
        arrays = dict(archive)
    old = arrays.pop(name)
    if how != "absent":
        flipped = np.frombuffer(bytes([old.tobytes()[0] ^ 1]) + old.tobytes()[1:], old.dtype)
        new = {"cut": old.ravel()[:-1], "objects": np.array("text"), "another type": old.astype(complex)}
        arrays[name] = (new | {"one bit": flipped.reshape(old.shape)})[how]
    path = tmp_path / "damaged.npz"
    np.savez(path, **arrays)
    with pytest.raises(DataError, match=r"damaged\.npz: "):
        pfslam.Mapper.load(path)


@pytest.mark.parametrize("bytes_kept", [0, 100, 5000])
def test_a_cut_file_and_one_of_something_else_give_one_clear_error(written, tmp_path, bytes_kept):
    path = tmp_path / "cut.npz"
    path.write_bytes(written.read_bytes()[:bytes_kept])
    with pytest.raises(DataError, match=r"cut\.npz: "):
        pfslam.Mapper.load(path)
    with ZipFile(path, "w") as archive:
        archive.writestr("told.npy", b"no array")
    with pytest.raises(DataError, match=r"cut\.npz: keys: found"):
        pfslam.Mapper.load(path)
