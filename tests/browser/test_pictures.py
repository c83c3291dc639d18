"""The pictures with a slider: the page computes what the package computes, under mouse, finger and key."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from headless import PHONE, WIDTH_BEYOND_SCREEN, touching
from lab_stills import default_options
from lab_stills import page as lab_page
from pfslam_book import ch00, ch01, ch04, ch08
from pfslam_book.ch06.live import describe_dot
from pfslam_book.show import faults
from pfslam_book.show.lab import FOLDER

from pfslam.grid import GridSpec, trace_rays
from pfslam.io.datasets import load
from pfslam.motion import controls, dead_reckoning, integrate
from pfslam.poses import transform_points
from pfslam.sensors import RgbdModel, scan_points
from pfslam.texture import disparity_from_depth

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("laboratories")]
nightly = pytest.mark.nightly

PICTURES = sorted(path.name[8:-3] for path in FOLDER.iterdir() if path.name.startswith("picture_"))
LAB = "document.querySelector('figure.pfslam-lab').lab"
FOLDS = "open => document.querySelectorAll('details').forEach(box => { box.open = open; })"
DRAWN = f"() => {{ {LAB}.draw(); return document.querySelector('canvas').toDataURL(); }}"


@pytest.fixture
def open_picture(open_file, tmp_path):
    """Open one picture on a page of its own: ``open_picture("dot", width=390)``, with its folds open or shut."""

    def go(name: str, folds: str = "open", below: str = "", **context):
        place = tmp_path / f"{name}.html"
        place.write_text(lab_page(name).replace("</main>", below + "</main>"), encoding="utf-8")
        page = open_file(place, f"() => {LAB}?.stage.fitted", height=844, **context)
        page.evaluate(FOLDS, folds == "open")
        return page

    return go


# ---- what the page computes


@cache
def hall():
    return load("hall")


@cache
def half_turn():
    part = faults.scans_between(hall(), *ch08.TURNS)
    return part, dead_reckoning(part)


def late(offset: float, seen: dict) -> str:
    right = {name: ch00.shifted_scans(hall(), moment, 0.0) for name, moment in ch00.STRETCHES.items()}
    for panel in seen["panels"]:
        points = ch00.shifted_scans(hall(), ch00.STRETCHES[panel["name"]], offset / 1e3)
        np.testing.assert_allclose(numbers(panel["points"]).reshape(-1, 2), points, atol=0.002)
    return ch00.describe_late_clock(hall(), right, offset)


def turn(way: str, degrees: float, seen: dict) -> str:
    points = ch00.turn_points(way, degrees)
    np.testing.assert_allclose(numbers(seen["points"]).reshape(-1, 2), points, atol=1e-9)
    return ch00.describe_turn(way, degrees)


def smoothing(seconds: float, seen: dict) -> str:
    inputs = controls(hall())
    soft = ch01.smoothed(inputs, seconds)
    np.testing.assert_allclose(numbers(seen["soft"]), soft.omega, atol=1e-4)
    path = numbers(seen["path"]).reshape(-1, 3)  # whose headings are unwrapped
    np.testing.assert_allclose(path[:, :2], integrate(soft).poses[:, :2], atol=5e-3)
    return ch01.describe_smoothing(inputs, seconds)


def sharpness(value: float, seen: dict) -> str:
    shares = np.array(default_options("sharpness")["shares"])
    np.testing.assert_allclose(numbers(seen["weights"]), ch04.sharpened(shares, value), rtol=1e-9)
    return ch04.describe_weights(shares, value)


def dot(z: float, seen: dict) -> str:
    assert seen["disparity"] == pytest.approx(disparity_from_depth(z, RgbdModel()))
    return describe_dot(RgbdModel(), z)


def blur(shift: float, seen: dict) -> str:
    part, along = half_turn()
    scans, lidar = part.scans(), part.robot.lidar
    points = [
        transform_points(along.at(t + shift), scan_points(ranges, lidar))
        for t, ranges in zip(scans.t[::16], scans.ranges[::16], strict=True)
    ]
    cells = len(np.unique(np.floor(np.concatenate(points) / 0.05), axis=0))
    assert seen["count"] == pytest.approx(cells, abs=2)  # a page has a millionth of a metre
    return f"Scans with stamps moved by {shift:.2f} s: the walls need {seen['count']} cells."


def lever(ahead: float, seen: dict) -> str:
    scans, path, drawn = hall().scans(), dead_reckoning(hall()), hall().robot.lidar.position_b[0]

    def cells(place: float) -> int:
        lidar = replace(hall().robot.lidar, position_b=(place, 0.0, 0.5))
        turn = range(3382, 3542, 8)  # the half turn that the chapter finds
        points = [transform_points(path.at(scans.t[i]), scan_points(scans.ranges[i], lidar)) for i in turn]
        return len(np.unique(np.floor(np.concatenate(points) / 0.02), axis=0))

    places = np.arange(-0.3, 0.41, 0.02)
    counts = [cells(place) for place in places]
    np.testing.assert_allclose(seen["counts"], counts, atol=3)  # a page has a millionth of a metre
    assert seen["count"] == pytest.approx(cells(ahead), abs=3)
    return f"""Left: cells hit against the place of the LiDAR, least at {places[np.argmin(counts)]:.2f} m; the drawing
    says {drawn:.2f} m. Right: the walls of one turn with the LiDAR {ahead:.2f} m ahead of the centre, in
    {seen["count"]} cells."""


def beam(end: tuple, seen: dict) -> str:
    start, spec = np.array([0, 0]), GridSpec((-0.5, -0.5), 1.0, (6, 9))
    ray = trace_rays(start, np.array([end]))
    np.testing.assert_array_equal(numbers(seen["ray"]).reshape(-1, 2), ray)
    along = spec.world_to_cell(np.linspace(0, 1, 5000)[:, None] * end)
    cut = len(np.unique(along, axis=0)) - len(ray) - 1
    way = f": ({'), ('.join(f'{x}, {y}' for x, y in ray)})" if len(ray) else ""
    return f"""A beam from cell (0, 0) to ({end[0]}, {end[1]}), which is hit. Bresenham's line takes {len(ray)} cells on
    the way{way}. The beam also cuts corners of {cut} other cells."""


CASES = [
    *(
        ("beam", {"end-in-column": str(x), "end-in-row": str(y)}, lambda seen, end=(x, y): beam(end, seen))
        for x, y in [(7, 3), (2, 5), (5, 4), (8, 0)]
    ),
    ("scrub", {"time": "62"}, lambda seen: ch00.describe_scrub(hall(), 62.0)),
    ("scrub", {"time": "14"}, lambda seen: ch00.describe_scrub(hall(), 14.0)),
    ("scrub", {"time": "116"}, lambda seen: ch00.describe_scrub(hall(), 116.0)),
    *(
        (
            "turn",
            {"drawn-with": way, "turned-by": str(degrees)},
            lambda seen, w=way, d=degrees: turn(w, d, seen),
        )
        for way, degrees in zip(ch00.WAYS, (360, 0, 95, 215), strict=True)
    ),
    ("late", {"clock-offset": "150"}, lambda seen: late(150.0, seen)),
    ("late", {"clock-offset": "-300"}, lambda seen: late(-300.0, seen)),
    ("smoothing", {}, lambda seen: smoothing(0.5, seen)),
    ("smoothing", {"averaged-over-the-last": "0"}, lambda seen: smoothing(0.0, seen)),
    ("smoothing", {"averaged-over-the-last": "2.35"}, lambda seen: smoothing(2.35, seen)),
    ("sharpness", {"sharpness-b-of-a-scan": "0"}, lambda seen: sharpness(0.0, seen)),
    ("sharpness", {"sharpness-b-of-a-scan": "731"}, lambda seen: sharpness(731.0, seen)),
    ("dot", {"wall-at": "0.5"}, lambda seen: dot(0.5, seen)),
    ("dot", {"wall-at": "6.35"}, lambda seen: dot(6.35, seen)),
    ("blur", {"clock-offset": "0"}, lambda seen: blur(0.0, seen)),
    ("blur", {"clock-offset": "-0.17"}, lambda seen: blur(-0.17, seen)),
    ("lever", {}, lambda seen: lever(-0.2, seen)),
    ("lever", {"lidar-ahead-of-the-centre-by": "0.16"}, lambda seen: lever(0.16, seen)),
]
SEEN = f"""settings => {{
  const {{stage, state}} = {LAB}, plain = value => ArrayBuffer.isView(value) ? Array.from(value) : value;
  stage.set(settings);
  const {{panels, ...seen}} = state.seen;
  return {{...Object.fromEntries(Object.entries(seen).map(([key, value]) => [key, plain(value)])),
          panels: panels.map(({{name, points}}) => ({{name, points}}))}};
}}"""
NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?")


def numbers(values) -> np.ndarray:
    return np.array(values, dtype=float)


def same_words(found: str, expected: str) -> None:
    """The same sentence, but for the last digit of a number: what the page gets is rounded."""
    assert NUMBER.sub("#", found) == NUMBER.sub("#", expected)
    for ours, theirs in zip(NUMBER.findall(found), NUMBER.findall(expected), strict=True):
        digit = 10.0 ** -len(theirs.partition(".")[2])
        assert float(ours) == pytest.approx(float(theirs), abs=1.01 * digit), (found, expected)


@pytest.mark.parametrize(("name", "settings", "expected"), CASES)
def test_the_page_computes_what_the_package_computes(open_picture, name, settings, expected):
    page = open_picture(name, reduced_motion="reduce")
    seen = page.evaluate(SEEN, settings)
    same_words(seen["words"], " ".join(expected(seen).split()))


def test_every_picture_has_its_cases():
    assert {name for name, _, _ in CASES} == set(PICTURES)


# ---- for fingers, keys and small screens


@pytest.mark.parametrize("name", PICTURES)
@pytest.mark.parametrize("by", ["finger", pytest.param("key", marks=nightly)])
def test_a_slider_draws_at_once_wherever_it_stands(open_picture, name, by):
    page = open_picture(name, reduced_motion="reduce", **(PHONE if by == "finger" else {}))
    slider = page.get_by_role("slider").first
    low, high, step, _ = slider.evaluate("s => [s.min, s.max, s.step, s.value].map(Number)")
    pictures, values = [page.evaluate(DRAWN)], [float(slider.input_value())]
    if by == "key":
        for key in ("Home", "ArrowRight", "ArrowUp", "End", "ArrowLeft"):
            slider.press(key)
            pictures.append(page.evaluate(DRAWN))
            values.append(float(slider.input_value()))
        assert values[1:] == pytest.approx([low, low + step, low + 2 * step, high, high - step])
        assert len(set(pictures[1:])) == 5
        return
    slider.scroll_into_view_if_needed()
    box = slider.bounding_box()
    at = (values[0] - low) / (high - low)
    parts = np.linspace(at, 0.9 if at < 0.5 else 0.1, 12)
    x, y = box["x"] + 8 + parts * (box["width"] - 16), box["y"] + box["height"] / 2
    pictures += [page.evaluate(DRAWN) for _ in touching(page, [(part, y) for part in x])]
    places = abs(parts[-1] - at) * (high - low) / step
    assert len(set(pictures)) >= min(9, places), "it follows the finger"


@pytest.mark.parametrize("name", PICTURES)
@pytest.mark.parametrize("width", [pytest.param(1280, marks=nightly), 390])
def test_a_picture_and_at_most_three_controls_are_seen_together(open_picture, name, width):
    page = open_picture(name, "shut", width=width)
    high, controls = page.evaluate("""() => {
      const seen = kinds => [...document.querySelectorAll(kinds)].filter(
        e => e.checkVisibility({contentVisibilityAuto: true}));
      const controls = 'button, .pfslam-slider, fieldset';
      const boxes = seen(`canvas, .pfslam-line:not(:empty), ${controls}`).map(e => e.getBoundingClientRect());
      return [Math.max(...boxes.map(b => b.bottom)) - Math.min(...boxes.map(b => b.top)), seen(controls).length]; }""")
    assert controls <= 3
    assert high <= 844 - 56
    assert page.evaluate(WIDTH_BEYOND_SCREEN) <= 0


# ---- what stands in a picture is taken hold of itself

# The panel with the thing, the slider that it stands for, and a place of the panel to which it is dragged.
GRIPS = {
    "beam": (0, "End in column", (3.2, 3.9), 3),
    "dot": (0, "Wall at", (4.0, 0.04), 4.0),
    "lever": (0, "LiDAR ahead of the centre by", (0.16, 6000), 0.16),
    "scrub": (3, "Time", (90.0, 0.5), 90.0),
    "smoothing": (0, "Averaged over the last", (None, 0.1), 2.0),
    "turn": (0, "Turned by", (0.6, 1.1), 90),
}
GRIP = f"""([panel, place]) => {{
  const {{state, at, stage}} = {LAB}, {{grip, x}} = state.seen.panels[panel];
  const box = stage.sheets[0].canvas.getBoundingClientRect();
  const middle = [(grip[0] + grip[2]) / 2, (grip[1] + grip[3]) / 2], [to, high] = place;
  const places = [middle, [to === null ? (x[0] + x[1]) / 2 - 2 : to, high]];
  return places.map(one => at(panel, ...one)).map(([px, py]) => [box.left + px, box.top + py]);
}}"""


def test_a_picture_has_sliders_in_view_only_for_what_cannot_be_touched(open_picture):
    for name in PICTURES:
        page = open_picture(name, "shut")
        assert page.get_by_role("slider").count() == (name not in GRIPS), name
        assert (page.locator(".pfslam-line").text_content() == "") == (name not in GRIPS), name


@pytest.mark.parametrize("name", sorted(GRIPS))
@pytest.mark.parametrize("by", ["mouse", "finger"])
def test_a_thing_in_a_picture_is_dragged(open_picture, name, by):
    panel, label, place, value = GRIPS[name]
    page = open_picture(name, **(PHONE if by == "finger" else {}))
    slider, before = page.get_by_role("slider", name=label), page.evaluate(f"{LAB}.state.seen.words")
    page.locator("canvas").scroll_into_view_if_needed()
    there = page.evaluate(GRIP, [panel, place])
    path = np.linspace(*there, 12)
    if by == "mouse":
        page.mouse.move(*there[0])
        assert page.evaluate("document.querySelector('canvas').style.cursor") == "grab"
        page.mouse.down()
        for x, y in path:
            page.mouse.move(x, y)
        page.mouse.up()
    else:
        list(touching(page, path))
    low, high = slider.evaluate("s => [s.min, s.max].map(Number)")
    assert float(slider.input_value()) == pytest.approx(value, abs=0.04 * (high - low))
    assert page.evaluate(f"{LAB}.state.seen.words") != before
    assert float(slider.input_value()) == page.evaluate(f"key => {LAB}.state.values[key]", KEYS[name])


KEYS = {"beam": "ix", "dot": "z", "lever": "ahead", "scrub": "time", "smoothing": "seconds", "turn": "turned"}


@pytest.mark.parametrize("name", sorted(GRIPS))
def test_a_thing_in_a_picture_is_moved_by_keys_as_its_help_says(open_picture, name):
    page = open_picture(name, "shut", reduced_motion="reduce")
    plan, value = page.locator(".pfslam-plan"), f"{LAB}.state.values.{KEYS[name]}"
    assert "Keys: " in page.locator(f"#{plan.get_attribute('aria-describedby')}").text_content()
    step = page.evaluate("Number([...document.querySelectorAll('input[type=range]')][0].step)")
    plan.focus()
    start = page.evaluate(value)
    for key in ("ArrowLeft", "ArrowRight"):
        page.keyboard.press(key)
        page.keyboard.press(key)
        moved, start = page.evaluate(value) - start, page.evaluate(value)
        assert abs(moved) in (0, pytest.approx(step), pytest.approx(2 * step))  # 0 at an end
    assert page.evaluate("document.activeElement === document.querySelector('.pfslam-plan')")
    assert moved != 0


@pytest.mark.parametrize("name", sorted(GRIPS))
def test_a_second_finger_puts_the_thing_back_and_a_swipe_elsewhere_scrolls(open_picture, name):
    page = open_picture(name, below="<div style='height: 3000px'></div>", **PHONE)
    panel, _, place, _ = GRIPS[name]
    value = f"{LAB}.state.values.{KEYS[name]}"
    page.locator("canvas").scroll_into_view_if_needed()
    (x, y), (tx, ty) = page.evaluate(GRIP, [panel, place])
    before, session = page.evaluate(value), page.context.new_cdp_session(page)

    def touch(kind, *points):
        points = [{"x": px, "y": py, "id": k} for k, (px, py) in enumerate(points)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    touch("touchStart", (x, y))
    for part in (0.3, 0.6, 1.0):
        touch("touchMove", (x + part * (tx - x), y + part * (ty - y)))
    assert page.evaluate(value) != before
    touch("touchStart", (tx, ty), (tx + 40, ty + 40))
    touch("touchMove", (tx, ty), (tx + 60, ty + 60))
    touch("touchEnd")
    assert page.evaluate(value) == before
    top, box = page.evaluate("scrollY"), page.locator("canvas").bounding_box()
    x, y = box["x"] + 10, box["y"] + 0.9 * box["height"]
    list(touching(page, [(x, y - 12 * k) for k in range(16)]))
    page.wait_for_function(f"scrollY > {top} + 50")
    assert page.evaluate(value) == before


def test_a_picture_plays_to_its_end_and_steps_for_who_wants_no_motion(open_picture):
    page = open_picture("dot")
    page.locator("summary").click()  # what is folded plays, too
    page.get_by_role("button", name="Start", exact=True).click()
    page.wait_for_function("() => Number(document.querySelector('input[type=range]').value) > 1.5")
    page.get_by_role("button", name="Pause", exact=True).click()
    page = open_picture("turn", reduced_motion="reduce")
    assert page.get_by_role("button", name="Start", exact=True).count() == 0
    step = page.get_by_role("button", name="Step")
    for _ in range(12):
        step.click()
    assert page.get_by_role("slider").input_value() == "360"
    step.click()
    assert page.get_by_role("slider").input_value() == "0"


SPECKS = """() => {
  const canvas = document.createElement('canvas'), context = canvas.getContext('2d'), at = (x, y) => [x, y];
  Object.assign(canvas, {width: 24, height: 12});
  context.setTransform(2, 0, 0, 2, 2, 0);  // two pixels to a unit, one unit to the right
  context.beginPath();
  context.rect(-1, 0, 10, 6);
  context.clip();
  context.globalAlpha = 0.5;
  pfslam.draw.specks({context, at}, [2, 2, 2, 2, -1, 5.5, 8.5, 1, 10.5, 1, 50, 50, NaN, NaN], '#ff0000', 1.4);
  pfslam.draw.specks({context, at}, [50, 50], '#ff0000', 1.4);
  const {data} = context.getImageData(0, 0, 24, 12), seen = [];
  for (let k = 3; k < data.length; k += 4) if (data[k]) seen.push([(k >> 2) % 24, Math.floor((k >> 2) / 24), data[k]]);
  return seen;
}"""


def test_specks_are_squares_at_their_points_as_far_as_the_sheet_and_its_clip_go(open_picture):
    """Three pixels a side; two in one place are no darker. The clip cuts the third off after column 19."""
    whole, at_the_edge, cut = ((5, 8), (3, 6)), ((0, 2), (10, 12)), ((18, 20), (1, 4))
    squares = [
        (x, y) for across, down in (whole, at_the_edge, cut) for x in range(*across) for y in range(*down)
    ]
    seen = open_picture("dot").evaluate(SPECKS)
    assert sorted((x, y) for x, y, _ in seen) == sorted(squares)
    assert {alpha for *_, alpha in seen} <= {127, 128}
