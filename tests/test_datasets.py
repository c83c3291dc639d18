"""What a user types becomes a recording; the cache helps and never harms."""

import numpy as np
import pytest
from box_recording import box_recording

from pfslam import simulator
from pfslam.errors import DataError
from pfslam.io.course import save_course
from pfslam.io.datasets import IMAGE_EVERY, dataset_name, load
from pfslam.simulator import cache

LOG = "FLASER 4 1 2 3 4 0 0 0 0 0 0 {t} robot {t}\n"


@pytest.fixture(scope="module")
def hall():
    return simulator.simulate("hall")


@pytest.fixture
def casts(monkeypatch, tmp_path, hall):
    """A cache folder of our own, and a simulator that notes how often it casts scans (always ``hall``)."""
    monkeypatch.setenv("PFSLAM_CACHE", str(tmp_path / "the cache"))
    made = []

    def simulate(name, seed=None, ranges=None, progress=None):
        if ranges is None:
            made.append(name)
            return hall
        return original(name, seed, ranges)

    original = simulator.simulate
    monkeypatch.setattr(simulator, "simulate", simulate)
    return made


# ---- numbers and paths -------------------------------------------------------------------------


def test_a_number_is_looked_for_in_the_folder_given_or_of_the_environment_or_data(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PFSLAM_DATA", str(tmp_path / "mine"))
    with pytest.raises(DataError, match="mine: data folder"):
        load(7)
    monkeypatch.delenv("PFSLAM_DATA")
    with pytest.raises(DataError, match="data: data folder"):
        load(7)
    save_course(box_recording(), 7, tmp_path / "data")
    assert load(7).name == load("7", tmp_path / "data").name == "7"


def test_a_path_is_a_carmen_log(tmp_path):
    path = tmp_path / "my log.v2.clf"
    path.write_text(LOG.format(t=1.0) + LOG.format(t=2.0))
    for dataset in (path, str(path)):
        assert load(dataset).name == "my log.v2"
    assert dataset_name(path) == "my log.v2"


@pytest.mark.parametrize(
    "dataset", ["", ".", "attic", "no/such.log", "x" * 5000, "a\0b", "-1", "2.5", "²", None]
)
def test_anything_else_is_answered_with_what_is_accepted(dataset):
    with pytest.raises(DataError, match="hall, ramp, ring, the number of a set"):
        load(dataset)


# ---- built-in sets and their cache -------------------------------------------------------------


@pytest.mark.slow
def test_built_in_sets_render_every_eighth_pair(casts, hall):
    camera = load("hall").camera
    assert IMAGE_EVERY == 8
    assert len(camera.rgb_index) == len(camera.disparity_index)
    assert abs(len(camera.rgb_index) - len(hall.recording.camera.rgb_index) / 8) < 10
    j = camera.rgb_index[20]
    np.testing.assert_array_equal(camera.read_rgb(j), hall.recording.camera.read_rgb(j))


def test_the_second_load_reads_the_cache_and_is_the_same(casts):
    first, second = load("hall"), load("hall")
    assert casts == ["hall"]
    for part, name in (
        ("lidar", "ranges"),
        ("encoders", "counts"),
        ("imu", "angular_velocity"),
        ("truth", "poses"),
    ):
        np.testing.assert_array_equal(*(getattr(getattr(drive, part), name) for drive in (first, second)))


@pytest.mark.parametrize("damage", [lambda data: data[:1000], lambda data: data.replace(b"\0", b"\1")])
def test_a_damaged_cache_is_remade_with_a_notice(casts, tmp_path, caplog, damage):
    load("hall")
    (path,) = (tmp_path / "the cache").iterdir()
    whole = path.read_bytes()
    path.write_bytes(damage(whole))
    assert len(load("hall").lidar.t) > 4000
    assert casts == ["hall", "hall"]
    assert len(caplog.records) == 1
    assert "damaged" in caplog.text
    assert path.read_bytes() == whole


def test_without_a_folder_to_write_to_it_works_with_one_warning(casts, tmp_path, caplog):
    (tmp_path / "the cache").write_text("a file where the folder should be")
    assert len(load("hall").lidar.t) > 4000
    assert len(caplog.records) == 1
    assert "not kept" in caplog.text


def test_a_changed_source_is_another_file_and_the_old_one_goes(casts, tmp_path, monkeypatch):
    load("hall")
    monkeypatch.setattr(cache, "SOURCES", ("poses.py",))
    load("hall")
    assert casts == ["hall", "hall"]
    assert len(list((tmp_path / "the cache").iterdir())) == 1
