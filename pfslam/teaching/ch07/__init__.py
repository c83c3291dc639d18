"""What the notebook of chapter 07 calls."""

from pfslam.teaching.ch07.changes import (
    Change,
    changes_picture,
    filter_pair,
    students_picture,
    threshold_change,
    threshold_pair,
)
from pfslam.teaching.ch07.checks import (
    check_median_interval,
    check_sharpness,
    check_sigma_from_sheet,
    check_wrong_pairs,
)
from pfslam.teaching.ch07.explorers import (
    how_often_wrong,
    seeds_explorer,
    sweep_explorer,
)
from pfslam.teaching.ch07.statistics import (
    best_of,
    bootstrap_interval,
    resampled,
    seconds_of,
)
from pfslam.teaching.ch07.sweeps import (
    groups,
    strips_picture,
)
from pfslam.teaching.show.drives import place_at
from pfslam.teaching.show.source import (
    show_source,
)
from pfslam.teaching.show.tables import (
    read_table,
    select,
    study_file,
)

__all__ = [
    "Change",
    "best_of",
    "bootstrap_interval",
    "changes_picture",
    "check_median_interval",
    "check_sharpness",
    "check_sigma_from_sheet",
    "check_wrong_pairs",
    "filter_pair",
    "groups",
    "how_often_wrong",
    "place_at",
    "read_table",
    "resampled",
    "seconds_of",
    "seeds_explorer",
    "select",
    "show_source",
    "strips_picture",
    "students_picture",
    "study_file",
    "sweep_explorer",
    "threshold_change",
    "threshold_pair",
]
