"""The texture of the simulated drives, drawn from true poses, against the floor that was painted."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from drives import simulated
from pfslam_book.show.texture_error import TextureError, texture_error, visible_floor

from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.recording import image_pairs
from pfslam.refined.floor import map_texture
from pfslam.texture import TextureConfig

EVERY = 110
PRESETS = {"report": TextureConfig.report(), "refined": TextureConfig.refined()}


@cache
def drive(name):
    """The drive, and on one grid: the true floor, its colours, what the images can show, and a perfect map."""
    simulation = simulated(name, None)
    camera = simulation.recording.camera
    read_once = {"read_disparity": cache(camera.read_disparity), "read_rgb": cache(camera.read_rgb)}
    recording = replace(simulation.recording, camera=replace(camera, **read_once))
    spec = GridSpec.around(recording.truth.poses[:, :2], 0.05, margin=6.0)
    floor, walls = simulation.world.free_area(spec), simulation.world.true_grid(spec)
    pairs = image_pairs(recording.camera, every=EVERY)
    some = replace(recording.camera, disparity_index=pairs.disparity, rgb_index=pairs.rgb)
    recording, t = replace(recording, camera=some), some.disparity_t[pairs.disparity]
    poses = recording.truth.at(t[recording.truth.covers(t)])
    visible = visible_floor(spec, poses, recording.robot.camera, ~floor, max_depth=4.0)
    grid = OccupancyGrid(spec, np.where(walls, 1, np.where(floor, -1, 0)).astype(np.float32))
    return recording, grid, simulation.floor_image(spec), floor, visible


def error(name, preset) -> TextureError:
    recording, grid, colours, floor, visible = drive(name)
    texture = map_texture(recording, recording.truth, grid, PRESETS[preset])
    return texture_error(texture, colours, floor, visible)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hall", "ramp"])
def test_the_refined_texture_lies_in_its_place_and_is_better_than_the_reports_in_every_figure(name):
    report, refined = error(name, "report"), error(name, "refined")
    assert refined.patches >= 20
    assert refined.position_median_cells <= min(1.0, report.position_median_cells - 1e-9)
    # The median colour error is that of the camera's noise and the floor's grain, a few levels of 255.
    assert refined.colour_median <= 8.0
    assert refined.position_p95_cells < report.position_p95_cells
    assert refined.colour_mean < report.colour_mean
    assert refined.beyond_floor <= report.beyond_floor
    # On level ground the report misses nothing; on slopes the floor leaves z = 0, where the fitted plane keeps it.
    assert refined.coverage > report.coverage + {"hall": -0.01, "ramp": 0.05}[name]
    assert refined.coverage >= {"hall": 0.9, "ramp": 0.0}[name]
