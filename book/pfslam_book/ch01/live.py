"""Chapter 01: the calibration of wheels and gyro, as a laboratory in the page."""

from __future__ import annotations

import numpy as np

from pfslam.evaluation.checkup import turned_by_gyro, turned_by_wheels
from pfslam.motion import controls
from pfslam.poses import Trajectory, between
from pfslam.recording import Recording
from pfslam_book.show.lab import Laboratory, show_lab

HERTZ = 20
RIGHT = {"bias": 0.0005, "gyro": 1.03, "wheels": 0.992, "track": 0.726}
"""With these numbers the path of `hall` comes closest to the truth: rad/s, two factors, m."""
UNITS = {"left": 1e-4, "right": 1e-4, "turned": 1e-4, "x": 1e-3, "y": 1e-3, "theta": 1e-3}
"""What one stands for in the lists that the page gets: m and rad."""
TITLE = "Calibrate: bend the orange path until it lies on the true one"
ALT = """From above, the true path of the drive, two long arms at a right angle, and the path that wheels and gyro
give with a wrong calibration: it bends away from the truth and ends some metres from the true end."""


def calibrate_options(recording: Recording) -> dict:
    """Give what the script needs: for each moment what both sides ran, what the gyro turned, and the true pose.

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
        "turned": turned_by_gyro(inputs, t),
        **dict(zip(("x", "y", "theta"), (*poses[:, :2].T, np.unwrap(poses[:, 2])), strict=True)),
    }
    steps = {name: np.diff(np.rint((total - total[0]) / UNITS[name])) for name, total in totals.items()}
    measured = recording.robot.encoders.track
    return {
        "hertz": HERTZ,
        "units": UNITS,
        "right": RIGHT,
        "track": measured,
        "steps": {name: values.astype(int).tolist() for name, values in steps.items()},
    }


def true_path(options: dict) -> Trajectory:
    """Return the true path as the page knows it, from (0, 0, 0)."""
    steps = np.column_stack(
        [options["units"][name] * np.array(options["steps"][name]) for name in ("x", "y", "theta")]
    )
    poses = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    return Trajectory(np.arange(len(poses)) / options["hertz"], poses)


def calibrate_lab(recording: Recording) -> Laboratory:
    """Make the laboratory in which the reader finds the numbers of a gyro and of wheels."""
    return show_lab("calibrate", TITLE, ALT, **calibrate_options(recording))
