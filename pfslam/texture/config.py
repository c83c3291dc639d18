"""The settings of the texture map: what counts as floor, which pose an image has, which view is kept."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import Annotated, Literal

from pfslam.errors import DataError
from pfslam.sensors import RgbdModel
from pfslam.settings import Range, Settings
from pfslam.texture.floor import depth_for_step


@dataclass(frozen=True)
class TextureConfig(Settings):
    """What counts as floor, which pose belongs to an image, and which of several views of a cell is kept."""

    z_min: Annotated[float, Range(0.0, 100.0)] = 0.1
    """Z_MIN (m), step 3."""
    z_max: Annotated[float, Range(0.0, 100.0)] = 10.0
    """Z_MAX (m), step 3."""
    max_depth_step: Annotated[float, Range(1e-6, inf)] = inf
    """Trust a depth only while one step of disparity is worth at most this (m); it tightens ``z_max``."""
    floor_tolerance: Annotated[float, Range(0.0, 100.0)] = 0.01
    """Step 5: how far from the floor (m) a point may lie."""
    tolerance_per_metre: Annotated[float, Range(0.0, 100.0)] = 0.0
    """What the tolerance gains per metre of depth."""
    pitch: Literal["calibration", "floor plane"] = "calibration"
    """``calibration``: the floor is z = 0 of the body. ``floor plane``: the camera's pitch and height come
    from planes fitted to some images, and the floor in each image is the plane fitted to it."""
    states: Literal["nearest", "interpolated"] = "nearest"
    """``nearest``: each state of the trajectory takes its nearest image pair. ``interpolated``: each image,
    depth or colour, has the pose of its own stamp."""
    view: Literal["last", "best"] = "last"
    """``last``: the last view of a cell stays. ``best``: the nearest, then the pixel nearest its centre."""
    crop: bool = False
    """Leave out what lies where the map knows nothing."""
    resolution: Annotated[float, Range(0.001, 10.0)] | None = None
    """Cell size (m); None is the map's, or 0.05 m without a map."""
    max_image_gap: Annotated[float, Range(0.0, inf)] = 0.1
    """Longest time (s) between a colour image and its depth image."""
    max_pose_gap: Annotated[float, Range(0.0, inf)] = 0.5
    """Longest time (s) between an image and its state, or between two states to interpolate in."""
    min_points: Annotated[int, Range(1, 10**9)] = 200
    """Fewer floor pixels than this are no floor."""

    def __post_init__(self):
        super().__post_init__()
        if not self.z_min < self.z_max:
            raise DataError("TextureConfig", "z_min, z_max", (self.z_min, self.z_max), "z_min < z_max")

    @classmethod
    def report(cls) -> TextureConfig:
        """The report's: ``|Z_w| <= 0.01`` m, depths of 0.1 to 10 m, one image per state, the last view wins."""
        return cls()

    @classmethod
    def refined(cls) -> TextureConfig:
        """The report's three improvements (crop, a pose for every image, depth range), and three more.

        The depth range ends where a step of disparity is worth 0.1 m. Since the best view wins, so far a point is
        only kept where no nearer view ever was.
        """
        return list(cls.steps().values())[-1]

    @classmethod
    def steps(cls) -> dict[str, TextureConfig]:
        """From ``report`` to ``refined``, one change after the other, each named by what it changes."""
        config, steps = cls.report(), {"report": cls.report()}
        for name, change in _CHANGES.items():
            config = steps[name] = replace(config, **change)
        return steps

    def depth_limit(self, camera: RgbdModel) -> float:
        """The largest depth (m) to trust with this camera."""
        return min(self.z_max, depth_for_step(self.max_depth_step, camera))


_CHANGES: dict[str, dict] = {
    "cut to the map": {"crop": True},
    "a pose for every image": {"states": "interpolated"},
    "depth range": {"max_depth_step": 0.1},
    "tolerance that grows with range": {"floor_tolerance": 0.015, "tolerance_per_metre": 0.01},
    "pitch from the floor plane": {"pitch": "floor plane"},
    "best view wins": {"view": "best"},
}
