"""Every page for everybody: axe finds nothing, keys reach everything, thumbs hit, paper shows what the screen shows."""

from importlib.resources import files

import pytest
from headless import WIDTH_BEYOND_SCREEN

pytestmark = pytest.mark.browser

LOST = "404.html"

AXE = files("axe_playwright_python").joinpath("axe.min.js").read_text(encoding="utf-8")
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
FINDINGS = """async rules => {
  const found = await axe.run(document, {
    runOnly: {type: 'tag', values: rules}, resultTypes: ['violations'], preload: false});
  return found.violations.flatMap(v => v.nodes.map(n => v.id + ': ' + n.html.slice(0, 160)));
}"""
FOCUSED = """() => { const e = document.activeElement, b = e.getBoundingClientRect();
  return {tag: e.tagName, id: e.id, text: (e.textContent ?? '').trim().slice(0, 40),
          order: Array.prototype.indexOf.call(document.querySelectorAll('*'), e),
          shown: b.width > 0 && b.height > 0 && getComputedStyle(e).visibility === 'visible'}; }"""


def violations(page, theme: str) -> list[str]:
    """What axe finds on the page in this look."""
    page.evaluate("theme => { document.documentElement.dataset.theme = theme; }", theme)
    if not page.evaluate("() => 'axe' in window"):
        page.evaluate(AXE)
    return page.evaluate(FINDINGS, RULES)


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_axe_finds_nothing(shared, theme):
    assert violations(shared, theme) == []


def test_source_pages_are_for_everybody_too(visit, source_page):
    seen = visit(source_page, width=390, reduced_motion="reduce")
    assert seen.complaints + seen.strangers == []
    assert seen.page.evaluate(WIDTH_BEYOND_SCREEN) <= 0
    for theme in ("light", "dark"):
        assert violations(seen.page, theme) == [], theme


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_lost_visitor_is_led_back(visit, scheme):
    seen = visit(LOST, width=390, color_scheme=scheme)
    assert seen.complaints + seen.strangers == []
    assert seen.page.evaluate("document.documentElement.dataset.theme") == scheme
    assert seen.page.evaluate(WIDTH_BEYOND_SCREEN) <= 0
    assert violations(seen.page, scheme) == []
    seen.page.get_by_text("to the first page").click()
    assert seen.page.url.endswith("/index.html")


def test_nothing_glides_for_who_asked_for_less_motion(shared):
    gliding = """() => [...document.querySelectorAll('*')].filter(e =>
      getComputedStyle(e).transitionDuration.split(',').some(d => parseFloat(d) > 0))
      .map(e => e.outerHTML.slice(0, 80))"""
    assert shared.evaluate(gliding) == []


def test_tab_goes_down_the_page(shared):
    assert shared.locator("[tabindex]:not([tabindex='0']):not([tabindex='-1'])").count() == 0
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


def test_folded_parts_open_by_key(shared):
    for summary in shared.locator("article details > summary").all():
        details = summary.locator("..")
        before = details.evaluate("d => d.open")
        for expected in (not before, before):
            summary.press("Enter")
            assert details.evaluate("d => d.open") == expected


def test_answers_open_by_key(shared):
    for button in shared.locator("article button.toggle-button").all():
        for expected in (False, True):
            button.press("Enter")
            hidden = button.evaluate("b => b.closest('.admonition').classList.contains('toggle-hidden')")
            assert hidden is expected


def test_controls_are_large_enough_for_a_thumb(shared):
    shared.set_viewport_size({"width": 390, "height": 900})
    controls = shared.locator("article :is(button, input, summary, select)")
    for box in controls.evaluate_all(  # a radio button answers on the whole of its label
        """all => all.map(e => [e, e.type === 'radio' ? e.closest('label') : e])
        .map(([e, target]) => [e.outerHTML.slice(0, 80), target.offsetWidth, target.offsetHeight])"""
    ):
        name, width, height = box
        assert (width, height) == (0, 0) or height >= 40 or "checkbox" in name or "copybtn" in name, box


def test_paper_shows_the_pictures_and_no_controls(shared):
    shared.emulate_media(media="print")
    for explorer in shared.locator("figure.pfslam-explorer").all():
        assert explorer.locator("img").is_visible()
        assert explorer.locator("figcaption").is_visible()
        for control in explorer.locator("input, button, .pfslam-note").all():
            assert not control.is_visible()
        for value in explorer.locator("output").all():
            assert value.is_visible(), "what the picture was drawn for"
    for furniture in shared.locator(".bd-sidebar-primary, .bd-sidebar-secondary, .bd-header-article").all():
        assert not furniture.is_visible()


def test_pictures_keep_their_paper_in_the_dark_and_do_not_glare(shared):
    shared.evaluate("() => { document.documentElement.dataset.theme = 'dark'; }")
    for picture in shared.locator("article img.pfslam-picture").all():
        assert picture.evaluate("i => getComputedStyle(i).filter") == "brightness(0.86)"
        assert picture.evaluate("i => getComputedStyle(i).backgroundColor") == "rgb(252, 252, 250)"
