"""What the notebook of chapter 06 calls."""

from pfslam.evaluation.faults import swapped_centre
from pfslam.teaching.ch06.checks import (
    check_best_view,
    check_blind_ring,
    check_optical_point,
)
from pfslam.teaching.ch06.explorers import (
    PIXELS,
    floor_explorer,
    journey_explorer,
)
from pfslam.teaching.ch06.pairs import (
    cheap_run,
    climb,
    fitted_camera,
    journey,
    judge_for,
    load_drive,
    pitched,
    score_table,
    shots_along,
    take_shot,
)
from pfslam.teaching.ch06.pictures import (
    birds_eye_picture,
    camera_picture,
    depth_error_picture,
    pitch_picture,
    swapped_picture,
    texture_pair_picture,
    word_picture,
)
from pfslam.teaching.show.source import (
    show_source,
)

__all__ = [
    "PIXELS",
    "birds_eye_picture",
    "camera_picture",
    "cheap_run",
    "check_best_view",
    "check_blind_ring",
    "check_optical_point",
    "climb",
    "depth_error_picture",
    "fitted_camera",
    "floor_explorer",
    "journey",
    "journey_explorer",
    "judge_for",
    "load_drive",
    "pitch_picture",
    "pitched",
    "score_table",
    "shots_along",
    "show_source",
    "swapped_centre",
    "swapped_picture",
    "take_shot",
    "texture_pair_picture",
    "word_picture",
]
