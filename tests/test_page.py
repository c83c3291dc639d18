"""The page and the pictures that a run leaves: one file, whole, harmless, small, and true to the run."""

import base64
import html
import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from box_recording import box_recording

from pfslam.__main__ import main
from pfslam.cli import page
from pfslam.cli.figures import picture_of_run
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.io.course import save_course
from pfslam.io.formats import read_map, read_tum
from pfslam.io.recordings import save
from pfslam.particles import Particles

EVIL = "</script><script>alert(1)</script><img src=x onerror=alert(1)>"
TYPES = {"int16": "<i2", "int32": "<i4", "float32": "<f4"}


def told(folder: Path) -> dict:
    """What the page of a run holds, with its arrays."""

    def unpack(value):
        if set(value) != {"type", "data"}:
            return value
        return np.frombuffer(base64.b64decode(value["data"]), TYPES[value["type"]])

    text = (folder / "index.html").read_text(encoding="utf-8")
    (data,) = re.findall(r'<script type="application/json" id="run">(.*?)</script>', text, re.DOTALL)
    return json.loads(data, object_hook=unpack)


def picture(value: dict) -> np.ndarray:
    """A picture of the page in grid order, BGR(A)."""
    data = np.frombuffer(base64.b64decode(value["image"].partition(",")[2]), np.uint8)
    return cv2.imdecode(data, cv2.IMREAD_UNCHANGED)[::-1]


@pytest.fixture(scope="module")
def box(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("box")
    save_course(box_recording(), 7, folder, image_every=1)
    save_course(replace(box_recording(images=0), lidar=None), 8, folder)
    return folder


def ran(box: Path, out: Path, *options: str, number: str = "7") -> Path:
    assert main(["run", number, "--data", str(box), "--out", str(out), "--quiet", *options]) == 0
    return out


@pytest.fixture(scope="module")
def results(box, tmp_path_factory) -> Path:
    return ran(box, tmp_path_factory.mktemp("out of box"), "--particles", "20", "--loops")


@pytest.mark.slow
def test_the_page_is_one_file_that_asks_for_nothing(results):
    text = re.sub(r"[\w+/=]{60,}", "", (results / "index.html").read_text(encoding="utf-8"))  # base64
    assert re.findall(r"https?:|//[\w.]+/|\b(?:src|href)\s*=\s*[\"']|@import|url\(|fetch\(", text) == []
    assert "default-src 'none'" in text
    assert (text.count("<script"), text.count("</script>")) == (3, 3)
    assert (results / "index.html").stat().st_size < 1_000_000
    summary = json.loads((results / "summary.json").read_text())
    assert {"index.html", "map.png", "map_revised.png"} <= set(summary["files"])


@pytest.mark.slow
def test_the_page_holds_what_the_files_say(results):
    shown, path = told(results), read_tum(results / "trajectory.tum")
    np.testing.assert_allclose(shown["t"], path.t - path.t[0], atol=1e-5)
    np.testing.assert_allclose(shown["paths"]["estimate"].reshape(-1, 3), path.poses, atol=1e-5)
    revised = read_tum(results / "trajectory_revised.tum")
    np.testing.assert_allclose(shown["paths"]["revised"].reshape(-1, 3), revised.poses, atol=1e-5)
    np.testing.assert_allclose(shown["paths"]["truth"][:3], path.poses[0], atol=1e-5)
    spec, cells = read_map(results / "map.yaml")
    kinds = picture(shown["maps"]["estimate"])[..., 0]
    assert shown["maps"]["estimate"]["extent"] == pytest.approx(spec.extent)
    np.testing.assert_array_equal(kinds, np.select([cells == 1, cells == -1], [254, 127], 0))
    assert picture(shown["floor"]).shape[2] == 4
    # The LiDAR looks round three quarters of a turn, and the first scan sees the room so far.
    blue, green, red = np.moveaxis(picture(shown["maps"]["estimate"]).astype(int), 2, 0)
    assert 0.7 < np.mean((256 * red + green)[blue > 0] == 0) < 0.85
    assert shown["about"]["command"].startswith("pfslam run 7 --data")
    cloud = shown["cloud"].reshape(len(shown["t"]), page.CLOUD, 2)
    assert np.abs(cloud).max() < 300  # millimetres from the estimate


@pytest.mark.slow
def test_maps_with_paths_have_the_pixels_of_the_maps(results):
    for name in ("map", "map_revised"):
        grey = cv2.imread(str(results / f"{name}.pgm"), cv2.IMREAD_UNCHANGED)
        drawn = cv2.imread(str(results / f"{name}.png"), cv2.IMREAD_UNCHANGED)
        assert drawn.shape == (*grey.shape, 3)
        apart = (drawn != grey[..., None]).any(axis=2)
        assert 0 < np.mean(apart) < 0.1  # the paths, and nothing else


def test_a_path_is_drawn_where_it_was_driven_and_odometry_is_dashed():
    grid = OccupancyGrid.empty(GridSpec((-1.0, -2.0), 0.05, (80, 120)))
    straight = np.array([[0.0, 1.0, 0.0], [4.0, 1.0, 0.0]])  # column 20 to 100, row 60 from below
    solid = picture_of_run(grid, {"estimate": straight})
    rows, columns = np.nonzero((solid != 205).any(axis=2))
    assert (rows.min(), rows.max()) == pytest.approx((19.5, 19.5), abs=2.5)
    assert (columns.min(), columns.max()) == pytest.approx((19.5, 99.5), abs=2.5)
    assert np.array_equal(solid[20, 60], [0, 114, 178])
    dashed = picture_of_run(grid, {"odometry": straight, "truth": np.array([[np.nan] * 3, [4.0, 2.0, 0.0]])})
    assert 0.4 < np.mean((dashed[20, 20:100] != 205).any(axis=1)) < 0.8


@pytest.mark.parametrize(
    "options", [["--method", "report"], ["--method", "matching"], ["--method", "per-particle"]]
)
@pytest.mark.slow
def test_every_method_has_a_page(box, tmp_path, options):
    shown = told(ran(box, tmp_path, *options, "--no-texture", "--every", "5"))
    assert shown["cloud"].size == shown["t"].size * 2 * page.CLOUD
    assert (shown["covariance"] is None) == (options[1] == "report")


def test_without_lidar_the_page_shows_the_path_of_the_odometry(box, tmp_path):
    shown = told(ran(box, tmp_path, number="8"))
    assert set(shown["paths"]) == {"odometry", "truth"}
    assert "maps" not in shown


def test_names_and_notes_of_others_stay_text(tmp_path):
    noted = replace(box_recording(images=0), name=EVIL, notes=(EVIL,), dropped={EVIL: 3})
    save(noted, tmp_path / "evil.npz")
    assert main(["run", str(tmp_path / "evil.npz"), "--out", str(tmp_path / "out"), "--every", "9"]) == 0
    text = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert "<script>alert" not in text
    assert "<img" not in text
    assert told(tmp_path / "out")["about"]["notes"][0] == EVIL
    assert html.escape("<script>") in text


def test_the_page_needs_no_book(box, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pfslam_book", None)
    line = ["run", "7", "--data", str(box), "--out", str(tmp_path), "--no-texture", "--every", "9"]
    assert main(line) == 0
    files = f"{tmp_path / 'index.html'} or {tmp_path / 'map.png'}"
    assert f"to look at the run, open {files}" in capsys.readouterr().out
    assert told(tmp_path)["paths"].keys() == {"odometry", "truth", "estimate"}


@pytest.mark.parametrize(("count", "shown"), [(1, 1), (2, 2), (1000, 1000), (1001, 501), (28_800, 995)])
def test_moments_are_few_even_and_hold_both_ends(count, shown):
    chosen = page.moments(count)
    assert (len(chosen), chosen[0], chosen[-1]) == (shown, 0, count - 1)
    assert len(set(np.diff(chosen)[:-1])) <= 1


def test_a_heavy_particle_comes_often_in_a_thinned_cloud():
    poses = np.zeros((3, 3))
    poses[:, 0] = [0.0, 0.1, 90.0]  # the last beyond what is stored
    found = page.thinned(Particles(poses, np.log([0.25, 0.7, 0.05])), np.zeros(3))
    assert [np.count_nonzero(found[:, 0] == value) for value in (0, 100, 32767)] == [25, 70, 5]


@pytest.mark.nightly
def test_ten_minutes_of_eight_scans_a_second_stay_below_three_megabytes(tmp_path):
    save(box_recording(seconds=600.0, images=0), tmp_path / "long.npz")
    out = tmp_path / "out"
    assert main(["run", str(tmp_path / "long.npz"), "--out", str(out), "--quiet", "--every", "1"]) == 0
    assert (out / "index.html").stat().st_size < 3_000_000
    assert len(told(out)["t"]) <= page.MOMENTS + 1
