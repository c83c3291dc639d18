"""Your graph, end to end: the page's own two functions mend the ring, and what was left out is said in words."""

import json
from dataclasses import replace

import numpy as np
import pytest
from notebook_cells import NOTEBOOKS, run
from pfslam_book.ch12 import check_graph, edges, stored
from pfslam_book.ch12.your_graph import off

from pfslam.beyond.loops.graph import relax
from pfslam.poses import compose

pytestmark = pytest.mark.slow


def printed():
    """The names that the page makes for its own graph: ``strain``, ``jacobian``, ``assemble`` and ``relax``."""
    cells = json.loads(next(NOTEBOOKS.glob("12_*")).read_text(encoding="utf-8"))["cells"]
    names = {}
    for cell in cells:
        if cell["id"] in ("c01", "c13", "c22", "c22b"):
            run("".join(cell["source"]), names)
    return names["relax"]


def test_the_printed_graph_mends_the_ring():
    widths = np.repeat([np.inf, 100, 30, 10, 3], 5)
    verdict = check_graph(lambda edges, poses: printed()(edges, poses, widths)[0])
    assert verdict, verdict
    assert "3.4 cm off" in verdict.message  # the page prints 0.034 m
    assert "79 cm" in verdict.message


def test_the_error_is_seen_from_the_first_pose():
    truth = stored("ring").truth_path
    assert off(truth) == pytest.approx(0.0, abs=1e-9)
    assert off(compose(np.array([3.0, -2.0, 0.7]), truth)) == pytest.approx(0.0, abs=1e-9)
    assert off(truth + np.where(np.arange(len(truth)) > 0, 0.3, 0.0)[:, None] * [1, 0, 0]) == pytest.approx(
        0.3 * np.sqrt(1 - 1 / len(truth))
    )


def left_out(change):
    """The package's graph on a changed set of edges."""
    return lambda some, poses: relax(change(some), poses)[0]


CHAIN, NEAR, LOOPS = edges("ring")
WRONG = {
    "without the loops": left_out(lambda some: CHAIN.joined(NEAR)),
    "without the near edges": left_out(lambda some: CHAIN.joined(LOOPS)),
    "their scale is an unknown": left_out(lambda some: replace(some, wheels=0 * some.wheels)),
    "that you were given": lambda some, poses: poses,
    "Is the sign right": lambda some, poses: 2 * poses - relax(some, poses)[0],
    "not numbers": lambda some, poses: poses * np.nan,
    "the poses alone": lambda some, poses: relax(some, poses),
    "LinAlgError": lambda some, poses: np.linalg.inv(np.zeros((3, 3))),
}


@pytest.mark.parametrize("words", WRONG)
def test_what_is_wrong_is_said(words):
    verdict = check_graph(WRONG[words])
    assert verdict.verdict == "wrong"
    assert words in verdict.message


def test_a_stub_is_unanswered():
    assert check_graph(lambda some, poses: ...).verdict == "unanswered"
