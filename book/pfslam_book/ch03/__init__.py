"""What the notebook of chapter 03 calls."""

from pfslam_book.ch03.cells import (
    fates,
    importance_picture,
    particle_walk,
    predict_cells,
    weigh_cells,
)
from pfslam_book.ch03.cloud import (
    end_spreads,
    fans_picture,
    honesty,
    honesty_picture,
    rates_picture,
)
from pfslam_book.ch03.corridor import (
    corridor_walk,
    door_likelihood,
)
from pfslam_book.ch03.live import cells_lab, cloud_lab, corridor_lab
from pfslam_book.ch03.mean import means_picture
from pfslam_book.ch03.models import (
    MODELS,
    TRUE_BIAS,
    model_cloud,
    models_explorer,
    path,
    widths,
)
from pfslam_book.exercises.ch03 import (
    check_heading_spread,
    check_predict,
    check_track,
)
from pfslam_book.show.keep import keep
from pfslam_book.show.source import show_source
from pfslam_book.show.tables import Shown

__all__ = [
    "MODELS",
    "TRUE_BIAS",
    "Shown",
    "cells_lab",
    "check_heading_spread",
    "check_predict",
    "check_track",
    "cloud_lab",
    "corridor_lab",
    "corridor_walk",
    "door_likelihood",
    "end_spreads",
    "fans_picture",
    "fates",
    "honesty",
    "honesty_picture",
    "importance_picture",
    "keep",
    "means_picture",
    "model_cloud",
    "models_explorer",
    "particle_walk",
    "path",
    "predict_cells",
    "rates_picture",
    "show_source",
    "weigh_cells",
    "widths",
]
