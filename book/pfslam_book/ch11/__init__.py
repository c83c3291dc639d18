"""What the notebook of chapter 11 calls."""

from pfslam_book.ch11.drives import Drive, drive
from pfslam_book.ch11.pictures import draw_belief, ellipse, slam_explorer
from pfslam_book.ch11.smoother import smooth
from pfslam_book.exercises.ch11 import check_predict, check_update, check_which_post, predict, update, yours
from pfslam_book.show.source import show_source
from pfslam_book.show.tables import Shown

__all__ = [
    "Drive",
    "Shown",
    "check_predict",
    "check_update",
    "check_which_post",
    "draw_belief",
    "drive",
    "ellipse",
]
__all__ += ["predict", "show_source", "slam_explorer", "smooth", "update", "yours"]
