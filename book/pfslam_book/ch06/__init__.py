"""What the notebook of chapter 06 calls."""

from pfslam_book.ch06.explorers import PIXELS, floor_picture
from pfslam_book.ch06.geometry import (
    calibration_picture,
    floor_votes,
    frames_picture,
    pinhole_picture,
    plane_picture,
    structured_light_explorer,
    tape_and_raw,
)
from pfslam_book.ch06.live import journey_lab
from pfslam_book.ch06.pairs import (
    cheap_run,
    climb,
    fitted_camera,
    journey_table,
    judge_for,
    load_drive,
    pitched,
    points_of,
    score_table,
    shots_along,
    state_gaps,
    take_shot,
    views_of_cell,
)
from pfslam_book.ch06.pictures import (
    birds_eye_picture,
    camera_picture,
    cell_views_picture,
    depth_error_picture,
    pitch_picture,
    swapped_picture,
    texture_pair_picture,
    word_picture,
)
from pfslam_book.exercises.ch06 import (
    check_best_view,
    check_blind_ring,
    check_calibrate,
    check_optical_point,
    check_to_body,
)
from pfslam_book.show.faults import swapped_centre
from pfslam_book.show.source import show_source
from pfslam_book.show.texture_error import nearest_floor

__all__ = [
    "PIXELS",
    "birds_eye_picture",
    "calibration_picture",
    "camera_picture",
    "cell_views_picture",
    "cheap_run",
    "check_best_view",
    "check_blind_ring",
    "check_calibrate",
    "check_optical_point",
    "check_to_body",
    "climb",
    "depth_error_picture",
    "fitted_camera",
    "floor_picture",
    "floor_votes",
    "frames_picture",
    "journey_lab",
    "journey_table",
    "judge_for",
    "load_drive",
    "nearest_floor",
    "pinhole_picture",
    "pitch_picture",
    "pitched",
    "plane_picture",
    "points_of",
    "score_table",
    "shots_along",
    "show_source",
    "state_gaps",
    "structured_light_explorer",
    "swapped_centre",
    "swapped_picture",
    "take_shot",
    "tape_and_raw",
    "texture_pair_picture",
    "views_of_cell",
    "word_picture",
]
