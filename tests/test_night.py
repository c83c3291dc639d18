"""Figures on dark paper: which colours change, that those that do can be seen, and what stays as it is."""

import re

import numpy as np
import pytest
from matplotlib.colors import to_rgb as rgb
from pfslam_book.show.artists import COLOURS, plan, sheet
from pfslam_book.show.night import CELLS, NIGHT, PAPER, WHITE, at_night, contrast, draw_at_night
from pfslam_book.show.pictures import to_rgb
from pfslam_book.show.style import INK
from pfslam_book.show.style import PAPER as DAY_PAPER

from pfslam.cli import viewer


def shares(image, colour, near=3) -> float:
    """The share of an image that is of a colour."""
    return float(
        (np.abs(image.astype(int) - np.rint(255 * np.array(rgb(colour)))) <= near).all(axis=2).mean()
    )


def hue(colour) -> float:
    red, green, blue = rgb(colour)
    return float(np.degrees(np.arctan2(np.sqrt(3) * (green - blue), 2 * red - green - blue)))


@pytest.mark.parametrize("name", COLOURS)
def test_each_colour_of_the_code_keeps_its_hue_and_can_be_seen(name):
    night = at_night(rgb(COLOURS[name]))
    assert contrast(night, PAPER) >= 3.0
    if name not in ("truth", "unknown"):
        assert abs(hue(night) - hue(COLOURS[name])) < 20


def test_the_particles_are_the_lighter_blue_and_lines_are_seen_on_free_cells():
    assert contrast(NIGHT[COLOURS["particles"]], PAPER) > 1.5 * contrast(NIGHT[COLOURS["estimate"]], PAPER)
    lines = set(COLOURS) - {"unknown"}
    assert min(contrast(at_night(rgb(COLOURS[name])), CELLS["#ffffff"]) for name in lines) >= 3.0


def test_the_laboratories_have_the_same_colours_in_the_dark():
    dark = viewer.source("lab.css").split('html[data-theme="dark"] .pfslam-lab,')[1]
    lab = dict(re.findall(r"--lab-([a-z]+): (#[0-9a-f]{6})", dark.split("}")[0]))
    for name, ours in {
        "clear": "free",
        "estimate": "estimate",
        "hits": "hits",
        "odometry": "odometry",
    }.items():
        assert lab[name] == NIGHT[COLOURS[ours]]
    assert (lab["particles"], lab["wall"]) == (NIGHT[COLOURS["particles"]], WHITE)
    assert [lab["paper"], lab["free"]] == [CELLS[COLOURS["unknown"]], CELLS["#ffffff"]]


def test_words_are_read_with_ease_and_greys_keep_their_order():
    assert contrast(at_night(rgb(INK)), PAPER) >= 4.5
    assert contrast(at_night(rgb(DAY_PAPER)), PAPER) < 1.1
    greys = [contrast(at_night((v, v, v)), PAPER) for v in np.linspace(1, 0, 6)]
    assert greys == sorted(greys)


def test_a_figure_at_night_is_dark_and_shows_the_same_colours_at_the_same_places():
    figure, axes = sheet(3.0)
    names = ("estimate", "particles", "odometry", "hits")
    for k, name in enumerate(names):
        axes.fill_between([k, k + 0.9], 0, 1, color=COLOURS[name], linewidth=0)
    axes.set_ylim(0, 3)
    day, engine = to_rgb(figure), figure.get_layout_engine()
    night = draw_at_night(figure)
    assert night.shape == day.shape
    assert figure.get_layout_engine() is engine
    assert night.mean() < 90 < day.mean()
    assert shares(night, PAPER) > 0.3
    for name in names:
        assert shares(night, NIGHT[COLOURS[name]]) == pytest.approx(shares(day, COLOURS[name]), rel=0.05) != 0


def picture_of(image, **options):
    figure, axes = sheet(3.0)
    plan(axes).imshow(image, **options)
    day = to_rgb(figure)
    return day, draw_at_night(figure)


def test_a_photograph_stays_and_a_map_turns():
    photo = np.random.default_rng(0).integers(0, 256, (30, 30, 3), dtype=np.uint8)
    grey = np.repeat(photo[..., :1], 3, axis=2)
    for image in (photo, grey):
        day, night = picture_of(image)
        middle = tuple(slice(n // 2 - 20, n // 2 + 20) for n in day.shape[:2])
        np.testing.assert_array_equal(night[middle], day[middle])
    cells = np.array([rgb(COLOURS["unknown"]), (1.0, 1.0, 1.0), rgb(COLOURS["truth"])])
    _, night = picture_of(cells[np.arange(16).reshape(4, 4) % 3])
    assert [shares(night, colour) > 0.03 for colour in ("#24282e", "#3a414a", WHITE)] == [True] * 3
    figure, axes = sheet(3.0)
    axes.set_facecolor(COLOURS["unknown"])  # as around a map
    to_rgb(figure)
    assert shares(draw_at_night(figure), CELLS[COLOURS["unknown"]]) > 0.5
    assert shares(to_rgb(figure), COLOURS["unknown"]) > 0.5
    day, night = picture_of(np.eye(4), cmap="Greys")
    assert shares(day, "white") > 0.15 > 0.01 > shares(night, "white")


def test_words_on_what_stays_are_readable():
    figure, axes = sheet(3.0)
    axes.imshow(np.array([[0.0, 1.0]]), cmap="cividis")
    axes.text(0, 0, "dark", color="white", fontsize=40)
    axes.text(0.6, 0, "light", color=COLOURS["truth"], fontsize=40)
    day = to_rgb(figure)
    night = draw_at_night(figure)
    middle = slice(day.shape[0] // 3, 2 * day.shape[0] // 3)
    assert shares(night[middle], COLOURS["truth"]) == pytest.approx(
        shares(day[middle], COLOURS["truth"]), rel=0.1
    )


def test_colours_that_are_data_stay():
    figure, axes = sheet(3.0)
    axes.scatter([0, 1, 2], [0, 1, 2], c=["#5b3a29", "#808080", "#d0d0c0"], s=2000)
    axes.scatter([0, 1], [2, 0], c=[COLOURS["odometry"], COLOURS["estimate"]], s=2000)
    axes.scatter([2], [0], facecolors="none", edgecolors=COLOURS["hits"])
    to_rgb(figure)
    night = draw_at_night(figure)
    colours = ("#5b3a29", "#808080", "#d0d0c0", NIGHT[COLOURS["odometry"]], NIGHT[COLOURS["estimate"]])
    assert [shares(night, colour) > 0.002 for colour in colours] == [True] * 5
