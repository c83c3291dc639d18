"""Chapter 03: the laboratories of the corridor and of the cloud, and four noise models on three drives."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from pfslam.motion import Controls, integrate, motion_model
from pfslam.poses import average_angle, wrap_angle
from pfslam_book.exercises.ch03 import check_heading_spread, check_predict, check_track
from pfslam_book.show.artists import COLOURS, draw_path, plan, sheet
from pfslam_book.show.drives import at_rate
from pfslam_book.show.keep import keep
from pfslam_book.show.lab import Laboratory, show_lab
from pfslam_book.show.source import show_source
from pfslam_book.show.tables import Shown
from pfslam_book.show.widgets import Explorer, Slider

__all__ = [
    "Shown",
    "at_rate",
    "cells_lab",
    "check_heading_spread",
    "check_predict",
    "check_track",
    "cloud_lab",
]
__all__ += ["corridor_lab", "ends", "keep", "models_explorer", "show_source"]

# ---- the laboratories

CELLS_ALT = """A corridor of fifteen cells with doors at 1, 4 and 10; the robot is at door 4. Under each cell stand the
belief before the look, the likelihood of seeing a door, which is high at the three doors, and their product, the
belief after it, which is highest in cell 4. At the bottom thirty blue dots, the particles, stand in columns
in the cells; the heaviest are in cell 4."""


def corridor_lab() -> Laboratory:
    """Make the laboratory of the exact filter: move, look, and change the doors."""
    return show_lab("cells", "Fifteen cells: prior times likelihood is posterior", CELLS_ALT, dots=False)


def cells_lab() -> Laboratory:
    """Make the same laboratory with particles under the histogram."""
    return show_lab("cells", "Fifteen cells with particles", CELLS_ALT)


CLOUD_ALT = """A small building from above. As far as 30 % of a drive through it is driven, dead reckoning is an
orange dashed line with the robot at its end. Two hundred and fifty blue dots, the particles, lie around the
robot in a cloud; thin blue lines are the paths of ten of them."""


def cloud_lab() -> Laboratory:
    """Make the laboratory of prediction alone: along a drive, or along a path that the reader draws."""
    return show_lab("cloud", "The cloud along the drive", CLOUD_ALT)


# ---- four noise models on three drives

Noise = Callable[[str, float, float], tuple[float, float, float]]
"""Standard deviations on v, omega, and x and y, at one control, for a model's name, v and omega."""
MODELS = ("constant", "own share", "with motion", "on x and y")
DRIVES = {"straight": (1.0, 0.0, 20.0), "bend": (1.0, 0.1, 20.0), "standing": (0.0, 0.0, 60.0)}
"""Speed (m/s), yaw rate (rad/s) and duration (s) that wheels and gyro report."""
WINDOWS = {"straight": (-1, 24, -8, 8), "bend": (-8, 15, -1, 15), "standing": (-2.3, 2.3, -1.6, 1.6)}
TAU = 0.1  # s, ten controls a second
TRUE_BIAS = 0.005
"""What the gyro of this robot shows at rest (rad/s): the fault that the cloud ought to cover."""
PARTICLES = 250


def clouds(noise: Noise, drive: str, model: str) -> np.ndarray:
    """Poses ``(3, n, 3)`` of the particles after a third, two thirds and all of the drive."""
    (v, omega, seconds), rng = DRIVES[drive], np.random.default_rng(0)
    sigma_v, sigma_omega, sigma_xy = noise(model, v, omega)
    poses, kept, steps = np.zeros((PARTICLES, 3)), [], round(seconds / TAU)
    for step in range(1, steps + 1):
        draws = rng.standard_normal((4, PARTICLES))
        poses = motion_model(poses, v + sigma_v * draws[0], omega + sigma_omega * draws[1], TAU)
        poses[:, :2] += sigma_xy * draws[2:].T
        if step in (steps // 3, 2 * steps // 3, steps):
            kept.append(poses)
    return np.array(kept)


def path(drive: str, bias: float = 0.0) -> np.ndarray:
    """Poses ``(K, 3)`` of a robot whose true yaw rate is the reported one minus the bias; it does not turn at rest."""
    v, omega, seconds = DRIVES[drive]
    n = round(seconds / TAU)
    true_omega = omega - bias * (v != 0.0)
    return integrate(Controls(TAU * np.arange(n + 1), np.full(n, v), np.full(n, true_omega))).poses


def ends(noise: Noise, drive: str, model: str) -> dict[str, float]:
    """Spread of the last cloud along and across its heading (m) and in heading (deg).

    "off" is how far the true heading (deg) lies from the cloud's own.
    """
    poses, truth = clouds(noise, drive, model)[-1], path(drive, TRUE_BIAS)[-1]
    middle = average_angle(poses[:, 2])
    c, s = np.cos(middle), np.sin(middle)
    return {
        "ahead": float(np.std(poses[:, :2] @ [c, s])),
        "across": float(np.std(poses[:, :2] @ [-s, c])),
        "heading": float(np.rad2deg(np.std(wrap_angle(poses[:, 2] - middle)))),
        "off": float(np.rad2deg(abs(wrap_angle(truth[2] - middle)))),
    }


def draw_model(noise: Noise, drive: str, model: str) -> Figure:
    """Cloud, reported path and true end of one drive under one noise model."""
    truth = path(drive, TRUE_BIAS)
    figure, axes = sheet(5.2)
    draw_path(axes, path(drive), "odometry", "reported")
    draw_path(axes, truth, "truth")
    x, y, _ = clouds(noise, drive, model).reshape(-1, 3).T
    axes.scatter(x, y, s=9, color=COLOURS["particles"], linewidths=0, zorder=3, label="particles")
    axes.plot(*truth[-1, :2], "*", markersize=16, color=COLOURS["truth"], zorder=5, label="true end")
    found = ends(noise, drive, model)
    plan(axes, f"heading: spread {found['heading']:.1f}°, truth off by {found['off']:.1f}°")
    axes.set(xlim=WINDOWS[drive][:2], ylim=WINDOWS[drive][2:])
    axes.legend(loc="upper left")
    return figure


def describe_model(noise: Noise, drive: str, model: str) -> str:
    """Say in words how wide the last cloud is, and how far off the true heading."""
    found = ends(noise, drive, model)
    return f"""Drive {drive}, noise {model}: at the end the cloud is {found["ahead"]:.2f} m wide along its heading,
    {found["across"]:.2f} m across and {found["heading"]:.1f} degrees in heading (standard deviations). The true
    heading is off by {found["off"]:.1f} degrees."""


def models_explorer(noise: Noise) -> Explorer:
    """Two sliders: which drive, and which idea of what can go wrong."""
    return Explorer(
        partial(draw_model, noise),
        [Slider("drive", tuple(DRIVES), 0, "Drive"), Slider("model", MODELS, 0, "Noise")],
        alt=partial(describe_model, noise),
        title="Four noise models on three drives",
    )
