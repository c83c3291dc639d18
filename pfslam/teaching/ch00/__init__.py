"""What the notebook of chapter 00 calls."""

from pfslam.teaching.ch00.checks import (
    check_distance_at,
    check_end_points,
    check_nearest_within,
    check_to_world,
)
from pfslam.teaching.ch00.frames import (
    STRETCHES,
    WAYS,
    blur,
    offset_alt,
    offset_frame,
    pictures_of_inverse,
    turn_alt,
    turn_frame,
    turn_rate,
)
from pfslam.teaching.ch00.streams import (
    all_stored,
    counts_picture,
    depth_picture,
    distance_by_pairing,
    nominal_error,
    pairing_gaps,
    pairing_picture,
    raster_picture,
    scrub,
    scrub_alt,
    scrub_frame,
    streams,
)
from pfslam.teaching.show.source import (
    show_source,
)
from pfslam.teaching.show.widgets import (
    Explorer,
    Slider,
)

__all__ = [
    "STRETCHES",
    "WAYS",
    "Explorer",
    "Slider",
    "all_stored",
    "blur",
    "check_distance_at",
    "check_end_points",
    "check_nearest_within",
    "check_to_world",
    "counts_picture",
    "depth_picture",
    "distance_by_pairing",
    "nominal_error",
    "offset_alt",
    "offset_frame",
    "pairing_gaps",
    "pairing_picture",
    "pictures_of_inverse",
    "raster_picture",
    "scrub",
    "scrub_alt",
    "scrub_frame",
    "show_source",
    "streams",
    "turn_alt",
    "turn_frame",
    "turn_rate",
]
