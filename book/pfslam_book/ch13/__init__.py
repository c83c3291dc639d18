"""What the notebook of chapter 13 calls."""

from dataclasses import replace

import numpy as np

from pfslam.evaluation.checkup import check_up
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.study.disturbances import first_seconds
from pfslam_book.ch13.bag import record_bag
from pfslam_book.ch13.gallery import gallery, gallery_picture, gallery_table
from pfslam_book.exercises.ch13 import check_classify, check_increments, check_track
from pfslam_book.show.lab import lidar_options, packed_scan
from pfslam_book.show.source import show_source
from pfslam_book.show.tables import Shown

__all__ = [
    "check_classify",
    "check_increments",
    "check_track",
    "check_up_table",
    "gallery",
    "gallery_picture",
]
__all__ += ["gallery_table", "lever_options", "minute", "record_bag", "show_source"]

MARKS = {True: "✓", False: "✗", None: "–"}


def minute(recording: Recording) -> Recording:
    """The first minute of a drive, without its images."""
    return replace(first_seconds(recording, 60.0), camera=None)


def check_up_table(recording: Recording) -> Shown:
    """The check-up of one recording: the question, what was found and what is expected."""
    rows = [(MARKS[f.ok], f.question, f.found, f.expected) for f in check_up(recording)]
    return Shown(("verdict", "question", "found", "expected"), rows, left=(1, 2, 3))


def lever_options(recording: Recording, path: Trajectory, turn: np.ndarray) -> dict:
    """What the picture of the LiDAR's place needs: the scans ``turn`` and the poses at which they were taken."""
    scans, lidar = recording.scans(), recording.robot.lidar
    return {
        "cell": 0.02,
        "ranges": [packed_scan(scans.ranges[i], lidar) for i in turn],
        "poses": path.at(scans.t[turn]).round(6).tolist(),
        "lidar": lidar_options(lidar),
    }
