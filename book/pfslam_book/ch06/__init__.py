"""What the notebook of chapter 06 calls."""

from pfslam_book.ch06.drives import judge_for, load_drive, shots_along, take_shot
from pfslam_book.ch06.live import dot_picture, journey_lab
from pfslam_book.ch06.your_floor import check_floor
from pfslam_book.exercises.ch06 import (
    check_blind_ring,
    check_calibrate,
    check_seen_at,
    check_to_body,
)
from pfslam_book.show.source import show_source

__all__ = ["check_blind_ring", "check_calibrate", "check_floor", "check_seen_at", "check_to_body"]
__all__ += ["dot_picture", "journey_lab", "judge_for", "load_drive", "shots_along"]
__all__ += ["show_source", "take_shot"]
