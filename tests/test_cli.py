"""The command line, run as a user runs it."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
from box_recording import ROOM, box_recording
from evo.core import metrics as evo_metrics
from evo.core import sync
from evo.tools import file_interface

from pfslam import simulator
from pfslam.__main__ import main
from pfslam.cli import commands, words
from pfslam.io import files
from pfslam.io.course import load_course, save_course
from pfslam.io.formats import read_covariances, read_map, read_tum, write_tum
from pfslam.poses import Trajectory
from pfslam.sensors import LidarModel

CONTRACT_FILES = ["map.pgm", "map.yaml", "odometry.tum", "summary.json", "trajectory.tum"]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """The box recording as set 7 and, without LiDAR and images, as set 8."""
    folder = tmp_path_factory.mktemp("some data.v1")
    save_course(box_recording(), 7, folder, image_every=1)
    save_course(box_recording(images=0), 8, folder)
    (folder / "Hokuyo8.npz").unlink()
    return folder


def pfslam(*arguments, **environment):
    """Run the command line in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "pfslam", *map(str, arguments)],
        capture_output=True,
        text=True,
        env=os.environ | environment,
        timeout=300,
    )


@pytest.fixture(scope="module")
def results(data, tmp_path_factory):
    """What ``run`` leaves for set 7."""
    out = tmp_path_factory.mktemp("runs") / "out of box.1"
    done = pfslam("run", 7, "--data", data, "--out", out, "--particles", 20, "--every", 5)
    assert (done.returncode, done.stderr) == (0, "")
    return out


# ---- run: what it leaves -----------------------------------------------------------------------


def test_run_leaves_all_files_and_no_others(results):
    assert sorted(p.name for p in results.iterdir()) == sorted(
        [*CONTRACT_FILES, "texture.png", "texture.yaml", "trajectory_covariance.txt"]
    )


def test_the_summary_holds_what_the_contract_names(results):
    summary = json.loads((results / "summary.json").read_text())
    scans = len(box_recording().lidar.t[::5])
    assert summary["config"]["particles"] == 20
    assert summary["config"]["every"] == 5
    assert set(summary["seconds"]) == {"load", "dead_reckoning", "slam", "texture", "write"}
    assert all(seconds >= 0 for seconds in summary["seconds"].values())
    assert summary["scans"] == scans
    assert summary["updates"] == scans - 1
    assert 0 <= summary["resamplings"] < scans
    assert all(isinstance(count, int) for count in summary["dropped"].values())
    for name in ("odometry", "slam"):
        assert set(summary[name]) >= {"ate_rmse_m", "ate_max_m", "heading_rmse_deg"}


def test_the_summary_says_what_the_drive_tells_about_its_instruments_and_applies_nothing(results):
    """Exact wheels and gyro: scales of one, to within what the grid allows; what could not be found has no error."""
    summary = json.loads((results / "summary.json").read_text())
    assert summary["lost"] == 0
    assert summary["distrust"] == []
    found = summary["calibration"]
    assert found["applied"] is False
    for name in ("wheel_scale", "gyro_scale"):
        assert found[name] == pytest.approx(1.0, abs=0.03)
    assert found["gyro_bias"] == pytest.approx(0.0, abs=1e-3)
    assert {name for name, value in found.items() if value is None} <= {
        n for n in found if n.endswith("_error")
    }


def test_evo_agrees_with_the_summary(results, data, tmp_path):
    write_tum(tmp_path / "truth.tum", load_course(7, data).truth)
    summary = json.loads((results / "summary.json").read_text())
    for file, name in (("trajectory.tum", "slam"), ("odometry.tum", "odometry")):
        reference = file_interface.read_tum_trajectory_file(tmp_path / "truth.tum")
        estimate = file_interface.read_tum_trajectory_file(results / file)
        reference, estimate = sync.associate_trajectories(reference, estimate)
        estimate.align_origin(reference)
        ape = evo_metrics.APE(evo_metrics.PoseRelation.translation_part)
        ape.process_data((reference, estimate))
        assert ape.get_statistic(evo_metrics.StatisticsType.rmse) == pytest.approx(
            summary[name]["ate_rmse_m"], abs=1e-6
        )


def test_covariances_stand_beside_the_trajectory_line_by_line(results):
    t, covariances = read_covariances(results / "trajectory_covariance.txt")
    np.testing.assert_array_equal(t, read_tum(results / "trajectory.tum").t)
    summary = json.loads((results / "summary.json").read_text())
    assert "trajectory_covariance.txt" in summary["files"]
    found = summary["covariance"]
    assert found["sigma_end_m"] == pytest.approx(np.sqrt(np.trace(covariances[-1, :2, :2])))
    assert found["sigma_end_m"] <= found["sigma_max_m"] < 0.05
    assert 0.0 <= found["truth_within_90"] <= 1.0


def test_the_map_shows_the_room_where_it_is(results):
    """Occupied cells lie on the four walls, in world coordinates that yaml file and image row order give."""
    spec, cells = read_map(results / "map.yaml")
    iy, ix = np.nonzero(cells == 1)
    points = spec.cell_to_world(np.column_stack([ix, iy]))
    start = box_recording().truth.poses[0]  # the filter's origin is its first scan
    c, s = np.cos(start[2]), np.sin(start[2])
    x, y = (points @ [[c, s], [-s, c]] + start[:2]).T
    distance = np.abs([x - ROOM[0], x - ROOM[1], y - ROOM[2], y - ROOM[3]])
    assert (distance.min(axis=0) < 0.1).mean() > 0.95
    assert (distance < 0.1).any(axis=1).all()  # all four walls are there
    assert set(np.unique(cv2.imread(str(results / "map.pgm"), cv2.IMREAD_UNCHANGED))) == {0, 205, 254}


def test_the_same_seed_gives_the_same_files(results, data, tmp_path):
    pfslam("run", 7, "--data", data, "--out", tmp_path, "--particles", 20, "--every", 5)
    for name in ("trajectory.tum", "odometry.tum", "map.pgm", "map.yaml", "texture.png", "texture.yaml"):
        assert (tmp_path / name).read_bytes() == (results / name).read_bytes()


def test_poses_that_the_truth_does_not_cover_are_counted(tmp_path):
    recording = box_recording(images=0)
    half = len(recording.truth) // 2
    truth = Trajectory(recording.truth.t[:half], recording.truth.poses[:half])
    save_course(replace(recording, truth=truth), 7, tmp_path)
    assert main(["run", "7", "--data", str(tmp_path), "--out", str(tmp_path), "--particles", "5"]) == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    not_compared = summary["dropped"]["poses outside the truth's time, not compared"]
    assert summary["slam"]["poses"] + not_compared == summary["scans"]
    assert not_compared == np.count_nonzero(recording.lidar.t > truth.t[-1])


def test_a_run_that_is_not_to_be_trusted_says_so_in_one_sentence():
    recording = box_recording(images=0)
    begin = float(recording.lidar.t[0])
    stretches = [
        {"from": begin + 25.0, "to": None, "reason": "scans dragged it"},
        {"from": begin + 40.0, "to": begin + 44.6, "reason": "no scan"},
    ]
    sentence = "do not trust path and map from 25 s on: scans dragged it; 1 more in summary.json"
    closing = words.closing_words(recording, {"distrust": stretches}, "here")
    assert closing.splitlines() == [sentence, "results are in here"]
    closing = words.closing_words(recording, {"distrust": stretches[1:]}, "here")
    assert closing.splitlines() == [
        "do not trust path and map from 40 s to 45 s: no scan",
        "results are in here",
    ]
    assert words.closing_words(recording, {"distrust": []}, "here") == "results are in here"
    again = words.closing_words(recording, {"second_look": True, "distrust": []}, "here")
    assert "the run was done again with care\nresults" in again


def test_options_reach_the_filter(data, tmp_path):
    done = pfslam(
        *("run", 7, "--data", data, "--out", tmp_path, "--method", "report"),
        *("--particles", 5, "--every", 10, "--seed", 3, "--no-texture"),
    )
    assert done.returncode == 0
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["config"]["particles"], summary["config"]["every"], summary["seed"]) == (5, 10, 3)
    assert summary["config"]["noise"]["kind"] == "ControlNoise"
    assert sorted(p.name for p in tmp_path.iterdir()) == CONTRACT_FILES


def test_without_lidar_it_says_so_and_writes_odometry(data, tmp_path):
    done = pfslam("run", 8, "--data", data, "--out", tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert "no LiDAR" in done.stdout
    assert sorted(p.name for p in tmp_path.iterdir()) == ["odometry.tum", "summary.json"]
    odometry = read_tum(tmp_path / "odometry.tum")
    np.testing.assert_array_equal(odometry.t, box_recording().imu.t)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["scans"] == summary["updates"] == 0
    assert "slam" not in summary


def test_the_default_folder_is_out_and_the_name(data, tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "pfslam", "run", "8"],
        cwd=tmp_path,
        env=os.environ | {"PFSLAM_DATA": str(data)},
    )
    assert done.returncode == 0
    assert (tmp_path / "out" / "8" / "odometry.tum").exists()


def test_a_carmen_log_runs(tmp_path):
    """The room again, as an old log would hold it: 181 beams, every scan used."""
    recording = box_recording(images=0)
    lines = []
    for t, ranges, pose in zip(recording.lidar.t, recording.lidar.ranges, recording.truth.poses, strict=True):
        beams = " ".join(f"{r:.3f}" for r in ranges[180:901:4])
        x, y, theta = pose
        laser = f"{x + 0.13323 * np.cos(theta)} {y + 0.13323 * np.sin(theta)} {theta}"
        lines.append(f"FLASER 181 {beams} {laser} {x} {y} {theta} {t:.6f} robot {t:.6f}")
    log = tmp_path / "box.v1.log"
    log.write_text("\n".join(lines))
    done = pfslam("run", log, "--out", tmp_path / "o", "--particles", 20)
    assert (done.returncode, done.stderr) == (0, "")
    estimate = read_tum(tmp_path / "o" / "trajectory.tum")
    assert len(estimate) == len(lines)
    odometry = read_tum(tmp_path / "o" / "odometry.tum")
    apart = np.hypot(*(estimate.poses - odometry.poses)[:, :2].T)
    assert apart.max() < 0.1


# ---- simulate and report -----------------------------------------------------------------------


def test_simulate_writes_a_set_that_loads(tmp_path, monkeypatch):
    monkeypatch.setenv("PFSLAM_CACHE", str(tmp_path / "cache"))
    done = pfslam("simulate", "ramp", "--out", tmp_path / "d", "--seed", 5, "--images", 800)
    assert done.returncode == 0
    recording = load_course(21, tmp_path / "d")
    assert len(recording.camera.rgb_index) == len(recording.camera.disparity_index) == 3
    assert recording.camera.read_rgb(recording.camera.rgb_index[1]).shape == (480, 640, 3)
    np.testing.assert_array_equal(recording.truth.poses[0], 0.0)
    with np.load(tmp_path / "d" / "truth21.npz") as truth:
        assert truth["z"].shape == truth["pitch"].shape == recording.truth.t.shape
    assert not (tmp_path / "cache").exists()  # only the built-in building is kept


def test_simulate_puts_hazards_into_the_building(tmp_path, monkeypatch):
    asked = {}

    def simulate(name, seed, *, progress, hazards):
        asked[name] = (seed, hazards)
        few_beams = replace(simulator.HALL.robot, lidar=LidarModel(beams=31))
        return simulator.simulate(replace(simulator.HALL, robot=few_beams), seed, hazards=hazards)

    monkeypatch.setattr(commands, "simulate", simulate)
    line = "simulate hall --people 1 --doors --glass --sweep 0.02 --bumps --slip --out"
    assert main([*line.split(), str(tmp_path)]) == 0
    assert asked == {"hall": (None, simulator.Hazards(1, 4, 0.1, 0.02, 8, 3))}
    with np.load(tmp_path / "Hokuyo20.npz") as scans:
        assert scans["sweep"] == 0.02
    assert load_course(20, tmp_path).robot.lidar.sweep == 0.02


@pytest.mark.parametrize(
    ("option", "value", "expected"),
    [
        ("--people", "-1", "found -1, expected a whole number from 0 to 1000"),
        ("--people", "2.5", "found 2.5, expected a whole number from 0 to 1000"),
        ("--sweep", "3", "found 3, expected a number from 0 to 1"),
        ("--sweep", "nan", "found nan, expected a number from 0 to 1"),
    ],
)
def test_a_hazard_out_of_range_is_named_as_it_was_typed(option, value, expected, tmp_path, capsys):
    assert main(["simulate", "hall", option, value, "--out", str(tmp_path / "d")]) == 2
    assert capsys.readouterr().err == f"pfslam: simulate: {option}: {expected}\n"
    assert not (tmp_path / "d").exists()


def test_report_draws_its_six_figures_without_the_book(tmp_path, data, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setitem(sys.modules, "pfslam_book", None)
    assert main(["report", "7", "--data", str(data), "--out", str(tmp_path)]) == 0
    names = (
        "dead_reckoning_trajectory prediction_only dead_reckoning_map slam_map slam_trajectory texture_map"
    )
    assert sorted(p.stem for p in tmp_path.glob("*.png")) == sorted(names.split())
    for path in tmp_path.iterdir():
        pixels = cv2.imread(str(path))
        assert pixels.shape == (930, 1020, 3)
        assert (pixels < 128).any(axis=2).mean() > 0.005, path.name


def test_report_without_matplotlib_is_one_line(tmp_path, data, monkeypatch, capsys):
    for name in ["matplotlib", *(name for name in sys.modules if name.startswith("matplotlib."))]:
        monkeypatch.setitem(sys.modules, name, None)
    assert main(["report", "7", "--data", str(data), "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "package: found no matplotlib" in said
    assert "pfslam[plots]" in said


# ---- bad input: exit code 2, one line, no traceback --------------------------------------------

BAD_LINES = [
    [],
    ["fly"],
    ["run"],
    ["run", "nowhere"],
    ["run", ""],
    ["run", "."],
    ["run", "two\nlines"],
    ["run", "7", "--data", "no such folder"],
    ["run", "9", "--data", "DATA"],
    ["run", "7", "--data", "DATA", "--method", "best"],
    ["run", "7", "--data", "DATA", "--particles", "0"],
    ["run", "7", "--data", "DATA", "--particles", "many"],
    ["run", "7", "--data", "DATA", "--method", "matching", "--particles", "5"],
    ["run", "7", "--data", "DATA", "--particles", "9" * 30],
    ["run", "7", "--data", "DATA", "--every", "0"],
    ["run", "7", "--data", "DATA", "--seed", "-1"],
    ["run", "7", "--data", "DATA", "--seed", "1.5"],
    ["run", "7", "--data", "DATA", "--part", "5"],
    ["run", "7", "--data", "DATA", "--out", "DATA/Imu7.npz"],
    ["run", "7", "--data", "DATA", "--out", "DATA/Imu7.npz/deeper"],
    ["run", "8", "--data", "DATA", "--texture"],
    ["run", "8", "--data", "DATA", "--loops"],
    ["run", "DATA/Imu7.npz"],
    ["simulate", "hall"],
    ["simulate", "attic", "--out", "x"],
    ["simulate", "hall", "--out", "DATA/Imu7.npz"],
    ["simulate", "hall", "--out", "x", "--images", "0"],
    ["simulate", "hall", "--out", "x", "--people", "many"],
    ["simulate", "hall", "--out", "x", "--people"],
    ["simulate", "hall", "--out", "x", "--doors", "4"],
    ["report", "nowhere"],
    ["study"],
]


@pytest.mark.parametrize("line", BAD_LINES, ids=" ".join)
def test_bad_input_is_one_line(line, data, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([word.replace("DATA", str(data)) for word in line]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("pfslam: ")
    assert said.err.endswith("\n")
    assert len(said.err.splitlines()) == 1
    assert not any(p.is_file() for p in tmp_path.rglob("*"))


def test_a_damaged_image_stops_the_run_with_its_name(data, tmp_path):
    save_course(box_recording(), 7, tmp_path, image_every=1)
    path = tmp_path / "dataRGBD" / "Disparity7" / "disparity7_2.png"
    path.write_bytes(path.read_bytes()[:-40])
    done = pfslam("run", 7, "--data", tmp_path, "--out", tmp_path / "o", "--particles", 5)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "disparity7_2.png" in done.stderr
    assert list((tmp_path / "o").iterdir()) == []


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="no /proc")
@pytest.mark.parametrize("words", ["run 7", "simulate hall", "report 7"])
def test_a_folder_that_nobody_may_write_to(words, data, monkeypatch, capsys):
    """Not even root makes a folder in /proc. The refusal comes at once, before any work is done."""
    monkeypatch.setenv("PFSLAM_DATA", str(data))
    assert main([*words.split(), "--out", "/proc/results"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "/proc/results" in said


def test_a_full_disk(data, tmp_path, monkeypatch, capsys):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "replace", full)
    assert main(["run", "8", "--data", str(data), "--out", str(tmp_path)]) == 2
    assert "No space left on device" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("fault", "code"), [(ZeroDivisionError("two\nlines"), 1), (MemoryError(), 2)], ids=repr
)
def test_a_fault_of_ours_and_too_little_memory_are_one_line_too(data, monkeypatch, capsys, fault, code):
    def broken(_):
        raise fault

    monkeypatch.setattr(commands, "run_command", broken)
    assert main(["run", "8", "--data", str(data)]) == code
    assert len(capsys.readouterr().err.splitlines()) == 1
    if code == 1:  # who asks is shown where
        monkeypatch.setenv("PFSLAM_DEBUG", "1")
        with pytest.raises(ZeroDivisionError):
            main(["run", "8", "--data", str(data)])


STUDY = """[common]
dataset = "7"
seed = { count = 2000 }
"""


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize(
    ("words", "begun"),
    [
        ("run 7 --particles 20000 --every 1 --out o", "o"),
        pytest.param("study s.toml --out o --jobs 2", "o/runs/*/*.json", marks=pytest.mark.slow),
    ],
    ids=["run", "study"],
)
def test_ctrl_c_is_answered_and_leaves_nothing_half_written(tmp_path, words, begun):
    """The work lasts so long that it cannot end before it is stopped. A terminal tells the workers of a study too."""
    save_course(box_recording(seconds=300.0 if begun == "o" else 6.0, images=0), 7, tmp_path / "data")
    (tmp_path / "s.toml").write_text(STUDY)
    process = subprocess.Popen(
        [sys.executable, "-m", "pfslam", *words.split()],
        cwd=tmp_path,
        env=os.environ | {"PFSLAM_DATA": str(tmp_path / "data")},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while not any(tmp_path.glob(begun)) and process.poll() is None:  # until it has begun
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said.replace("\r", "\n").endswith("pfslam: interrupted\n")
    assert "Traceback" not in said
    assert begun != "o" or list((tmp_path / "o").iterdir()) == []


@pytest.mark.skipif(os.name == "nt", reason="Windows reports a closed pipe as any other fault")
def test_output_that_nobody_reads_is_no_fault(data, tmp_path):
    command = [sys.executable, "-m", "pfslam", "run", "8", "--data", str(data), "--out", str(tmp_path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()
    process.wait()
    assert process.stderr.read() == b""
    process.stderr.close()


@pytest.mark.slow
def test_a_built_in_set_written_and_loaded_gives_the_same_results(tmp_path):
    options = ("--particles", 5, "--every", 40, "--no-texture")
    environment = {"PFSLAM_CACHE": str(tmp_path / "cache")}
    assert pfslam("simulate", "hall", "--out", tmp_path / "d", **environment).returncode == 0
    assert pfslam("run", "hall", "--out", tmp_path / "a", *options, **environment).returncode == 0
    assert pfslam("run", 20, "--data", tmp_path / "d", "--out", tmp_path / "b", *options).returncode == 0
    for name in ("trajectory.tum", "odometry.tum", "map.pgm", "map.yaml"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_run_with_loops_writes_the_revised_path_and_map_beside_the_others(data, tmp_path, capsys):
    out = tmp_path / "o"
    assert main(["run", "7", "--data", str(data), "--out", str(out), "--method", "matching", "--loops"]) == 0
    summary = json.loads((out / "summary.json").read_text())
    new = {"trajectory_revised.tum", "map_revised.pgm", "map_revised.yaml"}
    assert new <= set(summary["files"]) == {path.name for path in out.iterdir()}
    assert summary["loops"].keys() == {"key_scans", "candidates", "accepted", "largest_move_m"}
    assert "loops" in summary["seconds"]
    path, revised = read_tum(out / "trajectory.tum"), read_tum(out / "trajectory_revised.tum")
    assert np.array_equal(path.t, revised.t)
    moved = np.hypot(*(path.poses - revised.poses)[:, :2].T).max()
    assert moved == pytest.approx(summary["loops"]["largest_move_m"], abs=1e-5)


def test_help_names_every_command_and_loads_nothing():
    code = "import sys; from pfslam.cli.parser import *; build_parser().print_help(); print('numpy' in sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout
    names = ("simulate", "info", "check", "run", "locate", "report", "convert", "study", "lab")
    assert all(f"\n    {name} " in said for name in names)
    assert said.endswith("False\n")
