"""Story and Workshop: how long a Story is, the switch, and that every link still arrives."""

import re

import pytest
from headless import PHONE, violations

pytestmark = pytest.mark.browser

SCREENS = 8 * 800
EIGHT = "notebooks/05_particle_filter_slam.html"
SWITCH = ".pfslam-ways button"
# The height of the page when all its pictures are there.
HEIGHT = """async () => {
  const pictures = [...document.querySelectorAll('article img')];
  pictures.forEach(picture => { picture.loading = 'eager'; });
  await Promise.all(pictures.map(picture => picture.decode().catch(() => null)));
  return document.documentElement.scrollHeight;
}"""
# What a reader of this way sees of code, of folds, and of sentences that lead to nothing.
CODE = """() => [...document.querySelectorAll('article .cell_input, article details')]
  .filter(part => getComputedStyle(part).visibility !== 'hidden' && part.getClientRects().length
    && !part.closest('.tag_story, .pfslam-lab, .pfslam-waits')).map(part => part.textContent.trim().slice(0, 60))"""
DANGLING = """() => {
  const blocks = [...document.querySelectorAll('article section > *')].filter(block => !block.matches('section'));
  const shown = blocks.filter(block => getComputedStyle(block).visibility !== 'hidden');
  return shown.filter((block, k) => block.matches('p') && /:\\s*$/.test(block.textContent)
    && (!shown[k + 1] || shown[k + 1].matches('p, h1, h2, h3'))).map(block => block.textContent.slice(-60));
}"""
LAID_OUT_IN_VAIN = """[...document.querySelectorAll('article *:not(.headerlink)')].filter(part =>
  getComputedStyle(part).visibility === 'hidden' && part.getClientRects().length).length"""
FITTED = """() => [...document.querySelectorAll('article figure.pfslam-lab')].every(figure =>
  !figure.checkVisibility() || figure.lab?.stage.fitted)"""
# Of what is shown: how wide each laboratory is drawn, and whether one can stand in code and formulas, which may scroll.
WIDTHS = """() => Object.fromEntries([...document.querySelectorAll('article :is(canvas, pre, .katex-display)')]
  .map((part, k) => [k, part]).filter(([, part]) => part.checkVisibility({visibilityProperty: true}))
  .map(([k, part]) => [k, [part.nodeName, part.clientWidth, part.width ?? null, part.tabIndex]]))"""
TO_THE_EXERCISES = "document.querySelector('.bd-sidebar-secondary a[href=\"#exercises\"]').click()"
SEEN = "id => getComputedStyle(document.getElementById(id)).visibility !== 'hidden'"


@pytest.fixture
def story(visit):
    """Open a chapter for a reader who has chosen Story before."""

    def go(name: str, scheme: str = "http", **options):
        return visit(name, scheme, way="story", **options).page

    return go


def test_a_story_is_at_most_eight_screens_without_code_and_reads_whole(story, chapter_page):
    page = story(chapter_page, width=1280, height=800)
    assert page.evaluate(HEIGHT) <= SCREENS
    assert page.evaluate(CODE) == []
    assert page.evaluate(DANGLING) == []


@pytest.mark.parametrize("scheme", ["http", "file"])
def test_the_switch_is_used_by_keys_remembered_and_keeps_the_place(visit, scheme):
    page = visit(EIGHT, scheme).page
    whole = page.evaluate(HEIGHT)
    assert page.locator(SWITCH).all_inner_texts() == ["Story", "Workshop"]
    assert page.locator(f"{SWITCH}[aria-pressed=true]").inner_text() == "Workshop"
    page.locator("#drive-it-yourself").evaluate("e => e.scrollIntoView({behavior: 'instant'})")
    before = page.locator("#drive-it-yourself").bounding_box()["y"]
    page.locator(SWITCH).first.focus()
    page.keyboard.press("Enter")
    assert page.evaluate("document.documentElement.scrollHeight") < whole / 3
    assert abs(page.locator("#drive-it-yourself").bounding_box()["y"] - before) < 60
    page.goto(page.url.replace("05_particle_filter_slam", "01_dead_reckoning"))
    assert page.locator(f"{SWITCH}[aria-pressed=true]").inner_text() == "Story"
    page.locator(SWITCH).last.click()
    page.reload()
    assert page.locator(f"{SWITCH}[aria-pressed=true]").inner_text() == "Workshop"


@pytest.mark.parametrize(("width", "height"), [(390, 844), (844, 390)], ids=["upright", "sideways"])
def test_a_phone_opens_story_until_the_reader_chooses(visit, width, height):
    page = visit(EIGHT, **PHONE | {"width": width}, height=height).page
    assert page.locator(f"{SWITCH}[aria-pressed=true]").inner_text() == "Story"
    assert page.evaluate("localStorage.getItem('pfslam:read')") is None
    page.locator(SWITCH).last.tap()
    page.reload()
    assert page.locator(f"{SWITCH}[aria-pressed=true]").inner_text() == "Workshop"
    assert page.locator("article .cell_input:visible").count() > 20


@pytest.mark.parametrize("width", [390, 1280])
def test_what_story_folds_is_laid_out_only_when_it_opens_and_then_as_in_workshop(visit, chapter_page, width):
    """Else a phone lays out twice as much as it shows; what is measured while it is folded would keep no width."""
    page = visit(chapter_page, width=width, way="story", reduced_motion="reduce").page
    assert page.evaluate(LAID_OUT_IN_VAIN) == 0
    for button in page.locator(".pfslam-unfold").all():
        if button.is_visible():  # one within another that is not open yet has its turn after it
            button.press("Enter")
    page.wait_for_function(FITTED)
    page.wait_for_timeout(400)  # the theme waits for so long before it looks at a new size
    opened = page.evaluate(WIDTHS)
    page.locator(SWITCH).last.click()
    page.wait_for_timeout(400)
    whole = page.evaluate(WIDTHS)
    assert opened
    assert opened == {name: whole[name] for name in opened}


def test_without_script_a_chapter_is_workshop(visit):
    page = visit(EIGHT, java_script_enabled=False).page
    assert page.locator(SWITCH).count() == 0
    assert page.locator("#exercises p").first.is_visible()


@pytest.mark.parametrize("scheme", ["http", "file"])
def test_a_link_to_what_story_folds_opens_it(story, scheme):
    page = story(f"{EIGHT}#why-it-works-the-factorisation", scheme)
    heading = page.locator("#why-it-works-the-factorisation > h3")
    assert heading.get_by_role("button").get_attribute("aria-expanded") == "true"
    assert abs(heading.bounding_box()["y"]) < 150
    assert not page.evaluate(SEEN, "exercises") or not page.locator("#exercises > p").first.is_visible()
    page.evaluate(TO_THE_EXERCISES)
    page.wait_for_function("() => document.getElementById('exercises').classList.contains('pfslam-open')")


def test_a_link_to_what_story_leaves_out_turns_this_page_to_workshop(story):
    page = story(EIGHT)
    page.evaluate("document.querySelector('p.pfslam-workshop').id = 'left-out'; location.hash = 'left-out'")
    page.wait_for_function("() => !document.documentElement.dataset.read")
    assert page.evaluate("localStorage.getItem('pfslam:read')") == "story"


def test_a_link_opens_a_laboratory_in_a_folded_section(story):
    page = story("notebooks/01_dead_reckoning.html#lab=smoothing", width=1280)
    page.wait_for_function("() => document.querySelector('figure.pfslam-lab[data-lab=smoothing]').lab")
    assert page.locator("figure.pfslam-lab[data-lab=smoothing] canvas").first.is_visible()


def test_a_folded_section_opens_by_a_key_and_is_named(story):
    page = story(EIGHT)
    button = page.get_by_role("button", name="Read also: Now break it")
    button.focus()
    page.keyboard.press("Enter")
    assert button.get_attribute("aria-expanded") == "true"
    assert page.locator("#now-break-it > p").first.is_visible()


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_story_can_be_used_by_everybody_and_fits_a_phone(story, theme):
    page = story(EIGHT, color_scheme=theme, **PHONE)
    assert violations(page) == []
    assert page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth") <= 0
    assert page.locator(SWITCH).first.bounding_box()["height"] >= 44


def test_printed_a_story_is_what_the_reader_sees(story):
    page = story(EIGHT, width=680)
    page.emulate_media(media="print")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.locator("article .cell_input:visible").count() == 0
    assert (
        page.locator(".pfslam-ways, .pfslam-unfold, .pfslam-at-the-end").locator("visible=true").count() == 0
    )
    assert page.locator("#summary p").first.is_visible()


# Both ways. There were 274 folds; half of them did not need to be.
FOLDS = re.compile(r'<details class="admonition hide|class="[^"]*\bdropdown\b[^"]*admonition')
OUT_OF_SIGHT = ("Show the code", "Open the cell below", "Toggle hidden content")
ALT_IN_CODE = re.compile(r'\bshow\(\w+,\s*<span class="s')


def test_folds_are_few_and_have_names_and_no_code_tells_what_a_picture_shows(site):
    chapters = [path.read_text(encoding="utf-8") for path in sorted((site / "notebooks").glob("*.html"))]
    assert sum(len(FOLDS.findall(text)) for text in chapters) <= 137
    assert [words for words in OUT_OF_SIGHT for text in chapters if words in text] == []
    assert [found[0] for text in chapters if (found := ALT_IN_CODE.search(text))] == []


def test_the_button_of_an_answer_is_called_by_its_title(visit):
    page = visit(EIGHT).page
    names = page.locator("button.toggle-button").evaluate_all(
        "all => all.map(b => b.getAttribute('aria-label'))"
    )
    assert set(names) == {"Answer", "What you may have found"}
