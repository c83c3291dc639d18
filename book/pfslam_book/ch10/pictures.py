"""Chapter 10: the cloud over the map, scan by scan, with the robot and its twin."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pfslam.beyond.localization import LocalizationInfo, LocalizationResult
from pfslam_book.ch10.building import Place, shares
from pfslam_book.show.artists import COLOURS, draw_map, draw_pose, sheet
from pfslam_book.show.lab import Laboratory, show_lab
from pfslam_book.show.widgets import Explorer, Slider

SHOWN = 1500
"""Most particles in one picture."""
STOPS = (0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 16.0, 20.0, 22.0, 24.0, 25.0, 26.0, 27.0, 28.0, 30.0)
"""Seconds after the first scan at which the search is shown."""


def search_explorer(place: Place, result: LocalizationResult) -> Explorer:
    """Return the widget that scrubs through a search: the cloud over the map, with the robot and its twin."""
    t = result.trajectory.t - result.trajectory.t[0]

    def at(seconds: float) -> tuple[LocalizationInfo, np.ndarray, str]:
        info = result.infos[int(np.argmin(np.abs(t - seconds)))]
        assert info.particles is not None
        here, there = shares(place, info.t, info.particles.poses, info.particles.weights)
        words = f"{info.number:,} particles, {100 * here:.0f} % here, {100 * there:.0f} % at the twin"
        return info, info.particles.poses[:: max(1, info.number // SHOWN)], f"{seconds:g} s: {words}"

    def draw(seconds: float) -> Figure:
        info, poses, words = at(seconds)
        figure, axes = sheet(4.2)
        draw_map(axes, place.grid, words)
        axes.plot(*poses[:, :2].T, ".", color=COLOURS["particles"], markersize=2.5, alpha=0.5)
        truth = place.recording.true_path().at(info.t)
        draw_pose(axes, place.twin(truth), "odometry", 1.4)
        draw_pose(axes, truth, "truth", 1.4)
        return figure

    def alt(seconds: float) -> str:
        return f"{at(seconds)[2]}."

    slider = Slider("seconds", [s for s in STOPS if s <= t[-1]], 0, "Time", "s")
    title = "Lost in a building with two like halves"
    return Explorer(draw, [slider], title=title, alt=alt, play="seconds", pause=700)


def lost_lab() -> Laboratory:
    """Return the laboratory in which a robot is lost among twenty thousand particles, and its twin must die."""
    alt = """A building that is nearly the same after half a turn, seen from above. Blue dots, the particles, stand in
    two heaps: one at the robot, one at its twin in the other half. A strip below shows the share of weight at each."""
    return show_lab("lost", "Lost: twenty thousand guesses, and a twin", alt)
