"""What the notebook of chapter 09 calls."""

from pfslam.cli.figures import map_along
from pfslam_book.ch09.tables import (
    changes_table,
    elimination,
    elimination_table,
    hard_comparisons,
    hard_table,
    is_decided,
    ladder,
    ladder_table,
    lattice_medians,
    lost,
    nearer,
    on_floors,
    paired,
    parted,
    rungs,
    situation,
)
from pfslam_book.exercises.ch09 import (
    check_draw_all,
    check_line_step,
    check_log_weight,
    check_sub_cell,
    line_step,
)
from pfslam_book.show.source import show_source
from pfslam_book.show.tables import Shown, errors_by_label, read_table

__all__ = [
    "Shown",
    "changes_table",
    "check_draw_all",
    "check_line_step",
    "check_log_weight",
    "check_sub_cell",
]
__all__ += [
    "elimination",
    "elimination_table",
    "errors_by_label",
    "hard_comparisons",
    "hard_table",
    "is_decided",
    "ladder",
]
__all__ += ["ladder_table", "lattice_medians", "line_step", "lost", "map_along"]
__all__ += [
    "nearer",
    "on_floors",
    "paired",
    "parted",
    "read_table",
    "rungs",
    "show_source",
    "situation",
]
