"""Section 8: where the milliseconds of one update go, beside the least that the machine would need."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from pfslam.bench.scoring import lattice_of
from pfslam.bench.setting import Place, Setting, drive
from pfslam.bench.tables import Row, Section, interleaved
from pfslam.config import PolishConfig, SlamConfig
from pfslam.correlation import patches_and_scans, score_volume, search, updated_field
from pfslam.grid import integrate_scan
from pfslam.matching import match, window_for
from pfslam.particles import effective_sample_size, reweight
from pfslam.poses import transform_points
from pfslam.refinement import polish
from pfslam.search.lattice import Window, distinct_nodes
from pfslam.slam import estimate_pose, predict_motion

SEARCH = "search in all: these two, boxes, blocks"
TURN = "turn, round to cells, merge"
WIDTH = 40
"""Characters of the longest bar."""


@dataclass(frozen=True)
class Part:
    """A part of an update; ``without`` names one that it contains and that is taken off.

    ``bytes`` that it has to read and write at least, ``products`` that it has to add up.
    """

    job: Callable
    without: str | None = None
    bytes: float = 0.0
    products: float = 0.0


def profile(setting: Setting) -> Section:
    """8. One refined update with 200 particles, part by part."""
    config = replace(SlamConfig.refined(), draw_metres=0.0, draw_radians=0.0)
    place, _ = drive(setting.recording, config, setting.effort.scans)
    parts = parts_of(place)
    jobs = {name: part.job for name, part in parts.items()} | {"whole update": place.update}
    spent = interleaved(jobs, 3 * setting.effort.rounds)
    rows, longest = [], 1e3 * float(np.median(spent["whole update"]))
    for name, part in parts.items():
        own = 1e3 * (spent[name] - (spent[part.without] if part.without else 0.0))
        memory = 1e3 * part.bytes / setting.machine.bytes_per_second
        arithmetic = 1e3 * part.products / setting.machine.products_per_second
        least, by = max((memory, "memory"), (arithmetic, "arithmetic"))
        bar = "#" * round(WIDTH * max(float(np.median(own)), 0.0) / longest)
        rows.append(Row.of(name, own, "ms", limit=least, note=f"{by} alone {least:.3f} ms {bar}".rstrip()))
    rows.append(Row.of("whole update", 1e3 * spent["whole update"], "ms"))
    return Section(8, "One update, part by part", rows, "200 particles, polish included; bars to scale")


def parts_of(place: Place) -> dict[str, Part]:
    """The parts of an update from this place, in order."""
    state, event, config = place.state, place.event, place.config
    particles, variance = predict_motion(state.particles, event, config, np.random.default_rng(0))
    points, sigmas, n = event.points_b[:: config.search.beam_stride], np.sqrt(variance), len(particles)
    lattice = lattice_of(place)
    window = window_for(config.search, lattice, *sigmas)
    here = (state.field, state.grid.spec, points)
    parts = _search_parts(place, particles.poses, points, window)
    whole = partial(match, *here, particles.poses, sigmas, config.search, np.random.default_rng(0))
    moved, scores = whole().log_likelihood, n * len(window.steps())
    lines = config.polish or PolishConfig()
    ends, estimate = event.points_b[:: lines.beam_stride], state.estimate
    align = partial(polish, state.moments, ends, estimate, estimate, lines)

    def weigh():
        weighted, _ = reweight(particles, moved)
        return estimate_pose(weighted, config), effective_sample_size(weighted.weights)

    beams = lines.iterations * len(ends)
    return {
        "predict": Part(
            partial(predict_motion, state.particles, event, config, np.random.default_rng(0)), None, 96.0 * n
        ),
        **parts,
        "climb to the best perturbation": Part(whole, SEARCH, 4.0 * scores, 3.0 * scores),
        "reweight, estimate": Part(weigh, None, 64.0 * n),
        "polish": Part(align, None, beams * 9 * 6 * 8.0, beams * 9 * 36.0),
        **_map_parts(place),
    }


def _search_parts(place: Place, poses: np.ndarray, points: np.ndarray, window: Window) -> dict[str, Part]:
    state, lattice = place.state, lattice_of(place)
    here = (state.field, state.grid.spec, points, lattice)
    reach = np.array([window.cells, window.cells, window.yaws])
    nodes = distinct_nodes(lattice.nearest(poses))[0]
    low, high = nodes.min(axis=0) - reach, nodes.max(axis=0) + reach
    columns, rows, headings = (int(k) for k in high - low + 1)
    turn = partial(patches_and_scans, *here, low, high, (rows, columns))
    cells = sum(len(counts) for counts, _, _ in turn()[1])
    added = float(cells * rows * columns)
    look = partial(search, state.field, state.grid.spec, points, poses, lattice, window)
    return {
        TURN: Part(turn, None, headings * len(points) * 32.0),
        "copy patches and add them": Part(partial(score_volume, *here, low, high), TURN, 4.0 * added, added),
        SEARCH: Part(lambda: list(look()), None, 4.0 * added, added),
    }


def _map_parts(place: Place) -> dict[str, Part]:
    state, event, config = place.state, place.event, place.config
    points_w = transform_points(state.estimate, event.points_b)
    sensor_w = transform_points(state.estimate, event.sensor_b[None])[0]
    grid = state.grid.covering(points_w)
    draw = partial(integrate_scan, grid, points_w, event.beams, sensor_w, config.map)
    occupied, rectangle = grid.occupied, draw()[1]
    renew = partial(updated_field, state.field, occupied, rectangle, config.search.field)
    copied = 8.0 * grid.log_odds.size  # the old map stays as it was: 4 bytes a cell read, 4 written
    return {
        "draw the scan": Part(draw, None, copied),
        "renew the field": Part(renew, None, copied),
        "add the hits' moments": Part(partial(state.moments.add, points_w), None, copied),
    }
