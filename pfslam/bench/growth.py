"""Section 3: how the cost of an update grows, one quantity at a time, each as a curve with its slope."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from pfslam.bench.setting import Place, Setting, drive
from pfslam.bench.tables import Row, Section, interleaved, slope
from pfslam.config import SlamConfig
from pfslam.correlation import score_field
from pfslam.grid import OccupancyGrid, embed
from pfslam.slam import slam_step

ALWAYS_DRAW = replace(SlamConfig.refined(), draw_metres=0.0, draw_radians=0.0)
"""So that every update measured does the same work."""


def growth(setting: Setting) -> Section:
    """3. Time of one update against particles, beams, window, resolution, map size; of a run against scans."""
    config = ALWAYS_DRAW
    place, _ = drive(setting.recording, config, setting.effort.scans)
    rounds = setting.effort.rounds
    rows = particle_rows(place, "refined", setting)
    report, _ = drive(setting.recording, SlamConfig.report(), setting.effort.scans)
    rows += particle_rows(report, "report", setting)
    strides = {len(place.event.points_b[::k]): place.with_stride(k) for k in (16, 8, 4, 2, 1)}
    rows += curve("beams", "", {n: p.update for n, p in strides.items()}, rounds)
    windows = {(2 * w + 1) ** 3: partial(place.update, _windowed(config, w)) for w in (2, 4, 8, 12)}
    rows += curve("poses in the window", "", windows, rounds)
    rows += curve(
        "resolution", "m", {r: _at_resolution(setting, config, r) for r in (0.2, 0.1, 0.05)}, rounds
    )
    larger = {n: _on_larger_map(place, n) for n in (1, 2, 4)}
    rows += curve(
        "map size", "cells", {p.state.grid.log_odds.size: p.update for p in larger.values()}, rounds
    )
    rows += [scan_row(setting, config), crowd_row(setting, config)]
    note = (
        "refined, polish included, every update draws; the slope is that of the logarithms: 1 is proportional"
    )
    return Section(3, "Growth of one update", rows, note)


def curve(what: str, unit: str, jobs: Mapping[Any, Callable], rounds: int) -> list[Row]:
    """One row per value of a quantity with the milliseconds of its job, and one with the slope."""
    spent = interleaved({str(x): job for x, job in jobs.items()}, rounds)
    rows = [Row.of(f"{what} {x} {unit}".rstrip(), 1e3 * spent[str(x)], "ms") for x in jobs]
    medians = [float(np.median(spent[str(x)])) for x in jobs]
    end = slope(list(jobs)[-2:], medians[-2:])
    return [
        *rows,
        Row(f"{what}: slope", slope(list(jobs), medians), "", note=f"between the last two {end:.2f}"),
    ]


def particle_rows(place: Place, name: str, setting: Setting) -> list[Row]:
    """The curve over the number of particles, and the cost of the most against that of 200."""
    most = max(setting.effort.particles)
    jobs = {n: place.with_crowd(n).update for n in setting.effort.particles}
    rows = curve(f"{name}: particles", "", jobs, setting.effort.rounds)
    spent = interleaved({"200": place.with_crowd(200).update, "most": jobs[most]}, setting.effort.rounds)
    what = f"{name}: {most} particles against 200"
    return [*rows, Row.of(what, spent["most"] / spent["200"], "x", target=10.0, best="at most")]


def _windowed(config: SlamConfig, half: int) -> SlamConfig:
    return replace(config, search=replace(config.search, cells=(half, half), yaws=(half, half)))


def _at_resolution(setting: Setting, config: SlamConfig, resolution: float) -> Callable:
    config = replace(config, map=replace(config.map, resolution=resolution))
    return drive(setting.recording, config, min(setting.effort.scans, 40))[0].update


def _on_larger_map(place: Place, times: int) -> Place:
    """The same place in a map so many times as wide and as high, the rest of it unknown."""
    grid = place.state.grid
    height, width = ((times - 1) * n // 2 for n in grid.spec.shape)
    spec = grid.spec.grown(width, width, height, height)
    grid = OccupancyGrid(spec, embed(grid.log_odds, grid.spec, spec))
    field, moments = score_field(grid.occupied, place.config.search.field), place.state.moments.covering(spec)
    return replace(place, state=replace(place.state, grid=grid, field=field, moments=moments))


def _steps(place: Place, events, n: int) -> None:
    state, rng = place.state, np.random.default_rng(0)
    for event in [place.event, *islice(events, n - 1)]:
        state = slam_step(state, event, place.config, rng)[0]


def scan_row(setting: Setting, config: SlamConfig) -> Row:
    """The slope of the time of a run over the number of its scans."""
    counts = [max(setting.effort.scans // k, 2) for k in (4, 2, 1)]
    spent = []
    for n in counts:
        place, events = drive(setting.recording, config, 1)
        runs = interleaved({"run": partial(_steps, place, list(islice(events, n)), n)}, 1, warm_up=False)
        spent.append(float(runs["run"][0]))
    counted = ", ".join(f"{n}: {s:.2f} s" for n, s in zip(counts, spent, strict=True))
    return Row("scans: slope", slope(counts, spent), "", note=counted)


def crowd_row(setting: Setting, config: SlamConfig) -> Row:
    """How many times faster than the recording 10,000 particles take every fifth scan, for a stretch of the drive."""
    place, events = drive(setting.recording, replace(config, particles=10_000), setting.effort.scans)
    following = list(islice(events, setting.effort.crowd_updates))
    rounds = max(setting.effort.run_rounds, 1)
    spent = interleaved(
        {"run": partial(_steps, place, following, len(following) + 1)}, rounds, warm_up=False
    )["run"]
    interval = (following[-1].t - place.event.t) / len(following)
    speed = interval * (len(following) + 1) / spent
    note = f"{len(following) + 1} updates from the middle of the drive, {1e3 * interval:.0f} ms apart"
    return Row.of("10,000 particles: times faster than the recording", speed, "x", target=1.0, note=note)
