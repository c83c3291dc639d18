"""Predictions: the page takes what the reader expects, keeps it, and shows it beside the result."""

import json
from pathlib import Path

import numpy as np
import pytest
from headless import touching, violations
from pfslam_book.show.artists import sheet, show

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("predictions")]

STATIC = Path(__file__).resolve().parents[2] / "book" / "_static"
ASK = "<p>A case. <strong>Predict first:</strong> {}</p><p>Some words.</p>"
SAID = "<p>What was seen.</p><section><h2>Next</h2></section>"
CELL = "<div class='cell'><div class='cell_input'>code</div><div class='cell_output'><p>{}</p></div></div>"


def page_of(questions: list[str], theme: str = "light", output: str = "") -> str:
    cells = "".join(ASK.format(words) + CELL.format(output or k) + SAID for k, words in enumerate(questions))
    return f"""<!doctype html><html lang="en" data-theme="{theme}"><head><meta charset="utf-8"><title>A</title>
<link rel="stylesheet" href="{(STATIC / "pfslam.css").as_uri()}">
<style>main {{max-width: 46rem}}
html[data-theme=dark] {{background: #121212; color: #eee; --pst-color-text-base: #eee}}</style></head>
<body class="bd-content"><main class="bd-article"><h1>A</h1>{CELL.format("before")}<article>{cells}</article></main>
<script src="{(STATIC / "sketch.js").as_uri()}"></script>
<script src="{(STATIC / "predict.js").as_uri()}"></script></body></html>"""


@pytest.fixture
def open_questions(chromium, opener, tmp_path):
    contexts = []

    def go(*questions: str, theme: str = "light", before: str = "", output: str = "", **anew):
        if anew or not contexts:
            contexts.append(chromium.new_context(**anew))
        context = contexts[-1]
        place = tmp_path / "chapter.html"
        place.write_text(page_of(questions, theme, output), encoding="utf-8")
        if before:
            context.add_init_script(before)
        seen = opener(context, place.as_uri(), "file:///")
        assert seen.complaints + seen.strangers == []
        return seen.page

    yield go
    for context in contexts:
        context.close()


def test_a_prediction_is_kept_and_stands_beside_the_next_output(open_questions):
    questions = ("which of the two will be noticed? Then look.", "how many points will move?")
    page = open_questions(*questions)
    assert page.locator(".pfslam-said").count() == 0
    outputs, words = page.locator("article .cell_output"), page.get_by_text("What was seen.")
    assert [part.is_visible() for part in (*outputs.all(), *words.all())] == [False] * 4
    page.get_by_label("Your prediction").nth(1).focus()
    page.keyboard.type("about 40 <b>")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    assert [part.is_visible() for part in (*outputs.all(), *words.all())] == [False, True] * 2
    assert outputs.nth(1).inner_text().startswith("You said: about 40 <b>")
    assert "You said" not in outputs.nth(0).text_content()
    page.get_by_role("button", name="Skip").click()
    assert outputs.nth(0).is_visible()
    assert words.nth(0).is_visible()
    assert page.get_by_role("button", name="Skip").count() == 0
    assert page.get_by_role("status").nth(1).inner_text().startswith("Kept")
    later = open_questions(*questions)
    assert later.get_by_label("Your prediction").nth(1).input_value() == "about 40 <b>"
    assert later.locator(".pfslam-said").inner_text() == "You said: about 40 <b>"
    later.get_by_label("Your prediction").nth(1).fill("none")
    later.get_by_role("button", name="Keep it").nth(1).click()
    assert later.locator(".pfslam-said").inner_text() == "You said: none"
    assert [part.is_visible() for part in later.locator("article .cell_output").all()] == [False, True]
    later.emulate_media(media="print")
    assert later.locator("article .cell_output").first.is_visible()
    assert not later.locator(".pfslam-predict").first.is_visible()
    assert not later.locator(".pfslam-said").is_visible()


@pytest.mark.parametrize(
    ("question", "answers"),
    [
        ("does the total depend on how many scans it uses?", ["yes", "no"]),
        ("what will their effective number be, 20, 60 or 190?", ["20", "60", "190"]),
        ("will it get better, worse, or stay the same?", ["better", "worse", "stay the same"]),
        ("which will come first, the position or the heading?", ["the position", "the heading"]),
        ("will it get better? And if we take away the true one?", []),
        ("which clouds contain the star?", []),
    ],
)
def test_a_question_with_few_answers_is_a_choice(open_questions, question, answers):
    page = open_questions(question)
    radios = page.get_by_role("radio")
    assert radios.evaluate_all("all => all.map(one => one.value)") == answers
    if answers:
        radios.first.focus()
        page.keyboard.press("ArrowDown")
        page.keyboard.press("Enter")
        assert page.locator(".pfslam-said").inner_text() == f"You said: {answers[1]}"
        assert open_questions(question).get_by_role("radio").nth(1).is_checked()


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_it_is_for_everybody(open_questions, theme):
    page = open_questions("what will it be?", "is it so?", theme=theme)
    page.get_by_role("textbox").fill("a")
    page.get_by_role("button", name="Keep it").first.click()
    assert violations(page) == []


def test_a_laboratory_is_not_folded(open_questions):
    page = open_questions("which will it be?", output="<figure class='pfslam-lab'>A laboratory</figure>")
    assert page.get_by_text("A laboratory").is_visible()
    assert page.get_by_text("What was seen.").is_visible()
    assert page.get_by_role("button", name="Skip").count() == 0


def test_where_nothing_is_kept_nothing_is_asked(open_questions):
    blocked = "Object.defineProperty(window, 'localStorage', {get() { throw new Error('blocked'); }})"
    assert open_questions("is it so?", before=blocked).locator("form").count() == 0


@pytest.fixture
def level(monkeypatch):
    """A picture of a level line, on whose axes one draws first."""
    monkeypatch.setenv("PFSLAM_WIDGETS", "static")
    figure, axes = sheet(3.4)
    axes.plot([0, 32], [9, 9], color="red")
    axes.set(xlabel="time [s]", ylabel="evidence", xlim=(0, 32), ylim=(-2, 12))
    return show(figure, "A level line at 9.", sketch=axes)


def height_of_line(picture) -> float:
    """Where the red line is, as a share of the picture from its top."""
    red = (picture.image[..., 0] > 200) & (picture.image[..., 1] < 60)
    return np.nonzero(red.any(axis=1))[0].mean() / len(red)


def html_of(picture) -> str:
    return picture._repr_mimebundle_()["text/html"]


def kept(page) -> list[list[float]]:
    return json.loads(page.evaluate("Object.values(localStorage)[0] || '[]'"))


QUESTION = "how does it run over the drive? Sketch it."


def test_a_curve_is_drawn_on_the_axes_of_the_picture_and_stays_in_it(open_questions, level):
    page = open_questions(QUESTION, output=html_of(level))
    words, pad = page.get_by_text("What was seen."), page.get_by_role("slider")
    silent = page.locator("picture[inert]")  # not read aloud: its words would tell the result
    assert (words.is_visible(), silent.count()) == (False, 1)
    page.get_by_role("button", name="Keep it").click()
    assert page.get_by_role("status").inner_text().startswith("Draw a curve first")
    box, whole = pad.bounding_box(), page.locator("img").bounding_box()
    on_line = whole["y"] + height_of_line(level) * whole["height"]
    page.mouse.move(box["x"] + 1, on_line)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] - 1, on_line)
    page.mouse.up()
    page.get_by_role("button", name="Keep it").click()
    x, y = np.transpose(kept(page))
    assert (x[0], x[-1]) == (0, 32)
    np.testing.assert_allclose(y, 9, atol=0.1)
    assert (words.is_visible(), silent.count(), pad.count()) == (True, 0, 0)
    assert page.locator(".pfslam-pad").is_visible()
    later = open_questions(QUESTION, output=html_of(level))
    assert later.locator(".pfslam-stroke").get_attribute("points").count(" ") == len(x) - 1
    assert later.get_by_text("What was seen.").is_visible()
    later.emulate_media(media="print")
    assert not later.locator(".pfslam-pad").is_visible()
    assert later.locator("img").is_visible()
    later.emulate_media(media="screen")
    later.get_by_role("button", name="Draw it anew").click()
    assert not later.get_by_text("What was seen.").is_visible()
    assert kept(later) == []
    later.get_by_role("button", name="Skip").click()
    assert later.get_by_text("What was seen.").is_visible()
    assert (kept(later), later.locator(".pfslam-stroke").get_attribute("points")) == ([], "")


def test_a_curve_is_drawn_with_keys(open_questions, level):
    page = open_questions(QUESTION, output=html_of(level))
    pad = page.get_by_role("slider")
    pad.focus()
    assert pad.get_attribute("aria-valuetext") == "time [s] 0: nothing drawn"
    for key in ("ArrowDown", "End", *["ArrowUp"] * 3):
        page.keyboard.press(key)
    assert pad.get_attribute("aria-valuetext") == "time [s] 32: evidence 5.7"
    page.keyboard.press("ArrowLeft")
    assert pad.get_attribute("aria-valuetext") == "time [s] 31.2: nothing drawn"
    page.keyboard.press("ArrowUp")
    page.keyboard.press("Delete")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    assert kept(page) == [[0, 4.65], [32, 5.7]]


def test_a_finger_draws_on_the_axes_and_scrolls_beside_them(open_questions, level):
    phone = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
    page = open_questions(*[QUESTION] * 5, output=html_of(level), **phone)
    pad = page.get_by_role("slider").first
    box = pad.bounding_box()
    places = np.linspace(
        [box["x"] + 1, box["y"] + 1], [box["x"] + box["width"] - 1, box["y"] + box["height"] - 1], 9
    )
    for _ in touching(page, places):
        pass
    assert page.evaluate("scrollY") == 0
    page.get_by_role("button", name="Keep it").first.click()
    x, y = np.transpose(kept(page))
    np.testing.assert_allclose(y, 12 - 14 * x / 32, atol=0.5)
    below = box["y"] + box["height"] + 12  # on the numbers of the axis
    for _ in touching(page, np.linspace([box["x"] + 90, below], [box["x"] + 90, below - 150], 9)):
        pass
    page.wait_for_function("scrollY > 50")


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_a_curve_can_be_asked_of_everybody(open_questions, level, theme):
    page = open_questions(QUESTION, theme=theme, output=html_of(level))
    assert violations(page) == []
    page.get_by_role("button", name="Skip").click()
    assert violations(page) == []


def test_what_was_kept_in_words_is_no_curve(open_questions, level):
    page = open_questions("what will it be?")
    page.get_by_role("textbox").fill("12")
    page.get_by_role("button", name="Keep it").click()
    page = open_questions(QUESTION, output=html_of(level))
    assert page.get_by_role("slider").is_visible()
