"""What the notebook of chapter 09 calls."""

from pfslam.beyond.per_particle import per_particle_step
from pfslam.map import Map
from pfslam.particles import Particles
from pfslam_book.exercises.kinds import check_draw_all, check_log_weight, check_proposal
from pfslam_book.show.intel import intel_errors, intel_facts, intel_picture, intel_slips, intel_table
from pfslam_book.kinds.kinds import (
    cost_ratio,
    histories_explorer,
    kind_errors,
    kinds_table,
    loop_recording,
    medians_cm,
    one_and_many,
    play_histories,
    private_better,
)
from pfslam_book.kinds.particles import (
    lost_while_blind,
    particles_explorer,
    particles_help,
    particles_table,
    situation_errors,
)
from pfslam_book.kinds.proposals import Proposals, proposals_picture
from pfslam_book.show.source import show_source
from pfslam_book.show.tables import number_of_buildings

__all__ = [
    "Map",
    "Particles",
    "Proposals",
    "align",
    "check_draw_all",
    "check_log_weight",
    "check_proposal",
    "cost_ratio",
    "histories_explorer",
    "intel_errors",
    "intel_facts",
    "intel_picture",
    "intel_slips",
    "intel_table",
    "kind_errors",
    "kinds_table",
    "loop_recording",
    "lost_while_blind",
    "medians_cm",
    "number_of_buildings",
    "one_and_many",
    "particles_explorer",
    "particles_help",
    "particles_table",
    "per_particle_step",
    "play_histories",
    "private_better",
    "proposals_picture",
    "shifted",
    "show_source",
    "situation_errors",
]
