"""What the notebook of chapter 05 calls."""

from pfslam.study.disturbances import first_seconds
from pfslam_book.ch05.cells import success
from pfslam_book.ch05.live import drive_lab, maps_lab
from pfslam_book.ch05.measurements import (
    GENTLE,
    LATTICE_TABLE,
    corridor_excess,
    cost_at,
    erosion,
    erosion_picture,
    paths_over_seeds,
    slip_picture,
    stored_errors,
)
from pfslam_book.ch05.play import (
    dead_reckoned_maps_picture,
    film_explorer,
    odometry_at,
    play,
    results_picture,
)
from pfslam_book.ch05.slow_motion import comb_picture, one_update, slow_motion_explorer
from pfslam_book.ch05.weights import copies_table
from pfslam_book.ch05.whole import check_filter
from pfslam_book.ch05.window import moved_to_best, window_picture
from pfslam_book.ch05.your_filter import (
    CHANGES,
    FILTER_TABLE,
    Settings,
    drive,
    driven_picture,
    error,
    my_filter,
    odometry_error,
    step,
)
from pfslam_book.exercises.ch05 import check_mean_pose, check_resample, check_update
from pfslam_book.show.figures import map_along
from pfslam_book.show.keep import keep
from pfslam_book.show.source import show_source
from pfslam_book.show.tables import Shown, errors_by_label, read_table

__all__ = [
    "CHANGES",
    "FILTER_TABLE",
    "GENTLE",
    "LATTICE_TABLE",
    "Settings",
    "Shown",
    "check_filter",
    "check_mean_pose",
    "check_resample",
    "check_update",
    "comb_picture",
    "copies_table",
    "corridor_excess",
    "cost_at",
    "dead_reckoned_maps_picture",
    "drive",
    "drive_lab",
    "driven_picture",
    "erosion",
    "erosion_picture",
    "error",
    "errors_by_label",
    "film_explorer",
    "first_seconds",
    "keep",
    "map_along",
    "maps_lab",
    "moved_to_best",
    "my_filter",
    "odometry_at",
    "odometry_error",
    "one_update",
    "paths_over_seeds",
    "play",
    "read_table",
    "results_picture",
    "show_source",
    "slip_picture",
    "slow_motion_explorer",
    "step",
    "stored_errors",
    "success",
    "window_picture",
]
