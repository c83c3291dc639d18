"""Chapter 05: what the notebook calls."""

from pfslam.cli.figures import map_along
from pfslam_book.ch05.live import drive_lab, maps_lab
from pfslam_book.ch05.whole import check_filter
from pfslam_book.challenge import challenge, made_by, rank
from pfslam_book.exercises.ch05 import check_mean_pose, check_resample, check_update
from pfslam_book.show.keep import keep
from pfslam_book.show.source import show_source
from pfslam_book.show.tables import Shown
from pfslam_book.your_filter import Settings, drive, moments, my_filter, step, stored_errors

__all__ = ["Settings", "Shown", "challenge", "check_filter", "check_mean_pose", "check_resample"]
__all__ += ["check_update", "drive", "drive_lab", "keep", "made_by", "map_along", "maps_lab", "moments"]
__all__ += ["my_filter", "rank", "show_source", "step", "stored_errors"]
