"""Chapter 04: what the search costs where a cloud is wide, and where the milliseconds of one update go."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pfslam.bench.measure import interleaved
from pfslam.bench.sections import update_parts as profiled_parts
from pfslam.correlation import score_field
from pfslam.recording import Recording
from pfslam.search.lattice import distinct_nodes
from pfslam.search.volume import score_volume, search, window_scores
from pfslam.teaching.ch04.scores import LATTICE
from pfslam.teaching.ch04.search import PARTICLES, WINDOW
from pfslam.teaching.show.drives import Place
from pfslam.teaching.show.pictures import Picture
from pfslam.teaching.show.style import COLOURS, new_figure

CLOUDS = {
    "compact: 2 cm, 0.2°": (0.02, 0.003),
    "middle: 10 cm, 1.1°": (0.1, 0.02),
    "wide: 50 cm, 5.7°": (0.5, 0.1),
}
"""Standard deviations (m, rad) of clouds of particles, by the words for them."""
WAYS = {"one volume": "free", "each window by itself": "odometry", "the package": "estimate"}
"""The ways to score a cloud, and the colour of each."""


def ways_to_score(place: Place, sigma_xy: float, sigma_yaw: float) -> dict[str, Callable[[], object]]:
    """The three ways as functions without arguments, for 200 particles spread by so much (m, rad)."""
    field, spec = score_field(place.grid.occupied, "occupied"), place.grid.spec
    rng = np.random.default_rng(0)
    cloud = place.pose + rng.standard_normal((PARTICLES, 3)) * [sigma_xy, sigma_xy, sigma_yaw]
    nodes = distinct_nodes(LATTICE.nearest(cloud))[0]
    reach = np.array([WINDOW.cells, WINDOW.cells, WINDOW.yaws])
    low, high = nodes.min(axis=0) - reach, nodes.max(axis=0) + reach
    here = (field, spec, place.points_b, LATTICE)
    return {
        "one volume": lambda: score_volume(*here, low, high),
        "each window by itself": lambda: window_scores(*here, nodes, WINDOW),
        "the package": lambda: list(search(field, spec, place.points_b, cloud, LATTICE, WINDOW)),
    }


def width_times(place: Place, rounds: int = 3) -> dict[str, dict[str, float]]:
    """Milliseconds of processor time by cloud and way; the ways take turns, and the median counts."""
    return {
        name: {
            way: 1e3 * float(np.median(seconds))
            for way, seconds in interleaved(ways_to_score(place, *sigmas), rounds).items()
        }
        for name, sigmas in CLOUDS.items()
    }


def width_picture(times: dict[str, dict[str, float]]) -> Picture:
    """Bars on a logarithmic scale: three clouds, three ways."""
    figure, axes = new_figure(6.4, 3.6)
    height = 0.26
    for k, (way, colour) in enumerate(WAYS.items()):
        values = [times[cloud][way] for cloud in CLOUDS]
        y = np.arange(len(CLOUDS)) + (k - 1) * height
        bars = axes.barh(y, values, 0.9 * height, color=COLOURS[colour], label=way)
        axes.bar_label(bars, [f"{v:.3g} ms" for v in values], padding=4)
    axes.set_yticks(range(len(CLOUDS)), [name.replace(": ", "\n") for name in CLOUDS])
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    every = [v for by_way in times.values() for v in by_way.values()]
    axes.set(xlabel="milliseconds per scan, 200 particles", xlim=(min(every) / 2, max(every) * 8))
    axes.invert_yaxis()
    axes.legend(loc="upper center", bbox_to_anchor=(0.4, 1.2), ncols=3, columnspacing=1.0)
    words = "; ".join(
        f"{cloud}, " + ", ".join(f"{way} {value:.3g} ms" for way, value in by_way.items())
        for cloud, by_way in times.items()
    )
    return Picture(figure, f"Time to score one scan for 200 particles. {words}.")


def update_parts(recording: Recording) -> dict[str, float]:
    """Milliseconds of processor time of each part of one update of the refined filter, mean of sixty updates."""
    return profiled_parts(recording, updates=60)


def update_picture(parts: dict[str, float]) -> Picture:
    """Bars of the parts of an update."""
    figure, axes = new_figure(6.4, 4.0)
    bars = axes.barh(list(parts), list(parts.values()), 0.6, color=COLOURS["particles"])
    axes.bar_label(bars, [f"{value:.2f}" for value in parts.values()], padding=4)
    axes.set(xlabel="milliseconds of one update", xlim=(0, 1.15 * max(parts.values())))
    axes.invert_yaxis()
    words = ", ".join(f"{name} {value:.2g} ms" for name, value in parts.items())
    return Picture(figure, f"Parts of one update with 200 particles: {words}.")
