"""What the notebook of chapter 09 calls."""

from pfslam.teaching.ch09.beyond import (
    intel_picture,
    judged_lines,
    relations_lines,
    turned_start,
)
from pfslam.teaching.ch09.checks import (
    check_blocked,
    check_draw_all,
    check_first_pose_error,
)
from pfslam.teaching.ch09.kinds import (
    FRAMES,
    histories_alt,
    histories_frame,
    kinds_lines,
    loop_recording,
    medians,
    play_histories,
)
from pfslam.teaching.ch09.particles import (
    errors_of,
    load_particles,
    matching_lines,
    particles_alt,
    particles_frame,
    particles_lines,
    situations,
)
from pfslam.teaching.ch09.runs import (
    grid_lock,
    grid_lock_picture,
    live_rungs,
    rung_alt,
    rung_frame,
)
from pfslam.teaching.ch09.tables import (
    dots_picture,
    ladder_lines,
    left_out,
    left_out_lines,
    spread_line,
)
from pfslam.teaching.ch09.texture import (
    largest_spread,
    steps_lines,
)
from pfslam.teaching.ch09.walls import (
    blocked_share,
    field_score,
    room,
    scan_without_inner_wall,
)
from pfslam.teaching.show.source import (
    show_source,
)
from pfslam.teaching.show.tables import (
    errors_by_label,
    read_provenance,
    read_table,
    select,
)
from pfslam.teaching.show.widgets import (
    Explorer,
    Slider,
)

__all__ = [
    "FRAMES",
    "Explorer",
    "Slider",
    "blocked_share",
    "check_blocked",
    "check_draw_all",
    "check_first_pose_error",
    "dots_picture",
    "errors_by_label",
    "errors_of",
    "field_score",
    "grid_lock",
    "grid_lock_picture",
    "histories_alt",
    "histories_frame",
    "intel_picture",
    "judged_lines",
    "kinds_lines",
    "ladder_lines",
    "largest_spread",
    "left_out",
    "left_out_lines",
    "live_rungs",
    "load_particles",
    "loop_recording",
    "matching_lines",
    "medians",
    "particles_alt",
    "particles_frame",
    "particles_lines",
    "play_histories",
    "read_provenance",
    "read_table",
    "relations_lines",
    "room",
    "rung_alt",
    "rung_frame",
    "scan_without_inner_wall",
    "select",
    "show_source",
    "situations",
    "spread_line",
    "steps_lines",
    "turned_start",
]
