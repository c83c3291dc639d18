"""A step that raises leaves the belief and its map as they were, and the next scan gives what it would have given."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from breaking import lines_of
from rooms import CURVES, bare_corridor, drive

from pfslam.errors import DataError
from pfslam.refined.map import RefinedMap
from pfslam.refined.step import RefinedConfig
from pfslam.slam import SlamConfig

ROOM, CORRIDOR = drive(CURVES), bare_corridor()
ALWAYS = {"draw_metres": 0.0, "draw_radians": 0.0, "resample_below": 1.0}
REPORT = replace(SlamConfig.report(), particles=6, resample_below=1.0)
REFINED = replace(SlamConfig.refined(), particles=6, **ALWAYS)
METHODS = {
    "report": REPORT,
    "report, widened": RefinedConfig.of(REPORT),
    "refined": REFINED,
    "robust": REFINED.robust(),
    "matching": replace(SlamConfig.matching(), **ALWAYS),
    "per-particle": replace(SlamConfig.per_particle(), particles=4, **ALWAYS),
}


def after(method, scans):
    """The belief after so many scans, and the event that follows, where hypotheses differ if there are any."""
    config, rng = METHODS[method], np.random.default_rng(0)
    events = list(config.used_scans(CORRIDOR if method == "per-particle" else ROOM).events())
    belief = config.start()
    for event in events[:scans]:
        belief, _ = config.step(belief, event, rng)
    return belief, events[scans]


def one_state(belief):
    """All that a belief with one map holds, as arrays and numbers of its own."""
    drawn = belief.map
    held = [belief.particles.poses, belief.particles.log_weights, belief.estimate]
    held += [drawn.spec.origin, drawn.spec.shape, drawn.is_empty, drawn.grid.log_odds]
    if isinstance(drawn, RefinedMap):
        held += [belief.variance, belief.covariance, belief.corrected, drawn.field, drawn.drawn_at]
        held += [drawn.moments.sums, drawn.moments.first, drawn.moments.slots.values, np.array(drawn.drawn)]
        held += [part for scan in drawn.waiting for part in vars(scan).values()]
    return deepcopy(held)


def state(belief):
    """The same, or that of every family and of the best."""
    if not hasattr(belief, "families"):
        return one_state(belief)
    every = [part for one in (*belief.families, belief.best) for part in one_state(one)]
    weights = [one.log_weight for one in belief.families]
    return [*every, weights, len({id(one.map) for one in belief.families})]


def assert_same(found, expected):
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)


def assert_goes_on(method, scans, belief, event):
    """The next scan makes of a belief what it makes of one that no step has broken off on."""
    untouched, _ = after(method, scans)
    (found, step), (expected, expected_step) = (
        METHODS[method].step(b, event, np.random.default_rng(2)) for b in (belief, untouched)
    )
    assert_same(state(found), state(expected))
    np.testing.assert_array_equal(step.estimate, expected_step.estimate)
    assert step.drawn


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scans", [0, 12])
@pytest.mark.parametrize("beam", [120, 121])
def test_one_range_of_ten_kilometres(method, scans, beam):
    belief, event = after(method, scans)
    points = event.points_b.copy()
    points[beam] *= 9_999.0 / np.hypot(*points[beam])
    before = state(belief)
    with pytest.raises(DataError):
        METHODS[method].step(belief, replace(event, points_b=points), np.random.default_rng(1))
    assert_same(state(belief), before)
    assert_goes_on(method, scans, belief, event)


@pytest.mark.parametrize("method", METHODS)
def test_a_step_that_breaks_off_at_any_line(method):
    """At every fiftieth part of all lines that it runs, Ctrl-C or not; at the last the scan has been drawn."""
    config, (whole, event) = METHODS[method], after(method, 12)
    lines = lines_of(lambda: config.step(whole, event, np.random.default_rng(1)))
    belief, _ = after(method, 12)
    before = state(belief)
    for last in np.linspace(1, lines, 51)[:-1].astype(int):
        assert lines_of(lambda: config.step(belief, event, np.random.default_rng(1)), last) == last
        assert_same(state(belief), before)
    assert_goes_on(method, 12, belief, event)
