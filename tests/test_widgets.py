"""The explorer: its grid of pictures, its words, its page fragment, and its live twin."""

import base64
import gc
import html
import json
import re
import weakref

import cv2
import numpy as np
import pytest
from pfslam_book.show.pictures import Picture, quick_uri, to_rgb
from pfslam_book.show.style import sheet
from pfslam_book.show.widgets import Explorer, Slider, live_view, page_fragment


def grey(level, tint=0.0):
    """A tiny picture whose pixels tell the arguments it was drawn with."""
    image = np.full((8, 12, 3), level, np.uint8)
    image[..., 2] = int(100 * tint)
    return image


def explorer(**options):
    controls = [
        Slider("level", [10, 20, 30], start=1, label="Level", unit="m"),
        Slider("tint", [0.0, 0.5], label="Tint", live=(0, 1, 0.1)),
    ]
    return Explorer(grey, controls, **{"alt": "A grey sheet", "title": "Grey", **options})


def page_data(fragment):
    return json.loads(re.search(r'<script type="application/json">(.*?)</script>', fragment, re.DOTALL)[1])


@pytest.fixture
def mode(monkeypatch):
    return lambda name: monkeypatch.setenv("PFSLAM_WIDGETS", name)


def test_frames_cover_the_whole_grid_and_show_their_values():
    frames = explorer().frames()
    assert set(frames) == {(i, j) for i in range(3) for j in range(2)}
    for (i, j), (image, _) in frames.items():
        assert image[0, 0].tolist() == [(10, 20, 30)[i], (10, 20, 30)[i], (0, 50)[j]]


def test_too_many_frames_are_refused():
    with pytest.raises(ValueError, match="6 frames, at most 5"):
        explorer(max_frames=5)


def test_page_fragment_is_the_same_every_time_and_asks_nobody():
    fragment = page_fragment(explorer(play="level"))
    assert fragment == page_fragment(explorer(play="level"))
    assert re.findall(r"https?://|src=\"(?!data:)", fragment) == []


def test_stops_lie_where_their_values_are():
    assert Slider("a", [0, 10, 20]).places == (0, 1, 2)
    assert Slider("a", [0.0, 5.0, 20.0]).places == (0, 250, 1000)
    assert Slider("a", [-0.003, 0.0, 0.0005, 0.003]).places == (0, 500, 583, 1000)
    assert Slider("a", np.round(np.linspace(8, 116, 24), 1)).places == tuple(range(24))
    # Too close on a linear scale, so on a logarithmic one, where these are even and 2 is half way from 1 to 4.
    assert Slider("a", [10, 20, 40, 80, 160]).places == (0, 1, 2, 3, 4)
    assert Slider("a", [1, 2, 4, 256]).places == (0, 125, 250, 1000)
    # What has no place on a scale is counted.
    for values in (["on", "off"], [3, 2, 1], [1, 2, float("inf")], [False, True], [1, 1]):
        assert Slider("a", values).places == tuple(range(len(values)))


def choosing():
    """An explorer with a choice between words and a slider."""
    controls = [
        Slider("way", ["right", "no <arm>"], start=1, label="Way"),
        Slider("level", [10, 20, 50], label="Level"),
    ]
    return Explorer(
        lambda way, level: grey(level, len(way) / 10), controls, alt="Grey", title="Ways", play="way"
    )


def test_words_are_radio_buttons_on_the_page():
    fragment = page_fragment(choosing())
    assert "<legend>Way</legend>" in fragment
    assert re.findall(
        r'<input type="radio" name="[^"]+-0" value="(\d)" [^>]*?(checked)?> ([^<]+)', fragment
    ) == [("0", "", "right"), ("1", "checked", "no &lt;arm&gt;")]
    assert fragment.count('<input type="range"') == 1
    assert page_data(fragment)["places"] == [[0, 1], [0, 250, 1000]]


def test_markup_in_words_cannot_break_the_page():
    fragment = page_fragment(explorer(title="a <b> & c", alt="</script><script>alert(1)</script>"))
    assert "<b>" not in fragment
    assert fragment.count("</script>") == 2


def test_each_reader_gets_the_right_form(mode):
    mode("text")
    assert set(explorer()._repr_mimebundle_()) == {"text/plain"}
    mode("static")
    assert set(explorer()._repr_mimebundle_()) == {"text/plain", "text/html"}
    mode("live")
    assert "application/vnd.jupyter.widget-view+json" in explorer()._repr_mimebundle_()


def test_live_sliders_redraw_at_any_value():
    image, _caption, level, tint = live_view(explorer()).children
    assert (tint.min, tint.max, tint.step) == (0, 1, 0.1)
    level.value, tint.value = 30, 0.3
    assert quick_uri(grey(30, 0.3)) in image.value
    assert 'alt="A grey sheet. Level 30 m, Tint 0.3."' in image.value


def test_a_figure_is_freed_as_soon_as_its_picture_is_taken():
    figures = weakref.WeakSet()

    def draw(level, tint):
        figure, axes = sheet(1)
        axes.plot([level, tint])
        figures.add(figure)
        return figure

    subject = Explorer(draw, explorer().controls, alt="Two points", title="Points")
    subject.frame(level=10, tint=0.5)
    assert len(figures) == 0
    assert gc.isenabled()


def test_a_live_picture_is_the_drawn_one_bit_for_bit():
    image = np.random.default_rng(0).integers(0, 256, (32, 40, 3), dtype=np.uint8)
    data = base64.b64decode(quick_uri(image).partition(",")[2])
    decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    np.testing.assert_array_equal(decoded, image)


@pytest.mark.parametrize("image", [np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3))], ids=["grey", "float"])
def test_only_rgb_bytes_are_pictures(image):
    with pytest.raises(TypeError, match="uint8"):
        to_rgb(image)


def test_a_picture_carries_its_words(mode):
    picture = Picture(grey(5), 'A "grey"\n sheet')
    mode("text")
    assert picture._repr_mimebundle_() == {"text/plain": '[picture: A "grey" sheet]'}
    mode("static")
    assert 'alt="A &quot;grey&quot; sheet"' in picture._repr_mimebundle_()["text/html"]
    with pytest.raises(ValueError, match="alt text"):
        Picture(grey(5), " ")


def test_axes_to_sketch_on_are_told_where_both_layouts_have_them(mode):
    mode("static")
    figure, axes = sheet(3.0)
    axes.set(xlabel="time [s]", ylabel="share", xlim=(0, 30), ylim=(-1, 1))
    page = Picture(figure, "Nothing.", sketch=axes)._repr_mimebundle_()["text/html"]
    phone, desk = (json.loads(html.unescape(told)) for told in re.findall(r'data-sketch="([^"]*)"', page))
    left, top, width, height = desk["box"]
    assert 0 < left < left + width <= 1
    assert 0 < top < top + height < 1
    assert phone["box"][0] > left  # its words are larger
    for told in (phone, desk):
        assert told["across"] | {"ticks": []} == {"name": "time [s]", "from": 0, "to": 30, "ticks": []}
        assert (told["up"]["from"], told["up"]["to"]) == (-1, 1)
        assert 0 in told["up"]["ticks"]
    assert "data-sketch" not in Picture(figure, "Nothing.")._repr_mimebundle_()["text/html"]
    mode("live")
    assert "data-sketch" not in Picture(figure, "x", sketch=axes)._repr_mimebundle_()["text/html"]
