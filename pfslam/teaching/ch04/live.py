"""Chapter 04: a scan that is dragged over the map, as a laboratory in the page."""

from __future__ import annotations

import numpy as np

from pfslam.teaching.show.drives import Place
from pfslam.teaching.show.lab import Laboratory, show_lab

ALT = """A piece of the map with its walls, and the points of a scan beside them, since the guessed pose is wrong.
Below, the scores of all shifts of the scan at this heading as a small square map, with a cross at the guess."""


def slide_options(**places: Place) -> dict:
    """Give what the script needs: at each place the map as it was then, the scan and the guessed pose."""
    return {"places": {name: _as_options(place) for name, place in places.items()}}


def _as_options(place: Place) -> dict:
    spec = place.grid.spec
    return {
        "spec": {"origin": list(spec.origin), "resolution": spec.resolution, "shape": list(spec.shape)},
        "pose": np.asarray(place.pose).tolist(),
        "points": place.points_b.ravel().tolist(),
        "occupied": np.flatnonzero(place.grid.occupied).tolist(),
    }


def slide_lab(**places: Place) -> Laboratory:
    """Make the laboratory in which the reader fits a scan to the map, at each of the places."""
    return show_lab("slide", "Slide the scan over the map", ALT, **slide_options(**places))
