"""Which way is up for an IMU whose mounting nobody told: gravity says."""

from __future__ import annotations

import numpy as np

from pfslam.poses import rotation_matrix


def upright(acceleration) -> tuple[np.ndarray, str]:
    """Return a rotation ``(3, 3)`` without yaw that turns a mean acceleration ``(3,)`` in g upwards, and what it does.

    Over a drive an accelerometer shows one g upwards in the mean. One that shows much else is taken for upright.
    """
    (x, y, z), length = acceleration, float(np.linalg.norm(acceleration))
    if not 0.8 < length < 1.2:
        return np.eye(3), f"upright, as it shows {length:.2f} g in the mean"
    lean = np.degrees(np.arccos(np.clip(z / length, -1.0, 1.0)))
    words = f"leaning by {lean:.0f} deg, as gravity says"
    return rotation_matrix(np.arctan2(y, z), np.arctan2(-x, np.hypot(y, z))), words
