"""Formulas of the built site: every one is drawn, read as words, and keeps to what touches it."""

import json
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
KATEX = ROOT / "book" / "_static" / "katex"
INLINE = '<span class="math notranslate nohighlight">\\({}\\)</span>'
DISPLAY = '<div class="math notranslate nohighlight" id="equation-eq-5">\n<span class="eqno">(5)</span>\\[{}\\]</div>'


@pytest.fixture(scope="module")
def formulas():
    sys.path.insert(0, str(ROOT / "book" / "_ext"))
    import formulas

    yield formulas
    sys.path.remove(str(ROOT / "book" / "_ext"))


def drawn(formulas, page: str) -> str:
    return formulas.with_drawn(page, formulas.draw(formulas.formulas_of(page)))


def test_a_formula_is_drawn_for_the_eye_and_in_mathml(formulas):
    page = drawn(formulas, f"<p>As {INLINE.format('a &lt; b')} holds</p>{DISPLAY.format('x')}")
    assert page.count('<span class="katex-html" aria-hidden="true">') == 2
    assert page.count("<math ") == 2
    assert "<mi>a</mi><mo>&lt;</mo><mi>b</mi>" in page
    assert re.search(r'\(5\)</span><span class="katex-display">.*<mi>x</mi>', page)
    assert "\\(" not in page
    assert "\\[" not in page


def test_a_formula_with_a_class_of_its_own_is_drawn_too(formulas):
    shown = "pfslam-workshop math"
    page = f"{INLINE.format('a')}{DISPLAY.format('b')}".replace('"math', f'"{shown}')
    assert formulas.HAS_SOME.search(page)
    assert drawn(formulas, page).count('class="katex-html"') == 2
    assert not formulas.HAS_SOME.search('<p class="aftermath"></p><span class="mathnormal"></span>')


def test_a_name_of_several_letters_is_read_as_a_word(formulas):
    page = drawn(formulas, INLINE.format(r"\mathrm{corr}(y) + N"))
    assert "<mi>corr</mi>" in page
    assert "<mi>N</mi>" in page


def test_what_touches_a_formula_stays_on_its_line(formulas):
    joined = formulas.JOINED
    page = drawn(
        formulas,
        f"<p>({INLINE.format('x')}) or <em>{INLINE.format('y')}</em>, not {INLINE.format('z')} here</p>",
    )
    assert page.count(joined) == 3
    assert f'<span class="pfslam-held">({joined}</span><span' in page
    assert f"</span>{joined})" in page
    assert f"</em>{joined}," in page


def test_what_touches_a_formula_is_one_sign_however_it_is_written(formulas):
    page = drawn(formulas, f"<p>&lt;{INLINE.format('x')}&gt;</p>")
    assert f'<p><span class="pfslam-held">&lt;{formulas.JOINED}</span><span' in page
    assert page.count("<span") == page.count("</span>")


def test_what_is_not_understood_is_named(formulas):
    with pytest.raises(Exception, match=r"\\unheard"):
        formulas.draw([(r"\unheard{x}", False)])


def test_a_long_line_without_blanks_takes_no_time(formulas):
    """A picture in a page is one: a search that began anew at every letter would take minutes."""
    assert formulas.formulas_of("a" * 2_000_000 + INLINE.format("x")) == [("x", False)]


def test_style_sheet_and_fonts_are_those_of_the_script(formulas):
    engine = formulas.MiniRacer()
    engine.eval(formulas.files("sphinxcontrib").joinpath("katex.min.js").read_text(encoding="utf-8"))
    style = (KATEX / "katex.css").read_text(encoding="utf-8")
    assert f'content:"{engine.eval("katex.version")}"' in style
    fonts = set(re.findall(r"url\(fonts/([^)]+)\)", style))
    assert fonts == {path.name for path in (KATEX / "fonts").iterdir()}


def test_every_formula_of_the_chapters_can_be_drawn(formulas):
    cells = [
        "".join(cell["source"])
        for path in sorted((ROOT / "notebooks").glob("*.ipynb"))
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]
        if cell["cell_type"] == "markdown"
    ]
    found = [source for cell in cells for source in re.findall(r"(?<![\\$])\$([^$`\n]+)\$(?!\d)", cell)]
    assert len(found) > 400
    assert len(formulas.draw(list(dict.fromkeys((source, False) for source in found)))) > 200
