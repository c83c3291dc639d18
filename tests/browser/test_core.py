"""The equations in the browser are the package's: whole numbers are equal, all others agree to 1e-12.

Python makes inputs, random numbers and outputs with the package; Chromium runs ``core.js`` on the inputs.
"""

from dataclasses import replace
from itertools import islice
from math import inf, nan, pi
from types import SimpleNamespace

import numpy as np
import pytest
from dice import Handed
from fifteen_cells import SEEN_AT_DOOR, SEEN_AT_WALL, door_after

from pfslam.beyond.localization import KnownMap, LocalizationConfig, enough, kld_bound
from pfslam.beyond.loops.graph import (
    Edges,
    chi_square,
    gauss_newton_step,
    residuals,
    robust_weights,
)
from pfslam.cli import viewer
from pfslam.correlation import map_correlation
from pfslam.evaluation.checkup import turned_by_wheels
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import (
    LOG_4,
    GridSpec,
    MapConfig,
    OccupancyGrid,
    free_cells,
    integrate_scan,
    probability,
    trace_rays,
)
from pfslam.motion import Controls, integrate, motion_model
from pfslam.particles import (
    ControlNoise,
    Particles,
    effective_sample_size,
    log_sum_exp,
    predict,
    reweight,
    systematic_resample,
)
from pfslam.poses import Trajectory, average_pose, between, compose, transform_points, wrap_angle
from pfslam.recording import Encoders
from pfslam.refined.field import score_field
from pfslam.sensors import EncoderModel, ImuModel, LidarModel, scan_points
from pfslam.simulator.lidar import true_ranges
from pfslam.simulator.world import Person

pytestmark = pytest.mark.browser

CORE = viewer.source("core.js")
CLOSE = 1e-12
MAP = MapConfig(resolution=0.1, hit=1.1, free=0.4, clamp=2.3, rays="bresenham")
LIDAR = LidarModel(angle_min=-2.3, angle_max=2.35, beams=61, range_max=8.0, position_b=(0.13, 0.02, 0.5))
SPEC = GridSpec((-3.0, -2.0), 0.1, (50, 70))
# Typed arrays cross the border between Python and the browser as lists with the name of their type.
RUN = """({source, calls}) => {
  const root = {};
  new Function('globalThis', source)(root);
  const into = value => value?.type ? globalThis[value.type].from(value.values)
    : Array.isArray(value) ? value.map(into)
    : value && typeof value === 'object' ? Object.fromEntries(Object.entries(value).map(([k, v]) => [k, into(v)]))
    : value;
  const out = value => ArrayBuffer.isView(value) || Array.isArray(value) ? Array.from(value, out)
    : value && typeof value === 'object' ? Object.fromEntries(Object.entries(value).map(([k, v]) => [k, out(v)]))
    : value;
  return calls.map(([name, args]) => {
    if (name === 'generator') {
      const dice = root.pfslam.core.generator(...args);
      return {uniform: Array.from({length: 50}, dice.uniform), normals: out(dice.normals(49))};
    }
    return out(root.pfslam.core[name](...args.map(into)));
  });
}"""
NAMES = """source => {
  const root = {};
  new Function('globalThis', source)(root);
  return Object.keys(root.pfslam.core);
}"""
TYPES = {
    "f8": "Float64Array",
    "f4": "Float32Array",
    "i8": "Int32Array",
    "i1": "Int8Array",
    "u1": "Uint8Array",
    "b1": "Uint8Array",
}


def js(value):
    """A value as the browser takes it."""
    if isinstance(value, np.ndarray):
        return {"type": TYPES[value.dtype.str[1:]], "values": value.ravel().tolist()}
    if isinstance(value, GridSpec):
        return {"origin": list(value.origin), "resolution": value.resolution, "shape": list(value.shape)}
    if isinstance(value, LidarModel):
        x, y, _ = value.position_b
        limits = {"rangeMin": value.range_min, "rangeMax": value.range_max, "position": [x, y]}
        return {"angleMin": value.angle_min, "angleMax": value.angle_max, "beams": value.beams} | limits
    if isinstance(value, ImuModel):
        return {"gyroBias": value.gyro_bias, "gyroScale": value.gyro_scale}
    if isinstance(value, OccupancyGrid):
        return {"spec": js(value.spec), "logOdds": js(value.log_odds)}
    if isinstance(value, MapConfig):
        return {"hit": value.hit, "free": value.free, "clamp": value.clamp}
    if isinstance(value, dict):
        return {name: js(part) for name, part in value.items()}
    if isinstance(value, ControlNoise):
        sigmas = {"sigmaV": value.sigma_v, "sigmaOmega": value.sigma_omega}
        return sigmas | {"perRootSecond": value.per_root_second}
    return float(value) if isinstance(value, np.floating) else value


def agree(found, expected) -> bool:
    """Whole numbers and float32 must be equal, others within 1e-12; two infinities of one sign are equal."""
    if isinstance(expected, dict):
        return found.keys() == expected.keys() and all(agree(found[key], expected[key]) for key in expected)
    expected = np.asarray(expected)
    found = np.asarray(found, dtype=float).reshape(-1)
    if found.shape != (expected.size,):
        return False
    if expected.dtype.kind in "iub" or expected.dtype == np.float32:
        return np.array_equal(found, expected.ravel())
    return np.allclose(found, expected.ravel(), rtol=CLOSE, atol=CLOSE, equal_nan=True)


def sfc32(seed: int):
    """The generator's definition in whole numbers: uniform numbers without end."""
    mask = 2**32 - 1
    a, b, c, counter = 0, seed, 0, 1
    while True:
        t, counter = (a + b + counter) & mask, (counter + 1) & mask
        a, b, c = b ^ (b >> 9), (c + (c << 3)) & mask, (((c << 21) | (c >> 11)) + t) & mask
        yield t / 2**32


def poses_in(rng, n: int) -> np.ndarray:
    return np.column_stack([rng.uniform(-2, 3, n), rng.uniform(-1.5, 2.5, n), rng.uniform(-pi, pi, n)])


def ranges_with_gaps(rng) -> np.ndarray:
    """A scan with no return, returns too near and too far, and the limits themselves."""
    ranges = rng.uniform(0.2, 7.9, LIDAR.beams)
    ranges[::7] = nan
    ranges[[1, 2, 3, 4, 5]] = inf, 0.05, 9.0, LIDAR.range_min, LIDAR.range_max
    return ranges


def weights_of(rng, n: int) -> np.ndarray:
    weights = rng.random(n) ** 4
    return weights / weights.sum()


def motion_cases(rng):
    poses, normals = poses_in(rng, 40), rng.standard_normal(80)
    for theta in (0.0, pi, -pi, 3.5, -3.5, 100.0, np.nextafter(pi, 4), -0.0, *rng.uniform(-20, 20, 20)):
        yield "wrapAngle", [theta], wrap_angle(theta)
    yield "motionModel", [poses, 0.7, -0.3, 0.1], motion_model(poses, 0.7, -0.3, 0.1)
    v, omega = rng.normal(size=40), rng.normal(size=40)
    yield "motionModel", [poses, v, omega, 0.25], motion_model(poses, v, omega, 0.25)
    for per_root_second in (False, True):
        noise = ControlNoise(0.3, 0.14, per_root_second)
        moved = predict(
            Particles(poses, np.zeros(40)), 0.7, -0.3, 0.1, noise, Handed(normals[:40], normals[40:])
        )
        yield "predict", [poses, 0.7, -0.3, 0.1, noise, normals], moved.poses
    motions = rng.normal(size=(40, 3)) * [1, 1, 3]
    yield "composeEach", [poses, motions], compose(poses, motions)
    yield "averagePose", [poses, weights := weights_of(rng, 40)], average_pose(poses, weights)
    for turns in (1.0, 0.02):  # arcs, and chords among them
        path = Trajectory(np.cumsum(rng.uniform(0.1, 1, 9)), poses_in(rng, 9) * [1, 1, turns])
        for t in (path.t[0], path.t[4], path.t[-1], *rng.uniform(path.t[0], path.t[-1], 20)):
            yield "poseAt", [path.t.tolist(), [pose.tolist() for pose in path.poses], t], path.at(t)


def wheels_and_gyro_cases(rng):
    """A short drive with wrong wheels and a wrong gyro, and how far its path is from another."""
    rates, sides = rng.normal(size=60), rng.integers(-20, 80, (2, 61))
    imu = ImuModel(gyro_bias=0.02, gyro_scale=1.03)
    yield "yawRate", [rates, imu], imu.yaw_rate(np.column_stack([rates, rates, rates]))
    stamps, counts = 0.1 * np.arange(61.0), sides[[1, 0, 1, 0]].T  # FR, FL, RR, RL
    model = EncoderModel(track=0.7)
    robot = SimpleNamespace(encoders=model)
    drive = SimpleNamespace(wheels_and_gyro=lambda: (Encoders(stamps, counts), None), robot=robot)
    turns = np.diff(turned_by_wheels(drive, stamps, model.track))
    left, right = sides[:, 1:] * model.metres_per_count
    yield "wheelTurns", [left, right, model.track], turns
    v, start = rng.uniform(0, 1, 60), [0.3, -0.2, 2.5]
    path = integrate(Controls(stamps, v, rates), start)
    yield "integrate", [{"v": v, "omega": rates, "dt": 0.1}, start], path.poses
    uneven = np.concatenate([[0.0], np.cumsum(rng.uniform(0.01, 0.3, 60))])
    moves = {"v": v, "omega": rates, "dt": np.diff(uneven)}
    yield "integrate", [moves, start], integrate(Controls(uneven, v, rates), start).poses
    other = integrate(Controls(stamps, 1.1 * v, rates + 0.4), start)
    error = trajectory_error(other, path)
    expected = {"ateRmse": error.ate_rmse_m, "ateMax": error.ate_max_m}
    expected["headingRmse"] = error.heading_rmse_deg
    yield "trajectoryError", [other.poses, path.poses], expected


def scan_cases(rng):
    yield "beamAngles", [LIDAR], LIDAR.angles
    one = LidarModel(angle_min=0.3, angle_max=0.3, beams=1)
    yield "beamAngles", [one], one.angles
    ranges = ranges_with_gaps(rng)
    for value, valid in zip(ranges, LIDAR.valid(ranges), strict=True):
        yield "isValid", [value, LIDAR], int(valid)
    yield "scanPoints", [ranges, LIDAR], scan_points(ranges, LIDAR)
    yield "scanPoints", [np.full(LIDAR.beams, nan), LIDAR], np.zeros((0, 2))
    points = rng.normal(size=(30, 2))
    for pose in poses_in(rng, 3):
        yield "transformPoints", [pose, points], transform_points(pose, points)


def map_cases(rng):
    borders = np.array(SPEC.origin) + SPEC.resolution * rng.integers(-3, 75, (200, 2))
    for points in (rng.uniform(-4, 5, (300, 2)), borders, borders + 1e-15, np.zeros((0, 2))):
        yield "worldToCell", [SPEC, points], SPEC.world_to_cell(points)
    for cell in ([0, 0], [-1, 0], [0, -1], [69, 49], [70, 49], [69, 50]):
        yield "contains", [SPEC, *cell], int(SPEC.contains(cell))
    log_odds = rng.normal(size=SPEC.shape).astype(np.float32)
    log_odds[3:6] = 0.0
    grid = OccupancyGrid(SPEC, log_odds)
    yield "occupied", [grid], grid.occupied
    for points in (rng.uniform(-4, 5, (500, 2)), borders):
        yield "mapCorrelation", [grid.occupied, SPEC, points], map_correlation(grid.occupied, SPEC, points)
    for value in (0.0, LOG_4, -3.0, 40.0, -40.0):
        yield "probability", [value], probability(value)
    for door in (0.0, 0.3, 1.0, *rng.random(5)):
        for sees in (True, False):
            after, likelihood = door_after(door, sees)
            expected = {"door": after, "likelihood": likelihood}
            yield "doorAfter", [door, sees, SEEN_AT_DOOR, SEEN_AT_WALL], expected


def score_cases(rng):
    walls = rng.random(SPEC.shape) < 0.03
    walls[0, 0] = walls[-1, -1] = True
    points, poses = rng.uniform(-3, 3, (60, 2)), poses_in(rng, 25)
    for occupied in (walls, np.zeros(SPEC.shape, dtype=bool)):
        for kind, field in (("occupied", occupied.astype(np.float32)), ("distance", score_field(occupied))):
            yield "scoreField", [occupied, SPEC, kind], field
            sums = []
            for points_w in transform_points(poses, points):
                cells = SPEC.world_to_cell(points_w)
                ix, iy = cells[SPEC.contains(cells)].T
                sums.append(int(field[iy, ix].sum()))
            yield "scores", [field, SPEC, points, poses], np.array(sums)
    counts = np.array([0.0, 3.0, 61.0])
    yield "logLikelihood", [counts, 61.0, 12.0], 12.0 * counts / 61.0
    with np.errstate(divide="ignore"):
        yield "logLikelihood", [counts, 61.0, None], np.log(counts)


def weight_cases(rng):
    n = 50
    cloud = Particles(np.zeros((n, 3)), rng.normal(size=n))
    hopeless = np.full(n, -inf)
    half = np.where(np.arange(n) % 2, -inf, -1000.0)
    for log_likelihood in (rng.normal(size=n) * 30, half, hopeless):
        joint = cloud.log_weights + log_likelihood
        yield "logSumExp", [joint], log_sum_exp(joint)
        after, evidence = reweight(cloud, log_likelihood)
        expected = {"logWeights": after.log_weights, "logEvidence": evidence}
        yield "reweight", [cloud.log_weights, log_likelihood], expected
    short = np.full(10, 0.1)
    short[-1] -= 1e-16
    equal, one = np.full(8, 0.125), np.eye(5)[3]
    for weights in (weights_of(rng, 60), equal, one, np.ones(1), short, np.array([0.5, 0.5, 0.0, 0.0])):
        yield "effectiveSampleSize", [weights], effective_sample_size(weights)
        for u in (0.0, 0.3, rng.random(), 1.0 - 2.0**-53):
            yield "systematicResample", [weights, u], systematic_resample(weights, Handed(u))
    poses, ancestors = poses_in(rng, 6), np.array([0, 0, 3, 5, 5, 5])
    yield "chosen", [poses, ancestors], poses[ancestors]


def drawing_cases(rng):
    ends = [[4, 9], [9, 4], [4, 4], [-3, -11], [4, -6], [17, 5], *rng.integers(-20, 20, (20, 2)).tolist()]
    for end in ends:
        yield "traceRay", [[4, 4], end], trace_rays(np.array([4, 4]), np.array([end]))
    grid = OccupancyGrid.empty(SPEC)
    for pose in poses_in(rng, 12):
        low = np.array(SPEC.origin) + 0.05
        high = low + SPEC.resolution * np.array(SPEC.shape[::-1]) - 0.1
        points = np.clip(transform_points(pose, rng.uniform(-3, 3, (40, 2))), low, high)
        mask, (rows, columns) = free_cells(SPEC, points, np.arange(40), pose[:2], "bresenham")
        whole = np.zeros(SPEC.shape, dtype=np.uint8)
        whole[rows, columns] = mask
        yield "freeCells", [SPEC, points, pose[:2]], whole
        drawn, alone = grid.copy(), OccupancyGrid.empty(SPEC)
        for one in (drawn, alone):
            integrate_scan(one, points, np.arange(40), pose[:2], MAP)
        expected = {"spec": js(SPEC), "logOdds": drawn.log_odds}
        yield "integrateScan", [grid, points, pose[:2], MAP], expected
        said = np.sign(alone.log_odds).astype(np.int8)
        yield "evidence", [SPEC, points, pose[:2]], said
        yield "addEvidence", [grid, said, MAP], expected
        grid = drawn


def room(rng, people: int = 3):
    """A square room with clutter and people, as the simulator's beams meet it."""
    corners = np.array([[-2.5, -1.8], [3.5, -1.8], [3.5, 2.8], [-2.5, 2.8]])
    middles = np.column_stack([rng.uniform(-2, 3, 6), rng.uniform(-1.3, 2.3, 6)])
    clutter = middles[:, None] + rng.uniform(-0.4, 0.4, (6, 2, 2))
    walls = np.concatenate([np.stack([corners, np.roll(corners, -1, axis=0)], axis=1), clutter])
    closed = np.tile([-inf, inf], (len(walls), 1))
    walkers = tuple(Person(np.array([-1.0, 1.0]), np.tile(c + 1.0, (2, 1))) for c in middles[:people])
    return SimpleNamespace(walls=walls, closed=closed, people=walkers, slopes=(), pose_pw=np.zeros(3))


def beams_in(world, pose) -> np.ndarray:
    """The true ranges of the LiDAR's beams from a sensor at a pose ``(3,)``."""
    standing = SimpleNamespace(at=lambda t: (np.tile(pose, (len(t), 1)), *np.zeros((3, len(t)))))
    return true_ranges(world, standing, replace(LIDAR, position_b=(0.0, 0.0, 0.5)), np.zeros(1))[0]


def discs(world) -> np.ndarray:
    return np.array([[*person.at(np.zeros(1))[0], person.radius] for person in world.people]).reshape(-1, 3)


def ray_cases(rng):
    for people in (0, 3):
        world = room(rng, people)
        for pose in poses_in(rng, 15):
            yield "castRays", [world.walls, discs(world), pose, LIDAR.angles], beams_in(world, pose)
    world.walls, world.closed = world.walls[:1], world.closed[:1]
    yield "castRays", [world.walls, discs(world), pose, LIDAR.angles], beams_in(world, pose)


def lost_cases(rng):
    log_odds = np.where(rng.random(SPEC.shape) < 0.03, 1, np.where(rng.random(SPEC.shape) < 0.8, -1, 0))
    grid, config = OccupancyGrid(SPEC, log_odds.astype(np.float32)), LocalizationConfig()
    known, model = KnownMap.of(grid, config), {"sigma": config.sigma, "random": config.random}
    yield "likelihoodField", [grid.occupied, SPEC, model], known.field
    poses, points = poses_in(rng, 40), rng.uniform(-3, 3, (40, 2))
    model |= {"beams": config.effective_beams}
    expected = known.log_likelihood(poses, points)
    yield "lostLogLikelihood", [known.field, SPEC, grid.free, points, poses, model], expected
    for bins in (1, 2, 3, 50, 1234):
        yield "kldBound", [bins], kld_bound(bins)
    for times, least in ((20, 5), (20, 700), (1, 5)):  # by their bins, by the least, and all that there are
        many = np.tile(poses, (times, 1))
        yield "enough", [many, least], enough(many, least)


def graph_cases(rng):
    poses, i, j = poses_in(rng, 6), np.array([0, 1, 2, 3, 4, 0]), np.array([1, 2, 3, 4, 5, 5])
    measured = between(poses[i], poses[j]) + rng.normal(size=(6, 3)) * [0.2, 0.2, 0.1]
    diagonals, nothing = rng.uniform(1, 100, (6, 3)), np.zeros(6)
    edges = Edges(i, j, measured, np.stack([np.diag(d) for d in diagonals]), nothing, nothing.astype(bool))
    chi2, weights = chi_square(edges, poses, nothing), robust_weights(rng.uniform(0, 20, 6), 3.0)
    rows = [pose.tolist() for pose in poses]
    described = [
        {"i": int(a), "j": int(b), "z": z.tolist(), "information": d.tolist()}
        for a, b, z, d in zip(i, j, measured, diagonals, strict=True)
    ]
    for k, error in enumerate(residuals(edges, poses, nothing)):
        yield "between", [rows[i[k]], rows[j[k]]], between(poses[i[k]], poses[j[k]])
        yield "compose", [rows[i[k]], measured[k].tolist()], compose(poses[i[k]], measured[k])
        yield "edgeError", [described[k], rows], error
        yield "chiSquare", [described[k], rows], chi2[k]
        yield "robustWeight", [chi2[k], 3.0], robust_weights(chi2[k : k + 1], 3.0)[0]
    yield (
        "graphStep",
        [described, rows, weights.tolist()],
        gauss_newton_step(edges, poses, nothing, weights)[0],
    )


def way_cases(rng):
    wall = np.array([0.0, 0.0, 2.0, 0.0])
    for place, depth in (([1.0, 0.1], 0.1), ([1.0, 0.3], 0.0), ([2.3, 0.4], 0.0), ([2.12, 0.09], 0.05)):
        yield "touches", [wall, place, 0.2], depth
    yield "wayTo", [wall, SPEC, [1.0, 1.0], [3.0, 1.5], 0.28], [[3.0, 1.5]]
    for x, y, theta in poses_in(rng, 5):
        aside = wrap_angle(np.arctan2(1.0 - y, 2.0 - x) - theta)
        expected = [0.7 * max(0.0, np.cos(aside)) ** 3, np.clip(3.0 * aside, -1.6, 1.6)]
        yield "steer", [[x, y, theta], [2.0, 1.0], 0.7, 1.6], expected


def random_cases(rng):
    for seed in (0, 1, 16, 2**32 - 1):
        numbers = list(islice(sfc32(seed), 15 + 50 + 50))[15:]
        radius, turn = np.array(numbers[50:]).reshape(25, 2).T
        points = np.sqrt(-2.0 * np.log(1.0 - radius)) * np.exp(2j * pi * turn)
        normals = np.column_stack([points.real, points.imag]).ravel()[:49]
        yield "generator", [seed], {"uniform": numbers[:50], "normals": normals}


FAMILIES = (
    motion_cases,
    wheels_and_gyro_cases,
    scan_cases,
    map_cases,
    score_cases,
    weight_cases,
    drawing_cases,
    ray_cases,
    lost_cases,
    graph_cases,
    way_cases,
    random_cases,
)


def cases() -> list:
    rng = np.random.default_rng(7)
    return [case for family in FAMILIES for case in family(rng)]


def test_every_function_gives_what_the_package_gives(chromium):
    everything, page = cases(), chromium.new_page()
    calls = [[name, [js(value) for value in values]] for name, values, _ in everything]
    found = page.evaluate(RUN, {"source": CORE, "calls": calls})
    for (name, values, expected), result in zip(everything, found, strict=True):
        assert agree(result, expected), (name, values, result, expected)
    assert {name for name, _, _ in everything} == set(page.evaluate(NAMES, CORE))
    page.close()
