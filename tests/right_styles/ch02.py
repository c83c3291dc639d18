"""Right answers to the exercises of chapter 02, in the ways that people write them: each must pass its check."""

import math
from fractions import Fraction

import numpy as np

from pfslam.grid import GridSpec, trace_rays

LOG_4 = np.log(4)


def cells_in_a_loop(points, origin, resolution):
    found = []
    for x, y in points:
        found.append((math.floor((y - origin[1]) / resolution), math.floor((x - origin[0]) / resolution)))
    return found


def cells_by_division(points, origin, resolution):
    ix, iy = ((points - np.asarray(origin)) // resolution).T
    return np.stack([iy, ix], axis=1)


def cells_by_edges(points, origin, resolution):
    edges = [low + resolution * np.arange(-8, 40) for low in origin]
    ix, iy = (np.searchsorted(e, c, side="right") - 9 for e, c in zip(edges, points.T, strict=True))
    return np.column_stack([iy, ix]).astype(np.int16)


def cells_in_float32(points, origin, resolution):
    cells = (np.float32(points) - np.float32(origin)) / np.float32(resolution)
    return np.floor(cells)[:, [1, 0]]


def cells_of_the_package(points, origin, resolution):
    return GridSpec(tuple(origin), resolution, (3, 3)).world_to_cell(points)[:, ::-1]


def story_by_odds(story, clamp):
    odds = 1.0
    for word in story:
        odds *= {"hit": 4, "free": 1 / 4, "none": 1}[word]
        odds = max(min(odds, math.exp(clamp)), math.exp(-clamp))
    return odds / (1 + odds)


def story_by_bayes(story, clamp):
    gamma, most = 0.5, 1 / (1 + np.exp(-clamp))
    for word in story:
        if word != "none":
            p, q = (0.8, 0.2) if word == "hit" else (0.2, 0.8)
            gamma = p * gamma / (p * gamma + q * (1 - gamma))
        gamma = np.clip(gamma, 1 - most, most)
    return [round(float(gamma), 4)]


def story_in_array(story, clamp):
    steps = np.select([np.array(story) == "hit", np.array(story) == "free"], [LOG_4, -LOG_4], 0.0)
    level = np.float32(0)
    for step in steps.astype(np.float32):
        level = np.minimum(np.maximum(level + step, -clamp), clamp)
    return np.float32(1) / (1 + np.exp(-level))


def story_in_fractions(story, clamp):
    odds, most = Fraction(1), Fraction(math.exp(clamp))
    for word in story:
        odds = min(max(odds * {"hit": 4, "free": Fraction(1, 4), "none": 1}[word], 1 / most), most)
    return odds / (1 + odds)


def story_by_accumulating(story, clamp):
    steps = [0.0] + [LOG_4 * ((word == "hit") - (word == "free")) for word in story]
    clipped = np.frompyfunc(lambda level, step: np.clip(level + step, -clamp, clamp), 2, 1)
    return np.array([1 / (1 + np.exp(-clipped.accumulate(np.array(steps, dtype=object))[-1]))])


def crossed_in_a_loop(start, ends):
    cells = []
    for end in ends.tolist():
        way = [int(e - s) for s, e in zip(start, end, strict=True)]
        n = max(map(abs, way))
        cells += [
            tuple(round(s + k / n * d) for s, d in zip(start.tolist(), way, strict=True)) for k in range(n)
        ]
    return cells


def crossed_by_linspace(start, ends):
    rays = [np.rint(np.linspace(start, end, np.abs(end - start).max() + 1))[:-1] for end in ends]
    return np.concatenate(rays)


def crossed_all_at_once(start, ends):
    way = ends - start
    n = np.abs(way).max(axis=1)
    share = np.arange(n.max())[:, None] / np.maximum(n, 1)
    cells = np.floor(start + share[..., None] * way + 0.5)
    return cells[np.arange(n.max())[:, None] < n].astype(np.int16)


def crossed_each_once(start, ends):
    return sorted(set(crossed_in_a_loop(start, ends)))


def crossed_by_bresenham(start, ends):
    cells = []
    for end in ends:
        (r, c), (dr, dc) = start, np.abs(end - start)
        sr, sc, error = np.sign(end[0] - r), np.sign(end[1] - c), dr - dc
        while (r, c) != tuple(end):
            cells.append((r, c))
            twice = 2 * error
            if twice > -dc:
                error, r = error - dc, r + sr
            if twice < dr:
                error, c = error + dr, c + sc
    return cells


def write_by_sets(log_odds, hits, free, hit_step, free_step, clamp):
    new = [list(row) for row in log_odds]
    struck = {tuple(cell) for cell in hits.tolist()}
    for iy, ix in struck | {tuple(cell) for cell in free.tolist()}:
        change = hit_step if (iy, ix) in struck else -free_step
        new[iy][ix] = min(max(new[iy][ix] + change, -clamp), clamp)
    return new


def write_by_masks(log_odds, hits, free, hit_step, free_step, clamp):
    struck, crossed = np.zeros(log_odds.shape, bool), np.zeros(log_odds.shape, bool)
    struck[tuple(hits.T)], crossed[tuple(free.T)] = True, True
    return np.clip(log_odds + hit_step * struck - free_step * (crossed & ~struck), -clamp, clamp)


def write_by_repeated_index(log_odds, hits, free, hit_step, free_step, clamp):
    change = np.zeros_like(log_odds, dtype=np.float32)
    change[tuple(free.T)] -= free_step  # three times the same cell: subtracted once
    change[tuple(hits.T)] = hit_step
    return np.clip(np.float32(log_odds) + change, -clamp, clamp)


def meaning_by_rules(reading, range_min, range_max):
    if range_min <= reading < range_max:
        return "hit"
    return "free" if reading >= range_max else "nothing"


def meaning_by_numpy(reading, range_min, range_max):
    reading = np.float32(reading)
    return str(np.select([reading >= range_max, reading >= range_min], ["free", "hit"], "nothing"))


STYLES = {
    "check_cell_of": [
        cells_in_a_loop,
        cells_by_division,
        cells_by_edges,
        cells_in_float32,
        cells_of_the_package,
        lambda *a: tuple(map(list, cells_in_a_loop(*a))),
    ],
    "check_cell_story": [
        story_by_odds,
        story_by_bayes,
        story_in_array,
        story_in_fractions,
        story_by_accumulating,
    ],
    "check_crossed_cells": [
        crossed_in_a_loop,
        crossed_by_linspace,
        crossed_all_at_once,
        crossed_each_once,
        crossed_by_bresenham,
        trace_rays,
    ],
    "check_update_log_odds": [
        write_by_sets,
        write_by_masks,
        write_by_repeated_index,
        lambda *a: np.round(write_by_masks(*a), 4),
    ],
    "check_meaning": [
        meaning_by_rules,
        meaning_by_numpy,
        lambda *a: np.str_(meaning_by_rules(*a)),
    ],
}
