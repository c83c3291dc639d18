"""Chapter 02: a map that grows while the reader drives, as a laboratory in the page."""

from __future__ import annotations

from pfslam_book.show.lab import Laboratory, show_lab

TITLE = "A map grows: drag the robot, and click a cell for its diary"
ALT = """The map of a small building after a drive along its corridor: the corridor is free, its walls are occupied
with some gaps, a white fan reaches through a doorway into a room, and the rest is unknown. Orange lines mark a door and
a panel, a frame the chosen cell in the door, and beams run from the robot to the walls."""


def grow_lab() -> Laboratory:
    """Make the laboratory in which the reader maps a small building and reads the diary of any cell."""
    return show_lab("grow", TITLE, ALT)
