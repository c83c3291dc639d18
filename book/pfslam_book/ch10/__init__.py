"""What the notebook of chapter 10 calls."""

from pfslam.beyond.localization import (
    KnownMap,
    LocalizationConfig,
    enough,
    kld_bound,
    likelihood_field,
    localization_step,
    locate,
    spread,
)
from pfslam_book.ch10.building import distances, kidnapped, part, two_halves
from pfslam_book.ch10.exact import HEADINGS, Histogram
from pfslam_book.ch10.measured import (
    counts,
    distances_by_number,
    exact_picture,
    found_table,
    right_on_poor_maps,
    values,
)
from pfslam_book.ch10.pictures import (
    info_at,
    kidnap_picture,
    likelihood_picture,
    numbers_picture,
    search_explorer,
    shares,
    start_table,
)
from pfslam_book.exercises.ch10 import check_inject, check_particles_needed
from pfslam_book.show.figures import map_along
from pfslam_book.show.source import show_source

__all__ = [
    "HEADINGS",
    "Histogram",
    "KnownMap",
    "LocalizationConfig",
    "check_inject",
    "check_particles_needed",
    "counts",
    "distances",
    "distances_by_number",
    "enough",
    "exact_picture",
    "found_table",
    "info_at",
    "kidnap_picture",
    "kidnapped",
    "kld_bound",
    "likelihood_field",
    "likelihood_picture",
    "localization_step",
    "locate",
    "map_along",
    "numbers_picture",
    "part",
    "right_on_poor_maps",
    "search_explorer",
    "shares",
    "show_source",
    "spread",
    "start_table",
    "two_halves",
    "values",
]
