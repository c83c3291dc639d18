"""What the notebook of chapter 04 calls."""

from pfslam_book.ch04.live import slide_lab
from pfslam_book.ch04.scores import (
    LATTICE,
    field_picture,
    heading_picture,
    patches_picture,
    question_picture,
    surfaces_picture,
)
from pfslam_book.ch04.search import (
    WINDOW,
    block_by_definition,
    block_from_volume,
    fine_scores_picture,
    first_index_walk,
    lattice_picture,
    trials,
)
from pfslam_book.ch04.weights import (
    best_shift,
    cloud,
    counts_of_the_window,
    counts_where_they_stand,
    n_eff,
    sharpness_explorer,
    walls_picture,
)
from pfslam_book.exercises.ch04 import check_choose, check_count_on_walls, check_transform_test
from pfslam_book.show.drives import place_at
from pfslam_book.show.keep import keep
from pfslam_book.show.source import show_source

__all__ = [
    "LATTICE",
    "WINDOW",
    "best_shift",
    "block_by_definition",
    "block_from_volume",
    "check_choose",
    "check_count_on_walls",
    "check_transform_test",
    "cloud",
    "counts_of_the_window",
    "counts_where_they_stand",
    "field_picture",
    "fine_scores_picture",
    "first_index_walk",
    "heading_picture",
    "keep",
    "lattice_picture",
    "n_eff",
    "patches_picture",
    "place_at",
    "question_picture",
    "sharpness_explorer",
    "show_source",
    "slide_lab",
    "surfaces_picture",
    "trials",
    "walls_picture",
]
