"""One look for every figure of the book: the colour code, the style, and the sheet to draw on."""

from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# One thing, one colour, through the whole book. From the palette of Okabe and Ito, which stays apart under
# the common colour vision deficiencies; line styles say it a second time.
COLOURS = {
    "truth": "#1b1b1b",
    "odometry": "#d55e00",
    "estimate": "#0072b2",
    "particles": "#56b4e9",
    "hits": "#b5367a",
    "free": "#009e73",
    "unknown": "#b8bcc2",
    "highlight": "#e69f00",
    "report": "#7f5539",  # the filter as the report has it, where both filters are drawn
    "refined": "#0072b2",  # ours; as an estimate
    "particle A": "#5b2c9d",  # three particles that are followed by name from picture to picture
    "particle B": "#94850a",
    "particle C": "#7d1128",
}
LINE_STYLES = {"truth": (0, (1, 1.2)), "odometry": "--", "estimate": "-"}

# A near-white sheet in light and in dark mode: lines keep the contrast they were chosen for.
PAPER = "#fcfcfa"
INK = "#22262b"

WIDTH = 7.36  # inches of 100 CSS pixels: a figure of the site, 46rem (`--pfslam-wide`), dot for dot
WORDS = 10.4  # points, which are as large on the page as the words of a caption, 0.9rem

STYLE: dict[Any, Any] = {
    "figure.facecolor": PAPER,
    "savefig.facecolor": PAPER,
    "figure.dpi": 100,
    "axes.facecolor": PAPER,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlesize": "medium",
    "axes.titley": 1.0,  # where titles stand anyhow; the search for a free place would lay out every tick again
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dcdfe3",
    "grid.linewidth": 0.7,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "font.size": WORDS,
    "figure.constrained_layout.w_pad": 0.06,
    "figure.constrained_layout.h_pad": 0.06,
    "legend.frameon": True,
    "legend.handlelength": 1.6,
    "legend.labelspacing": 0.3,
    "legend.framealpha": 0.85,
    "legend.edgecolor": "none",
    "legend.facecolor": PAPER,
    "lines.linewidth": 1.8,
    "image.interpolation": "nearest",
    "image.cmap": "cividis",
}


def use_style() -> None:
    """Make the book's style the default of Matplotlib in this process."""
    matplotlib.rcParams.update(STYLE)


def sheet(height: float = 4.2, rows: int = 1, columns: int = 1, **subplots):
    """A figure as wide as the column and so many inches high, with its axes: one, or an array of them.

    It belongs to nobody else: no pyplot, nothing to close. Its last word is ``show(figure, words)``, where the words
    say what it shows to those who cannot see it. ``subplots`` are those of `Figure.subplots`, as ``sharex=True``.
    """
    use_style()
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    return figure, figure.subplots(rows, columns, **subplots)


def metric_axes(axes: Axes, title: str = "") -> Axes:
    """Axes for a plan view: equal scales, metres on both, no grid lines over the map."""
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.grid(False)
    if len(axes.get_shared_y_axes().get_siblings(axes)) > 1:
        axes.label_outer()  # one scale is told once
    if title:
        axes.set_title(title)
    return axes
