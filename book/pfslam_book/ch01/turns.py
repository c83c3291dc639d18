"""Chapter 01, two ways to turn wrongly: by the wheels' own width, and by a gyro that was smoothed."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from pfslam.evaluation.checkup import turned_by_gyro, turned_by_wheels
from pfslam.motion import Controls, controls, integrate
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam_book.ch01.odometry import DRAW_EVERY
from pfslam_book.show.figures import draw_trajectory
from pfslam_book.show.pictures import Picture, steady
from pfslam_book.show.style import COLOURS, LINE_STYLES, metric_axes, new_figure
from pfslam_book.show.widgets import Explorer, Slider


def effective_track(recording: Recording, seconds: float = 1.0) -> dict[str, float]:
    """Return the width (m) that makes the wheels agree with the gyro: in all turns, in slow ones, in fast ones.

    The drive is cut into pieces of ``seconds``; those that turn by less than 0.1 rad say nothing. Slow and fast are
    the halves below and above the median speed of these pieces.
    """
    inputs = controls(recording)
    t = np.arange(inputs.t[0], inputs.t[-1], seconds)
    wheels = np.diff(turned_by_wheels(recording, t, 1.0))  # right minus left, in metres
    gyro = np.diff(turned_by_gyro(inputs, t))
    metres = np.diff(np.interp(t, inputs.t[1:], np.cumsum(inputs.v * np.diff(inputs.t))))
    turning = np.abs(gyro) > 0.1
    slow = metres <= np.median(metres[turning])
    return {
        name: float(wheels[some] @ gyro[some] / (gyro[some] @ gyro[some]))
        for name, some in {"all": turning, "slow": turning & slow, "fast": turning & ~slow}.items()
    }


def track_picture(recording: Recording, fitted: float) -> Picture:
    """Draw the heading over time: from the truth, from the wheels with the measured width, and with a fitted one."""
    inputs, truth = controls(recording), recording.true_path()
    t = inputs.t[::DRAW_EVERY]
    measured = recording.robot.encoders.track
    curves = {
        f"wheels, {measured:g} m apart": (turned_by_wheels(recording, t, measured), "odometry"),
        f"wheels, as if {fitted:.2f} m": (turned_by_wheels(recording, t, fitted), "highlight"),
        "truth": (np.unwrap(truth.at(t)[:, 2]), "truth"),
    }
    figure, axes = new_figure(5.0, 4.3)
    words = []
    for name, (angle, kind) in curves.items():
        degrees = np.rad2deg(angle - angle[0])
        style = LINE_STYLES.get(kind, "-")
        axes.plot(t - t[0], degrees, color=COLOURS[kind], linestyle=style, label=name)
        words.append(f"{name}: between {degrees.min():.0f} and {degrees.max():.0f}")
    axes.set(xlabel="time [s]", ylabel="heading [deg]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.45, -0.18), ncols=1)
    return Picture(figure, f"Heading over the drive in degrees. {'; '.join(words)}.")


def smoothed(inputs: Controls, seconds: float) -> Controls:
    """Return the same controls with the yaw rate averaged over the last ``seconds``: a low-pass filter."""
    n = max(round(seconds / float(np.median(np.diff(inputs.t)))), 1)
    total = np.concatenate([np.zeros(n), np.cumsum(inputs.omega)])
    return replace(inputs, omega=(total[n:] - total[:-n]) / n)


def smoothing_errors(inputs: Controls, seconds: float) -> tuple[float, float]:
    """Return what smoothing does to the raw path: heading at the end (deg), greatest distance on the way (m)."""
    raw, soft = integrate(inputs), integrate(smoothed(inputs, seconds))
    away = np.hypot(*(soft.poses - raw.poses)[:, :2].T).max()
    return float(np.rad2deg(abs(soft.poses[-1, 2] - raw.poses[-1, 2]))), float(away)


def draw_smoothing(inputs: Controls, seconds: float) -> Figure:
    """Draw the yaw rate in the sharpest turn, raw and smoothed, and the path of both."""
    soft = smoothed(inputs, seconds)
    figure, (left, right) = new_figure(5.0, 3.7, columns=2)
    middle = inputs.t[1 + np.argmax(np.abs(smoothed(inputs, 1.0).omega))] - 0.5
    shown = np.abs(inputs.t[1:] - middle) < 3.0
    for some, kind, name in ((inputs, "odometry", "raw"), (soft, "estimate", "smoothed")):
        width = 0.9 if some is inputs else 2.0
        left.plot(
            some.t[1:][shown] - inputs.t[0],
            some.omega[shown],
            color=COLOURS[kind],
            linewidth=width,
            label=name,
        )
        path = integrate(some)
        draw_trajectory(right, Trajectory(path.t[::DRAW_EVERY], path.poses[::DRAW_EVERY]), kind, name)
    degrees, away = smoothing_errors(inputs, seconds)
    left.set(xlabel="time [s]", ylabel="yaw rate [rad/s]", ylim=(-1.7, 0.4), xticks=(84, 86, 88))
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=12)
    metric_axes(right).set(xlim=(-4, 27), ylim=(-4, 27))
    right.set(xticks=(0, 10, 20), yticks=(0, 10, 20))
    figure.suptitle(f"heading at the end {degrees:.2f}° apart, path {away:.2f} m at most", fontsize=12)
    return figure


def describe_smoothing(inputs: Controls, seconds: float) -> str:
    """Describe the picture of these values in words."""
    degrees, away = smoothing_errors(inputs, seconds)
    return f"""Yaw rate averaged over the last {seconds:g} s: at the end the heading differs from the raw one by
    {degrees:.2f} degrees, on the way the paths are up to {away:.2f} m apart."""


def smoothing_explorer(recording: Recording) -> Explorer:
    """Make the explorer with one slider: how much the gyro is smoothed before it is added up."""
    inputs = controls(recording)
    return Explorer(
        steady(partial(draw_smoothing, inputs)),
        [
            Slider(
                "seconds",
                (0.0, 0.1, 0.25, 0.5, 1.0, 2.0),
                3,
                "Averaged over the last",
                "s",
                "g",
                (0.0, 3.0, 0.05),
            )
        ],
        alt=partial(describe_smoothing, inputs),
        title="A smoothed gyro lags behind",
    )
