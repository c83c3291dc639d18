"""The course format: what is written comes back, real files load, and bad files are named in one line."""

import struct
import zipfile
from dataclasses import replace

import cv2
import numpy as np
import pytest
from box_recording import box_recording, rewrite

from pfslam.errors import DataError
from pfslam.io.course import load_course, save_course
from pfslam.io.files import atomic_write, read_npz
from pfslam.motion import dead_reckoning

BOX = box_recording()


@pytest.fixture
def folder(tmp_path):
    """The box recording as set 7, images included, in a folder whose name has a space and a dot."""
    folder = tmp_path / "my data.v2"
    save_course(BOX, 7, folder, image_every=1)
    return folder


def assert_same(a, b):
    assert a.dtype == b.dtype
    np.testing.assert_array_equal(a, b)


# ---- round trip --------------------------------------------------------------------------------


def test_saving_and_loading_changes_nothing_and_saving_again_gives_the_same_bytes(folder, tmp_path):
    after = load_course(7, folder)
    for name in ("encoders", "imu", "lidar", "truth", "camera"):
        for field, values in vars(getattr(BOX, name)).items():
            if not field.startswith(("read_", "_")):
                assert_same(getattr(getattr(after, name), field), values)
    for k in range(4):
        assert_same(after.camera.read_disparity(k), BOX.camera.read_disparity(k))
        assert_same(after.camera.read_rgb(k), BOX.camera.read_rgb(k))
    assert after.robot == BOX.robot
    assert after.dropped == {}
    save_course(after, 7, tmp_path / "again", image_every=1)
    for path in (p for p in folder.rglob("*") if p.is_file()):
        assert path.read_bytes() == (tmp_path / "again" / path.relative_to(folder)).read_bytes()


def test_what_a_recording_lacks_is_not_written_and_not_found(tmp_path):
    save_course(replace(BOX, lidar=None, truth=None, camera=None), 7, tmp_path, image_every=1)
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["Encoders7.npz", "Imu7.npz"]
    back = load_course(7, tmp_path)
    assert (back.lidar, back.truth, back.camera) == (None, None, None)


def test_every_nth_image_pair_keeps_its_number_and_stamp(tmp_path):
    save_course(BOX, 7, tmp_path, image_every=3)
    names = sorted(p.name for p in (tmp_path / "dataRGBD").rglob("*.png"))
    assert names == ["disparity7_1.png", "disparity7_4.png", "rgb7_1.png", "rgb7_4.png"]
    camera = load_course(7, tmp_path).camera
    np.testing.assert_array_equal(camera.rgb_index, [0, 3])
    assert len(camera.rgb_t) == 4
    assert camera.read_disparity(3)[0, 0] == 403


# ---- the layouts of the years ------------------------------------------------------------------


def test_capital_imu_data_folder_and_lower_case(folder):
    (folder / "data").mkdir()
    (folder / "Imu7.npz").rename(folder / "IMU7.npz")
    (folder / "Hokuyo7.npz").rename(folder / "data" / "hokuyo7.npz")
    (folder / "dataRGBD").rename(folder / "data" / "dataRGBD")
    recording = load_course("7", folder)
    assert len(recording.lidar.t) == len(BOX.lidar.t)
    assert len(recording.camera.rgb_index) == 4


def test_a_sweep_is_read_where_it_is_stated_and_written_with_the_set(tmp_path, folder):
    rewrite(folder / "Hokuyo7.npz", sweep=np.array([0.025]))
    save_course(load_course(7, folder), 8, tmp_path / "again")
    assert load_course(8, tmp_path / "again").robot.lidar.sweep == 0.025


@pytest.mark.parametrize("wrap", [float, np.array, lambda v: np.array([[v]])])
def test_limits_may_be_numbers_or_arrays_of_one(folder, wrap):
    limits = {"angle_min": wrap(-1.0), "angle_max": wrap(1.0), "range_min": wrap(0.2), "range_max": wrap(9.0)}
    rewrite(folder / "Hokuyo7.npz", **limits, angle_increment=np.array([0, 0]))
    lidar = load_course(7, folder).robot.lidar
    assert (lidar.angle_min, lidar.angle_max, lidar.range_min, lidar.range_max) == (-1.0, 1.0, 0.2, 9.0)
    np.testing.assert_allclose(np.diff(lidar.angles), 2.0 / 1080)


def test_what_cannot_be_used_is_counted(folder):
    ranges = BOX.lidar.ranges.T.astype(float)
    ranges[:3, 5] = np.nan
    ranges[:, 6] = np.inf
    rewrite(folder / "Hokuyo7.npz", ranges=ranges)
    rewrite(folder / "Kinect7.npz", rgb_time_stamps=BOX.camera.rgb_t[:3])
    recording = load_course(7, folder)
    assert recording.dropped == {"ranges that are not a number": 3, "images without a stamp": 1}
    valid = recording.robot.lidar.valid(recording.lidar.ranges)
    assert np.count_nonzero(~valid[5]) == 3
    assert not valid[6].any()
    np.testing.assert_array_equal(recording.camera.rgb_index, [0, 1, 2])
    (folder / "Kinect7.npz").unlink()
    assert load_course(7, folder).dropped["images without a stamp"] == 8


# ---- real files --------------------------------------------------------------------------------


@pytest.mark.parametrize(("number", "end"), [(20, (-2.12, -1.94, 0.04)), (21, (-2.53, -1.83, -0.92))])
def test_the_real_sets_load_and_dead_reckoning_ends_where_it_is_known_to(real_data, number, end):
    recording = load_course(number, real_data / "ece276a")
    assert recording.lidar is None
    assert len(recording.camera.rgb_index) == 0
    np.testing.assert_allclose(dead_reckoning(recording).poses[-1], end, atol=0.005)


# ---- bad files: one line that names file, field, value -----------------------------------------

LATER = BOX.imu.t.copy()
LATER[50] = LATER[49]
HOLES = BOX.imu.angular_velocity.T.copy()
HOLES[2, 3] = np.nan

BAD_FIELDS = {
    "repeated stamp": ("Imu7", {"time_stamps": LATER}, r"time_stamps\[50\]"),
    "nan stamp": ("Encoders7", {"time_stamps": np.full(241, np.nan)}, r"time_stamps\[0\]: found nan"),
    "stamps in ns": ("Encoders7", {"time_stamps": BOX.encoders.t * 1e9}, "time_stamps: found 1.3e"),
    "degrees per second": ("Imu7", {"angular_velocity": np.full((3, 561), 2e3)}, "rad/s, at most 1000"),
    "no stamps": ("Imu7", {"time_stamps": np.zeros(0)}, "time_stamps"),
    "missing key": ("Encoders7", {"counts": None}, "a key named counts"),
    "transposed": ("Encoders7", {"counts": np.zeros((241, 4))}, r"expected numbers of shape \(4, 241\)"),
    "nan gyro": ("Imu7", {"angular_velocity": HOLES}, r"angular_velocity\[.*3.*\]: found nan"),
    "objects": ("Imu7", {"angular_velocity": np.array([{}, 1], dtype=object)}, "never objects"),
    "complex": ("Encoders7", {"counts": np.zeros((4, 241), dtype=complex)}, "found an array of complex"),
    "ranges by row": ("Hokuyo7", {"ranges": BOX.lidar.ranges}, r"expected numbers of shape \(beams, 55\)"),
    "many beams": ("Hokuyo7", {"ranges": np.zeros((20_001, 55), dtype=np.int8)}, "at most 20000 beams"),
    "degrees": ("Hokuyo7", {"angle_min": -135.0, "angle_max": 135.0}, "radians"),
    "endless sweep": ("Hokuyo7", {"sweep": 25.0}, "sweep: found 25, expected seconds from the first beam"),
    "angles swapped": ("Hokuyo7", {"angle_min": 1.0, "angle_max": -1.0}, "the lesser first"),
    "nan limit": ("Hokuyo7", {"range_max": np.nan}, "range_max"),
    "far limit": (
        "Hokuyo7",
        {"range_max": 1e9},
        "range_max: found 1000000000.0, expected a number from 0 to 10000",
    ),
}


@pytest.mark.parametrize("case", BAD_FIELDS)
def test_a_bad_field_is_named(folder, case):
    name, changes, message = BAD_FIELDS[case]
    rewrite(folder / f"{name}.npz", **changes)
    with pytest.raises(DataError, match=message) as raised:
        load_course(7, folder)
    assert f"{name}.npz" in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("number", ["", "-1", "2.5", "../20", "twenty", "1234567", 1.5, None])
def test_a_set_number_is_digits(tmp_path, number):
    with pytest.raises(DataError, match="digits"):
        load_course(number, tmp_path)


def test_what_must_be_there_is_named(tmp_path, folder):
    with pytest.raises(DataError, match="no such folder"):
        load_course(7, tmp_path / "nowhere")
    for name in ("Imu7.npz", "Encoders7.npz"):
        (folder / name).unlink()
        with pytest.raises(DataError, match=name):
            load_course(7, folder)


@pytest.mark.parametrize("header", ["(10**15,)", "(1000000000000,)", "(-1,)", "(2, 3.5)"])
def test_an_absurd_header_costs_nothing(tmp_path, header):
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {header}, }}\n".encode()
    with zipfile.ZipFile(tmp_path / "bad.npz", "w") as archive:
        archive.writestr("a.npy", b"\x93NUMPY\x02\x00" + struct.pack("<I", len(text)) + text)
    with pytest.raises(DataError, match=r"bad\.npz: a: "):
        read_npz(tmp_path / "bad.npz", ("a",))


def test_a_header_that_python_stumbles_over_is_read_again(tmp_path, monkeypatch):
    # Python 3.11 raises SystemError if its collector runs code while a header is parsed: the file is sound.
    np.savez(tmp_path / "good.npz", a=np.arange(3))
    read = np.lib.npyio.NpzFile.__getitem__
    stumbles = [SystemError("AST constructor recursion depth mismatch")]

    def stumbling(archive, key):
        if stumbles:
            raise stumbles.pop()
        return read(archive, key)

    monkeypatch.setattr(np.lib.npyio.NpzFile, "__getitem__", stumbling)
    np.testing.assert_array_equal(read_npz(tmp_path / "good.npz", ("a",))["a"], np.arange(3))


def half(path):
    path.write_bytes(path.read_bytes()[:-12])


def flipped(path):
    data = bytearray(path.read_bytes())
    data[60] ^= 1
    path.write_bytes(data)


def other_pixels(path):
    cv2.imwrite(str(path), np.zeros((480, 640), np.uint8))


BAD_IMAGES = {
    (
        "Disparity7/disparity7_2.png",
        other_pixels,
    ): "found 640 x 480, 1 channels of 8 bits, expected .* 16 bits",
    ("RGB7/rgb7_2.png", other_pixels): "found .* 1 channels of 8 bits, expected .* 3 channels",
    ("RGB7/rgb7_2.png", half): r"rgb7_2\.png: image: found an end after",
    ("RGB7/rgb7_2.png", flipped): r"rgb7_2\.png: image: found a damaged part at byte",
}


@pytest.mark.parametrize("case", BAD_IMAGES, ids=lambda case: f"{case[0]} {case[1].__name__}")
def test_a_wrong_or_damaged_image_is_named(folder, case):
    name, damage = case
    damage(folder / "dataRGBD" / name)
    camera = load_course(7, folder).camera
    with pytest.raises(DataError, match=BAD_IMAGES[case]):
        camera.read_disparity(1), camera.read_rgb(1)


def test_a_missing_image_is_not_in_the_index(folder):
    (folder / "dataRGBD" / "RGB7" / "rgb7_2.png").unlink()
    camera = load_course(7, folder).camera
    np.testing.assert_array_equal(camera.rgb_index, [0, 2, 3])
    with pytest.raises(DataError, match="image that exists"):
        camera.read_rgb(1)


# ---- writing -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "raised"),
    [(KeyboardInterrupt(), KeyboardInterrupt), (OSError(28, "No space left on device"), DataError)],
    ids=["Ctrl-C", "full disk"],
)
def test_a_file_that_is_not_finished_leaves_the_old_one_as_it_was(tmp_path, fault, raised):
    def write_half():
        with atomic_write(tmp_path / "a.txt") as file:
            file.write(b"half")
            raise fault

    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(raised):
        write_half()
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"


def test_two_writers_of_one_file_never_mix(tmp_path):
    """Each has a hidden file of its own; the last to finish wins, whole."""
    path = tmp_path / "a"
    with atomic_write(path) as first:
        with atomic_write(path) as second:
            second.write(b"second")
            first.write(b"first")
        assert path.read_bytes() == b"second"
    assert path.read_bytes() == b"first"
    assert list(tmp_path.iterdir()) == [path]


def test_what_cannot_be_saved_is_refused_before_anything_is_written(tmp_path):
    log = replace(BOX, encoders=None, imu=None, odometry=BOX.truth)
    with pytest.raises(DataError, match="encoders and IMU"):
        save_course(log, 7, tmp_path)
    with pytest.raises(DataError, match="image_every: found 0, expected 1 or more"):
        save_course(BOX, 7, tmp_path, image_every=0)
    assert list(tmp_path.iterdir()) == []


def test_the_columns_of_an_imu_are_written_in_the_order_of_the_format(tmp_path):
    """The layout has no place for ``yaw_axis``: its yaw rate is always the third row."""
    rates, pushes = np.arange(3.0 * len(BOX.imu.t)).reshape(-1, 3), BOX.imu.acceleration_g
    plain = replace(BOX, imu=replace(BOX.imu, angular_velocity=rates))
    turned = replace(BOX.imu, angular_velocity=rates[:, [2, 0, 1]], acceleration_g=pushes[:, [2, 0, 1]])
    robot = replace(BOX.robot, imu=replace(BOX.robot.imu, yaw_axis=0))
    for name, recording in (("plain", plain), ("turned", replace(BOX, imu=turned, robot=robot))):
        save_course(recording, 7, tmp_path / name)
    assert (tmp_path / "plain" / "Imu7.npz").read_bytes() == (tmp_path / "turned" / "Imu7.npz").read_bytes()
