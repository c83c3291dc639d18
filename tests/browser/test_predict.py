"""Predictions: the page takes what the reader expects, keeps it, and shows it beside the result."""

from pathlib import Path

import pytest
from headless import violations

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("predictions")]

STATIC = Path(__file__).resolve().parents[2] / "book" / "_static"
ASK = "<p>A case. <strong>Predict first:</strong> {}</p><p>Some words.</p>"
SAID = "<p>What was seen.</p><section><h2>Next</h2></section>"
CELL = "<div class='cell'><div class='cell_input'>code</div><div class='cell_output'><p>{}</p></div></div>"


def page_of(questions: list[str], theme: str = "light", output: str = "") -> str:
    cells = "".join(ASK.format(words) + CELL.format(output or k) + SAID for k, words in enumerate(questions))
    return f"""<!doctype html><html lang="en" data-theme="{theme}"><head><meta charset="utf-8"><title>A</title>
<link rel="stylesheet" href="{(STATIC / "pfslam.css").as_uri()}">
<style>html[data-theme=dark] {{background: #121212; color: #eee; --pst-color-text-base: #eee}}</style></head>
<body><main><h1>A</h1>{CELL.format("before")}<article>{cells}</article></main>
<script src="{(STATIC / "predict.js").as_uri()}"></script></body></html>"""


@pytest.fixture
def open_questions(chromium, opener, tmp_path):
    context = chromium.new_context()

    def go(*questions: str, theme: str = "light", before: str = "", output: str = ""):
        place = tmp_path / "chapter.html"
        place.write_text(page_of(questions, theme, output), encoding="utf-8")
        if before:
            context.add_init_script(before)
        seen = opener(context, place.as_uri(), "file:///")
        assert seen.complaints + seen.strangers == []
        return seen.page

    yield go
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
