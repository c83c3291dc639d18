"""What the notebook of chapter 08 calls."""

from pfslam_book.ch08.data import BENDS, DELAY, MIRRORED_X, TURNS, corrections, turn_ratio
from pfslam_book.ch08.fault import explorer
from pfslam_book.ch08.filter import filter_run, score_aside
from pfslam_book.ch08.mystery import mystery
from pfslam_book.ch08.table import FAULTS
from pfslam_book.ch08.world import error_of, world_run
from pfslam_book.exercises.ch08 import check_diagnosis, check_find_shift, check_looks_broken
from pfslam_book.show.source import show_source
from pfslam_book.show.tables import Shown

__all__ = ["BENDS", "DELAY", "FAULTS", "MIRRORED_X", "TURNS", "Shown"]
__all__ += ["check_diagnosis", "check_find_shift", "check_looks_broken", "corrections"]
__all__ += ["error_of", "explorer", "filter_run", "mystery"]
__all__ += ["score_aside", "show_source", "turn_ratio", "world_run"]
