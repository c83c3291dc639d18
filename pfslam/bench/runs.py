"""Sections 2 and 5: whole runs against the clock of the recording."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from pfslam.bench.setting import Setting
from pfslam.bench.tables import Row, Section, interleaved
from pfslam.config import SlamConfig
from pfslam.recording import Recording
from pfslam.runs import slam_steps

PLANS = {
    "refined, every fifth scan": (replace(SlamConfig.refined(), every=5), 25.0),
    "refined, every scan": (replace(SlamConfig.refined(), every=1), 6.0),
    "report, every fifth scan": (replace(SlamConfig.report(), every=5), 10.0),
}
"""Configuration, and how many times faster than the recording it should be."""


def run_for(recording: Recording, config: SlamConfig, seconds: float | None) -> float:
    """A run over the first ``seconds`` of a recording (None: all of it); how many seconds of it were covered."""
    stamps: list[float] = []
    for _, info in slam_steps(recording, config, np.random.default_rng(0)):
        stamps.append(info.t)
        if seconds is not None and stamps[-1] - stamps[0] >= seconds:
            break
    return stamps[-1] - stamps[0]


def speed_rows(plans: dict, setting: Setting, seconds: float | None, rounds: int) -> list[Row]:
    """For every recording and plan: seconds recorded per second of processor time."""
    rows = []
    for name, recording in setting.recordings.items():
        covered: dict[str, float] = {}

        def run(plan, config, recording=recording, covered=covered):
            covered[plan] = run_for(recording, config, seconds)

        jobs = {plan: partial(run, plan, config) for plan, (config, _) in plans.items()}
        spent = interleaved(jobs, rounds, warm_up=False)
        for plan, (_, target) in plans.items():
            note = f"{covered[plan]:.0f} s in {np.median(spent[plan]):.1f} s"
            rows.append(Row.of(f"{name}: {plan}", covered[plan] / spent[plan], "x", target=target, note=note))
    return rows


def whole_runs(setting: Setting) -> Section:
    """2. Runs without texture: how many times faster than the recording."""
    seconds = setting.effort.seconds
    rows = speed_rows(PLANS, setting, seconds, setting.effort.run_rounds)
    note = "200 particles, polish included; processor time of one thread" + _extent(seconds)
    return Section(2, "Runs, times faster than the recording", rows, note)


def per_particle_runs(setting: Setting) -> Section:
    """5. A map for each of 30 particles, every fifth scan; once, since it takes about as long as the drive."""
    seconds = setting.effort.maps_seconds
    plans = {"30 maps, every fifth scan": (replace(SlamConfig.per_particle(), every=5), 1.0)}
    rows, note = speed_rows(plans, setting, seconds, 1), "one round; processor time of one thread"
    return Section(5, "Per-particle maps, times faster than the recording", rows, note + _extent(seconds))


def _extent(seconds: float | None) -> str:
    return "" if seconds is None else f"; only the first {seconds:.0f} s of each recording"
