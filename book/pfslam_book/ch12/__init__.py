"""What the notebook of chapter 12 calls."""

from pfslam_book.ch12.bag import record_bag
from pfslam_book.ch12.gallery import gallery, gallery_picture, gallery_table
from pfslam_book.ch12.robot import (
    calibration_table,
    check_up_table,
    complaints,
    drives,
    faults_table,
    lever_explorer,
    run_figure,
    sharpest_lever,
    track_explorer,
)
from pfslam_book.exercises.ch12 import check_classify, check_increments, check_track
from pfslam_book.show.source import show_source

__all__ = [
    "calibration_table",
    "check_classify",
    "check_increments",
    "check_track",
    "check_up_table",
    "complaints",
    "drives",
    "faults_table",
    "gallery",
    "gallery_picture",
    "gallery_table",
    "lever_explorer",
    "record_bag",
    "run_figure",
    "sharpest_lever",
    "show_source",
    "track_explorer",
]
