"""Every page of the site: whole, quiet, self-contained, and no wider than a phone."""

from html.parser import HTMLParser
from urllib.parse import unquote, urldefrag

import pytest

pytestmark = pytest.mark.browser

WIDTH_BEYOND_SCREEN = "document.documentElement.scrollWidth - document.documentElement.clientWidth"


class Anatomy(HTMLParser):
    """The identifiers, links and images of a page."""

    def __init__(self, text: str):
        super().__init__()
        self.ids, self.links, self.images = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        if "id" in attributes:
            self.ids.append(attributes["id"])
        if tag == "a" and attributes.get("href"):
            self.links.append(attributes["href"])
        if tag == "img":
            self.images.append(attributes)


@pytest.fixture(scope="session")
def anatomies(site):
    return {path: Anatomy(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}


def test_pages_hold_no_traceback(site):
    for path in site.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        assert "Traceback (most recent call last)" not in text, path
        assert 'class="output traceback' not in text, path


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


@pytest.mark.parametrize("scheme", ["http", "file"])
def test_page_is_quiet_and_asks_nobody(visit, site, page_name, scheme):
    seen = visit(page_name, scheme)
    assert seen.strangers == []
    assert seen.complaints == []


def test_equations_are_drawn(visit, site, page_name):
    page = visit(page_name).page
    written = page.locator(".math").count()
    assert page.locator("mjx-container").count() >= written
    assert page.locator("mjx-merror, [data-mjx-error]").count() == 0


@pytest.mark.parametrize("width", [390, 1280])
def test_no_sideways_scroll(visit, site, page_name, width):
    page = visit(page_name, width=width).page
    assert page.evaluate(WIDTH_BEYOND_SCREEN) <= 0


def test_search_finds_a_word(visit, site):
    page = visit("search.html?q=odometry", "file").page
    page.wait_for_selector("#search-results li a")
