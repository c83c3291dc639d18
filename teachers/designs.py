"""Try the design questions once, and keep what came out: `python teachers/designs.py [d00 d05 ...]`.

The numbers stand in `designs.json`, from where the solutions take them. They are one lecturer's runs, not a verdict:
students choose other drives, and then defend their own.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from pfslam_book import ch05, ch09, ch12
from pfslam_book.ch07 import runs as ch07
from pfslam_book.ch10.building import part, true_map
from pfslam_book.show.drives import place_at
from pfslam_book.show.tables import select

import pfslam
from pfslam import Recording, Trajectory
from pfslam.beyond.localization import LocalizationConfig, locate
from pfslam.beyond.loops import graph
from pfslam.evaluation.checkup import effective_track, turned_by_wheels
from pfslam.evaluation.trajectory import aligned_at_first
from pfslam.grid import LOG_4, MapConfig
from pfslam.motion import controls, motion_model
from pfslam.poses import between, compose, transform_points, wrap_angle
from pfslam.refined.lines import LineConfig
from pfslam.refined.step import RefinedConfig
from pfslam.sensors import LidarModel, RobotModel, scan_points
from pfslam.simulator import HALL, RING, simulate
from pfslam.study.disturbances import first_seconds, kidnap

STORED = Path(__file__).with_name("designs.json")
NO_FILE = Path("no file: the book's own parts")
Numbers = dict[str, float]


def rms(values: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def off(path: Trajectory, truth: Trajectory) -> float:
    """Distance (m, root mean square) of a path from the truth, both from the first pose."""
    poses, true = aligned_at_first(path, truth)
    return rms(np.hypot(*(poses - true)[:, :2].T))


def d00() -> Numbers:
    """Odometry ten times a second: where a wall 5 m ahead lands (95th percentile, cm), by how a pose is looked up."""
    hall = pfslam.load("hall")
    path = pfslam.dead_reckoning(hall)
    t = np.arange(path.t[0], path.t[-1], 0.1)
    poses, stamps = path.at(t), hall.lidar.t[(hall.lidar.t > t[1]) & (hall.lidar.t < t[-2])]
    at = np.searchsorted(t, stamps, side="right") - 1
    share = ((stamps - t[at]) / 0.1)[:, None]
    moved = between(poses[at - 1], poses[at])
    looked_up = {
        "last": poses[at],
        "nearest": poses[at + (share[:, 0] > 0.5)],
        "line": Trajectory(t, poses).at(stamps),
        "ahead": compose(poses[at], share * moved),
    }
    wall, true = np.array([[5.0, 0.0]]), path.at(stamps)
    landed = {
        name: [transform_points(p, wall)[0] for p in some]
        for name, some in (looked_up | {"true": true}).items()
    }
    return {
        name: 100 * float(np.quantile(np.hypot(*(np.array(landed[name]) - landed["true"]).T), 0.95))
        for name in looked_up
    }


def d01() -> Numbers:
    """Heading error (degrees, root mean square) of four sources over five buildings: median, and worst."""
    found: dict[str, list[float]] = {}
    few = replace(HALL, robot=RobotModel(lidar=LidarModel(beams=8)))  # the scans are not needed
    for seed in range(1, 6):
        drive = simulate(few, seed).recording
        inputs = controls(drive)
        dt = np.diff(inputs.t)
        still = (inputs.v == 0) & (inputs.t[1:] > inputs.t[0] + 3)
        gyro = np.append(0, np.cumsum((inputs.omega - inputs.omega[still].mean()) * dt))
        wheels = turned_by_wheels(drive, inputs.t, effective_track(drive) or 1.0)
        raw = np.append(0, np.cumsum(inputs.omega * dt))
        true = np.unwrap(drive.true_path().at(inputs.t)[:, 2])
        for name, heading in (
            ("raw", raw),
            ("gyro", gyro),
            ("wheels", wheels),
            ("mean", (gyro + wheels) / 2),
        ):
            error = heading - heading[0] - (true - true[0])
            found.setdefault(name, []).append(float(np.rad2deg(rms(error))))
    return {
        f"{name}{what}": of(some)
        for name, some in found.items()
        for what, of in (("", np.median), ("_worst", max))
    }


def d02() -> Numbers:
    """Cells of four sizes: memory (MB), points of an unseen scan on walls (%), the same 5 cm and 10 cm aside."""
    hall = first_seconds(pfslam.load("hall"), 60)
    found = {}
    for side in (0.025, 0.05, 0.1, 0.2):
        grid = ch09.map_along(
            hall, hall.truth, MapConfig(resolution=side, free=0.1 * LOG_4, rays="bresenham"), every=10
        )
        shares = {}
        for aside in (0.0, 0.05, 0.1):
            some = []
            for k in range(405, len(hall.lidar.t), 100):
                points = scan_points(hall.lidar.ranges[k], hall.robot.lidar)
                points = transform_points(hall.truth.poses[k], points) + [aside, aside]
                cells = grid.spec.world_to_cell(points)
                inside = grid.spec.contains(cells)
                some.append(grid.occupied[cells[inside, 1], cells[inside, 0]].sum() / len(points))
            shares[aside] = 100 * float(np.mean(some))
        name = f"{1000 * side:.0f}"
        found[f"mb_{name}"] = grid.log_odds.nbytes / 1e6
        found |= {f"at{100 * a:.0f}_{name}": share for a, share in shares.items()}
    return found


def d03() -> Numbers:
    """Three regions that should hold the truth in 90 %: how often they do (%), and their area (m^2)."""
    rng, n = np.random.default_rng(0), 4000
    poses = np.zeros((n, 3))
    for _ in range(400):  # 20 m straight on, at 20 samples a second
        noise = rng.standard_normal((2, n))
        poses = motion_model(poses, 1 + 0.2 * noise[0], 0.25 * noise[1], 0.05)
    cloud, truths = poses[: n // 2, :2], poses[n // 2 :, :2]
    mean, cov = cloud.mean(axis=0), np.cov(cloud.T)
    d2 = np.einsum("ni,ij,nj->n", truths - mean, np.linalg.inv(cov), truths - mean)
    radius = np.quantile(np.hypot(*(cloud - mean).T), 0.9)
    cells, counts = np.unique(np.floor(cloud / 0.5).astype(int), axis=0, return_counts=True)
    order = np.argsort(-counts)
    held = cells[order[: np.searchsorted(np.cumsum(counts[order]), 0.9 * len(cloud)) + 1]]
    kept = {tuple(cell) for cell in held}
    in_cells = np.mean([tuple(cell) in kept for cell in np.floor(truths / 0.5).astype(int)])
    return {
        "ellipse": 100 * float(np.mean(d2 < 4.605)),
        "ellipse_area": float(np.pi * 4.605 * np.sqrt(np.linalg.det(cov))),
        "disc": 100 * float(np.mean(np.hypot(*(truths - mean).T) < radius)),
        "disc_area": float(np.pi * radius**2),
        "cells": 100 * float(in_cells),
        "cells_area": 0.25 * len(held),
    }


def d04() -> Numbers:
    """From 10, 20 and 40 cm off, uphill in steps of 2.5 cm: how often (%) the climb ends within 5 cm of the truth."""
    hall, rng, found = pfslam.load("hall"), np.random.default_rng(0), {}
    places = [place_at(hall, t) for t in np.arange(14, 110, 8.0)]
    starts = rng.uniform(-np.pi, np.pi, (len(places), 6))

    def fields(occupied: np.ndarray) -> dict[str, np.ndarray]:
        away = cv2.distanceTransform((~occupied).astype(np.uint8), cv2.DIST_L2, 5) * 0.05
        return {"cell": occupied * 1.0, "wide": (away < 0.08) * 1.0} | {
            f"field{100 * s:.0f}": np.exp(-((away / s) ** 2) / 2) for s in (0.05, 0.2)
        }

    for distance in (0.1, 0.2, 0.4):
        home: dict[str, list[bool]] = {}
        for place, angles in zip(places, starts, strict=True):
            spec = place.grid.spec
            for name, field in fields(place.grid.occupied).items():
                for angle in angles:
                    at = distance * np.array([np.cos(angle), np.sin(angle)])
                    best, value = at, _credit(field, spec, place, at)
                    while True:
                        tries = [best + 0.025 * np.array(s) for s in ((1, 0), (-1, 0), (0, 1), (0, -1))]
                        values = [_credit(field, spec, place, shift) for shift in tries]
                        if max(values) <= value:
                            break
                        best, value = tries[int(np.argmax(values))], max(values)
                    home.setdefault(name, []).append(bool(np.hypot(*best) < 0.05))
        found |= {f"{name}_{100 * distance:.0f}": 100 * float(np.mean(some)) for name, some in home.items()}
    return found


def _credit(field, spec, place, shift) -> float:
    """What a scan earns in a field, moved by ``shift`` (m) from the truth."""
    cells = spec.world_to_cell(place.moved(*shift, 0.0)[::4])
    cells = cells[spec.contains(cells)]
    return float(field[cells[:, 1], cells[:, 0]].sum())


def d05() -> Numbers:
    """Whose pose draws: error (cm) of the reader's filter on 65 s, median over buildings and seeds, and worst."""
    step, book, rng = ch05.step, ch05.my_filter(NO_FILE), np.random.default_rng(0)

    def heaviest(poses, weights):
        return poses[np.argmax(weights)]

    def drawn(poses, weights):
        return poses[rng.choice(len(poses), p=weights)]

    def around_heaviest(poses, weights):
        near = np.hypot(*(poses - heaviest(poses, weights))[:, :2].T) < 0.1
        return book.mean_pose(poses[near], weights[near] / weights[near].sum())

    found = {}
    drives = [first_seconds(simulate(HALL, seed).recording, 66) for seed in (1, 2, 3)]
    for name, rule in (("mean", None), ("heaviest", heaviest), ("drawn", drawn), ("mode", around_heaviest)):
        mine = ch05.my_filter(NO_FILE, **({"mean_pose": rule} if rule else {}))
        runs = [
            100 * off(ch05.drive(step, mine, drive, seed=seed, **WIDE).trajectory, drive.truth)
            for drive in drives
            for seed in (0, 1)
        ]
        found |= {name: float(np.median(runs)), f"{name}_worst": max(runs)}
    return found


WIDE = {"origin": (-30.0, -30.0), "shape": (1300, 1400)}
"""A map with room for the other buildings."""


def d06() -> Numbers:
    """Fifty images of a drive: share (%) of the floor of all images that they show, by how they were chosen."""
    hall = pfslam.load("hall")
    stamps = hall.camera.disparity_t
    poses = hall.truth.at(stamps[stamps < hall.truth.t[-1]])[::4]
    far, aside = np.meshgrid(np.arange(0.65, 3.0, 0.1), np.arange(-1.5, 1.5, 0.1))
    seen = np.abs(aside) < 0.5 * 640 / 585 * far
    trapezoid = np.column_stack([far[seen], aside[seen]])
    cells = [np.floor(transform_points(p, trapezoid) / 0.1).astype(int) for p in poses]
    sets = [set(map(tuple, some)) for some in cells]
    everything = set().union(*sets)
    way = np.append(0, np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T)))
    turned = np.append(0, np.cumsum(np.abs(wrap_angle(np.diff(poses[:, 2])))))

    def evenly(x: np.ndarray) -> np.ndarray:
        return np.searchsorted(x, np.linspace(x[0], x[-1], 50))

    greedy, shown = [], set()
    for _ in range(50):
        greedy.append(max(range(len(sets)), key=lambda k: len(sets[k] - shown)))
        shown |= sets[greedy[-1]]
    chosen = {
        "time": evenly(np.arange(len(poses))),
        "way": evenly(way),
        "both": evenly(way + turned),
        "greedy": greedy,
    }
    return {
        name: 100 * len(set().union(*(sets[min(k, len(sets) - 1)] for k in some))) / len(everything)
        for name, some in chosen.items()
    }


def d07() -> Numbers:
    """Sixty runs: standard error (cm) of the mean change by how many buildings share them, from the stored table."""
    rows = ch07.stored("ch07_buildings")
    before, after = ch07.CHANGES["every 10th to 5th scan"]
    pairs = [select(rows, **some) for some in (before, after)]
    buildings = np.unique(pairs[0]["simulator.seed"])
    runs = [[some[ch07.ERROR][some["simulator.seed"] == b] for b in buildings] for some in pairs]
    within = float(np.mean([np.var(one, ddof=1) for some in runs for one in some]))
    change = np.array([a.mean() - b.mean() for b, a in zip(*runs, strict=True)])
    each = len(runs[0][0])
    between_b = max(0.0, float(np.var(change, ddof=1)) - 2 * within / each)
    return {
        "within_cm": 100 * np.sqrt(within),
        "between_cm": 100 * np.sqrt(between_b),
        "runs": each,
    } | {f"se_{b}": 100 * np.sqrt(between_b / b + 2 * within / 30) for b in (3, 5, 10, 15, 30)}


def d08() -> Numbers:
    """Three alarms: seconds from a kidnap at 40 s until each rings (-1: never within 22 s), and false alarms.

    The limit is the worst value of the calm part before: of 5 to 39 s, and on the clean drive of 5 to 35 s.
    """
    found: Numbers = {}
    false = dict.fromkeys(("score", "departure", "count"), 0)
    for seed in (1, 2, 3):
        drive = first_seconds(simulate(HALL, seed).recording, 65)
        for recording, calm, since in ((kidnap(drive, 40, 3), 39, 40), (drive, 35, 35)):
            t, numbers = _alarms(recording)
            for name, values in numbers.items():
                limit = values[(t > 5) & (t < calm)].max()
                rings = t[(t > since) & (values > limit)]
                if recording is drive:
                    false[name] += int(rings.size > 0)
                else:
                    found[f"{name}_{seed}"] = float(rings[0] - 40) if rings.size else -1.0
    return found | {f"{name}_false": count for name, count in false.items()}


def _alarms(recording: Recording) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """After each scan but the first: seconds since the first, and three numbers that grow when something is wrong."""
    config = replace(RefinedConfig(), particles=20, every=20)
    run = pfslam.run_slam(recording, config, rng=np.random.default_rng(0), second_look=False)
    odometry = pfslam.dead_reckoning(recording).at(run.trajectory.t)
    ours, theirs = (between(p[:-1], p[1:]) for p in (run.trajectory.poses, odometry))
    return (run.trajectory.t - recording.lidar.t[0])[1:], {
        "score": -np.array([info.score for info in run.infos])[1:],
        "departure": np.hypot(*(ours - theirs)[:, :2].T),
        "count": -np.array([info.effective_sample_size for info in run.infos])[1:],
    }


def d09() -> Numbers:
    """How much odometry counts against the lines: error (cm) in the bare corridor and in three halls."""
    found = {}
    corridor = simulate(replace(HALL, layout="corridor"), 1).recording
    halls = [first_seconds(simulate(HALL, seed).recording, 45) for seed in (1, 2, 3)]
    for beams in (0.0, 5.0, 50.0):
        config = replace(RefinedConfig(), particles=20, every=20, lines=LineConfig(independent_beams=beams))
        errors = [
            100 * off(pfslam.run_slam(d, config, rng=np.random.default_rng(0)).trajectory, d.truth)
            for d in (corridor, *halls)
        ]
        found |= {f"corridor_{beams:.0f}": errors[0], f"halls_{beams:.0f}": float(np.median(errors[1:]))}
    return found


def d10() -> Numbers:
    """A robot that wakes at four places of the hall: how many it finds rightly, after how long (median, s)."""
    simulation = simulate(HALL, 1)
    grid, found = true_map(simulation), {}
    for first in (10_000, 100_000):
        for beams in (1.0, 5.0, 30.0):
            config = LocalizationConfig(first=first, effective_beams=beams, every=10)
            right, wrong, times = 0, 0, []
            for begin in (14, 40, 60, 80):
                drive = part(simulation.recording, begin, 20)
                result = locate(grid, drive, config, rng=np.random.default_rng(begin), keep_particles=False)
                true = drive.true_path().at(result.trajectory.t)
                error = np.hypot(*(result.trajectory.poses - true)[:, :2].T)
                sure = result.located
                right += int(sure[-1] and error[-1] < 0.5)
                wrong += int((sure & (error > 1)).any())
                times += [result.trajectory.t[sure][0] - result.trajectory.t[0]] if sure.any() else []
            name = f"{first // 1000}_{beams:.0f}"
            found |= {f"right_{name}": right, f"wrong_{name}": wrong}
            found[f"seconds_{name}"] = float(np.median(times)) if times else -1.0
    return found


def d11() -> Numbers:
    """One look at a post from an unsure heading: how far three updates end from the exact mean (cm, median of 200)."""
    rng, found = np.random.default_rng(0), {}
    R, P = np.diag([0.05**2, np.deg2rad(1.0) ** 2]), np.diag([0.3**2, 0.3**2, np.deg2rad(15.0) ** 2])
    for distance in (0.8, 5.0):
        post, apart = np.array([distance, 0.0]), {"ekf": [], "iterated": [], "moments": []}
        for _ in range(200):
            true = rng.multivariate_normal(np.zeros(3), P)
            z = _sight(true, post) + rng.multivariate_normal(np.zeros(2), R)
            cloud = rng.multivariate_normal(np.zeros(3), P, 40_000)
            e = wrap(z[:, None] - _sight(cloud.T, post))
            logw = -0.5 * (e[0] ** 2 / R[0, 0] + e[1] ** 2 / R[1, 1])
            w = np.exp(logw - logw.max())
            exact = w @ cloud[:, :2] / w.sum()
            x = np.zeros(3)
            for k in range(6):
                H = _slopes(x, post)
                gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
                x = gain @ (wrap((z - _sight(x, post))[:, None])[:, 0] + H @ x)
                if k in (0, 5):
                    apart["ekf" if k == 0 else "iterated"].append(np.hypot(*(x[:2] - exact)))
            seen = np.array(_sight(cloud[:1000].T, post))
            C = np.cov(np.vstack([cloud[:1000].T, seen]))
            surprise = wrap((z - seen.mean(axis=1))[:, None])[:, 0]
            x = cloud[:1000].mean(axis=0) + C[:3, 3:] @ np.linalg.solve(C[3:, 3:] + R, surprise)
            apart["moments"].append(np.hypot(*(x[:2] - exact)))
        found |= {f"{name}_{distance:.0f}": 100 * float(np.median(some)) for name, some in apart.items()}
    return found


def wrap(e: np.ndarray) -> np.ndarray:
    """Range and bearing differences ``(2, N)`` with the bearing within half a turn."""
    return np.stack([e[0], wrap_angle(e[1])])


def _sight(x, post):
    dx, dy = post[0] - x[0], post[1] - x[1]
    return np.array([np.hypot(dx, dy), wrap_angle(np.arctan2(dy, dx) - x[2])])


def _slopes(x, post):
    (dx, dy), r = post - x[:2], np.hypot(*(post - x[:2]))
    return np.array([[-dx / r, -dy / r, 0], [dy / r**2, -dx / r**2, -1]])


def d12() -> Numbers:
    """One false loop among four: error (cm) of three ways to meet it, by how false it is (m)."""
    found = {}
    for false in (0.0, 0.2, 1.0, 3.0):
        name = f"{10 * false:.0f}"
        for kernel in ("without", "with"):
            found[f"{kernel}_{name}"] = 100 * ch12.outlier_case(false, kernel)[3]
        edges, start, truth = ch12.two_rounds(false, doubtful=False)
        poses, scale, _ = graph.relax(edges, start)
        chi2 = graph.chi_square(edges, poses, scale)
        loops = np.abs(edges.j - edges.i) > 1
        worst = int(np.argmax(np.where(loops, chi2, -1)))
        poses, _, _ = graph.relax(edges.chosen(np.arange(len(edges)) != worst), start)
        found[f"dropped_{name}"] = 100 * rms(np.hypot(*(poses - truth)[:, :2].T))
    return found


SCANNERS = {
    "wide": {"beams": 360, "range_max": 8.0, "angle_min": -np.pi, "angle_max": np.pi * 179 / 180},
    "front": {"beams": 181, "range_max": 30.0, "angle_min": -np.pi / 2, "angle_max": np.pi / 2},
    "narrow": {"beams": 361, "range_max": 30.0, "angle_min": -np.pi / 4, "angle_max": np.pi / 4},
    "own": {},
}


def d13() -> Numbers:
    """Four scanners on one robot: error (cm) by scan matching over 45 s, median of three buildings of each kind."""
    found = {}
    for layout, building in (("hall", HALL), ("ring", RING), ("corridor", replace(HALL, layout="corridor"))):
        for name, numbers in SCANNERS.items():
            robot = RobotModel(lidar=LidarModel(**numbers))
            drives = [
                first_seconds(simulate(replace(building, robot=robot), seed).recording, 45)
                for seed in (1, 2, 3)
            ]
            runs = [(pfslam.run_slam(drive, RefinedConfig.matching()), drive.truth) for drive in drives]
            found[f"{name}_{layout}"] = float(np.median([100 * off(run.trajectory, t) for run, t in runs]))
    return found


ALL = (d00, d01, d02, d03, d04, d05, d06, d07, d08, d09, d10, d11, d12, d13)


def main(names: list[str]) -> None:
    """Measure again what is named, or everything, and write it down."""
    stored = json.loads(STORED.read_text(encoding="utf-8")) if STORED.exists() else {}
    for make in ALL:
        if not names or make.__name__ in names:
            stored[make.__name__] = {name: round(float(value), 4) for name, value in make().items()}
            print(make.__name__, stored[make.__name__], flush=True)
            text = json.dumps(dict(sorted(stored.items())), indent=1)
            STORED.write_text(text + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main(sys.argv[1:])
