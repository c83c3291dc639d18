"""What the notebook of chapter 07 calls."""

from pfslam_book.ch07.runs import errors, in_buildings, stored, sweep
from pfslam_book.exercises.ch07 import check_by_building, check_choose_and_report, check_difference
from pfslam_book.show.tables import study_file

__all__ = ["check_by_building", "check_choose_and_report", "check_difference", "errors", "in_buildings"]
__all__ += ["stored", "study_file", "sweep"]
