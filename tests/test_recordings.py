"""A drive in one file: what is saved comes back bit for bit, and the commands take it."""

import json
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from box_recording import box_recording, rewrite
from hypothesis import given, settings
from hypothesis import strategies as st

import pfslam
from pfslam.__main__ import main
from pfslam.errors import DataError
from pfslam.io.recordings import FORMAT
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory
from pfslam.recording import Encoders, Imu, LidarScans, Recording, RgbdStream
from pfslam.sensors import LidarModel, RgbdModel, RobotModel


def assert_same(a, b):
    """Equal in every field, arrays in type and bits; images by their pixels."""
    assert type(a) is type(b)
    for field in fields(a):
        x, y = getattr(a, field.name), getattr(b, field.name)
        if field.name.startswith("read_"):
            for k in getattr(a, field.name.removeprefix("read_") + "_index"):
                np.testing.assert_array_equal(x(int(k)), y(int(k)))
        elif isinstance(x, np.ndarray):
            assert (x.dtype, x.shape, x.tobytes()) == (y.dtype, y.shape, y.tobytes()), field.name
        elif is_dataclass(x) and not isinstance(x, RobotModel):
            assert_same(x, y)
        else:
            assert x == y, field.name


# ---- random recordings -------------------------------------------------------------------------


def random_recording(rng, parts):
    """A recording with the named parts, full of numbers that mean nothing."""
    beams, two = int(rng.integers(1, 9)), np.sort(rng.uniform(0, 3, (2, 2)))
    lidar = LidarModel(*two[0], beams, *two[1], tuple(rng.normal(size=3)), rng.normal())
    robot, made = RobotModel(lidar=lidar, camera=RgbdModel(width=3, height=2, pitch=rng.normal())), {}
    for name in parts:
        t = rng.normal() * 1e9 + np.cumsum(rng.uniform(1e-3, 9, rng.integers(1, 6)))
        n = len(t)
        if name == "encoders":
            made[name] = Encoders(t, rng.integers(-99, 99, (n, 4)).astype(np.int16))
        elif name == "imu":
            made[name] = Imu(t, rng.normal(size=(n, 3)), rng.normal(size=(n, 3)))
        elif name == "lidar":
            ranges = rng.choice([np.nan, np.inf, -np.inf, 0.0, -0.0, 1.5], (n, beams))
            made[name] = LidarScans(t, ranges.astype(rng.choice(["f4", "f8"])))
        elif name == "camera":
            depth = rng.integers(0, 2**16, (n, 2, 3), dtype=np.uint16)
            colour = rng.integers(0, 256, (n, 2, 3, 3), dtype=np.uint8)
            index = np.flatnonzero(rng.random(n) < 0.7)
            made[name] = RgbdStream(t, t + 0.5, depth.__getitem__, colour.__getitem__, index, index)
        else:
            size = 0.03 if name == "odometry" else 9  # which must not jump, or its jumps are left out
            made[name] = Trajectory(t, rng.normal(size=(n, 3)) * size)
    if rng.random() < 0.5:
        made |= {
            "dropped": {"ranges that are zero": int(rng.integers(1, 99))},
            "notes": ("one", "two: näher"),
        }
    return Recording("a name, ü", robot, **made)


MOTIONS = [("encoders", "imu"), ("odometry",), ("odometry", "imu"), ("encoders", "imu", "odometry")]


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    motion=st.sampled_from(MOTIONS),
    others=st.sets(st.sampled_from(["lidar", "camera", "truth"])),
)
def test_load_gives_what_was_saved(tmp_path_factory, seed, motion, others):
    recording = random_recording(np.random.default_rng(seed), (*motion, *sorted(others)))
    path = tmp_path_factory.mktemp("drive") / "other name.npz"
    pfslam.save(recording, path)
    assert_same(pfslam.load(path), recording)


# ---- the layout --------------------------------------------------------------------------------


def test_numpy_alone_reads_it(tmp_path):
    recording = box_recording()
    pfslam.save(recording, tmp_path / "box.npz")
    with np.load(tmp_path / "box.npz", allow_pickle=False) as data:
        assert data["format"] == FORMAT
        assert data["name"].tobytes().decode() == "box"
        np.testing.assert_array_equal(data["lidar.ranges"], recording.lidar.ranges)
        np.testing.assert_array_equal(data["truth.poses"], recording.truth.poses)
        assert data["robot.lidar.angle_min"] == recording.robot.lidar.angle_min
        assert tuple(data["robot.lidar.position_b"]) == recording.robot.lidar.position_b
        assert data["camera.rgb.2"].tobytes()[1:4] == b"PNG"
        assert {values.dtype.kind for values in data.values()} <= set("fiu")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"format": None}, "a key named format"),
        ({"format": np.array(2)}, "format: found 2, expected the number 1"),
        ({"lidar__t": None}, "an array named lidar.t as well"),
        ({"lidar__ranges": np.zeros((3, 2))}, r"lidar.ranges: found float64 of shape \(3, 2\)"),
        ({"lidar__ranges": np.zeros((55, 2))}, "lidar ranges: found 2 beams, expected 1081"),
        ({"encoders__counts": np.zeros((241, 3))}, "encoders.counts: found float64 of shape"),
        ({"encoders__counts": np.full((241, 4), 1e9)}, "encoders.counts: found 1e.09, expected counts"),
        ({"imu__t": None, "imu__angular_velocity": None, "imu__acceleration_g": None}, "neither encoders"),
        ({"truth__poses": np.zeros((55, 2))}, r"truth.poses: found float64 of shape \(55, 2\)"),
        ({"robot__lidar__beams": np.array(2.5)}, "robot.lidar.beams: found 2.5, expected a whole number"),
        ({"robot__lidar__angle_min": np.array(9.0)}, "robot.lidar.angle_min, angle_max"),
        ({"camera__rgb_index": np.array([0, 7])}, "whole numbers from 0 to 3"),
        ({"camera__rgb_index": np.array([0, 2, 1, 3])}, "increasing"),
        ({"camera__rgb_t": None}, "an array named camera.rgb_t as well"),
        ({"name": np.array([255, 255], dtype=np.uint8)}, "name: found uint8"),
        ({"dropped": np.frombuffer(b"many scans", dtype=np.uint8)}, "lines of a count and its reason"),
        ({"lidar__t": np.array([{}] * 55, dtype=object)}, "never objects"),
    ],
)
def test_damage_is_named(tmp_path, changes, words):
    path = tmp_path / "box.npz"
    pfslam.save(box_recording(), path)
    rewrite(path, **changes)
    with pytest.raises(DataError, match=words) as caught:
        pfslam.load(path)
    assert "box.npz: " in str(caught.value)


def test_a_damaged_image_is_named_when_it_is_read(tmp_path):
    path = tmp_path / "box.npz"
    pfslam.save(box_recording(), path)
    rewrite(path, camera__rgb__1=None, camera__disparity__2=np.zeros(40, dtype=np.uint8))
    camera = pfslam.load(path).camera
    with pytest.raises(DataError, match=r"a key named camera\.rgb\.1"):
        camera.read_rgb(1)
    with pytest.raises(DataError, match=r"camera\.disparity\.2: image: found no PNG header"):
        camera.read_disparity(2)


# ---- the commands ------------------------------------------------------------------------------


def without_wheels():
    """The box drive as a robot with poses and scans would record it."""
    box = box_recording(images=0)
    return replace(box, encoders=None, imu=None, odometry=dead_reckoning(box))


def test_poses_and_scans_run_and_report_what_they_hold(tmp_path, capsys):
    path, out = tmp_path / "my robot.npz", tmp_path / "out"
    pfslam.save(without_wheels(), path)
    assert main(["info", str(path)]) == 0
    assert "motion: from the odometry's poses" in capsys.readouterr().out
    assert main(["run", str(path), "--out", str(out), "--particles", "9"]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["slam"]["ate_max_m"] < 0.05
    assert summary["notes"] == []
    assert "calibration" not in summary


def test_convert_then_info(tmp_path, capsys):
    pfslam.save_course(box_recording(), 7, tmp_path / "set", image_every=2)
    out, none = tmp_path / "seven.npz", tmp_path / "none.npz"
    assert main(["convert", "7", str(out), "--data", str(tmp_path / "set")]) == 0
    assert_same(pfslam.load(out), pfslam.load(7, tmp_path / "set"))
    assert main(["convert", str(tmp_path / "set"), str(none), "--no-images"]) == 0
    camera = pfslam.load(none).camera
    assert (len(camera.rgb_t), len(camera.rgb_index), len(camera.disparity_index)) == (4, 0, 0)
    capsys.readouterr()
    assert main(["info", str(out)]) == 0
    said = capsys.readouterr().out
    names = [line.split()[0] for line in said.splitlines()[1:6]]
    assert names == ["encoders", "imu", "lidar", "truth", "depth"]
    assert "1081 beams from -135.0 to 135.0 deg, 0.1 to 30 m" in said


def test_check_answers_with_its_exit_code(tmp_path, capsys):
    """Two counts more on the right are a turn of 0.4 rad/s over a track of 0.44 m; swapped, they are a fault."""
    box, path = replace(box_recording(images=0), lidar=None), tmp_path / "a.npz"
    for counts, code, end in (
        ([6, 4, 6, 4], 0, "no check failed"),
        ([4, 6, 4, 6], 1, "1 of 13 checks failed"),
    ):
        wheels = np.tile(np.array(counts, dtype=np.int16), (len(box.encoders.t), 1))
        pfslam.save(replace(box, encoders=replace(box.encoders, counts=wheels)), path)
        assert main(["check", str(path)]) == code
        said = capsys.readouterr().out.splitlines()
        assert said[0].split() == ["verdict", "question", "found", "expected"]
        assert (len(said), said[-1]) == (15, end)
        failed = [line for line in said if line.startswith("warning")]
        assert ["effective track -0.4" in line for line in failed] == [True] * code
    assert main(["check", str(tmp_path / "absent.npz")]) == 2
