"""The slides in a real browser: a lecturer walks through a set by keys or a remote, from a file, and on paper."""

import json
from itertools import pairwise

import pytest
from copies import NUMBERS, expressions
from headless import PAINTED

SITE_SETS = ("00", "01", "02", "03", "04", "05", "06")
NIGHT = pytest.mark.nightly
pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("slides")]

READY = "() => window.Reveal?.isReady()"
SLIDES = "Reveal.getSlides().length"
HERE = "Reveal.getSlides().indexOf(Reveal.getCurrentSlide())"
SETTLED = """() => [...Reveal.getCurrentSlide().querySelectorAll('.pfslam-lab')].every(
  figure => figure.querySelector('.pfslam-side') && figure.lab.stage.fitted)"""
# What of the present slide is cut off, by more than a pixel, or runs under another of its parts.
BEYOND = """() => {
  const slide = Reveal.getCurrentSlide().querySelector('.slide'), inside = slide.getBoundingClientRect();
  const foot = document.querySelector('.foot').getBoundingClientRect().top, found = [];
  const parts = 'h2, p, li, img, .katex-html, figure.pfslam-lab, canvas, button, input';
  for (const part of slide.querySelectorAll(parts)) {
    const box = part.getBoundingClientRect();
    if (!box.width || part.closest('.pfslam-status, details:not([open])')) continue;
    if (box.left < inside.left - 1 || box.right > inside.right + 1 || box.top < inside.top - 1 || box.bottom > foot + 1)
      found.push(`${part.tagName} ${part.className} ${JSON.stringify(box)}`);
  }
  const blocks = [...slide.querySelectorAll(':scope > h2, :scope > div > *')].map(part => part.getBoundingClientRect());
  blocks.forEach((box, k) => {
    const above = blocks[k - 1], under = k && box.height && box.top < above.bottom - 1 && box.left < above.right - 1;
    if (under) found.push(`part ${k} runs under the one above`);
  });
  return found;
}"""


@pytest.mark.parametrize("number", [n if n == "03" else pytest.param(n, marks=NIGHT) for n in SITE_SETS])
@pytest.mark.parametrize("size", [(1280, 720), (1920, 1080)], ids=lambda size: f"{size[0]}x{size[1]}")
def test_arrow_keys_lead_through_all_slides_and_none_is_cut(site, open_file, number, size):
    page = open_file(site / "slides" / f"{number}.html", READY, *size)
    count, cut, formulas = page.evaluate(SLIDES), {}, 0
    assert 10 <= count <= 15
    seen = {page.evaluate(HERE)}
    for _ in range(3 * count):
        page.evaluate(PAINTED)
        page.wait_for_function(SETTLED)
        cut |= {page.evaluate(HERE): found} if (found := page.evaluate(BEYOND)) else {}
        formulas += page.evaluate("Reveal.getCurrentSlide().querySelectorAll('.math .katex').length")
        page.keyboard.press("ArrowRight")
        seen.add(page.evaluate(HERE))
    assert seen == set(range(count))
    assert cut == {}
    assert formulas > 0
    assert page.evaluate("document.querySelectorAll('.math:not(:has(.katex))').length") == 0


def go_to_laboratory(page) -> None:
    page.evaluate(
        "Reveal.slide(Reveal.getSlides().findIndex(slide => slide.querySelector('.pfslam-lab[data-lab=cloud]')))"
    )
    page.wait_for_function(SETTLED)


def test_a_laboratory_on_a_slide_is_alive_and_a_remote_still_turns_pages(site, open_file):
    page = open_file(site / "slides" / "03.html", READY, 1280, 720)
    go_to_laboratory(page)
    lab, here = page.locator(".present .pfslam-lab"), page.evaluate(HERE)
    drawn = "document.querySelector('.present .pfslam-lab canvas').toDataURL()"
    before = page.evaluate(drawn)
    slider = lab.locator("input[type=range]").first
    slider.focus()
    page.keyboard.press("ArrowRight")  # the slider's, while it has the focus
    page.wait_for_function(f"before => {drawn} !== before", arg=before)
    assert page.evaluate(HERE) == here
    page.keyboard.press("PageDown")
    assert page.evaluate(HERE) == here + 1


def test_notes_come_in_a_window_of_their_own_and_follow(site, open_file):
    page = open_file(site / "slides" / "03.html", READY, 1280, 720)
    with page.expect_popup() as opened:
        page.keyboard.press("s")
    notes = opened.value
    shown = "document.querySelector('.speaker-controls-notes .value').textContent.trim()"
    for here in (0, 1):
        wanted = page.evaluate("Reveal.getCurrentSlide().querySelector('.notes').textContent.trim()")
        notes.wait_for_function(f"wanted => {shown} === wanted", arg=wanted)
        assert page.evaluate(HERE) == here
        page.keyboard.press("ArrowRight")


@pytest.mark.parametrize("number", [n if n == "03" else pytest.param(n, marks=NIGHT) for n in SITE_SETS])
def test_on_paper_every_slide_is_one_page(site, visit, number):
    page = visit(f"slides/{number}.html?print-pdf", "file", 1280).page
    page.wait_for_function("() => document.querySelectorAll('.pdf-page').length")
    printed = page.pdf(prefer_css_page_size=True, print_background=True)
    assert printed.count(b"/Type /Page\n") == page.evaluate("document.querySelectorAll('section').length")


def test_on_a_phone_one_reads_down_the_slides(site, open_file):
    page = open_file(
        site / "slides" / "03.html",
        "() => document.readyState === 'complete'",
        390,
        844,
        has_touch=True,
        is_mobile=True,
    )
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    tops = page.evaluate(
        "[...document.querySelectorAll('.slide')].map(slide => slide.getBoundingClientRect().top)"
    )
    assert len(tops) >= 10
    assert all(below > above + 100 for above, below in pairwise(tops))
    assert page.evaluate("parseFloat(getComputedStyle(document.querySelector('.slide p')).fontSize)") >= 16
    assert page.evaluate("document.querySelector('.pfslam-lab').lab.stage.fitted") > 200


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_a_slide_has_the_colours_of_its_machine(site, open_file, theme):
    page = open_file(site / "slides" / "03.html", READY, 1280, 720, color_scheme=theme)
    assert page.evaluate("document.documentElement.dataset.theme") == theme
    night = page.evaluate(
        "document.querySelector('img[data-night]').src.endsWith("
        "document.querySelector('img[data-night]').dataset.night.replace('../', ''))"
    )
    assert night == (theme == "dark")


def test_numbers_on_slides_are_none_of_the_sentences_of_the_copies(site):
    """The copies fill the sentences of a chapter one after the other with the numbers that the build wrote down."""
    for path in sorted((site.parents[1] / "notebooks").glob("0[0-6]_*.ipynb")):
        kept = json.loads((NUMBERS / f"{path.stem}.json").read_text(encoding="utf-8"))["numbers"]
        assert len(kept) == len(expressions(json.loads(path.read_text(encoding="utf-8"))))
