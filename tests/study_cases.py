"""A study of very cheap runs, on a drive of six seconds that is written to a folder of its own."""

import math
import os
import signal

from box_recording import box_recording

from pfslam import save_course
from pfslam.study import make_study, run_case


def write_box(folder):
    """Put the box's drive into ``folder`` as set 90."""
    save_course(box_recording(images=0), 90, folder)
    return folder


def box_study(folder, seeds):
    """Three variants with so many seeds each: a filter of three particles, one pose matched, dead reckoning."""
    return make_study(
        {
            "name": "box",
            "common": {"dataset": 90, "data_dir": str(folder), "seed": {"count": seeds}},
            "variant": [
                {"label": "filter", "particles": 3, "search.cells": [1, 2], "search.yaws": [1, 2]},
                {"label": "matching", "method": "matching", "every": [5, 10]},
                {"label": "odometry", "method": "dead-reckoning"},
            ],
        }
    )


def square_root(case):
    """What a study of one's own measures."""
    return {"root": math.sqrt(case.get("number"))}


def deadly_with_row(case, run):
    """What joblib's workers are given; the run with seed 1 of the odometry takes its worker down, every time."""
    if case.label == "odometry" and case.get("seed") == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return case, run_case(case, run)
