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

__version__ = "0.2.0"

# Each line of the stub names one module and one name of it, once for this file and for type checkers.
with open(f"{__path__[0]}/__init__.pyi", encoding="utf-8") as _stub:
    _HOMES = {line.split()[-1]: line.split()[1] for line in _stub if line.startswith("from ")}
__all__ = list(_HOMES)


def __getattr__(name: str):
    """Import a public name when it is first used, so that ``import pfslam`` costs next to nothing."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pfslam' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
