"""Chapter 02: the laboratory in which a map grows."""

from __future__ import annotations

from pfslam_book.exercises.ch02 import (
    check_cell_of,
    check_cell_story,
    check_crossed_cells,
    check_meaning,
    check_update_log_odds,
)
from pfslam_book.show.keep import keep
from pfslam_book.show.lab import Laboratory, show_lab
from pfslam_book.show.source import show_source

__all__ = ["check_cell_of", "check_cell_story", "check_crossed_cells", "check_meaning"]
__all__ += ["check_update_log_odds", "grow_lab", "keep", "show_source"]

TITLE = "A map grows: drag the robot, and click a cell for its diary"
ALT = """The map of a small building after a drive along its corridor: the corridor is free, its walls are occupied
with some gaps, a white fan reaches through a doorway into a room, and the rest is unknown. Orange lines mark two
doors, a frame the chosen cell in one of them, and beams run from the robot to the walls."""


def grow_lab() -> Laboratory:
    """The laboratory in which the reader maps a small building and reads the diary of any cell."""
    return show_lab("grow", TITLE, ALT)
