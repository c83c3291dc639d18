"""Chapter 03: the corridor of fifteen cells as a laboratory in the page."""

from __future__ import annotations

from pfslam.teaching.show.lab import Laboratory, show_lab

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
