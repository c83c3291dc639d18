"""What the notebook of chapter 09 calls."""

from pfslam.correlation import score_field
from pfslam.particles import MotionNoise
from pfslam.refined.lines import align_to_lines, nearby_lines
from pfslam_book.ch09.judging import judged_table, turned_start
from pfslam_book.ch09.runs import (
    PolishCase,
    grid_lock,
    grid_lock_picture,
    live_rungs,
    polish_picture,
    repeat_step,
    rungs_explorer,
)
from pfslam_book.ch09.tables import (
    buildings,
    buildings_picture,
    changes_table,
    decided,
    hard_ladder,
    hard_ladder_table,
    hard_left_out_table,
    ladder,
    ladder_picture,
    ladder_table,
    left_out,
    left_out_table,
    map_agreement_table,
    medians_cm,
    prior_table,
    spread_table,
    steps,
)
from pfslam_book.ch09.walls import walls_table
from pfslam_book.exercises.ch09 import check_blocked, check_first_pose_error, check_line_step, check_sub_cell
from pfslam_book.show.source import show_source
from pfslam_book.show.tables import number_of_buildings

__all__ = [
    "MotionNoise",
    "PolishCase",
    "align_to_lines",
    "buildings",
    "buildings_picture",
    "changes_table",
    "check_blocked",
    "check_first_pose_error",
    "check_line_step",
    "check_sub_cell",
    "decided",
    "grid_lock",
    "grid_lock_picture",
    "hard_ladder",
    "hard_ladder_table",
    "hard_left_out_table",
    "judged_table",
    "ladder",
    "ladder_picture",
    "ladder_table",
    "left_out",
    "left_out_table",
    "live_rungs",
    "map_agreement_table",
    "medians_cm",
    "nearby_lines",
    "number_of_buildings",
    "polish_picture",
    "prior_table",
    "repeat_step",
    "rungs_explorer",
    "score_field",
    "show_source",
    "spread_table",
    "steps",
    "turned_start",
    "walls_table",
]
