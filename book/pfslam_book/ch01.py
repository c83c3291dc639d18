"""Chapter 01: the calibration laboratory, and what smoothing a gyro does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pfslam.motion import Controls, controls, integrate
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

TITLE = "Calibrate: bend the orange path until it lies on the true one"
ALT = """A small building from above, the true path of a drive through it, and the path that wheels and gyro
give with a wrong calibration: it bends away from the truth and ends beside the true end."""


def calibrate_lab() -> Laboratory:
    """The laboratory in which the reader finds the numbers of a gyro and of wheels."""
    return show_lab("calibrate", TITLE, ALT)


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
