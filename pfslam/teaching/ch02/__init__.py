"""What the notebook of chapter 02 calls."""

from pfslam.teaching.ch02.checks import (
    check_cell_of,
    check_cell_story,
    check_meaning,
    check_write_scan,
)
from pfslam.teaching.ch02.failures import (
    behind_glass,
    edge_picture,
    flips_picture,
    glass_picture,
)
from pfslam.teaching.ch02.many_scans import (
    COUNTS,
    dead_reckoned_maps,
    dead_reckoned_picture,
    evidence_alt,
    evidence_frame,
    growth,
    growth_alt,
    growth_frame,
    scans_between,
    scans_to_believe,
    walls_of,
)
from pfslam.teaching.ch02.one_scan import (
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
from pfslam.teaching.show.source import (
    show_source,
)
from pfslam.teaching.show.widgets import (
    Explorer,
    Slider,
)

__all__ = [
    "COUNTS",
    "RULES",
    "Explorer",
    "Slider",
    "behind_glass",
    "check_cell_of",
    "check_cell_story",
    "check_meaning",
    "check_write_scan",
    "cleared",
    "crossings_at",
    "crossings_picture",
    "dead_reckoned_maps",
    "dead_reckoned_picture",
    "edge_picture",
    "evidence_alt",
    "evidence_frame",
    "flips_picture",
    "glass_picture",
    "growth",
    "growth_alt",
    "growth_frame",
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
