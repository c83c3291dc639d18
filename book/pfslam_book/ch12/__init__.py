"""What the notebook of chapter 12 calls."""

from pfslam_book.ch12.drives import edges, stored
from pfslam_book.ch12.springs import (
    draw_graph,
    outlier_case,
    outlier_explorer,
    six_poses,
    springs_lab,
    two_rounds,
)
from pfslam_book.ch12.your_graph import check_graph
from pfslam_book.exercises.ch12 import check_edge_error, check_landmark_jacobian, check_robust_weight
from pfslam_book.show.source import show_source
from pfslam_book.show.tables import Shown, read_table

__all__ = [
    "Shown",
    "check_edge_error",
    "check_graph",
    "check_landmark_jacobian",
    "check_robust_weight",
    "draw_graph",
    "edges",
    "outlier_case",
    "outlier_explorer",
    "read_table",
    "show_source",
    "six_poses",
    "springs_lab",
    "stored",
    "two_rounds",
]
