"""What the notebook of chapter 08 calls."""

from pfslam_book.ch08.camera import swap_angle_deg, swap_pixels
from pfslam_book.ch08.data import Turn, body_corrections, correction_fit, lever_fit
from pfslam_book.ch08.data_exhibits import DELAY, MIRRORED_X, data_faults
from pfslam_book.ch08.demos import cures, cures_table, mirrored_table, mirrored_worlds, standing_table
from pfslam_book.ch08.exhibit import clock_explorer, faults_explorer, readings_table
from pfslam_book.ch08.filter_exhibits import errors_over_seeds, filter_faults, filter_runs
from pfslam_book.ch08.map_exhibits import camera_faults, map_faults
from pfslam_book.ch08.mystery import mystery, mystery_picture, mystery_table
from pfslam_book.ch08.world_exhibits import world_faults, world_runs
from pfslam_book.exercises.ch08 import check_diagnosis, check_find_shift, check_looks_broken
from pfslam_book.show.faults import keep_weights, late_scans
from pfslam_book.show.source import show_source

__all__ = [
    "DELAY",
    "MIRRORED_X",
    "Turn",
    "body_corrections",
    "camera_faults",
    "check_diagnosis",
    "check_find_shift",
    "check_looks_broken",
    "clock_explorer",
    "correction_fit",
    "cures",
    "cures_table",
    "data_faults",
    "errors_over_seeds",
    "faults_explorer",
    "filter_faults",
    "filter_runs",
    "keep_weights",
    "late_scans",
    "lever_fit",
    "map_faults",
    "mirrored_table",
    "mirrored_worlds",
    "mystery",
    "mystery_picture",
    "mystery_table",
    "readings_table",
    "show_source",
    "standing_table",
    "swap_angle_deg",
    "swap_pixels",
    "world_faults",
    "world_runs",
]
