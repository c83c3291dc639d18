"""What the notebook of chapter 02 calls."""

from pfslam_book.ch02.failures import (
    edge_picture,
    glass_picture,
)
from pfslam_book.ch02.live import grow_lab
from pfslam_book.ch02.many_scans import (
    dead_reckoned_maps,
    dead_reckoned_picture,
    scans_between,
    scans_to_believe,
    walls_of,
)
from pfslam_book.ch02.one_scan import (
    RULES,
    cleared,
    crossings_at,
    crossings_picture,
    logistic_picture,
    question_picture,
    ray_picture,
    rays_picture,
    rules_picture,
    scan_after,
    walls_left,
)
from pfslam_book.exercises.ch02 import (
    check_cell_of,
    check_cell_story,
    check_meaning,
    check_update_log_odds,
)
from pfslam_book.show.keep import keep
from pfslam_book.show.source import show_source

__all__ = [
    "RULES",
    "check_cell_of",
    "check_cell_story",
    "check_meaning",
    "check_update_log_odds",
    "cleared",
    "crossings_at",
    "crossings_picture",
    "dead_reckoned_maps",
    "dead_reckoned_picture",
    "edge_picture",
    "glass_picture",
    "grow_lab",
    "keep",
    "logistic_picture",
    "question_picture",
    "ray_picture",
    "rays_picture",
    "rules_picture",
    "scan_after",
    "scans_between",
    "scans_to_believe",
    "show_source",
    "walls_left",
    "walls_of",
]
