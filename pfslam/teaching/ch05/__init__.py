"""What the notebook of chapter 05 calls."""

from pfslam.evaluation.faults import first_seconds
from pfslam.teaching.ch05.checks import (
    check_mean_pose,
    check_resample,
    check_update,
)
from pfslam.teaching.ch05.measurements import (
    GENTLE,
    corridor_excess,
    cost_at,
    erosion,
    erosion_picture,
    errors_picture,
    paths_over_seeds,
    slip_picture,
)
from pfslam.teaching.ch05.play import (
    dead_reckoned_maps_picture,
    film_explorer,
    n_eff_picture,
    odometry_at,
    play,
    results_picture,
)
from pfslam.teaching.ch05.weights import (
    copies_table,
    sharpness_explorer,
)
from pfslam.teaching.ch05.whole import check_filter
from pfslam.teaching.ch05.your_filter import Settings, my_filter
from pfslam.teaching.show.figures import (
    map_along,
)
from pfslam.teaching.show.source import (
    show_source,
)
from pfslam.teaching.show.tables import (
    errors_by_label,
    read_table,
)

__all__ = [
    "GENTLE",
    "Settings",
    "check_filter",
    "check_mean_pose",
    "check_resample",
    "check_update",
    "copies_table",
    "corridor_excess",
    "cost_at",
    "dead_reckoned_maps_picture",
    "erosion",
    "erosion_picture",
    "errors_by_label",
    "errors_picture",
    "film_explorer",
    "first_seconds",
    "map_along",
    "my_filter",
    "n_eff_picture",
    "odometry_at",
    "paths_over_seeds",
    "play",
    "read_table",
    "results_picture",
    "sharpness_explorer",
    "show_source",
    "slip_picture",
]
