"""Misses and false alarms together, over robots that are not the author's: a table on the page about trust.

Some eighty robots drive through the simulated hall: other scanners, rates, clocks, mountings and odometries, and a
building full of hazards. Sixty more have two faults at once, drawn by lot, in buildings of their own, and in 32 others
wheels slip among people. Every robot is checked and run, even where the check-up would stop the run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
from pfslam_book.show.faults import clockwise, late_scans

from pfslam.evaluation.checkup import check_up
from pfslam.evaluation.trajectory import aligned_at_first, trajectory_error
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory, between, compose, invert, transform_points
from pfslam.recording import LidarScans, Recording
from pfslam.refined.health import in_doubt
from pfslam.run import run_slam
from pfslam.sensors import LidarModel
from pfslam.simulator import PRESETS, Hazards, simulate
from pfslam.study import Case, Study, disturbances

SECONDS, MIDDLE = 60.0, 35.0
LIDAR = LidarModel(-np.pi, np.pi - np.radians(1.0), 360, 0.1, 12.0, (0.13, 0.05, 0.3))
Change = Callable[[Recording], Recording]


@cache
def drive(name: str = "hall", seed: int = 3, **hazards: Any) -> Recording:
    """Simulate the drive of a robot with a scanner of 360 beams, ten scans a second, and odometry of its own."""
    config = replace(PRESETS[name], robot=replace(PRESETS[name].robot, lidar=LIDAR))
    full = disturbances.first_seconds(simulate(config, seed, hazards=Hazards(**hazards)).recording, SECONDS)
    path, scans = dead_reckoning(full), full.scans()
    odometry = Trajectory(path.t[::2], path.poses[::2])
    lidar = LidarScans(scans.t[::4], scans.ranges[::4])
    return replace(full, encoders=None, imu=None, camera=None, odometry=odometry, lidar=lidar)


def with_scans(
    change: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]], r: Recording
) -> Recording:
    """Change stamps and ranges."""
    return replace(r, lidar=LidarScans(*change(r.scans().t, r.scans().ranges)))


def with_odometry(
    change: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]], r: Recording
) -> Recording:
    """Change stamps and poses."""
    return replace(r, odometry=Trajectory(*change(r.odometry.t, r.odometry.poses.copy())))


def with_lidar(r: Recording, **changes: Any) -> Recording:
    """Change what is stated of the scanner."""
    return replace(r, robot=replace(r.robot, lidar=replace(r.robot.lidar, **changes)))


def thinned(step: int, t: np.ndarray, rows: np.ndarray):
    return t[::step], rows[::step]


def gap(seconds: float, t: np.ndarray, rows: np.ndarray):
    """Leave out the readings of some seconds in the middle of the drive."""
    some = np.abs(t - t[0] - MIDDLE) > seconds / 2
    return t[some], rows[some]


def shorter(metres: float, r: Recording) -> Recording:
    """See no farther than so many metres."""
    ranges = np.where(r.scans().ranges < metres, r.scans().ranges, np.inf)
    return with_lidar(disturbances.with_ranges(r, ranges), range_max=metres)


def narrower(degrees: float, r: Recording) -> Recording:
    """See only what lies within an angle about ahead."""
    lidar, k = r.robot.lidar, np.flatnonzero(np.abs(r.robot.lidar.angles) <= np.radians(degrees / 2))
    return with_beams(r, k, angle_min=float(lidar.angles[k[0]]), angle_max=float(lidar.angles[k[-1]]))


def coarser(step: int, r: Recording) -> Recording:
    """Have only every so-many-th beam."""
    k = np.arange(0, r.robot.lidar.beams, step)
    return with_beams(r, k, angle_max=float(r.robot.lidar.angles[k[-1]]))


def with_beams(r: Recording, k: np.ndarray, **ends: float) -> Recording:
    """Keep the beams ``k`` of every scan."""
    lidar = LidarScans(r.scans().t, np.ascontiguousarray(r.scans().ranges[:, k]))
    return replace(r, lidar=lidar, robot=replace(r.robot, lidar=replace(r.robot.lidar, beams=len(k), **ends)))


def turned(degrees: float, r: Recording) -> Recording:
    """State a wrong yaw of the scanner; the truth is that of a robot for which it would be right."""
    lidar, yaw = r.robot.lidar, np.radians(degrees)
    x, y, _ = lidar.position_b
    poses = compose(compose(r.true_path().poses, [x, y, 0.0]), invert([x, y, yaw]))
    r = replace(r, truth=Trajectory(r.true_path().t, poses))
    return with_lidar(r, angle_min=lidar.angle_min + yaw, angle_max=lidar.angle_max + yaw)


def moved(along: float, turn: Callable[[np.ndarray], np.ndarray], t: np.ndarray, poses: np.ndarray):
    """Let every step be so many times as long, and turn by ``turn`` of what it turns."""
    step = between(poses[:-1], poses[1:]) * [along, along, 1.0]
    step[:, 2] = turn(step[:, 2])
    heading = np.append(0.0, np.cumsum(step[:, 2]))
    c, s = np.cos(heading[:-1]), np.sin(heading[:-1])
    xy = np.column_stack([c * step[:, 0] - s * step[:, 1], s * step[:, 0] + c * step[:, 1]])
    return t, np.column_stack([np.vstack([[0.0, 0.0], np.cumsum(xy, axis=0)]), heading])


def day_later(t: np.ndarray, rows: np.ndarray):
    """Let the clock jump by a day."""
    return t + 86400.0 * (t > t[0] + MIDDLE), rows


def restarted(r: Recording) -> Recording:
    """Let the clock start again in the middle: two halves of a drive one upon the other, in the order of stamps."""

    def halves(t, rows):
        t = np.where(t > r.odometry.t[0] + MIDDLE, t - MIDDLE, t)
        order = np.argsort(t, kind="stable")
        keep = np.diff(t[order], prepend=-np.inf) > 0
        return t[order][keep], rows[order][keep]

    first = {"truth": Trajectory(*halves(r.truth.t, r.truth.poses))}
    return with_scans(halves, with_odometry(halves, replace(r, **first)))


def jittered(sigma: float, t: np.ndarray, rows: np.ndarray):
    return np.sort(t + np.random.default_rng(0).normal(0.0, sigma, len(t)).clip(-0.04, 0.04)), rows


def noisy_headings(t: np.ndarray, poses: np.ndarray):
    poses[:, 2] += np.cumsum(np.random.default_rng(1).normal(0.0, np.radians(0.3), len(t)))
    return t, poses


def carried(metres: float, r: Recording) -> Recording:
    """Set the odometry on while the robot stands: it was picked up and put down farther along its way."""
    return disturbances.kidnap(r, MIDDLE, metres)


def frozen(seconds: float, t: np.ndarray, poses: np.ndarray):
    """Repeat one pose for some seconds in the middle of the drive, and go on with the right ones."""
    still = (t > t[0] + MIDDLE) & (t < t[0] + MIDDLE + seconds)
    poses[still] = poses[np.argmax(still)]
    return t, poses


def stuck(seconds: float, t: np.ndarray, poses: np.ndarray):
    """Lose the motion of some seconds in the middle of the drive, as a wheel in the air does."""
    last, first = np.searchsorted(t, t[0] + MIDDLE + np.array([0.0, seconds]))
    after = compose(poses[last], between(poses[first], poses[first:]))
    poses[last:first], poses[first:] = poses[last], after
    return t, poses


def set_back(t: np.ndarray, poses: np.ndarray):
    """Let the odometry start anew in the middle of the drive."""
    after = t > t[0] + MIDDLE
    poses[after] = between(poses[after][0], poses[after])
    return t, poses


def swung(turns: np.ndarray, r: Recording) -> Recording:
    """Turn the scanner on its mount by so much (rad) at each scan, to the next whole beam."""
    beams = np.rint(turns / r.robot.lidar.increment).astype(int)
    ranges = [np.roll(row, -beam) for row, beam in zip(r.scans().ranges, beams, strict=True)]
    return disturbances.with_ranges(r, np.array(ranges))


def loose(degrees: float, r: Recording) -> Recording:
    """Let the scanner shake to and fro about its stated direction."""
    return swung(np.radians(degrees) * np.sin(2 * np.pi * 1.3 * r.scans().t), r)


def bumped(degrees: float, r: Recording) -> Recording:
    """Let something turn the scanner on its mount in the middle of the drive."""
    return swung(np.radians(degrees) * (r.scans().t > r.scans().t[0] + MIDDLE), r)


def every_stream(change, r: Recording) -> Recording:
    truth = Trajectory(*change(r.truth.t, r.truth.poses))
    return with_scans(change, with_odometry(change, replace(r, truth=truth)))


def seeded(name: str, value: Any) -> Change:
    return partial(disturbances.disturb, what={name: value}, seed=0)


def scans(change, *arguments) -> Change:
    return partial(with_scans, partial(change, *arguments))


def odometry(change, *arguments) -> Change:
    return partial(with_odometry, partial(change, *arguments))


def both(first: Change, second: Change) -> Change:
    return lambda r: second(first(r))


GROUPS: dict[str, dict[str, Change]] = {
    "scanners: noise, range, view, beams": {
        **{f"noise of {cm} cm": seeded("range_noise", cm / 100) for cm in (2, 5, 10)},
        **{f"range of {m} m": partial(shorter, m) for m in (3.0, 5.0, 8.0)},
        "5 cm, 3 m": both(partial(shorter, 3.0), seeded("range_noise", 0.05)),
        "3 cm, 4 m": both(partial(shorter, 4.0), seeded("range_noise", 0.03)),
        **{f"{share:.0%} missing": seeded("missing_beams", share) for share in (0.3, 0.6)},
        **{f"{share:.0%} wild": seeded("random_ranges", share) for share in (0.02, 0.1)},
        **{f"view of {deg} deg": partial(narrower, deg) for deg in (240.0, 180.0, 120.0)},
        **{f"{360 // step} beams": partial(coarser, step) for step in (2, 4)},
    },
    "rates of scans and odometry": {
        **{f"scan each {0.1 * step:.1f} s": scans(thinned, step) for step in (2, 5, 10, 20, 30)},
        **{f"odometry each {0.02 * step:.1f} s": odometry(thinned, step) for step in (5, 10, 25, 50)},
    },
    "gaps": {
        **{f"no scans for {s:.0f} s": scans(gap, s) for s in (3.0, 10.0, 30.0)},
        **{f"no odometry for {s:.0f} s": odometry(gap, s) for s in (3.0, 10.0, 30.0)},
        **{f"nothing for {s:.0f} s": partial(every_stream, partial(gap, s)) for s in (10.0, 30.0)},
        **{f"no returns for {s:.0f} s": seeded("blind", (30.0, 30.0 + s)) for s in (5.0, 20.0)},
    },
    "clocks": {
        **{f"scans {ms} ms late": partial(late_scans, seconds=ms / 1000) for ms in (30, 100, 300, 1000)},
        "jitter of 10 ms": scans(jittered, 0.01),
        "a day later": partial(every_stream, day_later),
        "restarted": restarted,
    },
    "mountings": {
        **{f"turned by {deg} deg": partial(turned, deg) for deg in (3.0, 5.0, 10.0, 20.0, 45.0, 90.0, 180.0)},
        **{
            f"{dx:.1f} m ahead": partial(with_lidar, position_b=(0.13 + dx, 0.05, 0.3))
            for dx in (0.1, 0.2, 0.3)
        },
        "0.3 m to the left": partial(with_lidar, position_b=(0.13, 0.35, 0.3)),
        "clockwise": clockwise,
        **{f"loose by {deg} deg": partial(loose, deg) for deg in (1.0, 3.0)},
        **{f"bumped by {deg} deg": partial(bumped, deg) for deg in (3.0, 10.0)},
    },
    "odometries": {
        "millimetres": odometry(lambda t, p: (t, p * [1000.0, 1000.0, 1.0])),
        "all zero": odometry(lambda t, p: (t, 0.0 * p)),
        **{f"{k} times as far": odometry(moved, k, lambda w: w) for k in (0.5, 0.9, 1.1, 2.0)},
        "no turns": odometry(moved, 1.0, lambda w: 0.0 * w),
        "turns the other way": odometry(moved, 1.0, lambda w: -w),
        "turns in degrees": odometry(moved, 1.0, np.rad2deg),
        "10 % more turns": odometry(moved, 1.0, lambda w: 1.1 * w),
        "drift of 0.5 deg/s": odometry(moved, 1.0, lambda w: w + np.radians(0.01)),
        "noisy headings": odometry(noisy_headings),
    },
    "odometry that fails for a while": {
        **{f"frozen for {s:.0f} s": odometry(frozen, s) for s in (1.0, 3.0, 10.0)},
        **{f"stuck for {s:.0f} s": odometry(stuck, s) for s in (1.0, 3.0, 10.0)},
        "set back to zero": odometry(set_back),
    },
    "carried off by hand": {f"by {s:.0f} s of way": partial(carried, s) for s in (2.0, 6.0)},
}
"""What is done to the drive, by kind and name."""
HARD = {
    "hall": {},
    "people": {"people": 6},
    "doors": {"doors": 4},
    "glass": {"glass": 0.1},
    "bumps": {"bumps": 8},
    "slip": {"slip": 3},
    "everything": {"people": 6, "doors": 4, "glass": 0.1, "bumps": 8, "slip": 3},
}


BUILDINGS, PAIRS = "buildings with hazards", "two faults at once, other buildings"
AMONG = "wheels that slip among people, other buildings"
SLIPS = {f"{name} {seed}": (name, seed) for seed in range(300, 316) for name in ("hall", "ramp")}
"""The buildings of the last kind, none of which had been looked at before."""


def by_lot(count: int, rng: np.random.Generator) -> dict[str, tuple[str, int, Change]]:
    """Draw robots with two faults of different kinds: each by name, with its building, the building's seed and both."""
    faults = [(kind, name) for kind, group in GROUPS.items() for name in group]
    robots = {}
    while len(robots) < count:
        (kind, a), (other, b) = (faults[k] for k in np.sort(rng.choice(len(faults), 2, replace=False)))
        building, seed = ("hall", "ramp")[rng.integers(2)], int(rng.integers(100, 1000))
        if kind != other:
            robots[f"{a} + {b} ({building} {seed})"] = building, seed, both(GROUPS[kind][a], GROUPS[other][b])
    return robots


TWO = by_lot(60, np.random.default_rng(2))
"""They were drawn after every threshold had been set."""


def laid_on(path: Trajectory, other: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Lay a whole path on another by a turn and a shift; return the poses ``(K, 3)`` of both at the path's times."""
    poses, others = aligned_at_first(path, other)
    place = others[:, :2].mean(axis=0)
    xy, other_xy = poses[:, :2] - poses[:, :2].mean(axis=0), others[:, :2] - place
    (c_x, s_x), (s_y, c_y) = xy.T @ other_xy
    turn = np.arctan2(s_x - s_y, c_x + c_y)  # the turn that makes the sum of squares least
    return np.column_stack([transform_points([*place, turn], xy), poses[:, 2] + turn]), others


def bent(estimate: Trajectory, truth: Trajectory) -> float:
    """Return the largest error (m) that is left when the whole path is laid on the true one, by a turn and a shift."""
    poses, true_poses = laid_on(estimate, truth)
    return float(np.hypot(*(poses - true_poses)[:, :2].T).max())


def robot(kind: str, name: str) -> Recording:
    """Return the recording of a robot."""
    if kind == BUILDINGS:
        return drive(**HARD[name])
    if kind == PAIRS:
        building, seed, change = TWO[name]
        return change(drive(building, seed))
    if kind == AMONG:
        return drive(*SLIPS[name], people=6, slip=3)
    return GROUPS[kind][name](drive())


def judged(case: Case) -> dict[str, Any]:
    """Check and run one robot: its largest error (m), what a turn of the whole leaves of it, and what was said."""
    kind, name = case.get("kind"), case.get("robot")
    recording = robot(kind, name)
    findings = check_up(recording)
    told = {
        "failed": sum(f.ok is False for f in findings),
        "stopped": int(any(f.severity == "stop" for f in findings)),
    }
    result = run_slam(recording, keep_particles=False)
    error = trajectory_error(result.trajectory, recording.true_path())
    distrust = result.distrust
    return told | {
        "ate_max_m": error.ate_max_m,
        "bent_max_m": bent(result.trajectory, recording.true_path()),
        "doubted": float(in_doubt(distrust, result.trajectory.t).mean()),
        "to_the_end": int(any(stretch["to"] is None for stretch in distrust)),
        "reasons": "; ".join(str(stretch["reason"]) for stretch in distrust),
    }


ROBOTS = {BUILDINGS: HARD} | GROUPS | {PAIRS: TWO, AMONG: SLIPS}
STUDIES = [
    Study(
        "trust_robots",
        "Robots that are not the author's: what went wrong, and what was said.",
        tuple(Case(kind, (("kind", kind), ("robot", name))) for kind in ROBOTS for name in ROBOTS[kind]),
        run=judged,
    )
]
