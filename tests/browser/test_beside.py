"""On a wide screen a laboratory stands beside the questions about it, and stays in sight while they are read."""

import pytest

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("beside")]

CHAPTERS = ["01_dead_reckoning", "02_occupancy_grid", "05_particle_filter_slam"]
OPEN = """() => document.querySelectorAll('.pfslam-questions .admonition.dropdown.toggle-hidden .toggle-button')
  .forEach(button => button.click())"""
# Where the first laboratory with questions, and they, are in the window.
BOXES = """() => {
  const box = part => (({left, right, top, bottom}) => ({left, right, top, bottom}))(part.getBoundingClientRect());
  const all = document.querySelector('.pfslam-beside');
  const [lab, words] = ['.pfslam-lab', '.pfslam-questions'].map(name => box(all.querySelector(name)));
  return {lab, words, all: box(all)};
}"""


@pytest.fixture
def read(visit):
    def go(chapter: str, width: int, height: int, **options):
        seen = visit(
            f"notebooks/{chapter}.html", width=width, height=height, reduced_motion="reduce", **options
        )
        assert seen.complaints + seen.strangers == []
        seen.page.locator(".pfslam-beside").first.scroll_into_view_if_needed()
        seen.page.evaluate(OPEN)
        return seen.page

    return go


def scrolled(page, top: float) -> dict:
    """The boxes after the page has been scrolled until the pair of laboratory and questions begins there."""
    page.evaluate(
        """top => { const {y} = document.querySelector('.pfslam-beside').getBoundingClientRect();
          window.scrollBy({top: y - top, behavior: 'instant'}); }""",
        top,
    )
    return page.evaluate(BOXES)


@pytest.mark.parametrize(
    ("chapter", "width"), [(CHAPTERS[0], 1440), (CHAPTERS[1], 1600), (CHAPTERS[2], 1920)]
)
def test_a_laboratory_stays_while_its_questions_are_read(read, chapter, width):
    page = read(chapter, width, 1000)
    start = scrolled(page, 100)
    lab, words, pair = start["lab"], start["words"], start["all"]
    assert lab["right"] < words["left"] < words["right"] <= width
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert words["right"] - words["left"] >= 20 * 16
    page.locator(".pfslam-questions").first.evaluate("part => { part.style.minHeight = '3000px'; }")
    for top in (-200, -900, -1800):  # while its questions pass by, it is whole, below the head of the page
        here = scrolled(page, top)["lab"]
        assert here["top"] == pytest.approx(64, abs=2)
        assert here["bottom"] <= 1000
    after = scrolled(page, -2900)  # and it goes with the last of them
    assert after["lab"]["bottom"] <= after["all"]["bottom"]
    assert pair["bottom"] >= words["bottom"]


@pytest.mark.parametrize(("width", "height"), [(390, 844), (1280, 800)])
def test_where_there_is_no_room_questions_stand_below(read, width, height):
    page = read(CHAPTERS[1], width, height, way="workshop")
    start = scrolled(page, 100)
    assert start["words"]["top"] >= start["lab"]["bottom"]
    assert start["words"]["left"] == pytest.approx(start["all"]["left"], abs=1)
    assert scrolled(page, -300)["lab"]["top"] == pytest.approx(start["lab"]["top"] - 400, abs=2)


def test_in_a_window_that_is_too_low_it_does_not_stay(read):
    page = read(CHAPTERS[1], 1440, 500)
    page.locator(".pfslam-questions").first.evaluate("part => { part.style.minHeight = '3000px'; }")
    assert scrolled(page, -900)["lab"]["bottom"] < 200
    page.set_viewport_size({"width": 1440, "height": 1000})
    page.wait_for_function("document.querySelector('.pfslam-stays')")
    assert scrolled(page, -900)["lab"]["top"] == pytest.approx(64, abs=2)


def test_paper_and_story_know_nothing_of_it(read):
    page = read(CHAPTERS[1], 1440, 1000)
    page.emulate_media(media="print")
    assert page.evaluate("getComputedStyle(document.querySelector('.pfslam-beside')).display") == "block"
    page.emulate_media(media="screen")
    page.get_by_role("button", name="Story").click()
    assert page.locator(".pfslam-beside .pfslam-lab").first.is_visible()
    assert not page.locator(".pfslam-questions > p").first.is_visible()
