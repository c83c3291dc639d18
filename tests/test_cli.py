"""The command line, run as a user runs it."""

import importlib
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest
from box_recording import ROOM, box_recording
from evo.core import metrics as evo_metrics
from evo.core import sync
from evo.tools import file_interface

import pfslam
from pfslam import simulator
from pfslam.__main__ import main
from pfslam.cli import commands, words
from pfslam.cli.main import THREADS
from pfslam.io.course import load_course, save_course
from pfslam.io.formats import read_covariances, read_map, read_tum, write_tum
from pfslam.io.recordings import save
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory
from pfslam.sensors import LidarModel

CONTRACT_FILES = ["map.pgm", "map.yaml", "odometry.tum", "summary.json", "trajectory.tum"]
PICTURES = ["index.html", "map.png"]
WITH_ERRORS = ("wheel_scale", "gyro_scale", "gyro_bias")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """The box recording as set 7 and, without LiDAR and images, as set 8."""
    folder = tmp_path_factory.mktemp("some data.v1")
    save_course(box_recording(), 7, folder, image_every=1)
    save_course(replace(box_recording(images=0), lidar=None), 8, folder)
    return folder


def started(folder, line, data, **options):
    """Start the command line in a process of its own, in a folder."""
    command = [sys.executable, "-m", "pfslam", *line.split()]
    environment, pipe = os.environ | {"PFSLAM_DATA": str(data)}, subprocess.PIPE
    return subprocess.Popen(
        command, cwd=folder, env=environment, stdout=pipe, stderr=pipe, text=True, **options
    )


@pytest.fixture(scope="module")
def results(data, tmp_path_factory):
    """What ``run`` leaves for set 7."""
    folder = tmp_path_factory.mktemp("out of box.1")
    process = started(folder, "run 7 --particles 20 --every 5", data)
    assert (process.communicate(timeout=300)[1], process.returncode) == ("", 0)
    return folder / "out" / "7"


def summary_in(folder):
    return json.loads((folder / "summary.json").read_text())


# ---- run: what it leaves -----------------------------------------------------------------------


@pytest.mark.slow
def test_run_leaves_all_files_and_a_summary_that_holds_what_the_contract_names(results):
    more = [*PICTURES, "texture.png", "texture.yaml", "trajectory_covariance.txt"]
    summary, scans = summary_in(results), len(box_recording().lidar.t[::5])
    assert {p.name for p in results.iterdir()} == {*summary["files"]} == {*CONTRACT_FILES, *more}
    assert (summary["config"]["particles"], summary["config"]["every"], summary["seed"]) == (20, 5, 0)
    assert set(summary["seconds"]) == {"load", "dead_reckoning", "slam", "texture", "write"}
    found = [summary[name] for name in ("scans", "updates", "lost", "distrust")]
    assert found == [scans, scans - 1, 0, []]
    assert 0 <= summary["resamplings"] < scans
    assert all(isinstance(count, int) for count in summary["dropped"].values())
    # Exact wheels and gyro: scales of one, to within what the grid allows.
    found = summary["calibration"]
    assert found["applied"] is False
    assert [found[name] for name in WITH_ERRORS] == pytest.approx([1.0, 1.0, 0.0], abs=0.03)


def test_evo_agrees_with_the_summary(results, data, tmp_path):
    recording, odometry = load_course(7, data), read_tum(results / "odometry.tum")
    np.testing.assert_allclose(odometry.poses, dead_reckoning(recording).at(odometry.t), atol=1e-9)
    write_tum(tmp_path / "truth.tum", recording.truth)
    for file, name in (("trajectory.tum", "slam"), ("odometry.tum", "odometry")):
        reference = file_interface.read_tum_trajectory_file(tmp_path / "truth.tum")
        estimate = file_interface.read_tum_trajectory_file(results / file)
        reference, estimate = sync.associate_trajectories(reference, estimate)
        estimate.align_origin(reference)
        ape = evo_metrics.APE(evo_metrics.PoseRelation.translation_part)
        ape.process_data((reference, estimate))
        rmse = ape.get_statistic(evo_metrics.StatisticsType.rmse)
        assert rmse == pytest.approx(summary_in(results)[name]["ate_rmse_m"], abs=1e-6)


def test_covariances_stand_beside_the_trajectory_line_by_line(results):
    t, covariances = read_covariances(results / "trajectory_covariance.txt")
    np.testing.assert_array_equal(t, read_tum(results / "trajectory.tum").t)
    found = summary_in(results)["covariance"]
    assert found["sigma_end_m"] == pytest.approx(np.sqrt(np.trace(covariances[-1, :2, :2])))
    heading = np.rad2deg(np.sqrt(covariances[:, 2, 2]))
    assert found["heading_sigma_end_deg"] == pytest.approx(heading[-1])
    assert found["heading_sigma_max_deg"] == pytest.approx(heading.max())
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


def misled(tmp_path, mishap):
    """A short drive in the box among the named mishap, as a file."""
    drive = box_recording(seconds=8.0, images=0)
    ranges, t = drive.lidar.ranges.copy(), drive.lidar.t - drive.lidar.t[0]
    rng = np.random.default_rng(0)
    if mishap == "people":  # who walk ahead: half of the beams end at one distance, whatever the robot does
        ranges[t > 2.0, 200:-200] = 0.8
    elif mishap == "noise":
        ranges += rng.normal(0.0, 0.06, ranges.shape).astype(ranges.dtype)
    elif mishap == "glass":
        ranges[:, ::3] += rng.random(ranges[:, ::3].shape) < 0.5
    save(replace(drive, lidar=replace(drive.lidar, ranges=ranges)), tmp_path / "drive.npz")
    return str(tmp_path / "drive.npz")


REPEATED = {
    "refined": "--method refined --every 5 --particles 4 --set search.sharpness=30 --set draw_metres=inf",
    "report": "--method report --every 10 --particles 4 --set noise.sigma_v=0.2",
    "matching": "--method matching --set outliers=true --set outliers.gate=inf",
    "per-particle": "--method per-particle --particles 3 --every 10 --from 1.5 --set map.clamp=inf",
    "one look": "--no-second-look --particles 5 --set lines.min_hits=4 --from 1",
    "robust": "--particles 5 --set outliers=true --set lines.elongation=1.5",
}


@pytest.mark.parametrize("mishap", ["none", "people", "noise", "glass"])
@pytest.mark.parametrize("options", REPEATED)
def test_a_run_is_repeated_from_its_own_summary(tmp_path, options, mishap):
    line, name = ["run", misled(tmp_path, mishap), "--anyway", "--quiet"], options
    options = REPEATED[name].split()
    code = main([*line, *options, "--seed", "3", "--out", str(tmp_path / "first")])
    part = ["--from", options[options.index("--from") + 1]] if "--from" in options else []
    summary = str(tmp_path / "first" / "summary.json")
    assert main([*line, *part, "--config", summary, "--out", str(tmp_path / "again")]) == code
    first, second = (summary_in(tmp_path / name) for name in ("first", "again"))
    may = bool({"refined", "matching", "outliers=true"} & set(options)) and "--no-second-look" not in options
    # Where the first run has taken care already, the second is no better among these people.
    assert first["second_look"] == (may and (mishap == "noise" or (mishap == "people" and name == "refined")))
    for field in ("config", "method", "seed", "second_look_allowed", "slam"):
        assert first[field] == second[field]
    assert first["files"] == second["files"]
    for name in {*first["files"]} - {"summary.json", "index.html"}:
        one, other = (tmp_path / which / name for which in ("first", "again"))
        assert one.read_bytes() == other.read_bytes()


def test_a_summary_says_whether_the_run_took_robust_settings_of_its_own(tmp_path):
    line = ["run", misled(tmp_path, "noise"), "--particles", "4", "--every", "9", "--anyway", "--quiet"]
    expected = {"": (True, True, True), "--no-second-look": (False, False, False)}
    expected["--set outliers=true --no-second-look"] = (False, False, True)
    for options, wanted in expected.items():
        main([*line, *options.split(), "--out", str(tmp_path / "o")])
        found = summary_in(tmp_path / "o")
        robust = found["config"]["outliers"] is not None
        assert (found["second_look"], found["second_look_allowed"], robust) == wanted, options
    (tmp_path / "once.toml").write_text("second_look = false\n")
    main([*line, "--config", str(tmp_path / "once.toml"), "--out", str(tmp_path / "o")])
    assert summary_in(tmp_path / "o")["config"]["outliers"] is None


def test_settings_come_from_a_file_and_options_win(data, tmp_path, capsys):
    file = tmp_path / "run.toml"
    file.write_text(
        'method = "matching"\nevery = 10\nlines = false\n[search]\nsharpness = 20\n', encoding="utf-8"
    )
    line = ["run", "7", "--data", str(data), "--config", str(file), "--no-texture", "--json"]
    assert main([*line, "--set", "search.cells=[3, 5]", "--every", "12", "--out", str(tmp_path / "o")]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary == summary_in(tmp_path / "o")
    config = summary["config"]
    assert (summary["method"], config["every"], config["lines"]) == ("matching", 12, None)
    assert (config["search"]["sharpness"], config["search"]["cells"]) == (20.0, [3, 5])


def test_quiet_says_nothing_and_the_version_is_known(data, tmp_path, capsys):
    line = ["run", "7", "--data", str(data), "--particles", "4", "--every", "20", "--no-texture"]
    assert main([*line, "--quiet", "--out", str(tmp_path)]) == 0
    assert capsys.readouterr() == ("", "")
    with pytest.raises(SystemExit):
        main(["--version"])
    assert capsys.readouterr().out == f"pfslam {pfslam.__version__}\n"


@pytest.mark.parametrize("asked", [{}, {"OMP_NUM_THREADS": "3"}])
def test_linear_algebra_takes_one_thread_unless_asked(monkeypatch, asked):
    monkeypatch.setattr(os, "environ", dict(asked))
    main(["info", "nothing"])
    assert {name: value for name, value in os.environ.items() if "THREADS" in name} == (
        asked or dict.fromkeys(THREADS, "1")
    )


@pytest.mark.parametrize(
    ("content", "name", "words"),
    [
        ("search.sharp = 3", "a.toml", "key: found 'search.sharp', expected a field of SearchConfig"),
        ("particles = 0", "a.toml", "particles: found 0, expected a whole number from 1"),
        ("method = 'best'", "a.toml", "method: found 'best', expected one of"),
        ("method = ['matching']", "a.toml", "method: found ['matching'], expected one of"),
        ("seed = true", "a.toml", "seed: found True, expected a whole number"),
        ("seed = -1", "a.toml", "seed: found -1, expected a whole number"),
        ("second_look = 1", "a.toml", "second_look: found 1, expected true or false"),
        ("[search", "a.toml", "expected TOML"),
        ("{}", "a.json", "config: found nothing, expected the settings of a run"),
        ("[" * 9000, "a.json", "expected JSON"),
    ],
)
def test_a_bad_file_of_settings_is_one_line(data, tmp_path, capsys, content, name, words):
    (tmp_path / name).write_text(content, encoding="utf-8")
    assert main(["run", "7", "--data", str(data), "--config", str(tmp_path / name)]) == 2
    complaint = capsys.readouterr().err
    assert words in complaint
    assert name in complaint
    assert complaint.count("\n") == 1


def test_a_run_with_loops_writes_the_revised_beside_the_rest_and_one_without_clears_it_away(data, tmp_path):
    line = ["run", "7", "--data", str(data), "--out", str(tmp_path), "--method", "matching"]
    (tmp_path / "mine.png").write_bytes(b"")
    assert main([*line, "--loops"]) == 0
    summary = summary_in(tmp_path)
    new = {"trajectory_revised.tum", "map_revised.pgm", "map_revised.yaml", "map_revised.png"}
    assert new <= set(summary["files"])
    assert {*summary["files"], "mine.png"} == {path.name for path in tmp_path.iterdir()}
    assert summary["loops"].keys() == {"key_scans", "candidates", "accepted", "largest_move_m"}
    path, revised = read_tum(tmp_path / "trajectory.tum"), read_tum(tmp_path / "trajectory_revised.tum")
    moved = np.hypot(*(path.poses - revised.poses)[:, :2].T).max()
    assert moved == pytest.approx(summary["loops"]["largest_move_m"], abs=1e-5)
    assert main(line) == 0
    plain = summary_in(tmp_path)["files"]
    assert new.isdisjoint(plain)
    assert {*plain, "mine.png"} == {path.name for path in tmp_path.iterdir()}


def test_poses_that_the_truth_does_not_cover_are_counted(tmp_path):
    recording = box_recording(images=0)
    half = len(recording.truth) // 2
    truth = Trajectory(recording.truth.t[:half], recording.truth.poses[:half])
    save_course(replace(recording, truth=truth), 7, tmp_path)
    assert main(["run", "7", "--data", str(tmp_path), "--out", str(tmp_path), "--particles", "5"]) == 0
    summary = summary_in(tmp_path)
    not_compared = summary["dropped"]["poses outside the truth's time, not compared"]
    assert summary["slam"]["poses"] + not_compared == summary["scans"]
    assert not_compared == np.count_nonzero(recording.lidar.t > truth.t[-1])


def test_without_lidar_it_says_so_and_writes_odometry(data, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PFSLAM_DATA", str(data))
    assert main(["run", "8"]) == 0
    assert "no LiDAR" in capsys.readouterr().out
    out = tmp_path / "out" / "8"
    assert sorted(p.name for p in out.iterdir()) == ["index.html", "odometry.tum", "summary.json"]
    np.testing.assert_array_equal(read_tum(out / "odometry.tum").t, box_recording().imu.t)
    summary = summary_in(out)
    assert summary["scans"] == summary["updates"] == 0
    assert "slam" not in summary


def test_a_run_that_is_not_to_be_trusted_says_so_in_one_sentence():
    recording, end = box_recording(images=0), "results are in here"
    begin = float(recording.lidar.t[0])
    dragged = {"from": begin + 25.0, "to": None, "reason": "scans dragged it"}
    blind = {"from": begin + 40.0, "to": begin + 44.6, "reason": "no scan"}
    for summary, sentence in (
        ({"distrust": []}, ""),
        ({"distrust": [blind]}, "do not trust path and map from 40 s to 45 s: no scan\n"),
        (
            {"distrust": [dragged, blind]},
            "do not trust path and map from 25 s on: scans dragged it; summary.json lists 1 more\n",
        ),
        (
            {"distrust": [], "second_look": True},
            "people, glass or noise mislead the scans, so the run was made with robust settings\n",
        ),
    ):
        assert words.closing_words(recording, summary, "here") == sentence + end


# ---- simulate and report -----------------------------------------------------------------------


@pytest.mark.slow
def test_simulate_writes_a_set_that_loads(tmp_path, monkeypatch):
    monkeypatch.setenv("PFSLAM_CACHE", str(tmp_path / "cache"))
    out = tmp_path / "d"
    assert main(["simulate", "ramp", "--out", str(out), "--seed", "5", "--images", "800"]) == 0
    with np.load(
        out / "truth21.npz", allow_pickle=False
    ) as truth:  # on slopes the truth has a height and a lean
        assert all(np.abs(truth[name]).max() > 0.05 for name in ("z", "pitch"))
    recording = load_course(21, out)
    assert len(recording.camera.rgb_index) == len(recording.camera.disparity_index) == 3
    assert recording.camera.read_rgb(recording.camera.rgb_index[1]).shape == (480, 640, 3)
    assert not (tmp_path / "cache").exists()  # only the built-in building is kept


@pytest.mark.slow
def test_simulate_puts_hazards_into_the_building(tmp_path, monkeypatch):
    asked, whole = {}, simulator.simulate

    def simulate(name, seed, *, progress, hazards):
        asked[name] = (seed, hazards)
        few_beams = replace(simulator.HALL.robot, lidar=LidarModel(beams=31))
        return whole(replace(simulator.HALL, robot=few_beams), seed, hazards=hazards)

    monkeypatch.setattr(simulator, "simulate", simulate)
    line = "simulate hall --people 1 --doors --glass --sweep 0.02 --bumps --slip --out"
    assert main([*line.split(), str(tmp_path)]) == 0
    assert asked == {"hall": (None, simulator.Hazards(1, 4, 0.1, 0.02, 8, 3))}
    assert load_course(20, tmp_path).robot.lidar.sweep == 0.02


@pytest.mark.slow
def test_report_draws_its_six_figures_without_the_book(tmp_path, data, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setitem(sys.modules, "pfslam_book", None)
    assert main(["report", "7", "--data", str(data), "--out", str(tmp_path)]) == 0
    names = (
        "dead_reckoning_map dead_reckoning_trajectory prediction_only slam_map slam_trajectory texture_map"
    )
    assert [p.stem for p in sorted(tmp_path.glob("*.png"))] == names.split()
    for path in tmp_path.iterdir():
        pixels = cv2.imread(str(path))
        assert pixels.shape == (930, 1020, 3)
        assert (pixels < 128).any(axis=2).mean() > 0.005, path.name


def test_report_without_matplotlib_is_one_line(data, monkeypatch, capsys):
    for name in ["matplotlib", *(name for name in sys.modules if name.startswith("matplotlib."))]:
        monkeypatch.setitem(sys.modules, name, None)
    assert main(["report", "7", "--data", str(data)]) == 2
    assert "no matplotlib, expected the extra plots, or: pip install matplotlib" in capsys.readouterr().err


# ---- bad input: exit code 2, one line, no traceback --------------------------------------------

BAD_LINES = {
    "": "the following arguments are required: COMMAND",
    "fly": "invalid choice: 'fly'",
    "run": "required: DATASET",
    "run nowhere": "expected hall, ramp, ring, the number of a set",
    "run 7 --data DATA/none": "no such folder",
    "run 9 --data DATA": "Encoders9.npz",
    "run DATA/Imu7.npz": "a key named format",
    "run 7 --data DATA --method best": "--method: invalid choice",
    "run 7 --data DATA --particles 0": "run: --particles: found 0, expected a whole number from 1 to 100000",
    "run 7 --data DATA --particles many": "--particles: 'many' is not a number",
    "run 7 --data DATA --method matching --particles 5": "--particles: found 5, expected 1 with matching",
    "run 7 --data DATA --every 0": "--every: found 0",
    "run 7 --data DATA --seed -1": "--seed",
    "run 7 --data DATA --seed 1.5": "--seed: '1.5' is not a whole number from 0 to",
    "run 7 --data DATA --part 5": "unrecognized arguments: --part 5",
    "run 7 --data DATA --scan /scan": "no ROS bag",
    "run 7 --data DATA --lidar-at 0 0 left": "--lidar-at: 'left' is not a number",
    "run 7 --data DATA --out DATA/Imu7.npz": "a folder that can be written",
    "run 7 --data DATA --out DATA/Imu7.npz/deeper": "a folder that can be written",
    "run 8 --data DATA --texture": "--texture: found no images",
    "run 8 --data DATA --loops": "--loops: found no LiDAR",
    "locate none.yaml 8 --data DATA": "none.yaml",
    "locate none.yaml 8 --set sigma=0": "locate: --set sigma: found 0, expected a number from 0.001",
    "locate none.yaml 8 --set sigma": "locate: --set: found 'sigma', expected NAME=VALUE",
    "locate none.yaml 8 --set lines=false": "'--set lines', expected a field of LocalizationConfig",
    "locate none.yaml 8 --particles 0": "locate: --particles: found 0",
    "locate none.yaml 8 --config none.toml": "none.toml",
    "info DATA": "the number of a set",
    "simulate hall": "required: --out",
    "simulate attic --out x": "invalid choice: 'attic'",
    "simulate hall --out DATA/Imu7.npz": "a folder that can be written",
    "simulate hall --out x --images 0": "--images: '0' is not a whole number from 1 to",
    "simulate hall --out x --people -1": "simulate: --people: found -1, expected a whole number from 0 to 1000",
    "simulate hall --out x --people 2.5": "simulate: --people: found 2.5, expected a whole number from 0 to 1000",
    "simulate hall --out x --sweep nan": "simulate: --sweep: found nan, expected a number from 0 to 1",
    "simulate hall --out x --doors 4": "unrecognized arguments: 4",
    "convert 8 a.mat --data DATA": "a name that ends in .npz",
    "study none.toml": "none.toml",
}


@pytest.mark.parametrize("line", BAD_LINES)
def test_bad_input_is_one_line(line, data, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([word.replace("DATA", str(data)) for word in line.split()]) == 2
    said = capsys.readouterr()
    assert (said.out, said.err.count("\n")) == ("", 1)
    assert said.err.startswith("pfslam: ")
    assert BAD_LINES[line] in said.err
    assert not any(p.is_file() for p in tmp_path.rglob("*"))


def test_a_damaged_image_costs_its_pair_and_a_line(tmp_path, capsys):
    save_course(box_recording(), 7, tmp_path, image_every=1)
    paths = sorted((tmp_path / "dataRGBD" / "Disparity7").iterdir())
    line = ["run", "7", "--data", str(tmp_path), "--out", str(tmp_path / "o"), "--particles", "5"]
    paths[1].write_bytes(paths[1].read_bytes()[:-40])
    assert main(line) == 0
    words = f"pairs: an image that cannot be read, first {paths[1].name}"
    assert f"left out: 1 {words}" in capsys.readouterr().out
    summary = summary_in(tmp_path / "o")
    assert (summary["dropped"][words], summary["image_pairs"]) == (1, len(paths) - 1)
    for path in paths:
        path.write_bytes(b"")
    assert main(line) == 2
    assert paths[0].name in capsys.readouterr().err


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="no /proc")
@pytest.mark.parametrize("words", ["run 7", "simulate hall", "report 7"])
def test_a_folder_that_nobody_may_write_to(words, data, monkeypatch, capsys):
    """Not even root makes a folder in /proc. The refusal comes at once, before any work is done."""
    monkeypatch.setenv("PFSLAM_DATA", str(data))
    assert main([*words.split(), "--out", "/proc/results"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "/proc/results" in said


@pytest.mark.parametrize(
    ("fault", "code"), [(ZeroDivisionError("two\nlines"), 1), (MemoryError(), 2)], ids=repr
)
def test_a_fault_of_ours_and_too_little_memory_are_one_line_too(monkeypatch, capsys, fault, code):
    def broken(_):
        raise fault

    monkeypatch.setattr(commands, "run_command", broken)
    assert main(["run", "8"]) == code
    assert len(capsys.readouterr().err.splitlines()) == 1
    if code == 1:  # who asks is shown where
        monkeypatch.setenv("PFSLAM_DEBUG", "1")
        with pytest.raises(ZeroDivisionError):
            main(["run", "8"])


def test_a_package_that_is_missing_or_too_old_is_one_line(data, tmp_path, monkeypatch, capsys):
    line = ["run", "7", "--data", str(data), "--out", str(tmp_path), "--method", "matching", "--loops"]
    sparse = ModuleType("scipy.sparse")  # which knows nothing yet
    importlib.import_module("pfslam.beyond.loops.closing")
    with monkeypatch.context() as patch:
        patch.delattr("pfslam.beyond.loops")  # and with it, in the end, the module that others have imported
        for name in [name for name in sys.modules if name.startswith("pfslam.beyond.loops")]:
            patch.delitem(sys.modules, name)
        patch.setitem(sys.modules, "scipy.sparse", sparse)
        assert main(line) == 2
        assert "pfslam: the package scipy is missing or too old (cannot import" in capsys.readouterr().err

    def broken(_):
        raise AttributeError("module 'numpy' has no attribute 'new'")

    monkeypatch.setattr(commands, "run_command", broken)
    monkeypatch.setattr(metadata, "requires", lambda _: ["numpy>=1.26", "tqdm>=4.66; extra == 'x'"])
    for versions, said in (
        ("1.9.9", "numpy is too old: found 1.9.9, expected 1.26"),
        ("10.0", "a fault in pfslam"),
    ):
        monkeypatch.setattr(metadata, "version", {"numpy": versions, "tqdm": "4.66.1"}.get)
        assert main(line) == (2 if versions == "1.9.9" else 1)
        assert said in (words := capsys.readouterr().err)
        assert words.count("\n") == 1


def has_worker(process):
    """Whether a process has started one of joblib's, as Linux tells."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_bytes().decode().split()
    return any(b"popen_loky" in Path(f"/proc/{child}/cmdline").read_bytes() for child in children)


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize(
    ("line", "begun"),
    [
        ("run 7 --particles 20000 --every 1 --out o", "o"),
        pytest.param("study s.toml --out o --jobs 2", "o/runs/*/*.json", marks=pytest.mark.slow),
        pytest.param(
            "study s.toml --out o --jobs 2",
            None,
            marks=[
                pytest.mark.slow,
                pytest.mark.skipif(sys.platform != "linux", reason="/proc tells of workers"),
            ],
        ),
    ],
    ids=["run", "study", "study whose workers start"],
)
def test_ctrl_c_is_answered_and_leaves_nothing_half_written(tmp_path, line, begun):
    """The work lasts so long that it cannot end before it is stopped. A terminal tells the workers of a study too."""
    save_course(box_recording(seconds=300.0 if begun == "o" else 6.0, images=0), 7, tmp_path / "data")
    (tmp_path / "s.toml").write_text("[common]\ndataset = '7'\nseed = { count = 2000 }\n")
    process = started(tmp_path, line, tmp_path / "data", start_new_session=True)
    while process.poll() is None and not (any(tmp_path.glob(begun)) if begun else has_worker(process)):
        time.sleep(0.02)  # until it has begun
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said.replace("\r", "\n").endswith("pfslam: interrupted\n")
    assert "Traceback" not in said
    assert begun != "o" or list((tmp_path / "o").iterdir()) == []


@pytest.mark.skipif(os.name == "nt", reason="Windows reports a closed pipe as any other fault")
def test_output_that_nobody_reads_is_no_fault(data, tmp_path):
    process = started(tmp_path, "run 8", data)
    process.stdout.close()
    process.wait()
    assert process.stderr.read() == ""
    process.stderr.close()
