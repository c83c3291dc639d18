"""From a finished run to a revised one: key scans, candidates, checks against false loops, the map drawn anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pfslam.events import Drive
from pfslam.grid import GridSpec, OccupancyGrid, integrate_scan
from pfslam.loops.graph import Edges, chi_square, relax
from pfslam.loops.places import Place, align, blind, search_window
from pfslam.poses import Trajectory, between, compose, invert, transform_points
from pfslam.recording import Recording
from pfslam.runs import SlamResult

KEY_METRES, KEY_RADIANS = 1.0, 0.5
"""A key scan is taken after so much motion."""
AROUND, APART = 2, 2
"""A place holds so many key scans either side; where only wheels measured, scans so far apart are matched anew."""
LEAST_WAY, NEARBY, DRIFT, FARTHEST = 10.0, 1.5, 0.02, 8.0
"""After so many metres a loop is looked for, within ``NEARBY + DRIFT * way`` (m), at most ``FARTHEST``."""
YAW_SHARE = 0.06
"""Headings are searched so many radians to each side for every metre of that."""
LEAST_SHARE, TWIN, SUPPORT = 0.6, 0.9, 2
"""Share of points that two places explain of each other; score of a twin; loops that agree with one."""
AGREES, LEAST_SCALE = 7.81, 0.015
"""Squared error (chi-square) that 19 of 20 right loops stay below; least error of the wheels' scale that counts."""
LOOP_FLOOR, NEIGHBOUR_FLOOR = np.array([0.03, 0.03, 0.005]) ** 2, np.array([0.01, 0.01, 0.02]) ** 2
"""Variances (m^2, m^2, rad^2) that no match is better than, however many beams agree."""


@dataclass(frozen=True, eq=False)
class Revision:
    """A revised run: the path at the same times, the map drawn from it, and what was done.

    ``keys (K,)`` are indices of scans, ``candidates`` the number of pairs looked at, ``loops`` those kept, as edges
    between key scans, ``moved (T,)`` how far (m) each pose was moved, ``scale (K,)`` what was found about the wheels.
    """

    trajectory: Trajectory
    grid: OccupancyGrid
    keys: np.ndarray
    candidates: int
    loops: Edges
    moved: np.ndarray
    scale: np.ndarray


def close_loops(recording: Recording, result: SlamResult) -> Revision:
    """Revise the path of a finished run so that places seen twice agree, and draw the map anew.

    Where only the wheels measured the way, neighbouring scans are matched again, which finds the wheels' scale even on
    a drive that never returns. With neither loops nor such stretches the path stays as it is.
    """
    poses, keys = result.trajectory.poses, key_scans(result)
    events = Drive.of(recording, result.config).events()
    places = [Place.of(event) for k, event in enumerate(events) if k in keys]
    at, chain = poses[keys], chain_edges(result, keys)
    candidates, neighbours = find_candidates(at), neighbour_edges(places, at, chain.wheels)
    loops = consistent(match_loops(places, at, candidates), at)
    path, grid, scale = poses, result.grid, np.zeros(len(keys))
    if len(loops) + len(neighbours):
        held = confirming(loops, at)
        revised, scale, weights = relax(chain.joined(neighbours, held), at)
        if np.abs(scale).max() < LEAST_SCALE:
            revised, scale, weights = relax(chain.joined(held), at)
        loops = loops.chosen(weights[len(weights) - len(loops) :] > 0.5)
        path = carried(poses, keys, revised)
        grid = redrawn(recording, result, path)
    moved = np.hypot(*(path - poses)[:, :2].T)
    return Revision(Trajectory(result.trajectory.t, path), grid, keys, len(candidates), loops, moved, scale)


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
    alone = np.array([info.free_direction is not None or not info.matched for info in result.infos])
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


def submap(places: list[Place], poses: np.ndarray, k: int) -> Place:
    """Draw a key scan and its neighbours together, in the frame of the key scan."""
    near = range(max(k - AROUND, 0), min(k + AROUND + 1, len(poses)))
    parts = [places[n].seen_from(between(poses[k], poses[n])) for n in near]
    return Place(np.vstack([p.points for p in parts]), np.vstack([p.normals for p in parts]))


def match_loops(places: list[Place], poses: np.ndarray, candidates: list[tuple[int, int, float]]) -> Edges:
    """Match the candidates, and keep those in which each place explains most of the other."""
    found = []
    for i, j, radius in candidates:
        here, there, guess = submap(places, poses, i), submap(places, poses, j), between(poses[i], poses[j])
        if min(len(here.points), len(there.points)) < 10:
            continue
        (best, score), (twin, second) = search_window(here, there, guess, radius, YAW_SHARE * radius)
        fit = align(here, there, best, (0.1, 0.05))
        back = align(there, here, invert(fit.pose), (0.1, 0.05), rounds=1)
        if min(fit.share, back.share) >= LEAST_SHARE:
            unknown = blind(here, there, fit) + ([(twin - best)[:2]] if second > TWIN * score else [])
            found.append((i, j, fit.pose, softened(fit.information, LOOP_FLOOR, unknown)))
    return _edges(found)


def neighbour_edges(places: list[Place], poses: np.ndarray, wheels: np.ndarray) -> Edges:
    """Match key scans anew with others a little way back, where only the wheels measured the way in between.

    Scan against scan, what little there is across a corridor's length, the sides of a door frame, is not yet smeared by
    the very error that it is to show. The heading is left to the chain, which knows it better.
    """
    found = []
    for i in np.flatnonzero([wheels[k : k + APART].any() for k in range(len(poses) - APART)]):
        here, there, guess = places[i], places[i + APART], between(poses[i], poses[i + APART])
        if min(len(here.points), len(there.points)) >= 10:
            fit = align(here, there, guess, (0.02 + 0.03 * float(np.hypot(*guess[:2])), 0.02))
            unknown = blind(here, there, fit)
            found.append((i, i + APART, fit.pose, softened(fit.information, NEIGHBOUR_FLOOR, unknown)))
    return _edges(found)


def _edges(found: list[tuple]) -> Edges:
    i, j, pose, information = zip(*found, strict=True) if found else ((), (), (), ())
    ends, poses = (np.array(i, dtype=int), np.array(j, dtype=int)), np.reshape(pose, (-1, 3))
    informations = np.reshape(information, (-1, 3, 3))
    return Edges(*ends, poses, informations, np.zeros(len(found)), np.ones(len(found), dtype=bool))


def softened(information: np.ndarray, floor: np.ndarray, unknown: Sequence[np.ndarray]) -> np.ndarray:
    """Return an honest information ``(3, 3)``: none along the directions ``unknown (2,)``, and none above a floor.

    The Schur complement Omega - Omega u u^T Omega / u^T Omega u is what remains if the place along u may be anything;
    Omega (I + Sigma_0 Omega)^-1 adds the floor's covariance, also to an Omega that has no inverse.
    """
    for direction in unknown:
        u = np.append(direction / np.hypot(*direction), 0.0)
        known = information @ u
        information = information - np.outer(known, known) / max(float(u @ known), 1e-9)
    soft = information @ np.linalg.inv(np.eye(3) + np.diag(floor) @ information)
    return 0.5 * (soft + soft.T)


def consistent(loops: Edges, poses: np.ndarray, reach: float = 8.0) -> Edges:
    """Keep the loops with which at least ``SUPPORT`` others nearby, and most of them, agree (Olson, 2009).

    Another loop, carried along the path to both ends of this one, predicts it.
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


def confirming(loops: Edges, poses: np.ndarray) -> Edges:
    """Return the loops such that those which agree with the path hold it as it is, and the others pull.

    A loop agrees if its error is one that 19 of 20 right ones stay below. What it measured is no better than what the
    path says already, and would only bring its noise.
    """
    agrees = chi_square(loops, poses, np.zeros(len(poses))) <= AGREES
    says = between(poses[loops.i], poses[loops.j])
    return replace(loops, pose=np.where(agrees[:, None], says, loops.pose))


def carried(poses: np.ndarray, keys: np.ndarray, revised: np.ndarray) -> np.ndarray:
    """Revise all poses ``(T, 3)`` by what moves the key scans to their places, interpolated between them."""
    change = Trajectory(keys, compose(revised, invert(poses[keys])))
    return compose(change.at(np.clip(np.arange(len(poses)), keys[0], keys[-1])), poses)


def redrawn(recording: Recording, result: SlamResult, path: np.ndarray) -> OccupancyGrid:
    """Draw the map anew: the scans that the run drew, each from its revised pose."""
    grid = OccupancyGrid.empty(GridSpec.around(path[:, :2], result.config.map.resolution, margin=5.0))
    events = Drive.of(recording, result.config).events()
    for event, info, pose in zip(events, result.infos, path, strict=True):
        if info.drawn:
            points, sensor = (transform_points(pose, p) for p in (event.points_b, event.sensor_b[None]))
            grid = grid.covering(np.vstack([points, sensor]))
            grid, _ = integrate_scan(grid, points, event.beams, sensor[0], result.config.map)
    return grid
