"""What the notebook of chapter 00 calls."""

from pfslam_book.ch00.frames import (
    STRETCHES,
    late_clock,
    late_clock_explorer,
    turn_explorer,
)
from pfslam_book.ch00.readings import (
    all_stored,
    counts_picture,
    distance_by_pairing,
    raster_picture,
    scrub_explorer,
    streams,
)
from pfslam_book.ch00.robot import robot_picture
from pfslam_book.exercises.ch00 import (
    check_distance_at,
    check_nearest_within,
    check_scan_points,
    check_to_world,
)
from pfslam_book.show.keep import keep
from pfslam_book.show.source import show_source

__all__ = [
    "STRETCHES",
    "all_stored",
    "check_distance_at",
    "check_nearest_within",
    "check_scan_points",
    "check_to_world",
    "counts_picture",
    "distance_by_pairing",
    "keep",
    "late_clock",
    "late_clock_explorer",
    "raster_picture",
    "robot_picture",
    "scrub_explorer",
    "show_source",
    "streams",
    "turn_explorer",
]
