"""Chapter 04: a scan that is dragged over the map, as a laboratory in the page."""

from __future__ import annotations

import numpy as np

from pfslam.grid import OccupancyGrid
from pfslam.recording import Recording
from pfslam.simulator import DEFAULT_SEED, HALL
from pfslam.simulator.world import make_world
from pfslam_book.show.drives import Place
from pfslam_book.show.figures import map_along
from pfslam_book.show.lab import Laboratory, show_lab

ALT = """A piece of the map with its walls, and the points of a scan beside them, since the guessed pose is wrong.
Below, the scores of all shifts of the scan at this heading as a small square map, with a cross at the guess."""


BEAMS = 271  # every fourth
NOISE = 0.01  # m
WINDOW = (-16.0, 37.0, -3.6, 23.4)  # x from, to, y from, to (m)
START = (0.0, 0.0, 0.0)


def slide_options(recording: Recording, **places: Place) -> dict:
    """Give what the script needs: the building of the drive, and each place with its map, its scan and its pose."""
    return {
        "places": {name: _as_options(place) for name, place in places.items()},
        "building": building_options(recording),
    }


def building_options(recording: Recording) -> dict:
    """Give the walls of the built-in building, the whole map of a drive through it, and the LiDAR made sparser."""
    grid, lidar = map_along(recording, recording.true_path(), every=10), recording.robot.lidar
    walls = make_world(HALL, np.random.SeedSequence(DEFAULT_SEED)).walls_w
    return {
        "walls": np.round(walls, 4).ravel().tolist(),
        "spec": _spec(grid),
        "occupied": np.flatnonzero(grid.occupied).tolist(),
        "lidar": {
            "angleMin": lidar.angle_min,
            "angleMax": lidar.angle_max,
            "beams": BEAMS,
            "rangeMin": lidar.range_min,
            "rangeMax": lidar.range_max,
            "position": list(lidar.position_b[:2]),
        },
        "noise": NOISE,
        "window": WINDOW,
        "start": START,
    }


def _spec(grid: OccupancyGrid) -> dict:
    spec = grid.spec
    return {"origin": list(spec.origin), "resolution": spec.resolution, "shape": list(spec.shape)}


def _as_options(place: Place) -> dict:
    return {
        "spec": _spec(place.grid),
        "pose": np.asarray(place.pose).tolist(),
        "points": place.points_b.ravel().tolist(),
        "occupied": np.flatnonzero(place.grid.occupied).tolist(),
    }


def slide_lab(recording: Recording, **places: Place) -> Laboratory:
    """Make the laboratory in which the reader fits a scan to the map, at each of the places and anywhere else."""
    return show_lab("slide", "Slide the scan over the map", ALT, **slide_options(recording, **places))
