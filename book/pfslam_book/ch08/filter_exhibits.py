"""Chapter 08: the exhibits of the filter, drawn."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from pfslam.particles import Particles, resample
from pfslam.recording import Recording
from pfslam.slam import SlamConfig
from pfslam_book.ch08.data import BENDS
from pfslam_book.ch08.data_exhibits import Panel, pair
from pfslam_book.ch08.exhibit import COLOUR, STATES, Exhibit, by_name, few_ticks
from pfslam_book.ch08.filter import (
    LabRun,
    cloud_without_scans,
    heading_against_side,
    heading_if_placed,
    lab_run,
    n_eff_of,
    plain_filter,
    shift_test,
)
from pfslam_book.show.faults import (
    every_beam_a_witness,
    keep_weights,
    match_without_translation,
    scans_between,
    torn_rows,
    with_fault,
)
from pfslam_book.show.style import COLOURS
from pfslam_book.show.tables import Shown

NO_TRANSLATION = {"map.match": match_without_translation}


def filter_runs(recording: Recording, seed: int = 0) -> dict[str, LabRun]:
    """Return one run of the plain filter for each fault of the filter, and a healthy one."""
    lab, config = scans_between(recording, *BENDS), plain_filter()
    return {
        "healthy": lab_run(lab, config, seed=seed),
        "too sharp": lab_run(lab, every_beam_a_witness(config), seed=seed),
        "kept weights": with_fault({"slam.resample": keep_weights}, lab_run, lab, config, seed),
        "torn rows": with_fault({"slam.resample": torn_rows}, lab_run, lab, config, seed),
        "w = 0": with_fault(NO_TRANSLATION, lab_run, lab, config, seed),
    }


def filter_faults(recording: Recording, runs: dict[str, LabRun]) -> dict[str, Exhibit]:
    """Return the four faults of the filter by name, each beside the healthy run."""
    lab, config = scans_between(recording, *BENDS), plain_filter()
    return by_name(
        sharp_exhibit(runs),
        kept_exhibit(runs),
        torn_exhibit(recording, runs),
        blind_exhibit(lab, config, runs),
    )


def error_panel(runs: dict[str, LabRun]) -> Panel:
    """Return the error of the estimate over time, and how far off the cloud itself thinks it may be."""

    def draw(axes: Axes, state: str) -> str:
        run = runs[state]
        axes.fill_between(
            run.seconds, 0, 200 * run.spread, color=COLOURS["particles"], alpha=0.4, linewidth=0
        )
        axes.plot(run.seconds, 100 * run.error, color=COLOUR[state])
        top = max(max(100 * r.error.max(), 200 * r.spread.max()) for r in runs.values())
        few_ticks(axes, xlabel="time [s]", ylabel="error, 2 × spread [cm]", ylim=(0, 1.05 * top))
        outside = np.mean(run.error > 2 * run.spread)
        return f"""error {100 * run.ate:.0f} cm (RMS); outside twice the spread of the cloud for
        {100 * outside:.0f} % of the time"""

    return draw


def over_time(runs: dict[str, LabRun], what: str, label: str, words: str, log: bool = False) -> Panel:
    """Return one property of both runs over time, the state's own in bold; the words name its median."""

    def draw(axes: Axes, state: str) -> str:
        for s in STATES:
            axes.plot(
                runs[s].seconds, getattr(runs[s], what), color=COLOUR[s], linewidth=2.2 if s == state else 0.8
            )
        few_ticks(axes, xlabel="time [s]", ylabel=label, ylim=(0, None))
        if log:
            axes.set(yscale="log", ylim=(0.8, 120), yticks=(1, 10, 100), yticklabels=(1, 10, 100))
        values = getattr(runs[state], what)
        return f"{words}: {values[10]:.2f} after ten scans, median {np.median(values):.2f}"

    return draw


def sharp_exhibit(runs: dict[str, LabRun]) -> Exhibit:
    """Show the softmax of the count."""
    both = pair(runs["healthy"], runs["too sharp"])
    reading = {s: float(np.median(run.n_eff_share)) for s, run in both.items()}
    diagnosis = over_time(both, "n_eff_share", "$N_{eff}/N$", "N_eff / N")
    what = "weights are the softmax of the count"
    return Exhibit("too sharp", what, "median N_eff / N", "", reading, error_panel(both), diagnosis)


def kept_exhibit(runs: dict[str, LabRun]) -> Exhibit:
    """Show weights that survive resampling."""
    both = pair(runs["healthy"], runs["kept weights"])
    reading = {s: run.n_eff_after for s, run in both.items()}
    families = over_time(both, "families", "ancestors left", "first particles with a descendant", log=True)

    def draw(axes: Axes, state: str) -> str:
        for s, run in both.items():
            after = [n_eff_of(cloud) for _, cloud in run.resampled]
            axes.plot(after, color=COLOUR[s], linewidth=2.2 if s == state else 0.8)
        few_ticks(axes, xlabel="resampling", ylabel="$N_{eff}/N$ after it", ylim=(0, 1.05))
        return f"straight after resampling N_eff / N is {reading[state]:.2f} in the mean"

    what = "weights are kept after resampling"
    return Exhibit("kept weights", what, "N_eff / N after resampling", "", reading, families, draw)


def torn_exhibit(recording: Recording, runs: dict[str, LabRun]) -> Exhibit:
    """Show positions by one draw, headings by another."""
    both = pair(runs["healthy"], runs["torn rows"])
    cloud = cloud_without_scans(recording, 23.0, 4.0)
    after: dict[str, Particles] = {
        "healthy": resample(cloud, np.random.default_rng(1)),
        "broken": torn_rows(cloud, np.random.default_rng(1), "systematic"),
    }

    def symptom(axes: Axes, state: str) -> str:
        heading, weights = heading_if_placed(after[state])
        axes.hist(np.rad2deg(heading), list(range(-12, 13, 2)), weights=weights, color=COLOUR[state])
        few_ticks(axes, xlabel="heading [deg]", ylabel="weight", ylim=(0, 0.6))
        spread = np.rad2deg(np.sqrt(weights @ heading**2))
        return f"a wall fixes the sideways place to 5 cm; the heading is then known to {spread:.1f} degrees"

    def diagnosis(axes: Axes, state: str) -> str:
        _, y, theta = after[state].poses.T
        axes.scatter(y - y.mean(), np.rad2deg(theta - theta.mean()), s=8, color=COLOUR[state])
        few_ticks(axes, xlabel="sideways [m]", ylabel="heading [deg]")
        return f"""a cloud predicted for 4 s and resampled once: heading and sideways place are correlated
        by {heading_against_side(after[state]):.2f}"""

    reading = {s: run.known_rows for s, run in both.items()}
    what = "positions and headings are drawn separately"
    return Exhibit("torn rows", what, "share of rows known before", "", reading, symptom, diagnosis)


def errors_over_seeds(recording: Recording, first: dict[str, LabRun], seeds: int = 3) -> Shown:
    """Return the errors in cm of each filter, healthy or not, over some seeds, the first of which has been run."""
    more = [first, *(filter_runs(recording, seed) for seed in range(1, seeds))]
    head = ("error [cm]", *(f"seed {seed}" for seed in range(seeds)))
    return Shown(head, ((name, *(f"{100 * runs[name].ate:.1f}" for runs in more)) for name in first))


def blind_exhibit(lab: Recording, config: SlamConfig, runs: dict[str, LabRun]) -> Exhibit:
    """Show points that a pose turns but never moves."""
    both = pair(runs["healthy"], runs["w = 0"])
    faults = pair({}, NO_TRANSLATION)
    scores = {s: with_fault(faults[s], shift_test, lab, both[s], config) for s in STATES}

    def draw(axes: Axes, state: str) -> str:
        here, aside = scores[state]
        axes.bar([0, 1], [here, aside], color=COLOUR[state], width=0.6)
        axes.set_xticks([0, 1], ["here", "0.5 m aside"])
        axes.set(ylabel="mean score", ylim=(0, 1))
        return f"mean score {here:.2f} where the cloud is, {aside:.2f} half a metre aside"

    reading = {s: float(scores[s][0] - scores[s][1]) for s in STATES}
    what = "end points are made with w = 0, so that poses turn them and never move them"
    return Exhibit("w = 0", what, "score lost by 0.5 m aside", "", reading, error_panel(both), draw)
