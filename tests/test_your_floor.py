"""Your floor, end to end: the page's own program paints it, others may too, and what is different is said in words."""

import json
import re

import numpy as np
import pytest
from notebook_cells import NOTEBOOKS, run
from pfslam_book.ch06 import check_floor, judge_for, your_floor
from pfslam_book.ch06.your_floor import few_pairs, part_of

from pfslam.grid import GridSpec, OccupancyGrid
from pfslam.refined.floor import map_texture

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def drive():
    """Some five image pairs: enough for a test, and quickly painted."""
    return part_of(few_pairs(), 4)


def names_of_the_page(drive):
    """The names of the page from the six steps to the whole floor, as far as its program needs them."""
    cells = json.loads(next(NOTEBOOKS.glob("06_*")).read_text(encoding="utf-8"))["cells"]
    source = {cell["id"]: "".join(cell["source"]) for cell in cells}
    judge = judge_for(drive, GridSpec.around(drive.simulation.world.walls_w.reshape(-1, 2), 0.05))
    names = {"judge": judge, "spec": judge.spec, "path": drive.truth}
    ends = {"cell-17": "pixel =", "cell-21": "point_o =", "cell-47": "cell =", "cell-53": "floors =",
            "cell-72": "x, y =", "cell-97-runs": "flat ="}  # fmt: skip
    steps = ("cell-02", "cell-17", "cell-21", "cell-26", "cell-30", "cell-35")
    for name in (*steps, "cell-47", "cell-50", "cell-53", "cell-72", "cell-97-runs"):
        run(source[name].split(f"\n{ends[name]}")[0] if name in ends else source[name], names)
    return names


@pytest.fixture(scope="module")
def page(drive):
    return names_of_the_page(drive)


@pytest.fixture(autouse=True)
def few(drive, monkeypatch):
    monkeypatch.setattr(your_floor, "few_pairs", lambda: drive)


def painting(page, rule="best", **changes):
    """The program of the page, with some of its functions replaced."""

    def my_floor(drive, path, spec):
        kept = {name: page[name] for name in changes}
        page.update(changes)
        try:
            return page["paint_floor"](drive, path, [rule])[rule][0]
        finally:
            page.update(kept)

    return my_floor


def checked(page, drive, program):
    return check_floor(program, drive.truth, page["spec"])


def test_the_page_paints_as_well_as_the_book_and_no_difference_is_mentioned(page, drive):
    verdict = checked(page, drive, painting(page))
    assert verdict, verdict
    assert "looks most like" not in verdict.message


def on_free_cells(page):
    """The homography, on cells that the map knows to be free."""

    def my_floor(drive, path, spec):
        free = drive.simulation.world.free_area(spec)
        return page["paint_flat"](drive, path, 4.0) * free[:, :, None] / 1.0  # floats are colours, too

    return my_floor


def by_package(drive, path, spec):
    unknown = OccupancyGrid(spec, np.zeros(spec.shape, np.float32))
    return map_texture(drive.recording, path, unknown, your_floor.PAGE).rgb.tolist()


def test_other_ways_that_paint_the_floor_are_right(page, drive):
    for program in (on_free_cells(page), by_package):
        verdict = checked(page, drive, program)
        assert verdict, verdict
    verdict = checked(page, drive, painting(page, "last"))
    assert verdict, verdict
    assert "the last view of a cell stays" in verdict.message


def misread(page):
    """Programs that make one mistake of learners each, and what is said of their picture."""
    K, seen_from = page["K"], page["to_world"]
    swapped = np.array([[K[0, 0], 0, K[1, 2]], [0, K[1, 1], K[0, 2]], [0, 0, 1]])
    points = page["optical_points"]
    return {
        "the colour of the same pixel": painting(page, colour_pixel=lambda u, v, d: (u * 1.0, v * 1.0)),
        "the centres in K": painting(page, optical_points=lambda u, v, d, K: points(u, v, d, swapped)),
        "every point counts as floor": painting(page, is_floor=lambda p, tolerance: np.ones(len(p), bool)),
        "stood still at the origin": painting(page, to_world=lambda p, pose: seen_from(p, np.zeros(3))),
        "to the wrong side": painting(page, to_world=lambda p, pose: seen_from(p, pose * [1, 1, -1])),
    }


PICTURES = {
    "by the book's program": lambda rgb: np.roll(rgb, 1, axis=0),  # 5 cm aside
    "red and blue are exchanged": lambda rgb: rgb[..., ::-1],
    "x and y are exchanged": lambda rgb: rgb.transpose(1, 0, 2),
    "upside down": lambda rgb: rgb[::-1],
    "from 0 to 255": lambda rgb: rgb / 255,
    "Return one array": lambda rgb: rgb.mean(axis=2),
    "painted nothing": lambda rgb: 0 * rgb,
    "ZeroDivisionError": lambda rgb: rgb[1 // 0],
}


@pytest.mark.parametrize("words", PICTURES)
def test_a_picture_that_is_wrong_in_itself(page, drive, words):
    verdict = checked(page, drive, lambda *case: PICTURES[words](painting(page)(*case)))
    assert verdict.verdict == "wrong", verdict
    assert words in verdict.message


def test_a_step_that_is_wrong_is_what_the_picture_looks_like(page, drive):
    for words, program in misread(page).items():
        verdict = checked(page, drive, program)
        assert verdict.verdict == "wrong", words
        assert words in verdict.message


def test_walls_painted_on_the_ground_lie_beside_the_floor(page, drive):
    verdict = checked(page, drive, lambda drive, path, spec: page["paint_flat"](drive, path))
    assert verdict.verdict == "wrong", verdict
    assert int(re.search(r"(\d+) % of its paint lies beside", verdict.message)[1]) > 40
    assert "looks most like" not in verdict.message


def test_a_stub_is_unanswered(page, drive):
    assert checked(page, drive, lambda drive, path, spec: ...).verdict == "unanswered"
