"""Pages for everybody: axe finds nothing, nothing is cut off or asked for elsewhere, keys and thumbs reach all."""

import pytest
from headless import PHONE, WIDTH_BEYOND_SCREEN, violations
from pfslam_book.show.pictures import CSS_DPI
from pfslam_book.show.style import WORDS

pytestmark = pytest.mark.browser

RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
# What runs out of the screen of a phone, and printed sentences that do not wrap.
CUT_OFF = """() => [...document.querySelectorAll(
    'article :is(table, .katex-display, span.math, figure.pfslam-explorer, figure.pfslam-explorer *)')]
  .filter(e => e.getBoundingClientRect().right > document.documentElement.clientWidth)
  .concat([...document.querySelectorAll('.pfslam-sentences pre')].filter(e => e.scrollWidth > e.clientWidth))
  .map(e => e.tagName + ': ' + e.textContent.trim().slice(0, 60))"""
BACK_TO_TOP = "() => getComputedStyle(document.querySelector('#pst-back-to-top')).display"
# A while after the page has changed its width, what scrolls can be reached by the tabulator key.
REACHED = """() => [...document.querySelectorAll('article pre')].every(
  e => e.scrollWidth <= e.clientWidth || e.tabIndex >= 0)"""
# Headless, scroll bars are hidden; elsewhere they stand between the lines.
FORMULAS_WITH_SCROLL_BARS = """() => [...document.querySelectorAll('article :is(span.math, span.math *)')]
  .filter(e => /auto|scroll/.test(getComputedStyle(e).overflowX)).map(e => e.textContent)"""
GLIDING = """() => [...document.querySelectorAll('*')].filter(e =>
  getComputedStyle(e).transitionDuration.split(',').some(d => parseFloat(d) > 0)).map(e => e.outerHTML.slice(0, 80))"""
FOCUSED = """() => { const e = document.activeElement, b = e.getBoundingClientRect();
  return {tag: e.tagName, text: (e.textContent ?? '').trim().slice(0, 40),
          order: Array.prototype.indexOf.call(document.querySelectorAll('*'), e),
          shown: b.width > 0 && b.height > 0 && getComputedStyle(e).visibility === 'visible'}; }"""
# A radio button answers on the whole of its label.
SIZES = """all => all.map(e => [e, e.type === 'radio' ? e.closest('label') : e])
  .map(([e, target]) => [e.outerHTML.slice(0, 80), target.offsetWidth, target.offsetHeight])"""


def findings(page, theme: str) -> list[str]:
    """What axe finds on the page in this look."""
    page.evaluate("theme => { document.documentElement.dataset.theme = theme; }", theme)
    return violations(page, runOnly={"type": "tag", "values": RULES})


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280], ids=["phone", "desktop"])
def test_axe_finds_nothing_and_nothing_is_cut_off(shared, shared_visit, width, theme):
    shared.set_viewport_size({"width": width, "height": 900})
    shared.wait_for_function(REACHED)
    assert findings(shared, theme) == []
    assert shared.evaluate(WIDTH_BEYOND_SCREEN) <= 0
    assert shared.evaluate(CUT_OFF) + shared.evaluate(FORMULAS_WITH_SCROLL_BARS) == []
    assert shared.evaluate(GLIDING) == [], "who asked for less motion gets none"
    assert shared.evaluate(BACK_TO_TOP) == "none", "it lies over sliders on a phone"
    assert shared_visit.strangers + shared_visit.complaints == []


def test_page_works_from_its_file(visit, page_name):
    seen = visit(page_name, "file", width=390, color_scheme="dark")
    assert seen.strangers + seen.complaints == []
    assert seen.page.evaluate("document.documentElement.dataset.theme") == "dark"
    faces = (
        "() => document.fonts.ready.then(() => [...document.fonts].map(face => [face.family, face.status]))"
    )
    assert ["Literata", "loaded"] in seen.page.evaluate(faces)
    assert seen.page.locator(".math .katex").count() == seen.page.locator(".math").count()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_links_keep_their_contrast_under_the_pointer(visit, scheme):
    page = visit("book/where_this_stands.html", color_scheme=scheme, reduced_motion="reduce").page
    row = page.locator("article table.table tbody tr").filter(has=page.locator("a")).first
    for place in (row, row.locator("a").first, page.locator("article section > p > a").first):
        before = place.evaluate("e => getComputedStyle(e).color + getComputedStyle(e).backgroundColor")
        place.hover()
        assert (
            place.evaluate("e => getComputedStyle(e).color + getComputedStyle(e).backgroundColor") != before
        )
        assert violations(page, runOnly=["color-contrast"]) == []


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_source_pages_are_for_everybody_too(visit, source_page, theme):
    seen = visit(source_page, width=390, reduced_motion="reduce")
    assert seen.complaints + seen.strangers == []
    assert seen.page.evaluate(WIDTH_BEYOND_SCREEN) <= 0
    assert findings(seen.page, theme) == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_lost_visitor_is_led_back(visit, scheme):
    seen = visit("404.html", width=390, color_scheme=scheme)
    assert seen.complaints + seen.strangers + findings(seen.page, scheme) == []
    assert seen.page.evaluate(WIDTH_BEYOND_SCREEN) <= 0
    seen.page.get_by_text("to the first page").click()
    assert seen.page.url.endswith("/index.html")


def test_tab_goes_down_the_page(shared):
    shared.evaluate("() => { document.activeElement.blur(); }")
    steps = []
    for _ in range(25):
        shared.keyboard.press("Tab")
        steps.append(shared.evaluate(FOCUSED))
    assert "Skip to main content" in steps[0]["text"]
    assert all(step["shown"] for step in steps), [s for s in steps if not s["shown"]]
    order = [step["order"] for step in steps if step["tag"] != "BODY"]
    once_round = order[: order.index(order[0], 1) if order[0] in order[1:] else None]
    assert once_round == sorted(once_round)
    assert len(once_round) > 5


def test_folded_parts_and_answers_open_by_key(shared):
    opened = {
        "article details > summary": "e => e.parentElement.open",
        "article button.toggle-button": "e => !e.closest('.admonition').classList.contains('toggle-hidden')",
    }
    for selector, state in opened.items():
        for control in shared.locator(selector).all():
            before = control.evaluate(state)
            for expected in (not before, before):
                control.press("Enter")
                assert control.evaluate(state) == expected


def test_controls_are_large_enough_for_a_thumb(shared):
    shared.set_viewport_size({"width": 390, "height": 900})
    for box in shared.locator("article :is(button, input, summary, select)").evaluate_all(SIZES):
        name, width, height = box
        assert (width, height) == (0, 0) or height >= 40 or "checkbox" in name or "copybtn" in name, box


def test_paper_shows_the_pictures_and_no_controls(shared):
    shared.emulate_media(media="print")
    for explorer in shared.locator("figure.pfslam-explorer").all():
        for part in explorer.locator("img, figcaption, output").all():
            assert part.is_visible()
        for control in explorer.locator("input, button, .pfslam-note").all():
            assert not control.is_visible()
    for furniture in shared.locator(".bd-sidebar-primary, .bd-sidebar-secondary, .bd-header-article").all():
        assert not furniture.is_visible()


# How wide that is what stands in the column of a page, pictures apart; beside a laboratory its questions have the rest.
WIDTHS = """() => {
  const within = '.admonition, details, .pfslam-lab, .pfslam-explorer, .pfslam-questions, li, dd, table';
  const seen = selector => [...document.querySelectorAll(selector)].filter(e => e.checkVisibility()
    && !e.parentElement.closest(within))
    .map(e => Math.round(e.getBoundingClientRect().width));
  return {pictures: seen('article .cell_output img.pfslam-picture'),
          others: seen('article section > :is(p, ul, ol, dl), article :is(h1, h2, h3, div.math, div.cell_input)')
            .concat(seen('article :is(details, .admonition, figure.pfslam-lab, figure.pfslam-explorer)'))}; }"""
WIDE_SCREENS = (768, 1024, 1199, 1200, 1280, 1366, 1440, 1680, 1920)


def test_a_page_has_two_widths_and_a_wider_screen_no_smaller_figures(visit, chapter_page):
    page = visit(chapter_page).page
    for width in WIDE_SCREENS:
        page.set_viewport_size({"width": width, "height": 900})
        found = page.evaluate(WIDTHS)
        assert set(found["others"]) == {592, 736}, width
        assert set(found["pictures"]) == {736}, width
        assert page.evaluate(WIDTH_BEYOND_SCREEN) <= 0, width
        for caption in page.locator("article .cell_output figure.align-default > figcaption:visible").all():
            picture, words = caption.locator("..").bounding_box(), caption.bounding_box()
            if width >= 1200:  # beside its picture
                assert words["x"] >= picture["x"] + 736
                assert words["x"] + words["width"] <= width


SIZES_OF_CAPTIONS = """() => [...document.querySelectorAll('article figure.align-default > figcaption')]
  .map(e => parseFloat(getComputedStyle(e).fontSize))"""


def test_the_words_of_a_figure_are_as_large_as_those_of_its_caption(visit, chapter_page):
    page = visit(chapter_page).page
    sizes = page.evaluate(SIZES_OF_CAPTIONS)
    assert sizes == pytest.approx([WORDS * CSS_DPI / 72] * len(sizes), rel=0.02)
    drawn = page.locator("article .cell_output picture img:visible").evaluate_all(
        "all => all.map(e => e.width - e.getAttribute('width'))"
    )
    assert set(drawn) == {0}


def test_code_does_not_scroll_on_a_phone(visit, chapter_page):
    page = visit(chapter_page, **PHONE).page
    long = (
        "() => [...document.querySelectorAll('article div.highlight-ipython3 pre')]"
        ".filter(e => e.scrollWidth > e.clientWidth).map(e => e.textContent)"
    )
    assert page.evaluate(long) == []


def test_the_first_page_begins_with_its_title_and_a_picture(visit):
    page = visit("book/index.html").page
    assert not page.locator(".bd-sidebar-primary, .bd-sidebar-secondary").first.is_visible()
    page.locator("button.primary-toggle").click()
    page.wait_for_function("() => document.querySelector('.bd-sidebar-primary').checkVisibility()")
    assert page.locator(".bd-sidebar-primary").get_by_text("01 Dead reckoning").is_visible()


@pytest.mark.parametrize("name", ["book/index.html", "notebooks/01_dead_reckoning.html"])
def test_one_button_for_searching_is_in_sight_with_the_list_of_pages_and_without(visit, name):
    page = visit(name).page
    buttons, toggle = page.locator(".search-button__button"), page.locator("button.primary-toggle")
    for _ in range(3):
        assert sum(button.is_visible() for button in buttons.all()) == 1
        listed = page.locator(".bd-sidebar-primary").is_visible()
        toggle.click()
        page.wait_for_function(
            "was => document.querySelector('.bd-sidebar-primary')"
            ".checkVisibility({visibilityProperty: true}) !== was",
            arg=listed,
        )


def test_the_foot_of_each_page_leads_to_licence_and_maintainers(shared):
    for name in ("Licence", "For maintainers"):
        assert shared.locator("footer").get_by_role("link", name=name, exact=True).is_visible()
        assert shared.locator(".bd-sidebar-primary").get_by_role("link", name=name, exact=True).count() == 0


LINE = """() => [...document.querySelectorAll('article section > p')].flatMap(p => {
  const lines = Math.round(p.getBoundingClientRect().height / parseFloat(getComputedStyle(p).lineHeight));
  return lines < 4 || p.querySelector('.math, code') ? [] : [p.textContent.length / (lines - 0.5)]; })"""


@pytest.mark.parametrize("width", [1280, 1600])
def test_a_line_has_some_seventy_letters(visit, width):
    """Paragraphs of four lines and more, the last of which is half full on average."""
    letters = visit("notebooks/03_prediction_only.html", width=width).page.evaluate(LINE)
    assert len(letters) >= 5
    assert 62 <= sum(letters) / len(letters) <= 75


def test_without_a_third_column_captions_stand_below_their_pictures(visit):
    page = visit("notebooks/03_prediction_only.html", width=1199).page
    figure = page.locator("article .cell_output figure.align-default").first
    picture, caption = figure.locator("img").bounding_box(), figure.locator("figcaption").bounding_box()
    assert caption["y"] >= picture["y"] + picture["height"]


def test_contents_fold_while_a_caption_stands_in_their_place_and_open_for_the_keyboard(visit):
    page = visit("notebooks/03_prediction_only.html", height=800, reduced_motion="reduce").page
    contents = page.locator(".bd-sidebar-secondary")
    assert contents.bounding_box()["height"] > 100
    page.locator("article .cell_output figure.align-default > figcaption").first.evaluate(
        "e => window.scrollBy(0, e.getBoundingClientRect().top - 200)"
    )
    page.wait_for_function("() => document.querySelector('.bd-sidebar-secondary').offsetHeight < 60")
    contents.get_by_role("link").first.focus()
    page.wait_for_function("() => document.querySelector('.bd-sidebar-secondary').offsetHeight > 100")


@pytest.mark.parametrize("width", [390, 1280])
def test_a_picture_opens_at_its_full_size_by_key_and_by_tap(visit, width):
    page = visit("notebooks/06_texture_mapping.html", width=width).page
    picture, full = page.locator("#fig-your-floor img"), page.locator("dialog.pfslam-full")
    before = picture.bounding_box()["width"]
    picture.press("Enter")
    assert full.locator("img").bounding_box()["width"] >= max(width, 900, before)
    assert findings(page, "dark") == []
    assert full.locator("img").evaluate("e => getComputedStyle(e).filter") == "none"
    page.keyboard.press("Escape")
    assert not full.is_visible()
    assert picture.evaluate("e => e === document.activeElement")
    picture.click()
    full.locator("img").click()
    assert not full.is_visible()
    assert page.locator(".pfslam-explorer .pfslam-zoom, .pfslam-lab .pfslam-zoom").count() == 0
