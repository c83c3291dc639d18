"""Chapter 03: the corridor of fifteen cells and the cloud along a drive as laboratories in the page."""

from __future__ import annotations

import numpy as np

from pfslam.motion import controls
from pfslam.recording import Recording
from pfslam_book.show.drives import at_rate
from pfslam_book.show.lab import Laboratory, show_lab

ALT = """A corridor of fifteen cells with doors at 1, 4 and 10; the robot is at door 4. Under each cell stand the
belief before the look, the likelihood of seeing a door, which is high at the three doors, and their product, the
belief after it, which is highest in cell 4. At the bottom thirty blue dots, the particles of act two, stand in columns
in the cells; the heaviest are in cell 4."""


def corridor_lab() -> Laboratory:
    """Make the laboratory of the exact filter: move, look, and change the doors."""
    return show_lab("cells", "Fifteen cells: prior times likelihood is posterior", ALT, dots=False)


def cells_lab() -> Laboratory:
    """Make the same laboratory with particles under the histogram."""
    return show_lab("cells", "Fifteen cells with particles", ALT)


SKETCH_RATE = 10.0  # controls a second
CLOUD_ALT = """The path of the drive hall by dead reckoning, from above, as far as 30 % of it is driven as an
orange dashed line with the robot at its end. Two hundred and fifty blue dots, the particles, lie around the
robot in a cloud that is longer across the way than along it; thin blue lines are the paths of ten of them."""


def cloud_options(recording: Recording) -> dict:
    """Give what the script needs: the controls of the drive, made sparser."""
    inputs = at_rate(controls(recording), SKETCH_RATE)
    v, omega = np.round(inputs.v, 4), np.round(inputs.omega, 5)
    return {"hall": {"dt": 1.0 / SKETCH_RATE, "v": v.tolist(), "omega": omega.tolist()}}


def cloud_lab(recording: Recording) -> Laboratory:
    """Make the laboratory of prediction alone: along the drive, or along a path that the reader draws."""
    return show_lab("cloud", "The cloud along the drive", CLOUD_ALT, **cloud_options(recording))
