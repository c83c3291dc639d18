"""What the notebook of chapter 01 calls."""

from pfslam_book.ch01.live import calibrate_lab
from pfslam_book.ch01.odometry import (
    arcs_picture,
    calibrated,
    circle_picture,
    distance,
    heading_error_picture,
    path_picture,
    readings_of_equation_19,
    speed_picture,
    two_paths_picture,
)
from pfslam_book.ch01.turns import (
    effective_track,
    smoothing_explorer,
    track_picture,
)
from pfslam_book.exercises.ch01 import (
    check_arc,
    check_distance_ahead,
    check_gyro_bias,
    check_reckon_by_wheels,
)
from pfslam_book.show.drives import at_rate, length
from pfslam_book.show.source import show_source

__all__ = [
    "arcs_picture",
    "at_rate",
    "calibrate_lab",
    "calibrated",
    "check_arc",
    "check_distance_ahead",
    "check_gyro_bias",
    "check_reckon_by_wheels",
    "circle_picture",
    "distance",
    "effective_track",
    "heading_error_picture",
    "length",
    "path_picture",
    "readings_of_equation_19",
    "show_source",
    "smoothing_explorer",
    "speed_picture",
    "track_picture",
    "two_paths_picture",
]
