"""From a finished run to a revised one: key scans, candidates, checks against false loops, the map drawn anew."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pfslam.beyond.loops.graph import Edges, chi_square, relax
from pfslam.beyond.loops.places import Place, align, compare, search_window
from pfslam.grid import OccupancyGrid
from pfslam.poses import Trajectory, between, compose, invert
from pfslam.recording import Recording
from pfslam.refined.filling import filled
from pfslam.run import SlamResult

KEY_METRES, KEY_RADIANS = 1.0, 0.5
"""A scan becomes the next key scan after so much motion."""
AROUND = 2
"""A place is drawn from a key scan and so many key scans before and after it."""
APART = 2
"""Where only the wheels measured the way, a key scan is matched again to the one so many key scans later."""
LEAST_WAY = 10.0
"""Two key scans can close a loop if the robot drove at least so many metres between them."""
NEARBY, DRIFT, FARTHEST = 1.5, 0.02, 8.0
"""The search for a loop reaches ``NEARBY + DRIFT * way`` (m), as the error grows with the way; at most ``FARTHEST``."""
YAW_SHARE = 0.06
"""For every metre that a search reaches, it also turns by so much (rad)."""
LEAST_POINTS = 10
"""A place with fewer points is not matched."""
LEAST_SHARE = 0.6
"""After a match each place must explain at least this share of the other's points."""
TWIN = 0.9
"""A second pose with at least this share of the best score may be the right one as well."""
SUPPORT = 2
"""A loop is kept if at least so many others nearby agree with it."""
LEAST_CERTAIN = 0.5
"""A match whose standard deviation (m) is larger in some direction counts as a constraint, but not as a loop."""
AGREES = 7.81
"""The squared error (chi-square, 3 degrees of freedom) that 19 of 20 right loops stay below."""
LEAST_SCALE = 0.015
"""A smaller error of the wheels' scale than this cannot be told from none, and is taken for none."""
LOOP_FLOOR, NEIGHBOUR_FLOOR = np.array([0.03, 0.03, 0.005]) ** 2, np.array([0.01, 0.01, 0.02]) ** 2
"""Variances (m^2, m^2, rad^2) that no match is better than, however many beams agree."""


@dataclass(frozen=True, eq=False)
class Revision:
    """A revised run: the path at the same times, the map drawn from it, and what was done.

    ``keys (K,)`` are indices of scans, ``candidates`` the number of pairs looked at, ``loops`` those kept that fix
    a position, as edges between key scans, ``scale (K,)`` what was found about the wheels, and ``across`` how many more
    were kept that leave a direction open by half a metre or more, as along a corridor: springs, but no loops.
    """

    trajectory: Trajectory
    grid: OccupancyGrid
    keys: np.ndarray
    candidates: int
    loops: Edges
    scale: np.ndarray
    across: int


def close_loops(recording: Recording, result: SlamResult) -> Revision:
    """Revise the path of a finished run so that places seen twice agree, and draw the map anew.

    Where only the wheels measured the way, neighbouring scans are matched again, which finds the wheels' scale even on
    a drive that never returns. With neither loops nor such stretches the path stays as it is.
    """
    poses, keys = result.trajectory.poses, key_scans(result)
    events = result.config.used_scans(recording).events()
    places = [Place.of(event) for k, event in enumerate(events) if k in keys]
    at, chain = poses[keys], chain_edges(result, keys)
    candidates, path, grid, scale = find_candidates(at), poses, result.grid, np.zeros(len(keys))
    loops = consistent(matched(places, at, candidates, AROUND, LOOP_FLOOR), at)
    along = matched(places, at, neighbours(chain), 0, NEIGHBOUR_FLOOR)
    if len(loops) + len(along):
        held = confirming(loops, at)
        revised, scale, weights = relax(chain.joined(along, held), at)
        if np.abs(scale).max() < LEAST_SCALE:
            revised, scale, weights = relax(chain.joined(held), at)
        loops = loops.chosen(weights[len(weights) - len(loops) :] > 0.5)
        path = carried(poses, keys, revised)
        grid = redrawn(recording, result, path)
    done, sure = Trajectory(result.trajectory.t, path), loops.chosen(certain(loops))
    return Revision(done, grid, keys, len(candidates), sure, scale, len(loops) - len(sure))


def key_scans(result: SlamResult) -> np.ndarray:
    """Choose the key scans ``(K,)``: the first, and each after a metre or half a radian of motion."""
    poses, usable = result.trajectory.poses, [info.matched or info.drawn for info in result.infos]
    keys = [int(np.argmax(usable))]
    for k in np.flatnonzero(usable):
        motion = between(poses[keys[-1]], poses[k])
        if np.hypot(*motion[:2]) >= KEY_METRES or abs(motion[2]) >= KEY_RADIANS:
            keys.append(int(k))
    return np.array(keys)


def chain_edges(result: SlamResult, keys: np.ndarray) -> Edges:
    """Join each key scan to the next by the filter's own motion, with the share of it that only the wheels measured."""
    at, index = result.trajectory.poses[keys], np.arange(len(keys))
    motion = between(at[:-1], at[1:])
    alone = np.array([info.silent_direction is not None or not info.matched for info in result.infos])
    share = np.array([alone[a + 1 : b + 1].mean() for a, b in pairwise(keys)])
    xy, yaw = 0.003 + 0.003 * np.hypot(*motion[:, :2].T), 0.0005 + 0.005 * np.abs(motion[:, 2])
    information = np.stack([xy**-2, xy**-2, yaw**-2], axis=1)[:, :, None] * np.eye(3)
    return Edges(index[:-1], index[1:], motion, information, share, np.zeros(len(motion), dtype=bool))


def way_along(poses: np.ndarray) -> np.ndarray:
    """Return the way driven (m) up to each of the poses ``(K, 3)``."""
    return np.append(0.0, np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T)))


def find_candidates(poses: np.ndarray) -> list[tuple[int, int, float]]:
    """List pairs of key scans (i, j) near each other but far apart by the way driven, and how far (m) to search.

    Of each earlier visit the nearest key scan is taken.
    """
    way, pairs = way_along(poses), []
    for j in range(len(poses)):
        apart, distance = way[j] - way[:j], np.hypot(*(poses[:j] - poses[j])[:, :2].T)
        radius = np.minimum(NEARBY + DRIFT * apart, FARTHEST)
        near = np.flatnonzero((apart > LEAST_WAY) & (distance < radius))
        for visit in np.split(near, np.flatnonzero(np.diff(near) > 3) + 1):
            if len(visit):
                i = int(visit[np.argmin(distance[visit])])
                pairs.append((i, j, float(radius[i])))
    return pairs


def submap(places: list[Place], poses: np.ndarray, k: int, around: int) -> Place:
    """Draw a key scan and its neighbours together, in the frame of the key scan."""
    near = range(max(k - around, 0), min(k + around + 1, len(poses)))
    parts = [places[n].seen_from(between(poses[k], poses[n])) for n in near]
    return Place(np.vstack([p.points for p in parts]), np.vstack([p.normals for p in parts]))


def neighbours(chain: Edges) -> list[tuple[int, int, float]]:
    """List pairs of key scans (i, j) a little way apart where only the wheels measured the way; nothing to search."""
    return [(i, i + APART, 0.0) for i in range(len(chain) + 1 - APART) if chain.wheels[i : i + APART].any()]


def matched(places: list[Place], poses: np.ndarray, pairs: list, around: int, floor: np.ndarray) -> Edges:
    """Match pairs of key scans with ``around`` others either side, and return what was found as edges.

    After a search each place must explain most of the other. If a twin pose is as good, the place may be there as well:
    its covariance grows by d d^T with d from the best pose to the twin, so that the edge says nothing along d.
    """
    found = []
    for i, j, radius in pairs:
        here, there = submap(places, poses, i, around), submap(places, poses, j, around)
        pose, unsure = between(poses[i], poses[j]), np.diag(floor)
        if min(len(here.points), len(there.points)) < LEAST_POINTS:
            continue
        if radius > 0.0:
            (pose, score), (twin, second) = search_window(here, there, pose, radius, YAW_SHARE * radius)
            unsure = unsure + (second > TWIN * score) * np.outer(twin - pose, twin - pose)
        pose = align(here, there, pose)
        (_, information, share), (_, _, back) = compare(here, there, pose), compare(there, here, invert(pose))
        if radius == 0.0 or min(share, back) >= LEAST_SHARE:
            found.append((i, j, pose, softened(information, unsure)))
    ends, zero = np.array([pair[:2] for pair in found], dtype=int).reshape(-1, 2).T, np.zeros(len(found))
    motions, certain = (np.array([pair[k] for pair in found]) for k in (2, 3))
    return Edges(ends[0], ends[1], motions.reshape(-1, 3), certain.reshape(-1, 3, 3), zero, zero == 0.0)


def softened(information: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the information ``(3, 3)`` that is left when another error of such a ``covariance (3, 3)`` is added.

    (Omega^-1 + Sigma)^-1 = Omega (I + Sigma Omega)^-1, also of an Omega that has no inverse.
    """
    return information @ np.linalg.inv(np.eye(3) + covariance @ information)


def consistent(loops: Edges, poses: np.ndarray, reach: float = 8.0) -> Edges:
    """Keep a loop if ``SUPPORT`` or more of the loops near it, and more than half of them, agree with it (Olson, 2009).

    The path joins both ends of this loop to those of one near it. So that one predicts what this one should measure.
    """
    way, keep = way_along(poses), np.zeros(len(loops), dtype=bool)
    for b in range(len(loops)):
        gap = np.abs(way[loops.i] - way[loops.i[b]]) + np.abs(way[loops.j] - way[loops.j[b]])
        near = np.flatnonzero((gap < reach) & (np.arange(len(loops)) != b))
        before = between(poses[loops.i[b]], poses[loops.i[near]])
        after = between(poses[loops.j[near]], poses[loops.j[b]])
        error = np.abs(between(loops.pose[b], compose(compose(before, loops.pose[near]), after)))
        agree = (error < [0.2, 0.2, 0.04] + np.outer(gap[near], [0.03, 0.03, 0.003])).all(axis=1)
        keep[b] = np.count_nonzero(agree) >= SUPPORT and 2 * np.count_nonzero(agree) > len(near)
    return loops.chosen(keep)


def certain(loops: Edges) -> np.ndarray:
    """Say which matches ``(E,)`` bool fix a place to ``LEAST_CERTAIN`` in each direction, if the heading is known."""
    return np.linalg.eigvalsh(loops.information[:, :2, :2])[:, 0] > LEAST_CERTAIN**-2


def confirming(loops: Edges, poses: np.ndarray) -> Edges:
    """Change the loops so that those which agree with the path hold it as it is, while the others pull.

    A loop agrees if its error is one that 19 of 20 right ones stay below. What it measured is no better than what the
    path says already, and would only bring its noise.
    """
    agrees = chi_square(loops, poses, np.zeros(len(poses))) <= AGREES
    return replace(loops, pose=np.where(agrees[:, None], between(poses[loops.i], poses[loops.j]), loops.pose))


def carried(poses: np.ndarray, keys: np.ndarray, revised: np.ndarray) -> np.ndarray:
    """Revise all poses ``(T, 3)`` by what moves the key scans to their places, interpolated between them."""
    change = Trajectory(keys, compose(revised, invert(poses[keys])))
    return compose(change.at(np.clip(np.arange(len(poses)), keys[0], keys[-1])), poses)


def redrawn(recording: Recording, result: SlamResult, path: np.ndarray) -> OccupancyGrid:
    """Draw the map anew, as the run drew it: the same scans in the same way, each from its pose on ``path (K, 3)``."""
    map, spacing = result.config.start().map, getattr(result.config, "beam_spacing", 0.0)
    events = result.config.used_scans(recording).events()
    for event, info, pose in zip(events, result.infos, path, strict=True):
        if info.drawn:
            map.draw(filled(event, spacing), pose)
    return map.grid
