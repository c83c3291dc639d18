"""Chapter 01: the calibration laboratory, and what smoothing a gyro does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pfslam.evaluation.checkup import turned_by_wheels
from pfslam.motion import Controls, controls, integrate
from pfslam.poses import Trajectory, between
from pfslam.recording import Recording
from pfslam_book.exercises.ch01 import (
    check_arc,
    check_distance_ahead,
    check_gyro_bias,
    check_inputs_between,
    check_reckon_by_wheels,
)
from pfslam_book.show.keep import keep
from pfslam_book.show.lab import Laboratory, packed, show_lab
from pfslam_book.show.source import show_source

__all__ = ["calibrate_lab", "check_arc", "check_distance_ahead", "check_gyro_bias", "check_reckon_by_wheels"]
__all__ += ["check_inputs_between", "keep", "show_source", "smoothing_picture"]

# ---- the laboratory

HERTZ = 20
RIGHT = {"bias": 0.0005, "gyro": 1.03, "wheels": 0.992, "track": 0.726}
"""With these numbers the path of `hall` comes closest to the truth: rad/s, two factors, m."""
UNITS = {"left": 1e-4, "right": 1e-4, "turned": 1e-4, "x": 1e-3, "y": 1e-3, "theta": 1e-3}
"""What one stands for in the lists that the page gets: m and rad."""
TITLE = "Calibrate: bend the orange path until it lies on the true one"
ALT = """From above, the true path of the drive, two long arms at a right angle, and the path that wheels and gyro
give with a wrong calibration: it bends away from the truth and ends some metres from the true end."""


def calibrate_options(recording: Recording) -> dict:
    """What the script needs: for each moment what both sides ran, what the gyro turned, and the true pose.

    All are totals in the units of ``UNITS``, rounded and then written as steps, so that no rounding adds up.
    """
    inputs, truth = controls(recording), recording.true_path()
    covered = inputs.t[truth.covers(inputs.t)]
    t = np.arange(covered[0], covered[-1], 1 / HERTZ)
    travelled = np.interp(t, inputs.t[1:], np.cumsum(inputs.v * np.diff(inputs.t)))
    apart = turned_by_wheels(recording, t, 1.0)
    poses = between(truth.at(t[0]), truth.at(t))
    totals = {
        "left": travelled - apart / 2,
        "right": travelled + apart / 2,
        "turned": np.interp(t, inputs.t[1:], np.cumsum(inputs.omega * np.diff(inputs.t))),
        **dict(zip(("x", "y", "theta"), (*poses[:, :2].T, np.unwrap(poses[:, 2])), strict=True)),
    }
    steps = {name: np.diff(np.rint((total - total[0]) / UNITS[name])) for name, total in totals.items()}
    return {
        "hertz": HERTZ,
        "units": UNITS,
        "right": RIGHT,
        "track": recording.robot.encoders.track,
        "steps": {name: values.astype(int).tolist() for name, values in steps.items()},
    }


def true_path(options: dict) -> Trajectory:
    """The true path as the page knows it, from (0, 0, 0)."""
    steps = np.column_stack(
        [options["units"][name] * np.array(options["steps"][name]) for name in ("x", "y", "theta")]
    )
    poses = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    return Trajectory(np.arange(len(poses)) / options["hertz"], poses)


def calibrate_lab(recording: Recording) -> Laboratory:
    """The laboratory in which the reader finds the numbers of a gyro and of wheels."""
    return show_lab("calibrate", TITLE, ALT, **calibrate_options(recording))


# ---- a gyro that was smoothed before it was added up


def smoothed(inputs: Controls, seconds: float) -> Controls:
    """The same controls with the yaw rate averaged over the last ``seconds``: a low-pass filter."""
    n = max(round(seconds / float(np.median(np.diff(inputs.t)))), 1)
    total = np.concatenate([np.zeros(n), np.cumsum(inputs.omega)])
    return replace(inputs, omega=(total[n:] - total[:-n]) / n)


def smoothing_errors(inputs: Controls, seconds: float) -> tuple[float, float]:
    """What smoothing does to the raw path: heading at the end (deg), greatest distance on the way (m)."""
    raw, soft = integrate(inputs), integrate(smoothed(inputs, seconds))
    away = np.hypot(*(soft.poses - raw.poses)[:, :2].T).max()
    return float(np.rad2deg(abs(soft.poses[-1, 2] - raw.poses[-1, 2]))), float(away)


def describe_smoothing(inputs: Controls, seconds: float) -> str:
    """Say in words what smoothing does."""
    degrees, away = smoothing_errors(inputs, seconds)
    return f"""Yaw rate averaged over the last {seconds:g} s: at the end the heading differs from the raw one by
    {degrees:.2f} degrees, on the way the paths are up to {away:.2f} m apart."""


def smoothing_options(inputs: Controls) -> dict:
    """What the script needs: the controls, their usual step, and the middle (s) of the sharpest turn."""
    middle = inputs.t[1 + np.argmax(np.abs(smoothed(inputs, 1.0).omega))] - inputs.t[0] - 0.5
    dt = np.diff(inputs.t)
    each = {"v": packed(inputs.v), "omega": packed(inputs.omega), "dt": packed(dt)}
    return {"tau": float(np.median(dt)), "middle": round(float(middle)), **each}


def smoothing_picture(recording: Recording) -> Laboratory:
    """One slider: how much the gyro is smoothed before it is added up."""
    inputs = controls(recording)
    alt = describe_smoothing(inputs, 0.5)
    return show_lab("smoothing", "A smoothed gyro lags behind", alt, **smoothing_options(inputs))
