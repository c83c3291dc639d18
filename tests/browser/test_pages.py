"""The site as files: links lead somewhere, pictures say what they show; and what search, print and download do."""

import json
import re
import subprocess
import sys
import zipfile
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import quote_plus, unquote, urldefrag

import pytest
from pfslam_book.show.night import NIGHT
from windows_names import refused

pytestmark = pytest.mark.browser

PACK = Path(__file__).resolve().parents[2] / "book" / "_tools" / "pack.py"
FORMULAS_WITH_SCROLL_BARS = """() => [...document.querySelectorAll('article :is(.math, .katex-display)')]
  .filter(e => /auto|scroll/.test(getComputedStyle(e).overflowX)).map(e => e.textContent)"""
# Formulas whose last box, or first, stands on another line than the sign that touches it.
TORN_OFF = r"""() => [...document.querySelectorAll('article .katex')].filter(formula => {
  const boxes = formula.querySelectorAll('.base'), text = document.createRange();
  const math = formula.closest('.math'), whole = math.nextSibling ? math : math.parentNode;
  if (formula.closest('.katex-display') || !boxes.length || !formula.getClientRects().length) return false;
  const torn = (node, pattern, box, side) => {
    const at = node?.textContent.search(pattern) ?? -1;
    if (at < 0) return false;
    text.selectNodeContents(node.firstChild ?? node);
    text.setStart(text.startContainer, at);
    text.setEnd(text.startContainer, at + 1);
    const sign = text.getBoundingClientRect(), edge = box.getBoundingClientRect();
    return side * (sign.left - edge.left) < 0;
  };
  return torn(whole.nextSibling, /(?<=^\u2060)\S/, boxes[boxes.length - 1], 1)
    || torn(math.previousSibling, /\S(?=\u2060$)/, boxes[0], -1);
}).map(formula => formula.querySelector('annotation').textContent)"""
CODE_CUT_OFF = """() => [...document.querySelectorAll('article pre')]
  .filter(e => e.scrollWidth > e.clientWidth + 1).map(e => e.textContent.trim().slice(0, 60))"""

LOADED = """() => ['navigation', 'resource'].flatMap(kind => performance.getEntriesByType(kind))
  .map(entry => [entry.name, entry.decodedBodySize])"""
BY_DAY = "all => all.map(image => image.src === new URL(image.dataset.day, document.baseURI).href)"
# The figures that, once they were seen in the dark, are not at once whole and light when the page is printed. One that
# waits folded for a prediction was not seen: it would never be read.
NOT_YET_LIGHT = """async () => {
  const figures = [...document.querySelectorAll('img[data-night]:not([data-night=""])')]
    .filter(image => image.checkVisibility());
  for (const image of figures) {
    image.scrollIntoView();
    await image.decode();
  }
  await new Promise(done => setTimeout(done, 500));
  window.dispatchEvent(new Event('beforeprint'));
  const days = image => [image, ...image.parentElement.querySelectorAll('source')].flatMap(
    ({dataset}) => dataset.day ? [new URL(dataset.day, document.baseURI).href] : []);
  const there = image => image.complete && image.naturalWidth && days(image).includes(image.currentSrc);
  return figures.filter(image => !there(image)).length;
}"""
# Of each figure with a picture for the dark: how light its corner is, of 255, and the colours of a thousandth of it.
FIGURES = """async () => {
  const all = [];
  for (const image of document.querySelectorAll('img[data-night]')) {
    image.loading = 'eager';
    await image.decode();
    const canvas = new OffscreenCanvas(image.naturalWidth, image.naturalHeight), pen = canvas.getContext('2d');
    pen.drawImage(image, 0, 0);
    const data = pen.getImageData(0, 0, canvas.width, canvas.height).data, counts = {};
    for (let i = 0; i < data.length; i += 4) {
      const key = [data[i] >> 4, data[i + 1] >> 4, data[i + 2] >> 4].join();
      counts[key] = (counts[key] ?? 0) + 1;
    }
    all.push({corner: Math.max(data[0], data[1], data[2]),
              colours: Object.keys(counts).filter(key => counts[key] > data.length / 4000)});
  }
  return all;
}"""


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
            night = image.get("data-night", "")
            assert not night or (path.parent / night).is_file(), (path, night[:60])
            assert alt, f"{path.name}: a picture without alt text: {source[:60]}"
            assert "_images/" not in alt, f"{path.name}: a file name is no alt text: {alt}"
        for names in (anatomy.scripts, [i for i in anatomy.ids if i.startswith("explorer-")]):
            assert len(set(names)) == len(names), path


def test_no_page_asks_for_mathjax_and_none_has_more_elements_than_a_phone_lays_out_at_once(anatomies, site):
    for path, anatomy in anatomies.items():
        assert not [script for script in anatomy.scripts if "mathjax" in script.lower()], path
    chapters = (site / "notebooks").glob("*.html")
    crowded = {path.name: path.read_text(encoding="utf-8").count("<") // 2 for path in chapters}
    assert max(crowded.values()) < 10_000, crowded


def test_code_that_has_lost_its_marks_has_the_colour_of_the_code_around_it(site):
    style = (site / "_static" / "pygments.css").read_text(encoding="utf-8")
    for theme in ("light", "dark"):
        rule = rf'html\[data-theme="{theme}"\] \.highlight'
        around = re.search(rf"{rule} {{ background: [^;]+; color: (#\w+) }}", style)[1]
        for kind in ("n", "nn", "p", "w"):
            assert re.search(rf"{rule} \.{kind} {{ color: {around} }}", style), (theme, kind)


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


def test_windows_takes_every_file_of_the_site(site):
    """Unpacked from its archive where a browser puts it."""
    names = [path.relative_to(site).as_posix() for path in site.rglob("*") if path.is_file()]
    assert refused(names, f"C:\\Users\\{20 * 'u'}\\Downloads\\pfslam-site\\pfslam-site\\") == []


# What students type, and the place that has to be the first they are led to.
FIRST_HITS = {
    "log odds": "book/glossary.html#term-log-odds",
    "how to run": "book/install.html",
    "covariance": "book/glossary.html#term-covariance",
    "ICP": "book/glossary.html#term-ICP",
    "N_eff": "book/glossary.html#term-effective-number-of-particles",
    "Neff": "book/glossary.html#term-effective-number-of-particles",
    "ESS": "book/glossary.html#term-effective-number-of-particles",
    "exercise solution": "book/how_to_use.html#exercises-and-checks",
    "resampling": "book/glossary.html#term-resampling",
    "kidnapped": "notebooks/10_lost_and_found.html#kidnapped",
    "deskew": "book/glossary.html#term-deskewing",
    "track": "book/glossary.html#term-effective-track-width",
    "bias": "book/glossary.html#term-gyro-bias",
    "clamp": "book/glossary.html#term-clamp",
    "odometry": "book/glossary.html#term-odometry",
    "texture": "notebooks/06_texture_mapping.html",
    "bag": "notebooks/13_your_own_robot.html#a-ros-bag",
    "slam_step": "book/api/pfslam.slam.html#pfslam.slam.slam_step",
}
# Questions of students by the chapter that has to be among the first three places.
CHAPTERS_FOR = {
    "00": "time synchronization, coordinate frames",
    "01": "motion model, dead reckoning, gyro drift, wheel slip",
    "02": "occupancy grid update equation, inverse sensor model, log odds, ray casting",
    "03": "particle deprivation, what is a particle filter, Bayes rule",
    "04": "measurement model, beam model, scan matching",
    "05": "how does resampling work, particle filter SLAM, systematic resampling",
    "06": "depth camera calibration, floor texture",
    "07": "how many particles do I need",
    "08": "why is my map blurry, double walls",
    "09": "why does my map drift, GMapping, iterative closest point",
    "10": "kidnapped robot, global localization, Monte Carlo localization",
    "11": "Kalman filter, EKF SLAM, FastSLAM, landmarks",
    "12": "loop closure, graph SLAM, data association, robust kernel, covariance of the pose",
    "13": "how do I use my own data, ROS bag",
}
HITS = "#search-results li > a"
HREFS = "links => links.map(link => link.getAttribute('href'))"


@pytest.mark.parametrize("scheme", ["http", "file"])
def test_a_link_opens_a_laboratory_with_its_settings(visit, scheme):
    seen = visit("notebooks/03_prediction_only.html#lab=cells-2&particles=77", scheme)
    figure = "document.querySelectorAll('figure.pfslam-lab[data-lab=cells]')[1]"
    seen.page.wait_for_function(f"() => {figure}.lab?.state.settings.particles === 77")
    seen.page.wait_for_function(f"() => Math.abs({figure}.getBoundingClientRect().top - 80) < 40")
    assert seen.complaints + seen.strangers == []


@pytest.mark.parametrize("scheme", ["http", "file"])
def test_search_leads_first_to_the_place_itself(visit, scheme):
    seen, found = visit("search.html", scheme), {}
    address = seen.page.url
    for words in FIRST_HITS:
        seen.page.goto(f"{address}?q={quote_plus(words)}")
        seen.page.wait_for_selector(HITS)
        found[words] = seen.page.locator(HITS).first.get_attribute("href")
        seen.page.wait_for_load_state("networkidle")  # leaving before that breaks off what is being fetched
    assert found == FIRST_HITS
    assert seen.complaints + seen.strangers == []


def test_search_leads_from_a_students_question_to_the_chapter(visit):
    page = visit("search.html", "file").page
    ask = "query => findSections(query).slice(0, 3).map(hit => hit.page)"
    for number, queries in CHAPTERS_FOR.items():
        for query in queries.split(", "):
            pages = page.evaluate(ask, query)
            assert any(one.startswith(f"notebooks/{number}") for one in pages), (query, pages)


def test_search_finds_what_a_chapter_says_in_a_formula(visit):
    page = visit("search.html?q=Neff", "file").page
    page.wait_for_selector(HITS)
    assert any(link.startswith("notebooks/05") for link in page.eval_on_selector_all(HITS, HREFS))


def test_each_hit_opens_at_a_place_that_is_there(visit, anatomies, site):
    page = visit("search.html?q=weight", "file").page
    page.wait_for_selector(HITS)
    found = page.eval_on_selector_all(HITS, HREFS)
    assert sum("#" in link for link in found) > len(found) / 2
    for link in found:
        path, anchor = urldefrag(link)
        assert not anchor or anchor in anatomies[site / path].ids, link


def test_search_shows_chapters_before_pages_for_maintainers(visit):
    page = visit("search.html?q=seed", "file").page
    page.wait_for_selector(HITS)
    found = page.eval_on_selector_all(HITS, HREFS)
    late = [
        i for i, link in enumerate(found) if re.match(r"book/(teachers|maintainers|studies|changelog)", link)
    ]
    chapters = [i for i, link in enumerate(found) if link.startswith("notebooks/")]
    assert late
    assert len(chapters) >= 2
    assert sorted(chapters)[len(chapters) // 2] < late[0]


def test_the_magnifier_leaves_the_query_free(visit):
    page = visit("search.html?q=weight").page
    lens = page.locator("main form.bd-search i").bounding_box()
    box, indent = page.locator("main #search-input").evaluate(
        "e => [e.getBoundingClientRect().left, parseFloat(getComputedStyle(e).paddingLeft)]"
    )
    assert lens["x"] + lens["width"] <= box + indent


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


def test_in_the_dark_figures_are_dark_in_the_colours_of_the_code_and_on_paper_light(visit, chapter_page):
    page = visit(chapter_page, color_scheme="dark").page
    figures = page.evaluate(FIGURES)
    assert figures
    assert max(figure["corner"] for figure in figures) < 40
    near = {",".join(str(int(colour[i : i + 2], 16) >> 4) for i in (1, 3, 5)) for colour in NIGHT.values()}
    shown = {colour for figure in figures for colour in figure["colours"]}
    assert len(near & shown) >= (2 if len(figures) > 2 else 1), (
        near & shown
    )  # most of those of 12 are computed
    for event, ends in (("beforeprint", True), ("afterprint", False)):
        page.evaluate("event => window.dispatchEvent(new Event(event))", event)
        sources = page.locator("img[data-night]").evaluate_all(BY_DAY)
        assert set(sources) == {ends}
        assert (page.locator("html").get_attribute("data-theme") == "light") == ends
    page.evaluate("() => { document.documentElement.dataset.theme = 'light'; }")
    page.wait_for_timeout(100)
    assert min(figure["corner"] for figure in page.evaluate(FIGURES)) > 240


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_who_comes_for_the_first_time_has_one_theme_from_the_first_line_on(chromium, addresses, scheme):
    context = chromium.new_context(color_scheme=scheme)
    page = context.new_page()
    page.add_init_script("""window.themes = new Set();
      new MutationObserver(() => themes.add(document.documentElement.dataset.theme))
        .observe(document, {subtree: true, attributes: true, attributeFilter: ['data-theme']});""")
    page.goto(addresses["http"] + "notebooks/03_prediction_only.html", wait_until="load")
    assert page.evaluate("[...themes]") == [scheme]
    context.close()


def test_no_line_ends_between_a_formula_and_what_touches_it(visit, chapter_page):
    page = visit(chapter_page, way="workshop").page
    for width in (340, 365, 390, 430, 700, 1000, 1280, 1600):
        page.set_viewport_size({"width": width, "height": 900})
        assert not page.evaluate(TORN_OFF), width


@pytest.mark.parametrize("width", [390, 1280], ids=["phone", "desktop"])
def test_printed_from_the_dark_every_figure_is_light_without_waiting(visit, chapter_page, width):
    page = visit(chapter_page, width=width, way="workshop", color_scheme="dark").page
    assert page.evaluate(NOT_YET_LIGHT) == 0


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_a_page_is_light_to_load(visit, page_name, theme):
    """Before anybody scrolls or touches: a chapter at most 1.4 MB, others 1 MB beside the search index."""
    page = visit(page_name, width=390, way="workshop", color_scheme=theme).page
    page.wait_for_load_state("networkidle")
    loaded = dict(page.evaluate(LOADED))
    weight = sum(loaded.values())
    if not page_name.startswith("notebooks/"):
        weight -= sum(size for name, size in loaded.items() if re.search("/search.*js", name))
    assert weight < (1.4e6 if page_name.startswith("notebooks/") else 1e6), sorted(
        loaded.items(), key=lambda x: -x[1]
    )[:5]


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
