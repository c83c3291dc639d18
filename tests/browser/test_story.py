"""The first minute: four beats, then the reader's drive, which can be shared and never comes to a dead end."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from headless import PAINTED, PHONE, violations
from lab_stills import page as lab_page

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("laboratories")]

LAB = "document.querySelector('figure.pfslam-lab').lab"
STORY = f"{LAB}.story"
READY = f"() => {LAB}?.stage.fitted && {LAB}.state.ready !== false"
SIZES = {"laptop": (1366, 657), "phone": (390, 844), "phone held sideways": (844, 390)}
INDEX = Path(__file__).resolve().parents[2] / "book" / "index.md"


@pytest.fixture
def story(open_file, tmp_path):
    """Open the story on a page of its own, held: only a test lets time pass."""

    def go(**context):
        place = tmp_path / "story.html"
        place.write_text(lab_page("drive", {"small": True}), encoding="utf-8")
        page = open_file(place, READY, **context)
        page.evaluate(f"{LAB}.stage.beat.pause()")
        return page

    return go


def named(page, name: str):
    return page.get_by_role("button", name=name, exact=True)


def pass_time(page, seconds: float) -> None:
    page.evaluate(f"seconds => {{ for (let k = 0; k < 60 * seconds; k++) {STORY}.tick(); }}", seconds)


WHOLE_STORY = f"""start => {{
  const story = {STORY}, beats = [], cm = metres => Math.round(100 * metres);
  const away = (poses, k, [x, y]) => Math.hypot(poses[k] - x, poses[k + 1] - y);
  story.show(0);
  story.begin(start);
  let seconds = 0, behind = 0, longest = 0, nearest = Infinity;
  for (let beat = 0; !story.rest; story.tick()) {{
    const {{drive}} = story, {{truth, poses}} = drive;
    if (story.beat !== beat) {{ beats.push([beat, seconds]); [beat, seconds] = [story.beat, 0]; }}
    seconds += 1 / 60 / {LAB}.BEATS[beat].pace;
    if (beat === 1) {{
      nearest = Infinity;
      for (let k = 0; k < poses.length; k += 3) nearest = Math.min(nearest, away(poses, k, truth));
      nearest -= drive.offAlone;
    }} else if (beat > 1 && drive.ticks % 12 === 0) {{
      behind = cm(drive.off) > cm(drive.offAlone) ? behind + 0.2 : 0;
      longest = Math.max(longest, behind);
    }}
  }}
  const {{floor, grid}} = story.drive, painted = floor.data.filter((value, k) => k % 4 === 3 && value).length;
  beats.push([3, seconds]);
  return {{beats, longest, nearest, painted: 4 * painted / floor.data.length, off: story.drive.off,
          then: story.beat, seeds: {LAB}.STARTS.length}};
}}"""


def test_four_beats_of_a_quarter_of_a_minute_on_each_start_with_dots_no_worse_than_wheels(story):
    """What the first page says of its drives: how many there are, and how long the wheels are ahead at most."""
    page = story()
    words = INDEX.read_text(encoding="utf-8")
    assert "begin at five places" in words
    assert re.search(r"never behind the\s+wheels for longer than half a second", words)
    starts = range(page.evaluate(f"{LAB}.STARTS.length"))
    assert len(starts) == 5
    for start in starts:
        seen = page.evaluate(WHOLE_STORY, start)
        assert [beat for beat, _ in seen["beats"]] == [0, 1, 2, 3]
        np.testing.assert_allclose([seconds for _, seconds in seen["beats"]], 15, atol=0.6)
        assert seen["then"] == 4, "now you drive"
        assert seen["longest"] <= 0.5
        assert seen["nearest"] < 0, "a guess is nearer to the truth than the wheels"
        assert seen["off"] < 0.15
        assert seen["painted"] > 0.4


def test_the_beats_can_be_chosen_skipped_and_held(story):
    page = story()
    titles = page.evaluate(f"{LAB}.BEATS.map(beat => beat.title)")
    names = [f"{k + 1}: {title}" for k, title in enumerate(titles[:4])] + [titles[4]]
    shown = page.locator(".pfslam-beat")
    for name, title in zip(names, titles, strict=True):
        named(page, name).press("Enter")
        page.evaluate(PAINTED)
        assert named(page, name).get_attribute("aria-current") == "step"
        assert shown.text_content().startswith(f"{title}.")
    named(page, names[0]).click()
    seen = page.locator("figure.pfslam-lab button:visible:not(.pfslam-beats button)")
    for title in titles[1:]:
        named(page, "Skip").click()
        page.evaluate(PAINTED)
        assert shown.text_content().startswith(f"{title}.")
        assert seen.count() <= 3
    start = page.evaluate(f"{STORY}.start")
    named(page, names[-1]).click()
    assert page.evaluate(f"[{STORY}.start, {STORY}.beat]") == [(start + 1) % 5, 4], "once more is elsewhere"
    named(page, names[0]).click()
    named(page, "Hold").click()
    ticks = page.evaluate(f"{LAB}.state.ticks")
    page.wait_for_timeout(200)
    assert page.evaluate(f"{LAB}.state.ticks") == ticks
    named(page, "Go on").click()
    page.wait_for_function(f"ticks => {LAB}.state.ticks > ticks", arg=ticks)


def test_a_lap_ends_with_the_floor_and_begins_elsewhere_as_does_a_visit(story):
    page = story()
    here = page.evaluate(f"{STORY}.start")
    page.evaluate(f"() => {{ {STORY}.show(4); while (!{STORY}.rest) {STORY}.tick(); }}")
    page.evaluate(f"{LAB}.stage.redraw()")
    page.evaluate(PAINTED)
    assert "this is the floor" in page.locator(".pfslam-reading").text_content()
    pass_time(page, 7)
    assert page.evaluate(f"{STORY}.start") == (here + 1) % 5
    page.reload()
    page.wait_for_function(READY)
    assert page.evaluate(f"{STORY}.start") == (here + 1) % 5, "remembered is the visit, not the lap"


def test_it_never_comes_to_a_dead_end(story):
    """A wall, a box, a place outside, a thief: within seconds the robot is on its way again."""
    page = story()
    page.evaluate(f"{STORY}.show(4)")
    for x, y in [(4.5, 3.8), (8.3, 5.3), (-0.35, 3.0), (9.3, 6.3), (0.1, 0.1), (4.5, 6.0)]:
        page.evaluate(f"([x, y]) => {STORY}.goTo(x, y)", [x, y])
        assert page.evaluate(f"{LAB}.state.refused") == ""
        assert page.evaluate(f"{LAB}.state.way.length") > 0, (x, y)
        pass_time(page, 30)
        assert page.evaluate(f"{LAB}.state.auto"), "who does nothing is driven on"
    page.evaluate(f"{STORY}.byHand('K')")
    pass_time(page, 5)
    assert page.evaluate(f"Boolean({LAB}.state.before)")
    pass_time(page, 25)
    assert not page.evaluate(f"Boolean({LAB}.state.before)"), "it has begun elsewhere"
    before = page.evaluate(f"{LAB}.state.truth")
    pass_time(page, 3)
    assert page.evaluate(f"{LAB}.state.truth") != before


def test_it_forgets_old_odometry(story):
    page = story()
    page.evaluate(f"{STORY}.show(4)")
    page.evaluate(f"() => {{ for (let k = 0; k < 15 * 60 * 60; k++) {LAB}.state.tick(false); }}")
    assert page.evaluate(f"[{LAB}.state.ticks, {LAB}.state.reckoned.length <= 7200]") == [54000, True]
    page.evaluate(f"() => {{ for (let k = 0; k < 100; k++) {LAB}.state.remember(); }}")
    assert page.evaluate(f"{LAB}.state.history.length") == 80


STATE = f"""() => {{
  const {{ticks, truth, poses, grid, floor}} = {LAB}.state, sum = (total, value) => (total * 31 + value) % 1000003;
  return [ticks, truth, [...poses], [...grid.logOdds], floor.data.reduce(sum, 7)];
}}"""


def test_shared_are_a_picture_of_the_floor_and_a_link_that_drives_the_same_drive(story):
    page = story()
    named(page, "Now you drive").click()
    page.evaluate(f"{LAB}.stage.beat.pause()")
    pass_time(page, 2)
    page.evaluate(f"{STORY}.goTo(6.9, 1.2)")
    pass_time(page, 12)
    page.evaluate(f"{STORY}.hold('left', true)")
    pass_time(page, 1)
    page.evaluate(f"{STORY}.hold('left', false)")
    pass_time(page, 8)  # the autopilot has taken over
    page.evaluate(f"() => {{ {STORY}.byHand('K'); }}")
    pass_time(page, 0.5)
    page.evaluate(f"() => {{ {STORY}.byHand('B'); }}")
    pass_time(page, 3)
    driven = page.evaluate(STATE)
    with page.expect_download() as download:
        named(page, "Share").click()
    png = download.value.path().read_bytes()
    assert download.value.suggested_filename == "my-floor.png"
    assert png.startswith(b"\x89PNG\r\n")
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (801, 1176, 3)
    green = np.abs(picture.astype(int) - (0x6B, 0x9E, 0x6F)).sum(2) < 12  # tiles of the room it went to
    assert green.mean() > 0.01
    page.wait_for_function(
        "() => document.querySelector('[role=status]').textContent.includes('my-floor.png')"
    )

    assert "#lab=drive&drive=" in page.url
    page.reload()
    page.wait_for_function(READY)
    page.evaluate(f"{LAB}.stage.beat.pause()")
    page.evaluate(f"() => {{ while (!{STORY}.rest) {STORY}.tick(); }}")
    assert page.evaluate(STATE) == driven
    pass_time(page, 8)
    assert page.evaluate(f"{LAB}.state.ticks") > driven[0], "and it goes on from there"
    assert page.evaluate(f"{STORY}.link").startswith(page.url.split("drive=")[1].split("-")[0])


@pytest.mark.parametrize("asked", ["9-10-", "0-10-5X", "0-zzzzzzzz-", "%3Cscript%3E"])
def test_a_link_that_tells_no_drive_is_refused_in_words(story, asked):
    page = story()
    with page.expect_event("load"):
        page.evaluate("asked => { location.hash = `lab=drive&drive=${asked}`; }", asked)
    page.wait_for_function(READY)
    assert "cannot be here" in page.locator("[role=status]").text_content()
    assert page.evaluate(f"{STORY}.beat") == 0


def test_who_asked_for_less_motion_sees_the_finished_run_and_taps_from_goal_to_goal(story):
    page = story(reduced_motion="reduce")
    assert page.evaluate(f"Boolean({STORY}.rest)")
    picture = page.evaluate(f"() => {{ {LAB}.draw(); return {LAB}.stage.sheets[0].canvas.toDataURL(); }}")
    page.wait_for_timeout(200)
    assert page.evaluate(f"{LAB}.stage.sheets[0].canvas.toDataURL()") == picture
    assert named(page, "Hold").count() == named(page, "Go on").count() == 0
    there = page.evaluate(f"{LAB}.stage.sheets[0].at(6.9, 1.2)")
    page.locator(".pfslam-plan canvas").click(position={"x": there[0], "y": there[1]})
    x, y = page.evaluate(f"{LAB}.state.truth.slice(0, 2)")
    assert np.hypot(x - 6.9, y - 1.2) < 0.3
    named(page, "1: Wheels alone").click()
    page.wait_for_function(f"() => {LAB}.state.ready && {LAB}.state.ticks > 60")
    assert page.evaluate(f"{STORY}.beat") == 0


def test_who_listens_hears_each_beat_once_and_then_now_and_then_how_it_goes(story):
    page = story()
    heard = page.evaluate(f"""() => {{
      const story = {STORY}, heard = [];
      story.show(0);
      while (!story.rest) {{
        for (let k = 0; k < 6 && !story.rest; k++) story.tick();
        {LAB}.draw();
        const words = {LAB}.describe();
        if (words !== heard[heard.length - 1]) heard.push(words);
      }}
      return heard;
    }}""")
    assert len(heard) == 5
    assert heard[0].startswith("Wheels alone. The robot")
    assert "this is the floor" in heard[4]
    page.evaluate(f"{STORY}.elsewhere()")
    said = [page.evaluate(f"() => {{ {STORY}.tick(); return {LAB}.describe(); }}") for _ in range(120)]
    assert len(set(said)) == 1, "one reading in twenty seconds"


@pytest.mark.parametrize("beat", [0, 1, 4])
def test_it_is_for_everybody(story, beat):
    page = story(**PHONE)
    page.evaluate(f"beat => {STORY}.show(beat)", beat)
    page.evaluate(f"{LAB}.stage.redraw()")
    page.evaluate(PAINTED)
    assert violations(page) == []
    for button in page.locator(".pfslam-lab button").locator("visible=true").all():
        box = button.bounding_box()
        assert min(box["width"], box["height"]) >= 40, button.text_content()


BOXES = """() => [...document.querySelectorAll('.pfslam-front a, .pfslam-lab canvas, .pfslam-lab button')].filter(
  e => e.checkVisibility()).map(e => [e, e.getBoundingClientRect()]).map(
  ([e, box]) => [e.textContent || e.tagName, box.top, box.bottom])"""


@pytest.mark.parametrize("size", SIZES)
def test_picture_controls_and_the_way_into_the_book_are_in_the_first_window(visit, size):
    width, height = SIZES[size]
    phone = {"has_touch": True, "is_mobile": True} if size != "laptop" else {}
    page = visit("book/index.html", width=width, height=height, **phone).page
    page.wait_for_function(READY)
    page.evaluate(f"{LAB}.stage.beat.pause()")
    for beat in range(5):
        page.evaluate(f"beat => {{ {STORY}.show(beat); {LAB}.stage.redraw(); }}", beat)
        pass_time(page, 3)
        page.evaluate(PAINTED)
        boxes = page.evaluate(BOXES)
        expected = {"Start with chapter 00", "CANVAS"} | (
            {"Share"} if beat >= 2 else set()
        )  # nothing to share before
        assert expected <= {name.strip() for name, *_ in boxes}
        assert min(top for _, top, _ in boxes) >= 0
        assert max(bottom for *_, bottom in boxes) <= height, boxes
        assert page.evaluate("document.documentElement.scrollWidth") <= width
