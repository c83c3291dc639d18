"""Chapter 10: how often, how soon and with how many particles a robot is found in a known map."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from pfslam_book.ch10.building import (
    distances,
    match_along,
    part,
    shares,
    true_map,
    two_halves,
    without_furniture,
)

from measure import cases
from pfslam.beyond.localization import LocalizationConfig, locate, spread
from pfslam.particles import Particles
from pfslam.refined.events import LevelledScans
from pfslam.simulator import Simulation, simulate
from pfslam.study import Case, Study

BUILDINGS, STARTS, SECONDS = range(1, 11), (10.0, 45.0, 80.0), 30.0
SEEDS, HEAPS = range(20), (500, 5000)
NEAR = (0.05, 0.05, 0.02)
"""The deviations (m, m, rad) of a cloud whose start is known."""
WHOLE = LocalizationConfig()
VARIANTS = {
    "adaptive, with injection": WHOLE,
    "without injection": replace(WHOLE, inject=False),
    "1,000 particles, no injection": replace(WHOLE, first=1000, particles=1000, inject=False),
    "1,000 particles, with injection": replace(WHOLE, first=1000, particles=1000),
}
MATCHING = "scan matching, random start"
PAGE = Path(__file__).parents[3] / "notebooks" / "10_lost_and_found.ipynb"
NUMBERS, MORE = (100, 1000, 10_000, 100_000), 800_000
"""Particles at the start, in twenty clouds each; and eight times as many as usual."""
CHANGES: dict[str, dict[str, float]] = {
    "as it is": {},
    "resampled at every scan": {"below": 1.0},
    "at least 5,000 particles": {"least": 5000},
    "SIGMA = 0.05": {"SIGMA": 0.05},
    "SIGMA = 0.4": {"SIGMA": 0.4},
    "B_EFF = 30": {"B_EFF": 30.0},
    "B_EFF = 1": {"B_EFF": 1.0},
}
"""Arguments of the page's ``localise``; in capitals, constants of the page."""


@lru_cache(maxsize=1)
def hall(building: int) -> Simulation:
    """A simulated hall; each process keeps the last one."""
    return simulate("hall", building)


def found(case: Case) -> dict[str, Any]:
    """Search a building from one start, or match scans from one random pose."""
    building, start = case.get("building"), case.get("start_s")
    grid, recording = true_map(hall(building)), part(hall(building).recording, start, SECONDS)
    rng = np.random.default_rng([building, int(start)])
    row: dict[str, Any] = {"particles": 1}
    if case.label == MATCHING:
        path = match_along(grid, recording, spread(grid, 1, rng)[0])
        return row | {"error_at_end_m": distances(path, recording)[-1]}
    result = locate(grid, recording, VARIANTS[case.label], rng=rng, keep_particles=False)
    path, away = result.trajectory, distances(result.trajectory, recording)
    row["particles"] = np.mean([info.number for info in result.infos if info.used])
    if result.found_at is not None:
        at = int(np.searchsorted(path.t, result.found_at))
        truth = recording.true_path().at(path.t[: at + 1])
        row["seconds_to_find"] = result.found_at - path.t[0]
        row["metres_to_find"] = np.hypot(*np.diff(truth[:, :2], axis=0).T).sum()
        row["error_when_found_m"] = away[at]
    return row | {"error_at_end_m": away[-1]}


def poor(case: Case) -> dict[str, Any]:
    """Search a plan without furniture, from nowhere or from a start that is known."""
    building, start = case.get("building"), case.get("start_s")
    grid = true_map(without_furniture(hall(building).world))
    recording, cloud = part(hall(building).recording, start, SECONDS), None
    rng = np.random.default_rng([building, int(start)])
    if case.get("known"):
        first = recording.true_path().at(recording.scans().t[0])
        cloud = Particles(first + rng.normal(0.0, NEAR, (500, 3)), np.zeros(500))
    config = replace(WHOLE, inject=case.get("inject"))
    result = locate(grid, recording, config, rng=rng, start=cloud, keep_particles=False)
    return {"error_at_end_m": distances(result.trajectory, recording)[-1]}


def twins(case: Case) -> dict[str, Any]:
    """Search the building of two halves with its door or without, or let two even heaps drift in it."""
    place = two_halves(door=case.label == "door")
    rng, config, start = np.random.default_rng(case.get("seed")), WHOLE, None
    if case.label.startswith("drift"):
        n = int(case.label.split()[1])
        # The number of particles is held, and none is drawn anew: what is left is chance.
        config = replace(WHOLE, particles=n, least=n, inject=False)
        first = place.recording.true_path().poses[0]
        sides = np.where(np.arange(n)[:, None] % 2, first, place.twin(first))
        start = Particles(sides + rng.normal(0.0, NEAR, (n, 3)), np.zeros(n))
    result = locate(place.grid, place.recording, config, rng=rng, start=start)
    t = result.trajectory.t - result.trajectory.t[0]
    infos = result.infos[int(np.argmin(np.abs(t - 10.0)))], result.infos[-1]
    early, end = (shares(place, i.t, i.particles.poses, i.particles.weights) for i in infos)
    row = {"share_10s": early[0] / sum(early), "share_end": end[0] / sum(end)}
    if result.located.any():
        sure = int(np.argmax(result.located))
        right = distances(result.trajectory, place.recording)[sure] <= 0.5
        row |= {"sure_after_s": t[sure], "sure_right": int(right)}
    return row


@lru_cache(maxsize=1)
def localiser() -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the names of the localiser on the page, from the cells that the reader sees, and its constants."""
    names: dict[str, Any] = {}
    for cell in json.loads(PAGE.read_text(encoding="utf-8"))["cells"]:
        if any(tag == "setup" or tag.startswith("localiser") for tag in cell["metadata"].get("tags", ())):
            exec("".join(cell["source"]), names)
    return names, {name: names[name] for name in ("SIGMA", "B_EFF")}


def clouds(case: Case) -> dict[str, Any]:
    """Run the page's localiser for ten seconds: what lies at the robot and at its twin, and who descends from whom."""
    place, (own, usual), n = two_halves(), localiser(), case.get("particles")
    change, rng = CHANGES[case.get("change")], np.random.default_rng(case.get("seed"))
    own.update(usual | {name: value for name, value in change.items() if name in usual})
    options = {name: value for name, value in change.items() if name not in usual}
    events, first = list(LevelledScans.of(place.recording).events())[:80], own["anywhere"](place.grid, n, rng)
    step = own["localise"](place.grid, events, first, rng, **options)[-1]
    robot, twin = shares(place, *step[:3])
    return {"robot": robot, "twin": twin, "families": np.sum(np.bincount(step.founder, step.weights) ** 2)}


STUDIES = [
    Study(
        "ch10_locate",
        "Buildings searched from several starts, and scan matching from a random pose.",
        cases("method", building=BUILDINGS, start_s=STARTS, method=[*VARIANTS, MATCHING]),
        run=found,
    ),
    Study(
        "ch10_poor",
        "With and without injection on plans without furniture, from nowhere and from a start that is known.",
        cases("plan", building=BUILDINGS, start_s=STARTS, inject=[True, False], known=[False, True]),
        run=poor,
    ),
    Study(
        "ch10_twins",
        "How twenty clouds share their weight between two places that look alike.",
        cases("cloud", cloud=["door", "no door", *(f"drift {n}" for n in HEAPS)], seed=SEEDS),
        run=twins,
    ),
    Study(
        "ch10_clouds",
        "What the page's localiser believes after ten seconds: twenty clouds of each size, and some with one change.",
        cases("change", change=["as it is"], particles=NUMBERS, seed=SEEDS)
        + cases("change", change=["as it is"], particles=[MORE], seed=range(8))
        + cases("change", change=list(CHANGES)[1:], particles=[NUMBERS[-1]], seed=range(8)),
        run=clouds,
    ),
]
