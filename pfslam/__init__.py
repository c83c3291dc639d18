"""pfslam: particle-filter SLAM and floor texture mapping, small enough to read.

Conventions, everywhere in the package:

- Frames: w world, b body, l LiDAR, c camera, o camera optical (x right, y down, z forward). ``T_wb`` takes
  coordinates in b to w; adjacent letters cancel: ``T_wo = T_wb @ T_bo``. Names tell the frame: ``points_w``.
- A pose is (x, y, theta) in metres and radians, theta in (-pi, pi]; many are ``(N, 3)``. One point per row.
- Grids are ``log_odds[iy, ix]``, row 0 at y_min. Images are ``[v, u]``, u the column; colours are RGB, uint8.
- SI units and radians; a value in anything else says so in its name (``pitch_deg``).
- Random functions take ``rng: np.random.Generator``. There is no global random state.

>>> import pfslam
>>> recording = pfslam.load("hall")
>>> result = pfslam.run_slam(recording)
>>> error = pfslam.trajectory_error(result.trajectory, recording.truth)
"""

from importlib import import_module

_HOMES = {
    "Belief": "slam",
    "DataError": "errors",
    "FloorTexture": "texture",
    "GridSpec": "grid",
    "LocalizationConfig": "beyond.localization",
    "LocalizationResult": "beyond.localization",
    "OccupancyGrid": "grid",
    "Mapper": "mapper",
    "Odometer": "events",
    "Recording": "recording",
    "RobotModel": "sensors",
    "SlamConfig": "slam",
    "SlamResult": "run",
    "TextureConfig": "texture",
    "Trajectory": "poses",
    "dead_reckoning": "motion",
    "load": "io.datasets",
    "load_course": "io.course",
    "locate": "beyond.localization",
    "map_correlation": "correlation",
    "map_texture": "refined.floor",
    "read_known_map": "io.formats",
    "read_tum": "io.formats",
    "run_slam": "run",
    "save": "io.recordings",
    "save_course": "io.course",
    "simulate": "simulator",
    "slam_step": "slam",
    "trajectory_error": "evaluation.trajectory",
    "write_map": "io.formats",
    "write_texture": "io.formats",
    "write_tum": "io.formats",
}
__all__ = list(_HOMES)
__version__ = "0.2.0"


def __getattr__(name: str):
    """Import a public name when it is first used, so that ``import pfslam`` costs next to nothing."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pfslam' has no attribute {name!r}")
    value = getattr(import_module(f"pfslam.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
