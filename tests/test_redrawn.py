"""A map drawn again from the path of its run is the map of the run: whatever the scanner, the floor and the method."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from drives import simulated
from rooms import CURVES, LIDAR, SQUARE, drive

import pfslam
from pfslam.beyond.loops.closing import redrawn
from pfslam.io.selection import select
from pfslam.refined.outliers import OutlierConfig
from pfslam.refined.step import RefinedConfig
from pfslam.slam import SlamConfig

REFINED = replace(SlamConfig.refined(), particles=8)
METHODS = {
    "report": replace(SlamConfig.report(), particles=8),
    "report, widened": replace(RefinedConfig.of(SlamConfig.report()), particles=8),
    "refined": REFINED,
    "robust": REFINED.robust(),
    "outliers": replace(REFINED, outliers=OutlierConfig(), draw_metres=0.0),
    "matching": SlamConfig.matching(),
    "every scan": replace(REFINED, draw_metres=0.0, draw_radians=0.0),
    "seldom": replace(REFINED, draw_metres=0.4, draw_radians=1.0),
    "once": replace(REFINED, draw_metres=np.inf, draw_radians=np.inf),
}


@cache
def recording(which):
    room = drive(CURVES)
    if which == "coarse":  # three degrees between beams
        return drive(CURVES, lidar=replace(LIDAR, beams=91))
    if which == "masked":
        return select(drive(SQUARE), masks=[(-30.0, 20.0), (80.0, 200.0)])
    if which == "blind":
        ranges = room.lidar.ranges.copy()
        ranges[[0, 1, 7, 8, 20]] = np.inf
        ranges[30:33, 5:] = np.nan
        return replace(room, lidar=replace(room.lidar, ranges=ranges))
    if which == "people":
        return select(replace(simulated("hall", people=6).recording, camera=None), until=20.0)
    if which == "tilted":
        return select(replace(simulated("ramp", seed=None).recording, camera=None), start=20.0, until=40.0)
    return room


def assert_redrawn(which, config):
    result = pfslam.run_slam(recording(which), config, second_look=False)
    again = redrawn(recording(which), result, result.trajectory.poses)
    assert again.spec == result.grid.spec
    np.testing.assert_array_equal(again.log_odds, result.grid.log_odds)
    assert result.grid.occupied.any()
    return result


SOME = ("report", "refined", "robust", "matching")
ELSEWHERE = ("coarse", "masked", "blind", "people", "tilted")
CASES = [("dense", method) for method in METHODS] + [
    (which, method) for which in ELSEWHERE for method in SOME
]


@pytest.mark.parametrize(("which", "method"), CASES)
def test_with_every_method_in_a_room_and_with_some_elsewhere(which, method):
    every = 10 if which in ("people", "tilted") else None
    result = assert_redrawn(which, replace(METHODS[method], every=every))
    drawn = sum(info.drawn for info in result.infos)
    assert drawn == 1 if method == "once" else drawn > 3


def test_walls_between_coarse_beams_and_people_who_left_are_drawn_as_the_run_did():
    """What a plain drawing would give instead: dots in the place of walls, and people who stay."""
    coarse = assert_redrawn("coarse", REFINED)
    dots = redrawn(
        recording("coarse"),
        replace(coarse, config=replace(REFINED, beam_spacing=0.0)),
        coarse.trajectory.poses,
    )
    assert dots.occupied.sum() < 0.9 * coarse.grid.occupied.sum()
    robust = replace(REFINED.robust(), every=10)
    walked = assert_redrawn("people", robust)
    ghosts = redrawn(
        recording("people"), replace(walked, config=replace(robust, outliers=None)), walked.trajectory.poses
    )
    assert (ghosts.log_odds != walked.grid.log_odds).any()


def test_with_a_map_for_each_particle_that_of_the_run_is_drawn_again():
    """In a room the walls fix the pose, so all hypotheses are one, whose path is the run's."""
    assert_redrawn("room", replace(SlamConfig.per_particle(), particles=4))
