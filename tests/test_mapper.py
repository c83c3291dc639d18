"""A mapper that is fed scan by scan is the run over all scans, and one that was saved is one that was not."""

from dataclasses import replace
from zipfile import ZipFile

import numpy as np
import pytest
from rooms import SQUARE, drive

import pfslam
from pfslam.errors import DataError
from pfslam.io.beliefs import LAYERS
from pfslam.poses import Trajectory, compose
from pfslam.recording import LidarScans
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
    "report": SlamConfig.report(),
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
def test_a_mapper_is_the_run_to_the_last_bit_and_so_is_one_saved_at_any_time(name, tmp_path):
    config = CONFIGS[name]
    whole = pfslam.run_slam(DRIVE, replace(config, every=1), second_look=False)
    mapper = mapped(config=config)
    np.testing.assert_array_equal([step.estimate for step in mapper.steps], whole.trajectory.poses)
    np.testing.assert_array_equal(mapper.grid.log_odds, whole.grid.log_odds)
    if whole.covariances is not None:
        np.testing.assert_array_equal(mapper.covariance, whole.covariances[-1])
    assert mapper.doubt == next((d["reason"] for d in whole.distrust if d["to"] is None), None)
    resumed, path = pfslam.Mapper(DRIVE.robot.lidar, config), tmp_path / "belief.npz"
    for k, sample in enumerate(samples()):
        if k in (0, 1, 2, len(mapper.steps) // 2):
            resumed.save(path)
            resumed = pfslam.Mapper.load(path)
        resumed.add(*sample)
    assert_same(resumed, mapper)


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
    with pytest.raises(DataError, match="maps: found per-particle, expected shared"):
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


@pytest.mark.parametrize("name", ["told", "seal", *LAYERS])
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
