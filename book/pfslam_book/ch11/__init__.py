"""What the notebook of chapter 11 calls."""

from pfslam.beyond.loops.closing import close_loops, consistent
from pfslam.beyond.loops.graph import gauss_newton_step, jacobians, relax, residuals, robust_weights
from pfslam_book.ch11.drives import (
    corner_picture,
    drives_table,
    error,
    given,
    given_table,
    numbers,
    ring_picture,
    scale_picture,
)
from pfslam_book.ch11.springs import (
    kernel_picture,
    outlier_case,
    outlier_explorer,
    six_poses,
    springs_picture,
)
from pfslam_book.exercises.ch11 import check_edge_error, check_robust_weight
from pfslam_book.show.source import show_source

__all__ = [
    "check_edge_error",
    "check_robust_weight",
    "close_loops",
    "consistent",
    "corner_picture",
    "drives_table",
    "error",
    "gauss_newton_step",
    "given",
    "given_table",
    "jacobians",
    "kernel_picture",
    "numbers",
    "outlier_case",
    "outlier_explorer",
    "relax",
    "residuals",
    "ring_picture",
    "robust_weights",
    "scale_picture",
    "show_source",
    "six_poses",
    "springs_picture",
]
