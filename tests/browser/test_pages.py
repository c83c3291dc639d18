"""The site as files: links lead somewhere, pictures say what they show; and what search, print and download do."""

import json
import re
import subprocess
import sys
import zipfile
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pytest

pytestmark = pytest.mark.browser

PACK = Path(__file__).resolve().parents[2] / "book" / "_tools" / "pack.py"
FORMULAS_WITH_SCROLL_BARS = """() => [...document.querySelectorAll('article :is(.math, mjx-container)')]
  .filter(e => /auto|scroll/.test(getComputedStyle(e).overflowX)).map(e => e.textContent)"""
CODE_CUT_OFF = """() => [...document.querySelectorAll('article pre')]
  .filter(e => e.scrollWidth > e.clientWidth + 1).map(e => e.textContent.trim().slice(0, 60))"""


class Anatomy(HTMLParser):
    """The identifiers, links, images and scripts of a page."""

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


@pytest.fixture(scope="module")
def anatomies(site):
    return {path: Anatomy(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}


def test_internal_links_and_anchors_lead_somewhere(anatomies):
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


def test_pictures_are_there_and_say_what_they_show_and_nothing_stands_twice(anatomies):
    for path, anatomy in anatomies.items():
        for image in anatomy.images:
            source, alt = image.get("src", ""), image.get("alt", "").strip()
            assert source.startswith("data:") or (path.parent / unquote(source)).is_file(), (path, source)
            assert alt, f"{path.name}: a picture without alt text: {source[:60]}"
            assert "_images/" not in alt, f"{path.name}: a file name is no alt text: {alt}"
        for names in (anatomy.scripts, [i for i in anatomy.ids if i.startswith("explorer-")]):
            assert len(set(names)) == len(names), path


def test_no_cell_failed_and_no_number_shows_its_type(site):
    for path in site.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        assert 'class="output traceback' not in text, path
        assert not re.search(r'<span class="output text_plain">[^<]*\bnp\.[^<]*</span>', text), path


def test_the_site_is_light(site):
    weight = sum(path.stat().st_size for path in site.rglob("*") if path.is_file())
    assert weight <= 60e6
    folders = {"notebooks": 2e6, "api": 0.3e6}
    limits = {path: folders.get(path.parent.name, 1e6) for path in site.rglob("*.html")}
    assert [path.name for path, limit in limits.items() if path.stat().st_size > limit] == []


@pytest.mark.parametrize("scheme", ["http", "file"])
@pytest.mark.parametrize(
    ("words", "page", "first"),
    [
        ("Neff", "notebooks/05", False),
        ("ICP", "book/glossary", False),
        ("ESS", "notebooks/04", True),
        ("kidnapped", "notebooks/10", True),
        ("bag", "notebooks/12", True),
    ],
)
def test_search_finds_formulas_and_short_names_and_the_chapter_first(visit, words, page, first, scheme):
    seen = visit(f"search.html?q={words}", scheme)
    seen.page.wait_for_selector(f'#search-results li a[href*="{page}"]')
    found = seen.page.locator("#search-results li > a").first.get_attribute("href")
    assert found.startswith(page) or not first
    assert seen.complaints == []


@pytest.mark.nightly
def test_search_shows_chapters_first_and_pages_for_maintainers_last(visit):
    page = visit("search.html?q=resampling", "file").page
    page.wait_for_selector('#search-results li a[href*="book/teachers"]')
    found = page.eval_on_selector_all(
        "#search-results li > a", "links => links.map(link => link.getAttribute('href').split('?')[0])"
    )
    pages = [name for name in found if "#" not in name]  # a place within a page has a rank of its own
    chapters = [name for name in pages if name.startswith("notebooks/")]
    assert pages[: len(chapters)] == chapters
    assert len(chapters) >= 2
    assert pages[-1].removeprefix("book/").removesuffix(".html") in (
        ["teachers", "maintainers", "studies", "robustness", "execution", "changelog"]
    )


def test_on_paper_code_is_whole_and_answers_stand_at_the_end(visit, chapter_page):
    """A4 less its margins is 680 CSS pixels wide."""
    page = visit(chapter_page, width=680).page
    folds = page.locator("article .admonition.dropdown, article .cell[class*='tag_solution-']")
    count, own = folds.count(), page.locator("article > *").count()
    page.emulate_media(media="print")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate(CODE_CUT_OFF) == []
    assert page.evaluate(FORMULAS_WITH_SCROLL_BARS) == []
    assert page.locator(".pfslam-at-the-end > .pfslam-unfolded").count() == count
    assert all(text.strip() for text in page.locator(".pfslam-unfolded").all_inner_texts())
    assert page.locator(".pfslam-unfolded").last.is_visible()
    assert not any(fold.is_visible() for fold in folds.all())
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert page.locator("article > *").count() == own


def test_a_chapter_can_be_downloaded_as_a_notebook(visit, chapter_page):
    page = visit(chapter_page).page
    page.locator(".dropdown-download-buttons > button").click()
    with page.expect_download() as download:
        page.locator("a.btn-download-source-button").click()
    assert chapter_page.endswith(download.value.suggested_filename.replace(".ipynb", ".html"))
    assert json.loads(download.value.path().read_text(encoding="utf-8"))["nbformat"] == 4


@pytest.mark.nightly
def test_packed_and_unpacked_elsewhere_it_opens_from_its_files(chromium, opener, site, tmp_path):
    archive, folder = tmp_path / "site.zip", tmp_path / "my bücher"
    subprocess.run([sys.executable, PACK, "zip", site, archive], check=True, capture_output=True)
    with zipfile.ZipFile(archive) as packed:
        packed.extractall(folder)
    for path in site.rglob("*"):
        if path.is_file():
            assert (folder / "site" / path.relative_to(site)).stat().st_size == path.stat().st_size
    context, address = chromium.new_context(), (folder / "site").as_uri() + "/"
    seen = opener(context, f"{address}index.html", address)
    seen.page.wait_for_url("**/book/index.html")
    seen.page.locator(".prev-next-area a.right-next").click()
    seen.page.wait_for_selector("article h1")
    assert seen.complaints + seen.strangers == []
    context.close()
