"""Localization in a known map: the bound, the field, the filter against an exact one, symmetry, and kidnapping."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from drives import simulated
from rooms import ROOM, SQUARE, box, distance_to_walls, drive, scan
from scipy.stats import chi2

import pfslam
from pfslam.__main__ import main
from pfslam.beyond.localization import (
    BIN,
    KnownMap,
    LocalizationConfig,
    LocalizationState,
    densest,
    enough,
    kld_bound,
    likelihood_field,
    localization_step,
    locate,
    resample_adaptively,
    spread,
)
from pfslam.cli.words import closing_words_of_search
from pfslam.events import ScanEvent
from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.io.formats import read_tum, write_map
from pfslam.particles import Particles
from pfslam.poses import Trajectory, between, compose, wrap_angle
from pfslam.recording import LidarScans, Recording
from pfslam.refined.noise import MotionNoise
from pfslam.run import run_slam
from pfslam.sensors import LidarModel, RobotModel, scan_points
from pfslam.study.disturbances import first_seconds

LIDAR = LidarModel(beams=91, range_max=8.0, position_b=(0.0, 0.0, 0.5))


def known_map(walls, resolution=0.05):
    """The map of a rectangular room with boxes in it; the first four walls are the room's own."""
    low, high = walls[:4].reshape(-1, 2).min(axis=0), walls[:4].reshape(-1, 2).max(axis=0)
    spec = GridSpec.around(np.array([low, high]), resolution, margin=0.3)
    ix, iy = np.meshgrid(np.arange(spec.shape[1]), np.arange(spec.shape[0]))
    centres = spec.cell_to_world(np.stack([ix, iy], axis=-1)).reshape(-1, 2)
    free = ((centres > low) & (centres < high)).all(axis=1)
    for corners in walls[4:].reshape(-1, 4, 2, 2):
        a, b = corners.reshape(-1, 2).min(axis=0), corners.reshape(-1, 2).max(axis=0)
        free &= ~((centres > a) & (centres < b)).all(axis=1)
    log_odds = np.where(free, -1.0, 0.0)
    log_odds[distance_to_walls(centres, walls) < 0.5 * resolution] = 1.0
    return OccupancyGrid(spec, log_odds.reshape(spec.shape).astype(np.float32))


def recorded(walls, *paths, lidar=LIDAR):
    """A recording at 10 scans a second along paths ``(K, 3)``; between two of them the robot is carried."""
    odometry = [np.zeros(3)]
    for path in paths:
        if len(odometry) > 1:
            odometry.append(odometry[-1])
        for motion in between(path[:-1], path[1:]):
            odometry.append(compose(odometry[-1], motion))
    poses = np.vstack(paths)
    t = 0.1 * np.arange(len(poses))
    ranges = np.array([scan(walls, pose, lidar) for pose in poses])
    robot, moved = RobotModel(lidar=lidar), Trajectory(t, np.array(odometry))
    return Recording(
        "by hand", robot, odometry=moved, lidar=LidarScans(t, ranges), truth=Trajectory(t, poses)
    )


def straight(start, metres, step=0.05):
    x, y, theta = start
    s = np.arange(0.0, metres, step)
    return np.column_stack([x + s * np.cos(theta), y + s * np.sin(theta), np.full(len(s), theta)])


def errors(result, recording):
    return np.hypot(*(result.trajectory.poses - recording.truth.at(result.trajectory.t))[:, :2].T)


def weight_near(info, pose):
    offset = info.particles.poses - pose
    near = (np.hypot(*offset[:, :2].T) < 1.0) & (np.abs(wrap_angle(offset[:, 2])) < 0.5)
    return info.particles.weights[near].sum()


# ---- how many particles


@pytest.mark.parametrize(("epsilon", "delta"), [(0.01, 0.1), (0.05, 0.01), (0.3, 0.001)])
def test_the_bound_is_the_chi_square_quantile(epsilon, delta):
    bins = np.array([2, 10, 30, 100, 1000, 20_000])
    exact = chi2.ppf(1.0 - delta, bins - 1) / (2.0 * epsilon)
    found = kld_bound(bins, epsilon, delta)
    np.testing.assert_allclose(found[1:], exact[1:], rtol=0.008)
    assert found[0] == pytest.approx(exact[0], rel=0.06)
    assert kld_bound(1, epsilon, delta) == 1.0


def test_particles_are_counted_until_they_suffice():
    least, rng = 10, np.random.default_rng(1)
    poses = rng.uniform([0.0, 0.0, -3.0], [20.0, 20.0, 3.0], (20_000, 3))
    seen, n = set(), 0
    for pose in poses:  # Fox's loop, one particle at a time
        seen.add(tuple(np.floor(pose / BIN).astype(int)))
        n += 1
        if n >= max(kld_bound(len(seen)), least):
            break
    assert n == enough(poses, least)
    assert enough(np.tile(poses[0], (500, 1)), least) == 10
    assert enough(poses[:50], least) == 50


def test_the_number_follows_the_extent_of_the_cloud_in_whatever_order_it_lies():
    grid, rng, config = known_map(ROOM), np.random.default_rng(2), LocalizationConfig()
    poses = rng.uniform([0.0, 0.0, -1.0], [4.0, 2.0, 1.0], (10_000, 3))
    wide = Particles(poses[np.argsort(poses[:, 0])], np.zeros(10_000))
    narrow = Particles(0.02 * poses, np.zeros(10_000))
    assert 3000 < len(resample_adaptively(wide, 0.0, grid, config, rng)) < 6000
    assert len(resample_adaptively(narrow, 0.0, grid, config, rng)) == config.least


def test_mean_offspring_follow_the_weights():
    grid, rng = known_map(ROOM), np.random.default_rng(3)
    config = LocalizationConfig(least=1000, particles=1000)
    poses = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [2.0, 1.0, 2.0]])
    particles = Particles(poses, np.log([0.6, 0.25, 0.15]))
    drawn = resample_adaptively(particles, 0.0, grid, config, rng)
    counts = [(drawn.poses == pose).all(axis=1).sum() for pose in poses]
    np.testing.assert_allclose(counts, [600, 250, 150], atol=1)
    half = resample_adaptively(particles, 0.5, grid, config, rng)
    assert 0.45 < 1.0 - np.isin(half.poses[:, 0], poses[:, 0]).mean() < 0.55


# ---- where particles may be, and how well they explain a scan


def test_poses_are_spread_evenly_over_the_free_cells():
    grid, rng = known_map(ROOM), np.random.default_rng(4)
    poses = spread(grid, 40_000, rng)
    ix, iy = grid.spec.world_to_cell(poses[:, :2]).T
    assert grid.free[iy, ix].all()
    west = grid.free[:, : grid.spec.shape[1] // 2].sum() / grid.free.sum()
    assert np.mean(ix < grid.spec.shape[1] // 2) == pytest.approx(west, abs=0.01)
    assert np.histogram(poses[:, 2], 8, (-np.pi, np.pi))[0] == pytest.approx(np.full(8, 5000), rel=0.1)


def test_the_field_is_the_likelihood_of_the_distance_to_the_nearest_wall():
    grid, config = known_map(ROOM), LocalizationConfig(sigma=0.3, random=0.2)
    iy, ix = np.nonzero(grid.occupied)
    rng = np.random.default_rng(5)
    for y, x in rng.integers(0, grid.spec.shape, (200, 2)):
        d = 0.05 * np.sqrt(((iy - y) ** 2 + (ix - x) ** 2).min())
        expected = np.log(0.2 + 0.8 * np.exp(-0.5 * (d / 0.3) ** 2))
        assert likelihood_field(grid, config)[y, x] == pytest.approx(expected, abs=1e-4)


def test_the_true_pose_explains_a_scan_best_and_outside_explains_nothing():
    known = KnownMap.of(known_map(ROOM), LocalizationConfig())
    pose = np.array([1.0, 0.2, 0.7])
    points = scan_points(scan(ROOM, pose, LIDAR), LIDAR)
    there, wrong, outside = known.log_likelihood(np.array([pose, [0.0, 0.0, -1.0], [50.0, 0.0, 0.0]]), points)
    assert there > -1.0
    assert wrong < there - 1.5
    assert outside == pytest.approx(5.0 * np.log(0.1))
    in_a_wall = known.log_likelihood(np.array([[1.5, 1.95, 0.7]]), points)  # inside a pillar
    assert in_a_wall[0] == pytest.approx(5.0 * np.log(0.1))
    poses = spread(known.grid, 25_000, np.random.default_rng(6))  # more than are scored together
    together = known.log_likelihood(poses, points)
    np.testing.assert_array_equal(together[::100], known.log_likelihood(poses[::100], points))


# ---- the filter


def event_of(pose, motion, t=0.0):
    points = scan_points(scan(SMALL, pose, LIDAR), LIDAR)
    nothing = (np.zeros(0), np.zeros(0), np.zeros(0))
    return ScanEvent(t, points, np.arange(len(points)), np.zeros(2), np.asarray(motion), nothing)


SMALL = np.vstack([box(-1.5, -1.0, 1.5, 1.0), box(0.6, 0.4, 1.1, 0.8)])


@pytest.mark.slow
def test_the_cloud_agrees_with_a_histogram_filter():
    """The exact recursion on a grid of 15 x 10 places and 24 headings, with the model's own densities."""
    noise = MotionNoise(xy=0.15, xy_per_metre=0.0, yaw=0.2, yaw_per_radian=0.0, yaw_per_metre=0.0)
    config = LocalizationConfig(
        particles=30_000, least=30_000, sigma=0.3, effective_beams=4.0, noise=noise, inject=False
    )
    known = KnownMap.of(known_map(SMALL), config)
    path = np.array([[-1.0, -0.5, 0.0], [-0.6, -0.5, 0.0], [-0.2, -0.5, 0.2], [0.2, -0.4, 0.4]])
    motions = [np.zeros(3), *between(path[:-1], path[1:])]
    x, y = -1.5 + 0.2 * (np.arange(15) + 0.5), -1.0 + 0.2 * (np.arange(10) + 0.5)
    theta = -np.pi + np.pi / 12 * (np.arange(24) + 0.5)
    nodes = np.stack(np.meshgrid(x, y, theta, indexing="ij"), axis=-1).reshape(-1, 3)
    cells = known.grid.spec.world_to_cell(nodes[:, :2])
    belief = known.grid.free[cells[:, 1], cells[:, 0]].astype(float)
    state = LocalizationState(
        Particles(spread(known.grid, 30_000, np.random.default_rng(7)), np.zeros(30_000))
    )

    def moved(belief, motion):
        """Every node to every node: with equal sigmas in x and y their distance counts, in whatever frame."""
        ends = compose(nodes, motion)
        far = np.hypot(*(ends[:, None, :2] - nodes[::24, :2]).T).T / 0.15
        turned = wrap_angle(ends[:, 2, None] - theta) / 0.2
        return ((belief[:, None] * np.exp(-0.5 * far**2)).T @ np.exp(-0.5 * turned**2)).ravel()

    def coarse(poses, weights):
        edges = [np.linspace(-1.5, 1.5, 6), np.linspace(-1.0, 1.0, 6), np.linspace(-np.pi, np.pi, 9)]
        return np.histogramdd(poses, edges, weights=weights)[0]

    apart, still = [], []
    for pose, motion in zip(path, motions, strict=True):
        belief = moved(belief / belief.sum(), motion)
        event = event_of(pose, motion)
        belief *= np.exp(known.log_likelihood(nodes, event.points_b))
        belief /= belief.sum()
        state, info = localization_step(state, event, known, np.random.default_rng(8))
        exact = coarse(nodes, belief)
        apart.append(0.5 * np.abs(exact - coarse(info.particles.poses, info.particles.weights)).sum())
        still.append(0.5 * np.abs(exact - coarse(nodes, np.full(len(nodes), 1.0 / len(nodes)))).sum())
    assert max(apart) < 0.12, apart
    assert min(still) > 0.35, still  # so that the bound says something


@pytest.fixture(scope="module")
def search():
    """A recording in the room, and the search in it."""
    path = np.vstack([straight((-1.5, -0.8, 0.0), 3.0), straight((1.45, -0.8, 1.2), 2.0)])
    recording = recorded(ROOM, path)
    return recording, locate(known_map(ROOM), recording, LocalizationConfig(every=1))


@pytest.mark.slow
def test_a_robot_is_found_in_a_room_and_its_path_followed(search):
    recording, result = search
    assert result.found_at < 4.0
    assert errors(result, recording)[result.located].max() < 0.4
    assert errors(result, recording)[-1] < 0.1
    assert result.infos[0].number == 100_000
    assert result.infos[-1].number == 500
    # Scans from one place say the same: a step of 5 cm is too short to use the next one.
    assert [info.used for info in result.infos[:4]] == [True, False, True, False]
    again = locate(known_map(ROOM), first_seconds(recording, 1.0), LocalizationConfig(every=1)).trajectory
    np.testing.assert_array_equal(result.trajectory.poses[: len(again)], again.poses)
    assert len(again) == 11


CORRIDOR = np.vstack([box(-9.0, -1.5, 9.0, 1.5), box(1.0, 1.0, 1.6, 1.5), box(-1.6, -1.5, -1.0, -1.0)])
MARK = box(7.0, -1.5, 7.5, -0.9)
"""Half a turn about the origin leaves the corridor as it was; the mark is on one end only."""


SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.nightly) for seed in (1, 2))]


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_two_clouds_live_until_the_mark_decides(seed):
    near_sighted = LidarModel(beams=91, range_max=4.0, position_b=(0.0, 0.0, 0.5))
    walls = np.vstack([CORRIDOR, MARK])
    recording = recorded(walls, straight((-2.0, 0.1, 0.0), 8.0), lidar=near_sighted)
    result = locate(known_map(walls), recording, LocalizationConfig(every=1), rng=np.random.default_rng(seed))
    twin = recording.truth.poses * [-1, -1, 1] + [0, 0, np.pi]
    x = recording.truth.poses[:, 0]
    both = [
        [weight_near(i, p) for p in (a, b)]
        for i, a, b in zip(result.infos, recording.truth.poses, twin, strict=True)
    ]
    settled = (x > 0.0) & (x < 2.9)
    assert np.sum(both, axis=1)[settled].min() > 0.8
    assert np.min(both, axis=1)[settled].min() > 0.15  # equal clouds' shares wander as resampling draws them
    assert not result.located[x < 2.9].any()
    assert both[-1][0] > 0.99
    assert result.located[-1]


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_a_kidnapped_robot_is_found_again_only_with_injection(seed):
    first, then = straight((-1.5, -0.8, 0.0), 3.0), straight((3.5, 2.0, -2.4), 3.5)
    recording = recorded(ROOM, first, then)
    start = Particles.at(first[0], 500)
    ends = {}
    for inject in (True, False):
        config = LocalizationConfig(every=1, inject=inject)
        result = locate(known_map(ROOM), recording, config, rng=np.random.default_rng(seed), start=start)
        assert errors(result, recording)[len(first) - 1] < 0.2
        ends[inject] = errors(result, recording)[-1]
        assert (max(info.injected for info in result.infos) > 0.1) == inject
    assert ends[True] < 0.2
    assert ends[False] > 0.5


def test_short_motions_are_added_up_until_a_scan_is_used_again():
    known, rng = KnownMap.of(known_map(SMALL), LocalizationConfig()), np.random.default_rng(0)
    start, still = LocalizationState(Particles.at(np.zeros(3), 500)), event_of(np.zeros(3), np.zeros(3))
    state, first = localization_step(start, still, known, rng)
    motions = [np.array([0.0, 0.0, 0.09]), np.array([0.06, 0.0, 0.0])]
    for motion in motions:
        state, info = localization_step(state, event_of(np.zeros(3), motion), known, rng)
        assert first.used > info.used
    np.testing.assert_allclose(state.pending, compose(*motions))


def test_the_estimate_is_one_cloud_and_never_between_two():
    rng = np.random.default_rng(9)
    poses = np.vstack([rng.normal([0, 0, 3.1], 0.1, (600, 3)), rng.normal([10, 0, 0], 0.1, (400, 3))])
    poses[:, 2] = wrap_angle(poses[:, 2])
    estimate, share = densest(Particles(poses, np.zeros(1000)))
    np.testing.assert_allclose(estimate[:2], [0, 0], atol=0.05)
    assert abs(wrap_angle(estimate[2] - 3.1)) < 0.05
    assert share == pytest.approx(0.6, abs=0.02)


# ---- the command line


@pytest.fixture
def files(tmp_path):
    write_map(tmp_path / "room.yaml", OccupancyGrid(known_map(ROOM).spec, 5.0 * known_map(ROOM).log_odds))
    path = [straight((-1.5, -0.8, 0.0), 3.0), straight((1.45, -0.8, 1.2), 2.0)]
    pfslam.save(recorded(ROOM, np.vstack(path)), tmp_path / "drive.npz")
    return tmp_path


@pytest.mark.slow
def test_locate_writes_trajectory_summary_and_picture(files, capsys):
    options = ["--out", str(files / "a"), "--seed", "3", "--particles", "3000"]
    assert main(["locate", str(files / "room.yaml"), str(files / "drive.npz"), *options]) == 0
    assert "found after" in capsys.readouterr().out
    assert {p.name for p in (files / "a").iterdir()} == {"located.png", "summary.json", "trajectory.tum"}
    summary = json.loads((files / "a/summary.json").read_text())
    assert summary["found"]
    assert summary["explained"] > 0.98
    assert summary["located_at_end"]
    assert 0.0 <= summary["seconds_to_find"] < 4.0
    assert summary["particles"]["most"] == 30_000
    assert summary["config"]["every"] == 1
    path, truth = read_tum(files / "a/trajectory.tum"), pfslam.load(str(files / "drive.npz")).truth
    assert np.hypot(*(path.poses[-1] - truth.at(path.t[-1]))[:2]) < 0.1
    assert cv2.imread(str(files / "a/located.png")).shape[:2] == known_map(ROOM).spec.shape


@pytest.mark.slow
def test_a_robot_is_found_without_odometry(files):
    """Scans alone tell how it moves, and where it is. Its summary repeats that."""
    recording = drive(SQUARE)
    pfslam.save(recording, files / "drive.npz")
    summary = located(files, "a", "--no-odometry", "--seed", "3", "--particles", "3000")
    assert (summary["found"], summary["located_at_end"]) == (True, True)
    path = read_tum(files / "a/trajectory.tum")
    assert np.hypot(*(path.poses[-1] - recording.truth.at(path.t[-1]))[:2]) < 0.1
    again = located(files, "b", "--config", str(files / "a" / "summary.json"))
    assert "--no-odometry" in again["selection"]
    assert (files / "a/trajectory.tum").read_bytes() == (files / "b/trajectory.tum").read_bytes()


@pytest.mark.slow
def test_a_place_lost_again_is_said_to_be_a_guess(search):
    recording, result = search
    assert "now at" in closing_words_of_search(recording, result, Path("out"))
    lost = replace(result, infos=(*result.infos[:-1], replace(result.infos[-1], share=0.1)))
    words = closing_words_of_search(recording, lost, Path("out"))
    assert "not sure at the end: seemed found after" in words
    assert "is it the map of this building?" in words


def located(files, out, *options):
    line = ["locate", str(files / "room.yaml"), str(files / "drive.npz"), "--out", str(files / out)]
    assert main([*line, *options]) in (0, 1)
    return json.loads((files / out / "summary.json").read_text())


def test_a_search_takes_settings_and_is_repeated_from_its_summary(files):
    (files / "mine.toml").write_text("sigma = 0.25\nseed = 4\nrandom = 0.2\n")
    asked = ["--config", str(files / "mine.toml"), "--particles", "700", "--set", "sigma=0.3"]
    first = located(files, "a", *asked, "--set", "noise.xy=0.03", "--set", "inject=false")
    again = located(files, "b", "--config", str(files / "a" / "summary.json"))
    assert first["config"] == again["config"]
    wanted = {"sigma": 0.3, "random": 0.2, "particles": 700, "first": 7000, "least": 500, "inject": False}
    assert {name: first["config"][name] for name in wanted} == wanted
    assert (first["config"]["noise"]["xy"], first["seed"], again["seed"]) == (0.03, 4, 4)
    assert (files / "a/trajectory.tum").read_bytes() == (files / "b/trajectory.tum").read_bytes()
    other = located(files, "c", "--config", str(files / "a" / "summary.json"), "--seed", "5")
    assert other["seed"] == 5
    assert (files / "a/trajectory.tum").read_bytes() != (files / "c/trajectory.tum").read_bytes()


@pytest.mark.slow
def test_another_building_is_not_found(files, tmp_path, capsys):
    """A room that is half a metre longer and wider, and has no pillars."""
    wider = known_map(box(-2.53, -1.52, 4.01, 2.98))
    write_map(tmp_path / "other.yaml", OccupancyGrid(wider.spec, 5.0 * wider.log_odds))
    line = ["locate", str(tmp_path / "other.yaml"), str(files / "drive.npz"), "--out", str(tmp_path / "out")]
    assert main([*line, "--particles", "3000"]) == 1
    assert "found after" not in capsys.readouterr().out
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert not summary["found"]
    assert summary["explained"] < 0.9


BUILDINGS = [("hall", 1), ("hall", 2), ("ramp", 3), ("ring", 5)]


@cache
def mapped(building):
    """The map that a run draws of a simulated building."""
    return run_slam(simulated(*building).recording, keep_particles=False).grid


@pytest.mark.nightly
@pytest.mark.parametrize("drive", BUILDINGS, ids=str)
@pytest.mark.parametrize("building", BUILDINGS, ids=str)
def test_a_robot_is_found_in_its_own_building_and_in_no_other(building, drive):
    """Two of the four are drawn by one rule. A hall and a ramp of one seed have the same walls, so seeds differ."""
    known, recording = mapped(building), simulated(*drive).recording
    assert locate(known, recording, keep_particles=False).found == (building == drive)
