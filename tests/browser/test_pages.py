"""Every page of the site: whole, quiet, self-contained, light, and no wider than a phone."""

import json
import re
from html.parser import HTMLParser
from urllib.parse import unquote, urldefrag

import pytest
from headless import WIDTH_BEYOND_SCREEN

pytestmark = pytest.mark.browser

SENTENCES_CUT_OFF = """() => [...document.querySelectorAll('.pfslam-sentences pre')]
  .filter(e => e.scrollWidth > e.clientWidth).map(e => e.textContent.trim().slice(0, 60))"""
FORMULAS_WITH_SCROLL_BARS = """selector => [...document.querySelectorAll(`article :is(${selector})`)]
  .filter(e => /auto|scroll/.test(getComputedStyle(e).overflowX)).map(e => e.textContent)"""
CODE_CUT_OFF = """() => [...document.querySelectorAll('article pre')]
  .filter(e => e.scrollWidth > e.clientWidth + 1).map(e => e.textContent.trim().slice(0, 60))"""
BEYOND_SCREEN = """() => [...document.querySelectorAll(
    'article :is(table, mjx-container > svg, figure.pfslam-explorer, figure.pfslam-explorer *)')]
  .filter(e => e.getBoundingClientRect().right > document.documentElement.clientWidth)
  .map(e => e.tagName + ': ' + e.textContent.trim().slice(0, 60))"""


class Anatomy(HTMLParser):
    """The identifiers, links and images of a page."""

    def __init__(self, text: str):
        super().__init__()
        self.ids, self.links, self.images, self.scripts = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        if "id" in attributes:
            self.ids.append(attributes["id"])
        if tag == "a" and attributes.get("href"):
            self.links.append(attributes["href"])
        if tag == "img":
            self.images.append(attributes)
        if tag == "script" and attributes.get("src"):
            self.scripts.append(attributes["src"])


@pytest.fixture(scope="session")
def anatomies(site):
    return {path: Anatomy(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}


def test_pages_hold_no_traceback(site):
    for path in site.rglob("*.html"):
        if "_modules" in path.parts:  # source code shows the examples in its docstrings
            continue
        text = path.read_text(encoding="utf-8")
        # The reference may show an error on purpose, as an example in a docstring.
        shown = text.replace('<span class="gt">Traceback (most recent call last):</span>', "")
        assert "Traceback (most recent call last)" not in shown, path
        assert 'class="output traceback' not in text, path


def test_numbers_in_sentences_are_written_as_numbers(site):
    """A NumPy number that is quoted without a format shows its type: np.int64(2)."""
    found = re.compile(r'<span class="output text_plain">[^<]*\bnp\.[^<]*</span>')
    shown = {path.name: found.findall(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    assert not {name: spans for name, spans in shown.items() if spans}


def test_internal_links_and_anchors_lead_somewhere(site, anatomies):
    broken = []
    for path, anatomy in anatomies.items():
        for link in anatomy.links:
            target, anchor = urldefrag(link)
            if "://" in target or target.startswith(("mailto:", "data:", "javascript:")):
                continue
            goal = (path.parent / unquote(target)).resolve() if target else path
            anchor_found = not anchor or goal not in anatomies or unquote(anchor) in anatomies[goal].ids
            if not (goal.exists() and anchor_found):
                broken.append((path.name, link))
    assert not broken


def test_pictures_exist(anatomies):
    for path, anatomy in anatomies.items():
        for image in anatomy.images:
            source = image.get("src", "")
            assert source.startswith("data:") or (path.parent / unquote(source)).is_file(), (
                path.name,
                source,
            )


def test_identifiers_are_unique(anatomies):
    for path, anatomy in anatomies.items():
        ours = [i for i in anatomy.ids if i.startswith("explorer-")]
        assert len(set(ours)) == len(ours), path


def test_pictures_say_what_they_show(anatomies):
    for path, anatomy in anatomies.items():
        for image in anatomy.images:
            alt = image.get("alt", "").strip()
            assert alt, f"{path.name}: a picture without alt text: {image.get('src', '')[:60]}"
            assert "_images/" not in alt, f"{path.name}: a file name is no alt text: {alt}"


def test_no_script_is_loaded_twice(anatomies):
    for path, anatomy in anatomies.items():
        assert len(set(anatomy.scripts)) == len(anatomy.scripts), path


def test_the_site_is_light(site):
    weight = sum(path.stat().st_size for path in site.rglob("*") if path.is_file())
    assert weight <= 60e6
    heavy = {path.name: path.stat().st_size for path in site.rglob("*.html") if path.stat().st_size > 3e6}
    assert heavy == {}, "at most 3 MB a page"
    chapters = {path.name: path.stat().st_size for path in (site / "notebooks").glob("*.html")}
    assert {name: size for name, size in chapters.items() if size > 2e6} == {}, "at most 2 MB a chapter"


def test_page_is_quiet_and_asks_nobody(shared_visit):
    assert shared_visit.strangers == []
    assert shared_visit.complaints == []


def test_page_works_from_its_file(visit, site, page_name):
    seen = visit(page_name, "file", width=390, color_scheme="dark")
    assert seen.strangers == []
    assert seen.complaints == []
    assert seen.page.evaluate("document.documentElement.dataset.theme") == "dark"
    assert_equations_are_drawn(seen.page)


def assert_equations_are_drawn(page) -> None:
    assert page.locator("mjx-container").count() >= page.locator(".math").count()
    assert page.locator("mjx-merror, [data-mjx-error]").count() == 0


def test_equations_are_drawn(shared):
    assert_equations_are_drawn(shared)


@pytest.mark.parametrize("width", [390, 640, 1280], ids=["phone", "zoomed to 200 %", "desktop"])
def test_no_sideways_scroll(shared, width):
    shared.set_viewport_size({"width": width, "height": 900})
    assert shared.evaluate(WIDTH_BEYOND_SCREEN) <= 0


def test_a_formula_in_a_sentence_has_no_scroll_bar(shared):
    """Headless, scroll bars are hidden; elsewhere they stand between the lines."""
    assert shared.evaluate(FORMULAS_WITH_SCROLL_BARS, "span.math, span.math mjx-container") == []


def test_tables_equations_and_explorers_fit_a_phone(shared):
    shared.set_viewport_size({"width": 390, "height": 900})
    assert shared.evaluate(BEYOND_SCREEN) == []


def test_sentences_that_cells_print_wrap_on_a_phone(shared, page_name):
    shared.set_viewport_size({"width": 390, "height": 900})
    assert shared.evaluate(SENTENCES_CUT_OFF) == []
    printed = shared.locator(".pfslam-sentences").count()
    assert printed > 0 or not page_name.startswith("notebooks/")


@pytest.mark.parametrize("scheme", ["http", "file"])
def test_search_finds_a_word(visit, site, scheme):
    seen = visit("search.html?q=odometry", scheme)
    seen.page.wait_for_selector("#search-results li a")
    if scheme == "http":
        seen.page.wait_for_selector("#search-results li p.context")
    assert seen.complaints == []


@pytest.mark.parametrize(
    ("words", "page"),
    [
        ("Neff", "book/glossary"),
        ("Neff", "notebooks/05"),
        ("N_eff", "notebooks/05"),
        ("ICP", "book/glossary"),
    ],
)
def test_search_finds_what_is_a_formula_or_a_short_name(visit, site, words, page):
    seen = visit(f"search.html?q={words}", "file")
    seen.page.wait_for_selector(f'#search-results li a[href*="{page}"]')


@pytest.mark.parametrize(
    ("words", "chapter"),
    [("Neff", "03"), ("ESS", "03"), ("kidnapped", "11"), ("loop closure", "12"), ("bag", "13")],
)
def test_search_finds_the_chapter_first(visit, site, words, chapter):
    page = visit(f"search.html?q={words}", "file").page
    page.wait_for_selector("#search-results li a")
    first = page.locator("#search-results li > a").first.get_attribute("href")
    assert first.startswith(f"notebooks/{chapter}")


def test_search_shows_chapters_first_and_pages_for_maintainers_last(visit, site):
    page = visit("search.html?q=resampling", "file").page
    page.wait_for_selector('#search-results li a[href*="book/teachers"]')
    found = page.eval_on_selector_all(
        "#search-results li > a", "links => links.map(link => link.getAttribute('href').split('?')[0])"
    )
    pages = [name for name in found if "#" not in name]  # a place within a page has a rank of its own
    chapters = [name for name in pages if name.startswith("notebooks/")]
    assert len(chapters) >= 2
    assert pages[: len(chapters)] == chapters
    staff = ["teachers", "maintainers", "studies", "robustness", "execution", "changelog"]
    last = [name for name in pages if name.removeprefix("book/").removesuffix(".html") in staff]
    assert len(last) >= 2
    assert pages[-len(last) :] == last


def test_on_paper_code_is_whole_and_answers_stand_at_the_end(visit, chapter_page):
    """A4 less its margins is 680 CSS pixels wide."""
    page = visit(chapter_page, width=680).page
    folds = page.locator("article .admonition.dropdown, article .cell[class*='tag_solution-']")
    count, own = folds.count(), page.locator("article > *").count()
    page.emulate_media(media="print")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate(CODE_CUT_OFF) == []
    assert page.evaluate(FORMULAS_WITH_SCROLL_BARS, ".math, mjx-container") == []
    assert page.locator(".pfslam-at-the-end > .pfslam-unfolded").count() == count
    assert page.locator(".pfslam-at-the-end :is(details, summary)").count() == 0
    assert all(text.strip() for text in page.locator(".pfslam-unfolded").all_inner_texts())
    assert page.locator(".pfslam-unfolded").last.is_visible()
    assert not any(fold.is_visible() for fold in folds.all())
    assert "Open the cell below for a solution" not in page.locator("article").inner_text()
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert page.locator("article > *").count() == own
    assert page.locator(".pfslam-at-the-end, .pfslam-moved").count() == 0


def test_a_chapter_can_be_downloaded_as_a_notebook(visit, site, anatomies):
    chapters = sorted((site / "notebooks").glob("*.html"))
    assert chapters
    for path in chapters:
        sources = {link for link in anatomies[path].links if link.endswith(".ipynb")}
        assert len(sources) == 1, path.name
        notebook = json.loads((path.parent / sources.pop()).read_text(encoding="utf-8"))
        assert notebook["nbformat"] == 4
    page = visit(f"notebooks/{chapters[0].name}").page
    page.locator(".dropdown-download-buttons > button").click()
    with page.expect_download() as download:
        page.locator("a.btn-download-source-button").click()
    assert download.value.suggested_filename == chapters[0].with_suffix(".ipynb").name


def test_addresses_that_are_not_filled_in_leave_nothing_behind(site):
    for path in [site / "index.html", *(site / "notebooks").glob("*.html")]:
        page = path.read_text(encoding="utf-8")
        assert "og:image" not in page, path.name
        assert "btn-source" not in page, path.name
        assert "binderhub" not in page.lower(), path.name


def test_a_page_says_how_to_run_it_and_what_a_message_shows_of_it(site):
    for path in (site / "notebooks").glob("*.html"):
        page = path.read_text(encoding="utf-8")
        number = path.name[:2]
        command = f'pfslam</span> <span class="pre">lab</span> <span class="pre">{number}</span>'
        assert page.count(command) == 1, path.name
        assert f'<meta property="og:title" content="{number} ' in page, path.name
        assert re.search(r'<meta property="og:description" content="[^"]{60,}"', page), path.name
