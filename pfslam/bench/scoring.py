"""Sections 1 and 4: the search against the definition, against a compiled loop, and against its own other ways."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from pfslam.bench.compiled import compiled_loop
from pfslam.bench.setting import Place, Setting, drive
from pfslam.bench.tables import Row, Section, interleaved
from pfslam.config import SlamConfig
from pfslam.correlation import (
    map_correlation,
    patches_and_scans,
    score_volume,
    search,
    window_scores,
)
from pfslam.grid import OccupancyGrid
from pfslam.poses import transform_points
from pfslam.search import boxes
from pfslam.search.lattice import Lattice, Window, distinct_nodes

WINDOW = Window(4, 4)
CLOUDS = {"compact": (0.02, 0.003), "middle": (0.1, 0.02), "wide": (0.5, 0.1)}
"""Standard deviations (m, rad) of clouds of particles."""


def lattice_of(place: Place) -> Lattice:
    """The lattice that a place's configuration scores on."""
    return Lattice(place.state.grid.spec.resolution, place.config.search.yaw_step)


def off_lattice(place: Place) -> Place:
    """The same place with the map moved by an odd fraction of a cell.

    A beam straight ahead, seen from a node, would end exactly on the border of two cells, where round-off decides.
    """
    grid = place.state.grid
    x, y = np.array(grid.spec.origin) + np.array([0.3717, 0.4293]) * grid.spec.resolution
    moved = OccupancyGrid(replace(grid.spec, origin=(x, y)), grid.log_odds)
    return replace(place, state=replace(place.state, grid=moved))


def search_from(place: Place) -> list:
    """All scores of all particles at a place."""
    state = place.state
    cloud = state.particles.poses
    return list(search(state.field, state.grid.spec, place.event.points_b, cloud, lattice_of(place), WINDOW))


def definition(place: Place, poses: np.ndarray) -> list[int]:
    """The scores of ``poses (S, 3)``, one after the other through the definition."""
    grid = place.state.grid
    occupied, points = grid.occupied, place.event.points_b
    return [map_correlation(occupied, grid.spec, transform_points(pose, points)) for pose in poses]


def sampled_poses(place: Place, found: list, n: int) -> tuple[np.ndarray, np.ndarray]:
    """``n`` poses drawn from all perturbations of all particles, and what the search says they score."""
    rng, lattice, poses, scores = np.random.default_rng(0), lattice_of(place), [], []
    for _ in range(n):
        box = found[rng.integers(len(found))]
        node = box.node_of[rng.integers(len(box.node_of))]
        step = rng.integers(box.scores.shape[1])
        poses.append(lattice.pose(box.nodes[node] + WINDOW.steps()[step]))
        scores.append(box.scores[node, step])
    return np.array(poses), np.array(scores)


def scoring(setting: Setting) -> Section:
    """1. All perturbations of 200 compact particles: the search against the definition."""
    place = off_lattice(drive(setting.recording, SlamConfig.report(), setting.effort.scans)[0])
    poses, scores = sampled_poses(place, search_from(place), setting.effort.sample)
    same = np.array_equal(scores, definition(place, poses))
    spent = interleaved(
        {"search": partial(search_from, place), "definition": partial(definition, place, poses)},
        setting.effort.rounds,
    )
    total = len(place.state.particles) * len(WINDOW.steps())
    by_definition = spent["definition"] * total / len(poses)
    rows = [
        Row.of("by the definition, pose by pose", 1e3 * by_definition, "ms"),
        Row.of("by the search", 1e3 * spent["search"], "ms"),
        Row.of("times faster", by_definition / spent["search"], "x", target=500.0),
        Row("same integers in the sample", float(same), "(1 = yes)", target=1.0),
    ]
    beams = len(place.event.points_b)
    note = f"{total} poses, {beams} beams; the definition on a random sample of {len(poses)}, scaled up"
    return Section(1, "Scoring every perturbation of 200 compact particles", rows, note)


def clouds(setting: Setting) -> Section:
    """4. Clouds from compact to wide: against the compiled loop, and whether the cheaper way was taken."""
    start = off_lattice(drive(setting.recording, SlamConfig.report(), setting.effort.scans)[0])
    rows = []
    for name, (sigma_xy, sigma_yaw) in CLOUDS.items():
        place = start.with_crowd(len(start.state.particles), sigma_xy, sigma_yaw)
        rows += _against_compiled(name, place, setting) + _against_other_ways(name, place, setting)
    note = "200 particles, 9 x 9 x 9, one thread each; compact 0.02 m, 0.003 rad; middle 0.1, 0.02; wide 0.5, 0.1"
    return Section(4, "Wide clouds, and the switch between the ways", rows + cost_rows(start, setting), note)


def _against_compiled(name: str, place: Place, setting: Setting) -> list[Row]:
    loop, what = compiled_loop(), f"{name}: time against the compiled loop"
    if loop is None:
        return [Row(what, None, "", note="Numba is not installed: pip install numba")]
    state, lattice = place.state, lattice_of(place)
    nodes = lattice.nearest(state.particles.poses)
    poses = lattice.pose((nodes[:, None] + WINDOW.steps()).reshape(-1, 3))
    scores, origin = np.zeros(len(poses)), np.array(state.grid.spec.origin)
    compiled = partial(
        loop, state.field, origin, state.grid.spec.resolution, place.event.points_b, poses, scores
    )
    spent = interleaved({"ours": partial(search_from, place), "loop": compiled}, setting.effort.rounds)
    ours = np.zeros((len(nodes), len(WINDOW.steps())))
    for box in search_from(place):
        ours[box.members] = box.scores[box.node_of]
    same = np.array_equal(ours.reshape(-1), scores)
    note = f"loop {1e3 * np.median(spent['loop']):.0f} ms; {'same' if same else 'OTHER'} integers"
    target = 1.0 if name == "wide" else None
    return [Row.of(what, spent["ours"] / spent["loop"], "x", target=target, best="at most", note=note)]


def _against_other_ways(name: str, place: Place, setting: Setting) -> list[Row]:
    """What was chosen, against always one volume and always each window by itself."""
    state, lattice = place.state, lattice_of(place)
    nodes = distinct_nodes(lattice.nearest(state.particles.poses))[0]
    here = (state.field, state.grid.spec, place.event.points_b, lattice)
    reach = np.array([WINDOW.cells, WINDOW.cells, WINDOW.yaws])

    def one_volume():
        low = nodes.min(axis=0) - reach
        volume = score_volume(*here, low, nodes.max(axis=0) + reach)
        x, y, k = (nodes - reach - low).T
        return sliding_window_view(volume, WINDOW.shape)[k, y, x]

    jobs: dict[str, Callable] = {
        "chosen": partial(search_from, place),
        "one volume": one_volume,
        "each window by itself": partial(window_scores, *here, nodes, WINDOW),
    }
    spent = interleaved(jobs, setting.effort.rounds)
    least = np.minimum(spent["one volume"], spent["each window by itself"])
    ways = ", ".join(f"{job} {1e3 * np.median(s):.1f} ms" for job, s in spent.items())
    what = f"{name}: the choice, against the better of two fixed ways"
    return [Row.of(what, spent["chosen"] / least, "x", note=ways)]


def cost_rows(place: Place, setting: Setting) -> list[Row]:
    """The three constants of the cost estimate, measured on this machine."""
    state, lattice = place.state, lattice_of(place)
    node = lattice.nearest(state.estimate)
    here = (state.field, state.grid.spec, place.event.points_b, lattice)
    jobs: dict[str, Callable] = {
        "turn": lambda: patches_and_scans(*here, node - [0, 0, 20], node + [0, 0, 20], (1, 1))
    }
    sides = (9, 33)
    scans = {}
    for side in sides:
        reach = np.array([side // 2, side // 2, 20])
        patches, found = patches_and_scans(*here, node - reach, node + reach, (side, side))
        scans[side] = (patches, found)
        jobs[str(side)] = partial(_add_patches, patches, found, side)
    spent = {name: np.median(s) for name, s in interleaved(jobs, setting.effort.rounds).items()}
    cells = sum(len(counts) for counts, _, _ in scans[9][1])
    small, large = (1e9 * spent[str(side)] / cells for side in sides)
    per_node = (large - small) / (sides[1] ** 2 - sides[0] ** 2)
    measured = {
        "HEADING": 1e9 * spent["turn"] / 41,
        "PATCH": small - per_node * sides[0] ** 2,
        "NODE": per_node,
    }
    return [
        Row(
            f"COST_PER_{name} measured",
            float(value),
            "ns",
            note=f"the package has {getattr(boxes, f'COST_PER_{name}')}",
        )
        for name, value in measured.items()
    ]


def _add_patches(patches, scans, side: int) -> None:
    """Copy and add the patches of side x side nodes that each heading selects, a cacheful at a time."""
    for counts, iy, ix in scans:
        for k in range(0, len(counts), 64):
            some = slice(k, k + 64)
            _ = counts[some] @ patches[iy[some], ix[some]].reshape(-1, side * side)
