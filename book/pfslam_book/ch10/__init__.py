"""What the notebook of chapter 10 calls."""

from pfslam.beyond.localization import enough, kld_bound, localization_step, locate
from pfslam.cli.figures import map_along
from pfslam_book.ch10.building import after_moves, distances, kidnapped, match_along, part, shares, two_halves
from pfslam_book.ch10.pictures import lost_lab, search_explorer
from pfslam_book.ch10.your_localiser import check_localiser
from pfslam_book.exercises.ch10 import check_inject, check_particles_needed
from pfslam_book.show.source import show_source
from pfslam_book.show.tables import Shown, read_table, select

__all__ = ["Shown", "after_moves", "check_inject", "check_localiser", "check_particles_needed", "distances"]
__all__ += ["enough", "kidnapped", "kld_bound", "localization_step", "locate", "lost_lab", "map_along"]
__all__ += ["match_along", "part", "read_table", "search_explorer", "select", "shares", "show_source"]
__all__ += ["two_halves"]
