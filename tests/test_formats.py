"""The files of the trade: our own reader, the usual tool, and the conventions by hand agree."""

import cv2
import numpy as np
import pytest

from pfslam.errors import DataError
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.io.carmen import load_carmen
from pfslam.io.formats import (
    read_covariances,
    read_known_map,
    read_map,
    read_relations,
    read_tum,
    write_covariances,
    write_map,
    write_texture,
    write_tum,
)
from pfslam.poses import Trajectory

T = 1_298_445_265.123456 + np.arange(400) * 0.123456789


@pytest.fixture
def trajectory():
    """A loop that passes heading pi."""
    theta = np.linspace(-3.0, 7.0, len(T))
    return Trajectory(T, np.column_stack([10.0 * np.cos(theta), 7.0 * np.sin(theta), theta]))


# ---- TUM trajectories --------------------------------------------------------------------------------------


def test_tum_round_trip(tmp_path, trajectory):
    write_tum(tmp_path / "a b.c.tum", trajectory)
    again = read_tum(tmp_path / "a b.c.tum")
    np.testing.assert_array_equal(again.t, trajectory.t)
    np.testing.assert_allclose(again.poses, trajectory.poses, rtol=0, atol=1e-9)


def test_tum_line_by_hand(tmp_path):
    write_tum(tmp_path / "a.tum", Trajectory([1_300_000_000.25], [[1.5, -2.0, np.pi / 2]]))
    words = (tmp_path / "a.tum").read_text().split()
    assert words[0] == "1300000000.250000"
    root = np.sqrt(0.5)
    np.testing.assert_allclose([float(w) for w in words[1:]], [1.5, -2.0, 0, 0, 0, root, root])


def test_covariances_round_trip(tmp_path):
    t, roots = T[:3], np.random.default_rng(0).standard_normal((3, 3, 3))
    covariances = roots @ roots.transpose(0, 2, 1)
    write_covariances(tmp_path / "a.txt", t, covariances)
    again_t, again = read_covariances(tmp_path / "a.txt")
    np.testing.assert_array_equal(again_t, t)
    np.testing.assert_allclose(again, covariances, rtol=1e-9)
    np.testing.assert_allclose(np.loadtxt(tmp_path / "a.txt")[:, 5], covariances[:, 1, 2], rtol=1e-9)


@pytest.mark.parametrize(
    ("read", "text", "message"),
    [
        (read_tum, "", "poses: found none"),
        (read_tum, "1 2 3\n", "line 1: found 3 values"),
        (read_tum, "# c\n1 0 0 0 0 0 0 x\n", "line 2: found 'x'"),
        (read_tum, "1 0 0 0 0 0 0 nan\n", "line 1: found nan"),
        (read_tum, "1 0 0 0 0 0 0 0.5\n", "quaternion of length 0.5"),
        (read_tum, "2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "increasing times"),
        (read_covariances, "# t xx\n", "covariances: found none"),
        (read_covariances, "1 2 3\n", "line 1: found 3 values"),
        (read_relations, "1 2 3\n", "line 1: found 3 values, expected 8 values"),
    ],
)
def test_bad_tables(tmp_path, read, text, message):
    (tmp_path / "bad.tum").write_text(text)
    with pytest.raises(DataError, match=message) as raised:
        read(tmp_path / "bad.tum")
    assert "bad.tum" in str(raised.value)


def test_relations_by_hand(tmp_path):
    """Those whose both ends are stamps of ours are kept, at our stamps."""
    (tmp_path / "a.relations").write_text("1.0001 2.0 3 4 9 9 9 0.5\n2 7 1 1 0 0 0 1\n")
    found = read_relations(tmp_path / "a.relations").at_stamps(np.array([1.0, 2.0, 6.5]))
    assert (found.t1, found.t2) == ([1.0], [2.0])
    np.testing.assert_array_equal(found.poses, [[3.0, 4.0, 0.5]])


# ---- ROS maps ----------------------------------------------------------------------------------------------


@pytest.fixture
def grid():
    """4 x 3 cells of 0.5 m: the corner at (x_min, y_max) occupied, the one at (x_max, y_min) free."""
    log_odds = np.zeros((3, 4), dtype=np.float32)
    log_odds[2, 0], log_odds[0, 3] = 5.0, -5.0
    return OccupancyGrid(GridSpec((-10.25, 3.5), 0.5, (3, 4)), log_odds)


@pytest.mark.parametrize("name", ["map.pgm", "map.png", "map"])
def test_a_map_under_the_name_of_its_image_is_refused(tmp_path, grid, name):
    """Else the text would be written over the picture."""
    seen, message = np.ones((3, 4), dtype=bool), r"file name: found .*, expected a name that ends in \.yaml"
    with pytest.raises(DataError, match=message):
        write_map(tmp_path / name, grid)
    with pytest.raises(DataError, match=message):
        write_texture(tmp_path / name, grid.spec, np.zeros((3, 4, 3), dtype=np.uint8), seen)
    assert list(tmp_path.iterdir()) == []


def test_map_keys_and_pixels_by_hand(tmp_path, grid):
    write_map(tmp_path / "map.yaml", grid)
    assert (tmp_path / "map.yaml").read_text().splitlines() == [
        "image: map.pgm",
        "resolution: 0.5",
        "origin: [-10.25, 3.5, 0.0]",
        "negate: 0",
        "occupied_thresh: 0.65",
        "free_thresh: 0.196",
    ]
    pixels = cv2.imread(str(tmp_path / "map.pgm"), cv2.IMREAD_UNCHANGED)
    assert pixels.dtype == np.uint8
    # The first row of the image is the greatest y.
    np.testing.assert_array_equal(pixels, [[0, 205, 205, 205], [205, 205, 205, 205], [205, 205, 205, 254]])


def test_a_cell_is_exported_as_what_the_run_takes_it_for(tmp_path):
    """Seen once is enough, as to the filter; unknown is only what was never seen, or told both ways alike."""
    once = np.float32(0.1 * np.log(4.0))  # what one scan of the refined filter says against a cell
    log_odds = np.array([[once, -once, 0.0, 1e-8, -1e-8, np.inf, -np.inf]], dtype=np.float32)
    grid = OccupancyGrid(GridSpec((0, 0), 1.0, (1, 7)), log_odds)
    write_map(tmp_path / "m.yaml", grid)
    pixels = cv2.imread(str(tmp_path / "m.pgm"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(pixels, [[0, 254, 205, 0, 254, 0, 254]])
    # As map_server reads it, by the thresholds in the text: p = (255 - pixel) / 255.
    p = (255.0 - pixels) / 255.0
    np.testing.assert_array_equal((p > 0.65) * 1 - (p < 0.196), [[1, -1, 0, 1, -1, 1, -1]])
    known = read_known_map(tmp_path / "m.yaml")
    np.testing.assert_array_equal(known.occupied, grid.occupied)
    np.testing.assert_array_equal(known.free, grid.free)


def test_a_map_of_another_program(tmp_path):
    """Comments in the image, quotes in the yaml, the origin item by item, negated grey values."""
    (tmp_path / "their #1.pgm").write_bytes(b"P5\n# made elsewhere\n2 1\n255\n\xff\x00")
    lines = [
        "image: 'their #1.pgm'",
        "resolution: 0.05 # m",
        "origin: # x, y, yaw",
        "  - 1",
        "  - -2",
        "  - 0",
    ]
    lines += ["negate: 1", "occupied_thresh: 0.65", "free_thresh: 0.25", "mode: trinary"]
    (tmp_path / "m.yaml").write_text("\n".join(lines))
    spec, cells = read_map(tmp_path / "m.yaml")
    assert spec == GridSpec((1.0, -2.0), 0.05, (1, 2))
    np.testing.assert_array_equal(cells, [[1, -1]])


def test_a_map_with_a_png_image(tmp_path, grid):
    write_map(tmp_path / "map.yaml", grid)
    pixels = cv2.imread(str(tmp_path / "map.pgm"), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(tmp_path / "map.png"), pixels)
    (tmp_path / "png.yaml").write_text((tmp_path / "map.yaml").read_text().replace(".pgm", ".png"))
    for name in ("map.yaml", "png.yaml"):
        spec, cells = read_map(tmp_path / name)
        assert spec == grid.spec
        np.testing.assert_array_equal(cells, np.sign(grid.log_odds))
    cv2.imwrite(str(tmp_path / "map.png"), np.dstack([pixels] * 4))
    with pytest.raises(DataError, match=r"map\.png: image: found 4 channels, expected one of grey, or three"):
        read_map(tmp_path / "png.yaml")


@pytest.mark.parametrize("kind", ["pgm", "png"])
def test_a_map_in_colour_is_read_by_the_mean_of_its_colours(tmp_path, grid, kind):
    write_map(tmp_path / "map.yaml", grid)
    pixels = cv2.imread(str(tmp_path / "map.pgm"), cv2.IMREAD_UNCHANGED).astype(int)
    bgr = np.dstack([np.clip(pixels + 2, 0, 255), pixels, np.clip(pixels - 2, 0, 255)]).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "map.ppm"), bgr)  # P6, under the name of a PGM image
    (tmp_path / "map.ppm").replace(tmp_path / "map.pgm")
    cv2.imwrite(str(tmp_path / "map.png"), bgr)
    (tmp_path / "map.yaml").write_text((tmp_path / "map.yaml").read_text().replace(".pgm", f".{kind}"))
    np.testing.assert_array_equal(read_map(tmp_path / "map.yaml")[1], np.sign(grid.log_odds))


ORIGIN = "origin: [-10.25, 3.5, 0.0]"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (ORIGIN, "origin: [0, 0, 0.3]", "origin: found a map rotated by 0.3 rad"),
        (ORIGIN, "origin: [0, 0]", "origin: found 2 values"),
        ("negate: 0", "", "a key named negate"),
        ("negate: 0", "negate: 2", "negate: found 2, expected 0 or 1"),
        ("negate: 0", "negate: [0", "file: found while parsing .*, expected YAML"),
        (ORIGIN, "origin: 3", "origin: found 1 values"),
        (ORIGIN, "a: &a [1]\norigin: *a", "file: found an alias, expected YAML"),
        ("resolution: 0.5", "resolution: big", "resolution: found 'big'"),
        ("resolution: 0.5", "resolution: -1", "resolution"),
        ("resolution: 0.5", "resolution: 1.0e-9", "found 1e-09, expected metres a cell, from 0.001 to 10"),
        ("resolution: 0.5", "resolution: 1.0e+12", "resolution: found .*, expected metres a cell"),
        ("free_thresh: 0.196", "free_thresh: 0.7", "probabilities, the lesser first"),
        ("map.pgm", "none.pgm", r"none\.pgm: reading"),
        ("negate: 0", "negate: 0\nmode: raw", "mode: found raw, expected trinary"),
        (None, b"", r"map\.pgm: header"),
        (None, b"P5\n4 3\n255\n123", r"map\.pgm: pixels"),
        (None, b"P5\n999999999 999999999\n255\n", r"map\.pgm: pixels"),
        (None, b"P5\n4 3\n255\n" + 12 * b"\xfe", "no occupied cell"),
        (None, b"P5\n4 3\n255\n" + 12 * b"\x00", "no free cell"),
    ],
)
def test_bad_maps(tmp_path, grid, old, new, message):
    path = tmp_path / "map.yaml"
    write_map(path, grid)
    if old is None:
        (tmp_path / "map.pgm").write_bytes(new)
    else:
        path.write_text(path.read_text().replace(old, new))
    with pytest.raises(DataError, match=message):
        read_known_map(path)


# ---- floor texture -----------------------------------------------------------------------------------------


def test_texture_by_hand(tmp_path):
    spec = GridSpec((-1.0, 2.0), 0.25, (2, 3))
    rgb, seen = np.zeros((2, 3, 3), dtype=np.uint8), np.zeros((2, 3), dtype=bool)
    rgb[0, 2], seen[0, 2] = (200, 100, 50), True
    write_texture(tmp_path / "texture.yaml", spec, rgb, seen)
    bgra = cv2.imread(str(tmp_path / "texture.png"), cv2.IMREAD_UNCHANGED)
    assert bgra.shape == (2, 3, 4)
    np.testing.assert_array_equal(bgra[1, 2], [50, 100, 200, 255])
    assert np.count_nonzero(bgra[..., 3]) == 1
    expected = "image: texture.png\nresolution: 0.25\norigin: [-1.0, 2.0, 0.0]\n"
    assert (tmp_path / "texture.yaml").read_text() == expected


# ---- CARMEN logs -------------------------------------------------------------------------------------------


def flaser(t, ranges=(1, 2, 3, 4), pose="1 2 0.5", laser=None):
    return f"FLASER {len(ranges)} {' '.join(map(str, ranges))} {laser or pose} {pose} {t} robot {t}"


def robotlaser(t, ranges=(1, 2, 3), laser="1.2 2 0", robot="1 2 0", start=-1.0, step=1.0, maximum=50.0):
    head = (
        f"ROBOTLASER1 0 {start} 2.0 {step} {maximum} 0.01 0 {len(ranges)} {' '.join(map(str, ranges))} 2 7 7"
    )
    return f"{head} {laser} {robot} 0 0 0.3 0.2 1000 {t} host 0.1"


def rawlaser(t, ranges=(1, 2, 3)):
    return f"RAWLASER1 0 -1.0 2.0 1.0 81.9 0.01 0 {len(ranges)} {' '.join(map(str, ranges))} 0 {t} host 0.1"


def load(tmp_path, *lines):
    path = tmp_path / "a log.v1.clf"
    path.write_text("\n".join(lines) + "\n", encoding="latin-1")
    return load_carmen(path)


def test_the_intel_log_equals_the_table_of_the_same_log(real_data):
    recording = load_carmen(real_data / "intel" / "intel.log")
    with np.load(real_data / "intel" / "intel.npz") as table:
        np.testing.assert_array_equal(recording.lidar.ranges, table["ranges"])
        np.testing.assert_allclose(recording.lidar.t, table["time"], rtol=0, atol=1e-6)
        np.testing.assert_allclose(recording.odometry.poses, table["odom_xyt"], atol=1e-9)
        np.testing.assert_allclose(recording.robot.lidar.angles, table["bearing_rad"], atol=1e-12)
        no_return = table["ranges"] > 81.0
    np.testing.assert_array_equal(recording.robot.lidar.valid(recording.lidar.ranges), ~no_return)
    assert recording.default_every == 1
    assert recording.dropped == {}


@pytest.mark.parametrize(("count", "last_deg"), [(180, 89.0), (181, 90.0), (360, 89.5), (361, 90.0)])
def test_angles_of_the_old_laser_message(tmp_path, count, last_deg):
    lidar = load(tmp_path, flaser(1.0, ranges=[1] * count)).robot.lidar
    np.testing.assert_allclose(np.rad2deg([lidar.angle_min, lidar.angle_max]), [-90.0, last_deg])


def test_new_laser_message(tmp_path):
    second = robotlaser(10.75, robot="1.1 2 0", laser="1.3 2 0")
    recording = load(tmp_path, "# made by hand", robotlaser(10.5), second)
    lidar = recording.robot.lidar
    np.testing.assert_allclose(lidar.angles, [-1.0, 0.0, 1.0])
    np.testing.assert_allclose(lidar.position_b[:2], [0.2, 0.0], atol=1e-12)
    assert 49.0 < lidar.range_max < 50.0
    np.testing.assert_array_equal(recording.lidar.t, [10.5, 10.75])
    np.testing.assert_allclose(recording.odometry.poses, [[1, 2, 0], [1.1, 2, 0]])
    np.testing.assert_array_equal(recording.lidar.ranges, [[1, 2, 3], [1, 2, 3]])


def test_raw_laser_with_odometry_lines(tmp_path):
    odometry = [f"ODOM {x} 0 0 0.1 0 0 {t} host 0.1" for x, t in ((0, 1.0), (1, 2.0), (2, 3.0))]
    recording = load(tmp_path, *odometry, rawlaser(1.5), rawlaser(2.5))
    np.testing.assert_allclose(recording.odometry.at(recording.lidar.t)[:, 0], [0.5, 1.5])


@pytest.mark.parametrize(
    ("lines", "place"),
    [
        ([robotlaser(1.0, laser="1 2 0.25")], (0.0, 0.0, 0.25)),  # askew
        (["PARAM robot_frontlaser_offset 0.17 1 host 1", robotlaser(1.0)], (0.17, 0.0, 0.0)),
        # Corrected poses are not taken for a mounting: their offset changes.
        ([robotlaser(1.0), robotlaser(2.0, laser="1.4 2.1 0.1")], (0.0, 0.0, 0.0)),
    ],
)
def test_where_the_laser_is_mounted(tmp_path, lines, place):
    lidar = load(tmp_path, *lines).robot.lidar
    np.testing.assert_allclose((*lidar.position_b[:2], lidar.angle_min + 1.0), place, atol=1e-12)


def test_scans_come_in_the_order_of_their_stamps(tmp_path):
    """By hand: the first range of each scan is its stamp. Of doubled stamps the first counts."""
    stamps = np.random.default_rng(0).permutation(300) + 1.0
    lines = [flaser(t, (t, 3, 3, 3), pose=f"{t} 0 0") for t in stamps]
    scans = load(tmp_path, *lines, *(flaser(t) for t in stamps))
    np.testing.assert_array_equal(scans.lidar.t, np.arange(1.0, 301.0))
    np.testing.assert_array_equal(scans.lidar.ranges[:, 0], scans.lidar.t)
    np.testing.assert_array_equal(scans.odometry.poses[:, 0], scans.lidar.t)
    assert scans.dropped == {"scans with the stamp of another": 300}


def test_lines_out_of_order_and_silences_are_spoken_of(tmp_path):
    """A scan every 0.25 s; the third and the fourth change places, and from 2 s on there is nothing for 1.5 s."""
    stamps = [0.25, 0.5, 1.0, 0.75, 1.25, 1.5, 1.75, 2.0, 3.5, 3.75]
    recording = load(tmp_path, *(flaser(t) for t in stamps))
    assert recording.notes == (
        "scans out of order, put in order: 1, the first at 0.750 s",
        "no scans for 1.50 s after 2.000 s, the longest gap",
    )
    assert recording.dropped == {}


def test_what_is_not_used_is_counted(tmp_path):
    lines = [flaser(3.0, (9, 9, 9, 9)), flaser(1.0), flaser(1.0, (5, 5, 5, 5)), flaser(2.0, (1, "nan", 3, 4))]
    recording = load(tmp_path, *lines, "SYNC 1", "# caf\xe9", "TRUEPOS 1 2 3")
    np.testing.assert_array_equal(recording.lidar.t, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(recording.lidar.ranges[0], [1, 2, 3, 4])
    assert recording.dropped == {
        "scans with the stamp of another": 1,
        "ranges that are not a number": 1,
        "messages of other kinds": 2,
    }


BAD_LOGS = {
    "nothing in it": ("", "laser messages: found none"),
    "not a log": ("\x89PNG\r\n\x1a\n\xff\xff", "laser messages: found none"),
    "too few ranges": ("FLASER 180 1 2 3", "line 1: found 4 values, expected 190 values"),
    "absurd count": ("FLASER 999999999 1 2", "line 1, word 2: found 999999999"),
    "word for a range": (flaser(1.0, (1, "x", 3, 4)), "line 1: found a range that is no number"),
    "nan pose": (flaser(1.0, pose="nan 0 0"), "line 1: found nan"),
    "far away": (flaser(1.0, pose="0 1e300 0"), r"odometry\.pose: found 1e\+300, expected m and rad"),
    "stamp in ns": (flaser(976052890244111000), "stamps: found 9.76.*, expected seconds"),
    "beams change": (flaser(1.0) + "\n" + flaser(2.0, (1, 2)), "line 2: found 2 beams"),
    "angles in degrees": (robotlaser(1.0, start=-90.0), "laser, angle_min: found -90"),
    "more than a turn": (robotlaser(1.0, step=4.0), "laser: found angles from -1 to 7, expected radians"),
    "odometry for some": (f"{robotlaser(1.0)}\n{rawlaser(2.0)}", "odometry: found none for some scans"),
    "laser far away": (
        f"PARAM robot_frontlaser_offset 1e300 1 host 1\n{flaser(1.0)}",
        "laser, position_b: found .1e",
    ),
    "laser sees nothing": (robotlaser(1.0, maximum=0.01), "laser, range_min, range_max: found .0.1, 0.0099"),
    "endless line": ("#" * (2**20 + 5), "line 1: found a longer"),
}


@pytest.mark.parametrize("case", BAD_LOGS)
def test_a_bad_log_is_named_by_its_line(tmp_path, case):
    text, message = BAD_LOGS[case]
    with pytest.raises(DataError, match=message) as raised:
        load(tmp_path, text)
    assert "a log.v1.clf" in str(raised.value)
    assert "\n" not in str(raised.value)
