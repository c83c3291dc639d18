"""Words of a figure that leave it, are cut off or lie on others: each is found, and the book is not built with it."""

import matplotlib
import pytest
from pfslam_book.show.artists import plan, sheet, show
from pfslam_book.show.edges import drawn
from pfslam_book.show.pictures import FOR_PHONES, to_rgb
from pfslam_book.show.style import STYLE, WIDTH, WORDS


def two_plans(height: float = 3.0):
    """A sound figure of two panels with a legend below them."""
    figure, row = sheet(height, 1, 2, sharex=True, sharey=True)
    for axes, name in zip(row, ("left", "right"), strict=True):
        plan(axes, name).plot([0, 1], [0, 1], label="path")
    figure.legend(*row[0].get_legend_handles_labels(), loc="outside lower center")
    return figure, row


def under_a_legend(figure, row):
    figure.legends[0].remove()
    figure.legend(*row[0].get_legend_handles_labels(), loc="lower center", borderpad=3)


def ticks_too_many(figure, row):
    row[0].set_xticks([k / 40 for k in range(41)])


BROKEN = {
    "is cut off": lambda figure, row: row[0].set_title("a title that has no room " * 4),
    "'slanted' is cut off": lambda figure, row: row[1].text(0.9, 0.9, "slanted", rotation=60, clip_on=True),
    "lies under the edge of a legend": under_a_legend,
    "lies on": ticks_too_many,
    "'one' lies on 'other'": lambda figure, row: [
        figure.text(0.5, 0.5, "one"),
        figure.text(0.5, 0.51, "other"),
    ],
}


def test_words_with_room_are_no_fault():
    figure, (left, _) = two_plans()
    left.text(2.0, 2.0, "beyond the axes, and not drawn", clip_on=True)
    assert drawn(figure)[1] == []


@pytest.mark.parametrize("said", BROKEN)
def test_a_broken_figure_is_told_and_stops_the_build(monkeypatch, said):
    figure, row = two_plans()
    BROKEN[said](figure, row)
    assert any(said in fault for fault in drawn(figure)[1]), drawn(figure)[1]
    for mode in ("static", "text"):
        monkeypatch.setenv("PFSLAM_WIDGETS", mode)
        with pytest.raises(ValueError, match="in this figure"):
            show(figure, "Two panels")
    monkeypatch.setenv("PFSLAM_WIDGETS", "live")
    assert show(figure, "Two panels").image.any()


def test_what_fits_a_page_and_no_phone_stops_the_build_too(monkeypatch):
    monkeypatch.setenv("PFSLAM_WIDGETS", "text")
    figure, (left, right) = two_plans()
    left.set_title("a title of forty letters, and some more")
    assert to_rgb(figure).any()
    right.set_title("a title of forty letters, and some more")
    with pytest.raises(ValueError, match="in this figure"):
        show(figure, "Two panels")


def test_on_a_phone_words_are_larger_and_the_picture_has_as_many_pixels():
    figure, _ = two_plans()
    wide, phone = to_rgb(figure), to_rgb(figure, FOR_PHONES)
    assert phone.shape == pytest.approx(wide.shape, abs=1)
    assert figure.get_figwidth() == pytest.approx(FOR_PHONES * WIDTH)


def test_every_word_of_the_style_has_one_size():
    figure, row = two_plans()
    figure.draw_without_rendering()
    assert matplotlib.rcParams["font.size"] == STYLE["font.size"] == WORDS
    texts = figure.findobj(matplotlib.text.Text)
    assert {text.get_fontsize() for text in texts if text.get_text()} == {WORDS}
    assert row[1].get_ylabel() == "", "a shared scale is told once"
