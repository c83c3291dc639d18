"""CARMEN logs through a file: the recording and the run of a log held in memory, in a fraction of the memory."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from rooms import CURVES, drive
from test_formats import BAD_LOGS, flaser, rawlaser, robotlaser

from pfslam.__main__ import main
from pfslam.config import SlamConfig
from pfslam.errors import DataError
from pfslam.io import carmen
from pfslam.io.carmen import load_carmen
from pfslam.io.carmen_lines import ranges_again, read_log
from pfslam.poses import compose
from pfslam.runs import run_slam
from pfslam.simulator.streams import carmen_to_file, map_npz

FEW = replace(SlamConfig.refined(), particles=20)
ODOM = [f"ODOM {x} 0 0 0.1 0 0 {t} host 0.1" for x, t in ((0, 1.0), (2, 3.0), (1, 2.0), (7, 2.0))]
LOGS = {
    "old messages": [flaser(1.0), flaser(2.0, (4, 3, 2, 1))],
    "new messages": [robotlaser(10.5), "# a word", robotlaser(10.75, robot="1.1 2 0", laser="1.3 2 0")],
    "odometry apart": [*ODOM, rawlaser(2.5), rawlaser(1.5, (3, 2, 1))],
    "not in order": [flaser(t, (t, 2, 3, 4), pose=f"{t} 0 0") for t in (3.0, 1.0, 2.0, 5.0, 4.0)],
    "stamps twice": [flaser(2.0), flaser(1.0, (9, 9, 9, 9)), flaser(2.0, (5, 5, 5, 5)), flaser(1.0)],
    "no numbers": [flaser(1.0, ("nan", 2, "inf", 1e300)), flaser(2.0, ("-1", "nan", 0, "nan")), "SYNC 1"],
    "a place for the laser": ["PARAM robot_frontlaser_offset 0.17 1 host 1", flaser(1.0)],
}


def write(folder, lines, end="\n"):
    path = folder / "a.log"
    path.write_bytes(end.join([*lines, ""]).encode("latin-1"))
    return path


def as_dictionary(recording):
    """All that a recording holds, as plain lists; NaN as a word, so that it equals itself."""
    lidar, odometry = recording.lidar, recording.odometry
    arrays = (lidar.t, lidar.ranges, odometry.t, odometry.poses)
    return {
        "arrays": [(str(a.dtype), a.shape, repr(np.array(a).tolist())) for a in arrays],
        "rest": (recording.name, recording.robot, recording.default_every, list(recording.dropped.items())),
    }


@pytest.mark.parametrize("end", ["\n", "\r\n"], ids=["unix", "windows"])
@pytest.mark.parametrize("case", LOGS)
def test_a_streamed_log_is_the_log(tmp_path, case, end):
    log = write(tmp_path, LOGS[case], end)
    found = carmen_to_file(log, tmp_path / "scans.npz")
    assert isinstance(found.lidar.ranges, np.memmap)
    assert as_dictionary(found) == as_dictionary(load_carmen(log))
    with np.load(tmp_path / "scans.npz") as archive:
        np.testing.assert_array_equal(archive["ranges"], found.lidar.ranges)


@pytest.mark.parametrize("case", LOGS)
def test_a_long_log_is_the_log(tmp_path, monkeypatch, case):
    log = write(tmp_path, LOGS[case])
    held = load_carmen(log)
    monkeypatch.setattr(carmen, "LONG_LOG_BYTES", log.stat().st_size)
    found = load_carmen(log)
    assert isinstance(found.lidar.ranges, np.memmap)
    assert not isinstance(held.lidar.ranges, np.memmap)
    assert as_dictionary(found) == as_dictionary(held)
    assert list(tmp_path.iterdir()) == [log]


def test_a_long_log_runs_from_the_command_line_like_a_short_one(tmp_path, monkeypatch):
    log = written_drive(tmp_path)
    for out, long in (("short", carmen.LONG_LOG_BYTES), ("long", 0)):
        monkeypatch.setattr(carmen, "LONG_LOG_BYTES", long)
        assert main(["run", str(log), "--particles", "5", "--out", str(tmp_path / out)]) == 0
    for name in ("trajectory.tum", "odometry.tum", "map.pgm"):
        assert (tmp_path / "long" / name).read_bytes() == (tmp_path / "short" / name).read_bytes()


def test_a_long_log_needs_room_in_the_temporary_folder(tmp_path, monkeypatch, capsys):
    log = write(tmp_path, LOGS["old messages"])
    monkeypatch.setattr(carmen, "LONG_LOG_BYTES", 0)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "gone"))
    assert main(["run", str(log), "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(r"a\.log: scans: found .*, expected 0 MB of room in the temporary folder", line)
    assert list(tmp_path.iterdir()) == [log]


def test_any_order_of_lines(tmp_path):
    """By hand: the stamp of a scan is its first range, so ranges must come out sorted."""
    rng = np.random.default_rng(0)
    stamps = rng.permutation(300) + 1.0
    log = write(tmp_path, [flaser(t, (t, *rng.integers(1, 70, 3))) for t in stamps])
    found = carmen_to_file(log, tmp_path / "scans.npz").lidar
    np.testing.assert_array_equal(found.ranges[:, 0], np.arange(1.0, 301.0))
    np.testing.assert_array_equal(found.t, np.arange(1.0, 301.0))


@pytest.mark.parametrize("case", BAD_LOGS)
def test_a_bad_log_gets_the_same_answer_and_leaves_no_file(tmp_path, case):
    log = write(tmp_path, [BAD_LOGS[case][0]])
    with pytest.raises(DataError, match=BAD_LOGS[case][1]) as found:
        carmen_to_file(log, tmp_path / "scans.npz")
    with pytest.raises(DataError) as expected:
        load_carmen(log)
    assert str(found.value) == str(expected.value)
    assert list(tmp_path.iterdir()) == [log]


def test_a_log_that_is_not_there(tmp_path):
    with pytest.raises(DataError, match=r"none\.log: reading"):
        carmen_to_file(tmp_path / "none.log", tmp_path / "scans.npz")


def test_the_log_itself_is_never_written_over(tmp_path):
    log = write(tmp_path, LOGS["old messages"])
    with pytest.raises(DataError, match="found the log itself"):
        carmen_to_file(log, tmp_path / "." / "a.log")
    assert len(load_carmen(log).lidar.t) == 2


@pytest.mark.parametrize("change", ["cut off", "other stamp", "other beams", "gone"])
def test_a_log_that_changes_between_the_readings_is_noticed(tmp_path, change):
    path = write(tmp_path, LOGS["not in order"])
    log = read_log(path, lambda ranges: None)
    text = path.read_text()
    path.write_text(
        {
            "cut off": text[: len(text) // 2],
            "other stamp": text.replace(" 4.0 robot", " 6.0 robot"),
            "other beams": text.replace("FLASER 4 1.0", "FLASER 3    "),
        }.get(change, "")
    )
    if change == "gone":
        path.unlink()
    with pytest.raises(DataError, match=r"a\.log: reading: found other lines than before"):
        list(ranges_again(log, np.arange(5)))


def written_drive(folder):
    """A drive through a room by hand, as a log of new messages, its lines in any order."""
    recording = drive(CURVES)
    lidar, t = recording.robot.lidar, recording.lidar.t
    poses, rng = recording.truth.at(t), np.random.default_rng(1)
    drift = np.cumsum(rng.normal(0.0, [0.002, 0.002, 0.001], poses.shape), axis=0)
    laser = np.array([*lidar.position_b[:2], 0.0])
    step = np.ptp(lidar.angles) / (lidar.beams - 1)
    lines = []
    for when, ranges, pose in zip(t + 1.0, recording.lidar.ranges, poses + drift, strict=True):
        words = (" ".join(map(repr, map(float, values))) for values in (ranges, compose(pose, laser), pose))
        scan, placed, driven = words
        head = f"ROBOTLASER1 0 {lidar.angle_min} 4.7 {step} 60 0.01 0 {lidar.beams} {scan} 0"
        lines.append(f"{head} {placed} {driven} 0 0 0 0 0 {when} robot {when}")
    return write(folder, rng.permutation(lines))


def test_the_filter_gives_the_same_run_to_the_last_bit(tmp_path):
    log = written_drive(tmp_path)
    same_run(load_carmen(log), carmen_to_file(log, tmp_path / "scans.npz"), FEW)


def test_the_filter_gives_the_same_run_of_the_intel_log(tmp_path, real_data):
    log = real_data / "intel" / "intel.log"
    held, streamed = load_carmen(log), carmen_to_file(log, tmp_path / "scans.npz")
    assert as_dictionary(held) == as_dictionary(streamed)
    same_run(held, streamed, replace(FEW, every=20))


def same_run(held, streamed, config):
    expected, found = (run_slam(recording, config) for recording in (held, streamed))
    assert expected.updates > 40
    np.testing.assert_array_equal(found.trajectory.poses, expected.trajectory.poses)
    np.testing.assert_array_equal(found.grid.log_odds, expected.grid.log_odds)
    assert found.dropped == expected.dropped


# Memory
# ---------------------------------------------------------------------------------------------

BEAMS = 1081


def long_log(folder, scans):
    """A log of so many scans of a scanner that sees round walls."""
    ranges = " ".join(f"{value:.3f}" for value in np.linspace(3.0, 9.0, BEAMS))
    with open(folder / f"{scans}.log", "w") as file:
        for k in range(scans):
            file.write(f"FLASER {BEAMS} {ranges} {k / 100} 0 0 {k / 100} 0 0 {k / 10} robot {k / 10}\n")
    return folder / f"{scans}.log"


def in_a_process(code, *arguments):
    """What a fresh process prints, as JSON."""
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=300,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_memory_grows_by_less_than_a_twentieth_of_the_log(tmp_path):
    """Per scan: 8 numbers of 8 bytes while reading, and a few times that while they are put in order."""
    code = """
import sys, tracemalloc
import pfslam.simulator.streams, pfslam.io.carmen
small, large = sys.argv[1:3]
pfslam.simulator.streams.carmen_to_file(small, sys.argv[3])
if sys.argv[4] == "long":
    pfslam.io.carmen.LONG_LOG_BYTES = 0
peaks = []
for log in (small, large):
    tracemalloc.start()
    if sys.argv[4] == "streamed":
        kept = pfslam.simulator.streams.carmen_to_file(log, sys.argv[3])
    else:
        kept = pfslam.io.carmen.load_carmen(log)
    peaks.append(tracemalloc.get_traced_memory()[1])
    tracemalloc.stop()
print(peaks)
"""
    logs = long_log(tmp_path, 300), long_log(tmp_path, 1200)
    longer = logs[1].stat().st_size - logs[0].stat().st_size
    share = {}
    for how in ("streamed", "long", "held"):
        small, large = in_a_process(code, *logs, tmp_path / "scans.npz", how)
        share[how] = (large - small) / longer
    assert share["held"] > 0.5
    assert share["streamed"] < 0.05
    assert share["long"] < 0.05


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux counts private memory against RLIMIT_DATA")
def test_a_log_streams_where_there_is_no_room_to_hold_it(tmp_path):
    """26 MB of ranges, with 12 MB of private memory to spare."""
    code = """
import json, resource, sys
from pathlib import Path
import pfslam.simulator.streams, pfslam.io.carmen
from pfslam.errors import DataError
log, out, short = sys.argv[1:]
pfslam.simulator.streams.carmen_to_file(short, out)
(used,) = (int(line.split()[1]) for line in Path("/proc/self/status").read_text().splitlines() if "VmData" in line)
limit = 1024 * used + 12 * 2**20
resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
streamed = pfslam.simulator.streams.carmen_to_file(log, out)
try:
    pfslam.io.carmen.load_carmen(log)
except MemoryError:
    print(json.dumps([len(streamed.lidar.t), float(streamed.lidar.ranges[-1, -1])]))
"""
    log, short = long_log(tmp_path, 6000), long_log(tmp_path, 20)
    scans, last = in_a_process(code, log, tmp_path / "scans.npz", short)
    assert (scans, last) == (6000, 9.0)
    assert map_npz(tmp_path / "scans.npz", "ranges").shape == (6000, BEAMS)
