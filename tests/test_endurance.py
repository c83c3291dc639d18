"""Long drives: scans that are never all in memory give the same run, and memory does not grow with the drive.

The hour itself is ``make endurance``; its table is drawn in the book.
"""

import itertools
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pfslam.bench.endurance import Milestone, long_drive, milestones, table
from pfslam.config import SlamConfig
from pfslam.errors import DataError
from pfslam.io.files import write_npz
from pfslam.runs import run_slam
from pfslam.simulator import DEFAULT_SEED, HALL, simulate
from pfslam.simulator.drive import path_length
from pfslam.simulator.streams import map_npz, scan_chunks, simulate_to_file, write_rows
from pfslam.simulator.world import make_world

FEW = replace(SlamConfig.refined(), particles=5, every=20)
TABLE = Path(__file__).resolve().parents[1] / "book" / "tables" / "endurance.csv"


@pytest.fixture(scope="module")
def streamed(tmp_path_factory):
    """The built-in drive with its scans in a file."""
    path = tmp_path_factory.mktemp("streams") / "scans.npz"
    return simulate_to_file("hall", path), path


def test_rows_come_back_as_they_went(tmp_path):
    parts = [np.arange(6.0).reshape(2, 3), np.ones((1, 3))]
    write_rows(tmp_path / "a.npz", "ranges", (3, 3), parts)
    mapped = map_npz(tmp_path / "a.npz", "ranges")
    assert isinstance(mapped, np.memmap)
    np.testing.assert_array_equal(mapped, np.vstack(parts))
    with np.load(tmp_path / "a.npz") as data:
        np.testing.assert_array_equal(data["ranges"], np.vstack(parts))
    with pytest.raises(ValueError, match="read-only"):
        mapped[0, 0] = 1.0


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("kind", ["f4", "f8", "i2", "u1"])
def test_any_uncompressed_archive_can_be_mapped(tmp_path, kind, order):
    values = np.asarray(np.arange(12).reshape(3, 4), dtype=kind, order=order)
    write_npz(tmp_path / "a.npz", before=np.zeros(3), x=values)
    np.testing.assert_array_equal(map_npz(tmp_path / "a.npz", "x"), values)


@pytest.mark.parametrize(("rows", "columns"), [(1, 3), (4, 3)])
def test_fewer_or_more_rows_than_announced_leave_no_file(tmp_path, rows, columns):
    with pytest.raises(DataError, match=rf"{rows} rows.*2 rows"):
        write_rows(tmp_path / "a.npz", "x", (2, columns), [np.zeros((rows, columns))])
    assert list(tmp_path.iterdir()) == []


def damaged(path, how):
    write_npz(path, x=np.arange(1000.0))
    if how == "compressed":
        np.savez_compressed(path, x=np.arange(10.0))
    elif how == "cut off":
        path.write_bytes(path.read_bytes()[:500])
    elif how == "other key":
        write_npz(path, y=np.zeros(3))
    elif how == "objects":
        np.savez(path, x=np.array([{}], dtype=object))
    elif how == "gone":
        path.unlink()


@pytest.mark.parametrize("how", ["compressed", "cut off", "other key", "objects", "gone"])
def test_what_cannot_be_mapped_is_said_in_one_line(tmp_path, how):
    damaged(tmp_path / "a.npz", how)
    with pytest.raises(DataError, match=r"a\.npz") as caught:
        map_npz(tmp_path / "a.npz", "x")
    assert "\n" not in str(caught.value)


def test_the_streamed_drive_is_the_drive_with_another_draw_of_noise(streamed):
    whole, (simulation, _) = simulate("hall"), streamed
    found, expected = simulation.recording, whole.recording
    np.testing.assert_array_equal(found.lidar.t, expected.lidar.t)
    np.testing.assert_array_equal(found.encoders.counts, expected.encoders.counts)
    np.testing.assert_array_equal(found.truth.poses, expected.truth.poses)
    both = (found.lidar.ranges < 30.0) & (expected.lidar.ranges < 30.0) & (found.lidar.ranges > 0.1)
    difference = (found.lidar.ranges - expected.lidar.ranges)[both & (expected.lidar.ranges > 0.1)]
    # Two independent draws of 1 cm each: the middle two thirds of the differences lie within sqrt(2) cm.
    assert np.quantile(np.abs(difference), 0.6827) == pytest.approx(0.01 * np.sqrt(2.0), rel=0.03)


def test_chunks_are_small_and_the_same_every_time(streamed):
    simulation, path = streamed
    first, second = itertools.islice(scan_chunks(simulation, 100), 2)
    assert first.shape == second.shape == (100, 1081)
    again = next(scan_chunks(simulation))
    np.testing.assert_array_equal(again, map_npz(path, "ranges")[: len(again)])


def test_a_mapped_recording_gives_the_run_of_one_in_memory(streamed):
    recording = streamed[0].recording
    held = replace(recording, lidar=replace(recording.lidar, ranges=np.array(recording.lidar.ranges)))
    found, expected = (run_slam(r, replace(FEW, every=100)).trajectory.poses for r in (recording, held))
    np.testing.assert_array_equal(found, expected)


def test_milestones_tell_of_every_minute(streamed):
    rows = list(milestones(streamed[0], replace(FEW, every=40), every=30.0))
    assert [round(2 * row.minutes) for row in rows[:-1]] == list(range(1, len(rows)))
    assert all(a.updates < b.updates and a.hit_cells <= b.hit_cells for a, b in itertools.pairwise(rows))
    assert rows[-1].ate_rmse_m < 0.05
    assert table(rows).count("\n") == len(rows) + 1


def test_laps_make_the_drive_longer():
    path = make_world(long_drive(2), np.random.SeedSequence(DEFAULT_SEED)).path
    assert path_length(path) == pytest.approx(2 * HALL.path_length, rel=0.02)


@pytest.mark.skipif(sys.platform != "linux", reason="private memory is read from /proc")
def test_memory_does_not_grow_with_the_drive():
    """The second minute of a drive needs no more memory than the first: 2 MB for poses and what the heap leaves."""
    code = """
import tempfile
from dataclasses import replace
from pathlib import Path
from pfslam.bench.endurance import milestones
from pfslam.config import SlamConfig
from pfslam.simulator.streams import simulate_to_file
with tempfile.TemporaryDirectory() as folder:
    simulation = simulate_to_file("hall", Path(folder) / "scans.npz")
    config = replace(SlamConfig.refined(), particles=20, every=10)
    print([row.private_mb for row in milestones(simulation, config, every=55.0)])
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=300,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr
    first, second = (float(word) for word in done.stdout.strip("[]\n").split(", ")[:2])
    assert second - first < 2.0
    assert second < 250.0


def test_the_stored_table_of_the_long_drive_is_bounded():
    """What the book says of the hour: the map stops growing, memory too, and the error stays under 5 cm."""
    header, *lines = TABLE.read_text(encoding="utf-8").splitlines()
    assert header.split(",") == list(Milestone.__dataclass_fields__)
    rows = [Milestone(*(float(word) for word in line.split(","))) for line in lines]
    later = [row for row in rows if row.minutes >= 5.0]
    assert later[-1].private_mb - later[0].private_mb < 20.0
    assert later[-1].map_cells == later[0].map_cells
    assert rows[-1].ate_rmse_m < 0.05
