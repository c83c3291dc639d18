"""What the notebook of chapter 00 calls."""

from pfslam.teaching.ch00.checks import (
    check_distance_at,
    check_nearest_within,
    check_scan_points,
    check_to_world,
)
from pfslam.teaching.ch00.frames import (
    STRETCHES,
    late_clock,
    late_clock_explorer,
    turn_explorer,
)
from pfslam.teaching.ch00.readings import (
    all_stored,
    counts_picture,
    distance_by_pairing,
    raster_picture,
    scrub_explorer,
    streams,
)
from pfslam.teaching.ch00.robot import robot_picture
from pfslam.teaching.show.keep import keep
from pfslam.teaching.show.source import show_source

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
