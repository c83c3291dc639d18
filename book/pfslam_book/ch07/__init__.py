"""What the notebook of chapter 07 calls."""

from pfslam_book.ch07.pictures import (
    changes_picture,
    how_often_wrong,
    seeds_explorer,
    strips_picture,
    students_picture,
    sweep_explorer,
)
from pfslam_book.ch07.runs import (
    Change,
    building_change,
    building_table,
    changes_table,
    filter_pair,
    groups,
    interaction,
    threshold_change,
    threshold_pair,
)
from pfslam_book.ch07.statistics import (
    best_of,
    bootstrap_interval,
    difference_interval,
    paired_interval,
    re_paired,
    resampled,
    seconds_of,
)
from pfslam_book.exercises.ch07 import (
    check_difference,
    check_median_interval,
    check_sharpness,
    check_sigma_from_sheet,
    check_wrong_pairs,
)
from pfslam_book.show.drives import place_at
from pfslam_book.show.source import show_source
from pfslam_book.show.tables import Shown, read_table, select, study_file

__all__ = [
    "Change",
    "Shown",
    "best_of",
    "bootstrap_interval",
    "building_change",
    "building_table",
    "changes_picture",
    "changes_table",
    "check_difference",
    "check_median_interval",
    "check_sharpness",
    "check_sigma_from_sheet",
    "check_wrong_pairs",
    "difference_interval",
    "filter_pair",
    "groups",
    "how_often_wrong",
    "interaction",
    "paired_interval",
    "place_at",
    "re_paired",
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
