"""Chapter 03, four ways to be uncertain: what each noise model makes of a drive, and what it cannot imagine."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from matplotlib.figure import Figure

from pfslam.motion import Controls, integrate, motion_model
from pfslam.poses import wrap_angle
from pfslam_book.show.style import COLOURS, LINE_STYLES, metric_axes, new_figure
from pfslam_book.show.widgets import Explorer, Slider

TAU = 0.1  # s, ten controls a second
DRIVES = {"straight": (1.0, 0.0, 20.0), "bend": (1.0, 0.1, 20.0), "standing": (0.0, 0.0, 60.0)}
"""Speed (m/s), yaw rate (rad/s) and duration (s) that wheels and gyro report."""
MODELS = ("constant", "own share", "with motion", "on x and y")
SIGMA_V, SIGMA_OMEGA, SHARE, PER_METRE, JITTER = 0.2, 0.07, 0.2, 0.07, 0.04
TRUE_BIAS = 0.005
"""What the gyro of this robot shows at rest (rad/s): the fault that the cloud ought to cover."""
PARTICLES = 250


def sigmas(model: str, v: float, omega: float) -> tuple[float, float]:
    """Standard deviations of speed (m/s) and yaw rate (rad/s) at one control, for a model with noise on the control."""
    return {
        "constant": (SIGMA_V, SIGMA_OMEGA),
        "own share": (SHARE * abs(v), SHARE * abs(omega)),
        "with motion": (SHARE * abs(v), SHARE * abs(omega) + PER_METRE * abs(v)),
        "on x and y": (0.0, 0.0),
    }[model]


@lru_cache(maxsize=16)
def model_cloud(drive: str, model: str, seed: int = 0) -> np.ndarray:
    """Poses ``(3, n, 3)`` of the particles after a third, two thirds and all of the drive."""
    (v, omega, seconds), rng = DRIVES[drive], np.random.default_rng(seed)
    sigma_v, sigma_omega = sigmas(model, v, omega)
    jitter = JITTER if model == "on x and y" else 0.0
    poses, kept, steps = np.zeros((PARTICLES, 3)), [], round(seconds / TAU)
    for step in range(1, steps + 1):
        draws = rng.standard_normal((4, PARTICLES))
        poses = motion_model(poses, v + sigma_v * draws[0], omega + sigma_omega * draws[1], TAU)
        poses[:, :2] += jitter * draws[2:].T
        if step in (steps // 3, 2 * steps // 3, steps):
            kept.append(poses)
    return np.array(kept)


def path(drive: str, bias: float = 0.0) -> np.ndarray:
    """Poses ``(K, 3)`` of a robot whose true yaw rate is the reported one minus the bias; it does not turn at rest."""
    v, omega, seconds = DRIVES[drive]
    n = round(seconds / TAU)
    true_omega = omega - bias * (v != 0.0)
    return integrate(Controls(TAU * np.arange(n + 1), np.full(n, v), np.full(n, true_omega))).poses


def widths(poses: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Spread of a cloud ``(n, 3)`` along and across its mean heading (m) and in heading (deg); the true pose's error.

    "off" is how far the true heading (deg) lies from the cloud's own.
    """
    middle = np.arctan2(np.sin(poses[:, 2]).mean(), np.cos(poses[:, 2]).mean())
    turned = np.rad2deg(wrap_angle(poses[:, 2] - middle))
    ahead, across = [np.cos(middle), np.sin(middle)], [-np.sin(middle), np.cos(middle)]
    return {
        "ahead": float(np.std(poses[:, :2] @ ahead)),
        "across": float(np.std(poses[:, :2] @ across)),
        "heading": float(np.std(turned)),
        "off": float(np.rad2deg(abs(wrap_angle(truth[2] - middle)))),
    }


def draw_model(drive: str, model: str) -> Figure:
    """Cloud, reported path and true end of one drive under one noise model."""
    clouds, reported, truth = model_cloud(drive, model), path(drive), path(drive, TRUE_BIAS)
    figure, axes = new_figure(5.1, 4.2)
    axes.plot(*reported[:, :2].T, color=COLOURS["odometry"], linestyle=LINE_STYLES["odometry"], linewidth=1.2)
    axes.plot(*truth[:, :2].T, color=COLOURS["truth"], linestyle=LINE_STYLES["truth"], label="truth")
    for cloud, colour in zip(clouds, ("particles", "particles", "estimate"), strict=True):
        axes.scatter(*cloud[:, :2].T, s=8, color=COLOURS[colour], linewidths=0, zorder=3)
    axes.scatter(*truth[-1, :2], s=90, marker="*", color=COLOURS["truth"], zorder=5, label="true end")
    limits = {
        "straight": ((-1, 24), (-9, 9)),
        "bend": ((-6, 14), (-1, 17)),
        "standing": ((-2, 2), (-1.6, 1.6)),
    }
    axes.set(xlim=limits[drive][0], ylim=limits[drive][1])
    w = widths(clouds[-1], truth[-1])
    metric_axes(axes, f"heading: spread {w['heading']:.1f}°, truth off by {w['off']:.1f}°")
    axes.legend(loc="upper left")
    return figure


def describe_model(drive: str, model: str) -> str:
    """The same in words."""
    w = widths(model_cloud(drive, model)[-1], path(drive, TRUE_BIAS)[-1])
    return f"""Drive {drive}, noise {model}: at the end the cloud is {w["ahead"]:.2f} m wide along its heading,
    {w["across"]:.2f} m across and {w["heading"]:.1f} degrees in heading (standard deviations). The true heading is off
    by {w["off"]:.1f} degrees."""


def models_explorer() -> Explorer:
    """Two sliders: which drive, and which idea of what can go wrong."""
    return Explorer(
        draw_model,
        [Slider("drive", tuple(DRIVES), 0, "Drive"), Slider("model", MODELS, 0, "Noise")],
        alt=describe_model,
        title="Four noise models on three drives",
    )
