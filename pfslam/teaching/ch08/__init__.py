"""What the notebook of chapter 08 calls."""

from pfslam.teaching.ch08.checks import (
    check_diagnosis,
    check_find_shift,
    check_looks_broken,
)
from pfslam.teaching.ch08.data import (
    Turn,
    correction_fit,
    lever_fit,
)
from pfslam.teaching.ch08.data_exhibits import (
    DELAY,
    data_exhibits,
)
from pfslam.teaching.ch08.demos import (
    cure_table,
    cures,
    mirrored_worlds,
    standing_cloud,
)
from pfslam.teaching.ch08.exhibit import (
    bench,
    clock_explorer,
    readings,
)
from pfslam.teaching.ch08.filter_exhibits import (
    errors_over_seeds,
    filter_exhibits,
    filter_runs,
)
from pfslam.teaching.ch08.map_exhibits import (
    camera_exhibits,
    map_exhibits,
)
from pfslam.teaching.ch08.mystery import (
    chart,
    mystery,
    ward_picture,
)
from pfslam.teaching.show.faults import (
    keep_weights,
    late_scans,
)
from pfslam.teaching.show.source import (
    show_source,
)

__all__ = [
    "DELAY",
    "Turn",
    "bench",
    "camera_exhibits",
    "chart",
    "check_diagnosis",
    "check_find_shift",
    "check_looks_broken",
    "clock_explorer",
    "correction_fit",
    "cure_table",
    "cures",
    "data_exhibits",
    "errors_over_seeds",
    "filter_exhibits",
    "filter_runs",
    "keep_weights",
    "late_scans",
    "lever_fit",
    "map_exhibits",
    "mirrored_worlds",
    "mystery",
    "readings",
    "show_source",
    "standing_cloud",
    "ward_picture",
]
