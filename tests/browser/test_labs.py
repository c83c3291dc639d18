"""The laboratories, one story each, by mouse, finger and key: it ends where the package says; for everybody; quiet."""

import re
from dataclasses import replace
from itertools import pairwise

import fifteen_cells
import numpy as np
import pytest
from dice import Handed
from headless import PAINTED, PHONE, WIDTH_BEYOND_SCREEN, touching, violations
from lab_stills import MOMENTS
from lab_stills import page as lab_page
from pfslam_book.exercises.ch03 import CELLS, STEP, predict_belief, update_belief
from pfslam_book.show.lab import FOLDER
from pfslam_book.show.style import COLOURS

from pfslam.beyond.localization import KnownMap, LocalizationConfig
from pfslam.beyond.loops.graph import Edges, chi_square, gauss_newton_step, robust_weights
from pfslam.cli import viewer
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import LOG_4, GridSpec, MapConfig, OccupancyGrid, integrate_scan
from pfslam.motion import Controls, integrate, motion_model
from pfslam.particles import (
    ControlNoise,
    Particles,
    effective_sample_size,
    predict,
    reweight,
    systematic_resample,
)
from pfslam.poses import Trajectory, average_pose, compose, transform_points, wrap_angle
from pfslam.refined.field import TOP, score_field
from pfslam.refined.noise import MotionNoise
from pfslam.sensors import LidarModel, RgbdModel, scan_points
from pfslam.texture import NO_READING, associate_rgb, back_project, depth_from_disparity, to_world

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("laboratories")]

LABS = sorted(path.name[4:-3] for path in FOLDER.iterdir() if path.name.startswith("lab_"))
LAB = "document.querySelector('figure.pfslam-lab').lab"
STATUS = "document.querySelector('[role=status]').textContent"
FIRST_PICTURES = "[...document.querySelectorAll('canvas')].map(c => c.toDataURL()).join()"
READY = f"() => {LAB}?.stage.fitted && {LAB}.state.ready !== false"
# Parts of the state by name, a function called, with typed arrays and sets as lists.
SEE = f"""names => {{
  const {{state, constants}} = {LAB};
  const plain = value => ArrayBuffer.isView(value) || Array.isArray(value) || value instanceof Set
    ? Array.from(value, plain) : value && typeof value === 'object'
    ? Object.fromEntries(Object.entries(value).map(([name, part]) => [name, plain(part)])) : value;
  const part = name => name === 'constants' ? constants : state[name];
  return Object.fromEntries(names.map(
    name => [name, plain(typeof part(name) === 'function' ? state[name]() : part(name))]));
}}"""
TRUE_START = 1  # of the robot in the corridor of fifteen cells


@pytest.fixture
def open_lab(open_file, tmp_path):
    """Open one laboratory on a page of its own: ``open_lab("drive", {"small": True}, width=390)``."""

    def go(name: str, options=None, theme: str = "light", below: str = "", **context):
        place = tmp_path / f"{name}.html"
        page = lab_page(name, options, theme).replace("</main>", below + "</main>")
        place.write_text(page, encoding="utf-8")
        page = open_file(place, READY, **context)
        page.evaluate("document.querySelectorAll('details').forEach(box => { box.open = true; })")
        return page

    return go


class Hand:
    """A reader before one laboratory, with a mouse, a finger on a phone, or keys alone."""

    def __init__(self, page, by: str):
        self.page, self.by = page, by

    def see(self, *names: str) -> dict:
        return self.page.evaluate(SEE, names)

    def hears(self, words: str) -> None:
        """Wait until the laboratory says so to who listens."""
        self.page.wait_for_function(f"words => {STATUS}.includes(words)", arg=words)

    def wait(self, condition: str) -> None:
        self.page.wait_for_function(f"() => {{ const state = {LAB}.state; return {condition}; }}")

    def point(self, target, **options) -> None:
        (target.tap if self.by == "finger" else target.click)(**options)

    def keys(self, *keys: str, plan: int = 0) -> None:
        self.page.locator(".pfslam-plan").nth(plan).focus()
        for key in keys:
            self.page.keyboard.press(key)

    def press(self, name: str, key: str, times: int = 1) -> None:
        """A button, or the key that stands for it."""
        for _ in range(times):
            if self.by == "key":
                self.keys(key)
            else:
                self.point(self.page.get_by_role("button", name=name, exact=True))

    def choose(self, label: str) -> None:
        control = self.page.get_by_label(re.compile(rf"^\s*{re.escape(label)}"))  # its key comes after it
        if self.by == "key":
            control.press("Space")
        else:
            self.point(control)

    def slide(self, name: str, value: float) -> None:
        """A slider to a value, or to the pixel that is nearest."""
        slider = self.page.get_by_role("slider", name=name)
        low, high, step, now = slider.evaluate("s => [s.min, s.max, s.step, s.value].map(Number)")
        if self.by == "key":
            if value in (low, high):
                slider.press("Home" if value == low else "End")
                return
            for _ in range(round(abs(value - now) / step)):
                slider.press("ArrowRight" if value > now else "ArrowLeft")
        else:
            box = slider.bounding_box()
            x = (value - low) / (high - low) * (box["width"] - 1)
            self.point(slider, position={"x": x, "y": 0.5 * box["height"]})
        assert float(slider.input_value()) == pytest.approx(value, abs=0.06 * (high - low))

    def window(self, sheet: int = 0) -> list[float]:
        """What a plan shows: x from, to, y from, to."""
        return self.page.evaluate(f"{LAB}.stage.sheets[{sheet}].window")

    def pixel(self, place, sheet: int) -> tuple:
        """A canvas, and where on it a place of the plan is."""
        stage = f"{LAB}.stage.sheets[{sheet}]"
        canvas = self.page.evaluate_handle(f"{stage}.canvas").as_element()
        canvas.scroll_into_view_if_needed()
        return canvas, self.page.evaluate(f"place => {stage}.at(...place)", list(place))

    def tap(self, *place: float, sheet: int = 0) -> None:
        canvas, (x, y) = self.pixel(place, sheet)
        self.point(canvas, position={"x": x, "y": y})

    def drag(self, *places, sheet: int = 0) -> None:
        """Press at the first place, go to the others, let go."""
        box = self.pixel(places[0], sheet)[0].bounding_box()
        path = [np.add(self.pixel(place, sheet)[1], (box["x"], box["y"])).tolist() for place in places]
        if self.by == "mouse":
            self.page.mouse.move(*path[0])
            self.page.mouse.down()
            for place in path[1:]:
                self.page.mouse.move(*place, steps=8)
            self.page.mouse.up()
            return
        between = [np.linspace(a, b, 9)[1:] for a, b in pairwise(path)]
        list(touching(self.page, [path[0], *np.concatenate(between)]))


@pytest.fixture
def lab(open_lab):
    """A laboratory and the hand that works in it: ``lab("drive", "finger")``."""

    def go(name: str, by: str = "mouse", options=None) -> Hand:
        return Hand(open_lab(name, options, **(PHONE if by == "finger" else {})), by)

    return go


nightly = pytest.mark.nightly
by_each_hand = pytest.mark.parametrize(
    "by", ["mouse", pytest.param("finger", marks=nightly), pytest.param("key", marks=nightly)]
)


def spec_of(constants: dict) -> GridSpec:
    spec = constants["SPEC"]
    return GridSpec(tuple(spec["origin"]), spec["resolution"], tuple(spec["shape"]))


def lidar_of(constants: dict) -> LidarModel:
    names = {"angle_min": "angleMin", "angle_max": "angleMax", "beams": "beams"}
    names |= {"range_min": "rangeMin", "range_max": "rangeMax"}
    model, position = constants["LIDAR"], constants["LIDAR"].get("position", (0.0, 0.0))
    return LidarModel(**{ours: model[theirs] for ours, theirs in names.items()}, position_b=(*position, 0.0))


# ---- Drive: the whole filter, from the package's functions, along the record of a drive


class Replay:
    def __init__(self, constants: dict, particles: int):
        self.constants, self.spec, self.lidar = constants, spec_of(constants), lidar_of(constants)
        self.grid, self.cloud = OccupancyGrid.empty(self.spec), Particles.at(constants["START"], particles)

    @property
    def estimate(self) -> np.ndarray:
        return average_pose(self.cloud.poses, self.cloud.weights)

    def take(self, event: dict) -> None:
        n = len(self.cloud)
        if "normals" in event:
            noise, dice = event["sigmas"], Handed(event["normals"][:n], event["normals"][n:])
            noise = ControlNoise(noise["sigmaV"], noise["sigmaOmega"], noise["perRootSecond"])
            self.cloud = predict(self.cloud, event["v"], event["omega"], event["dt"], noise, dice)
        elif "ranges" in event:
            self.ranges = np.array(event["ranges"])
            self.points_b = scan_points(self.ranges, self.lidar)
        elif "sharpness" in event:
            self.score(event["sharpness"])
        elif "u" in event:
            ancestors = systematic_resample(self.cloud.weights, Handed(event["u"]))
            self.cloud = Particles(self.cloud.poses[ancestors], np.zeros(n))
        elif "free" in event:
            self.draw(event["free"])
        elif "particles" in event:
            chosen = np.arange(event["particles"]) % n
            self.cloud = Particles(self.cloud.poses[chosen], self.cloud.log_weights[chosen])

    def score(self, sharpness: float) -> None:
        few = self.points_b[:: self.constants["EVERY"]]
        field, scores = score_field(self.grid.occupied), []
        for points_w in transform_points(self.cloud.poses, few):
            cells = self.spec.world_to_cell(points_w)
            ix, iy = cells[self.spec.contains(cells)].T
            scores.append(field[iy, ix].sum())
        self.cloud, _ = reweight(self.cloud, sharpness * np.array(scores) / (len(few) * TOP))

    def draw(self, free: float) -> None:
        hit, clamp = self.constants["HIT"], self.constants["CLAMP"]
        config = MapConfig(self.spec.resolution, hit, free, clamp, rays="bresenham")
        sensor = transform_points(self.estimate, np.array([self.lidar.position_b[:2]]))[0]
        points_w = transform_points(self.estimate, self.points_b)
        beams = np.flatnonzero(self.lidar.valid(self.ranges))
        integrate_scan(self.grid, points_w, beams, sensor, config)


def the_filter_agrees(hand: Hand) -> dict:
    """What the browser shows is what the package computes from the same moves and the same random numbers."""
    found = hand.see("trace", "poses", "weights", "nEff", "estimate", "grid", "settings", "constants")
    replay = Replay(found["constants"], 200)
    for event in found["trace"]:
        replay.take(event)
    np.testing.assert_allclose(found["estimate"], replay.estimate, atol=1e-9)
    np.testing.assert_allclose(np.reshape(found["poses"], (-1, 3)), replay.cloud.poses, atol=1e-9)
    assert found["nEff"] == pytest.approx(effective_sample_size(replay.cloud.weights))
    np.testing.assert_array_equal(found["grid"]["logOdds"], replay.grid.log_odds.ravel())
    assert len(replay.cloud) == found["settings"]["particles"]
    return found


@by_each_hand
def test_drive(lab, by):
    hand = lab("drive", by, {"trace": True, "empty": True})
    if by == "key":
        hand.keys()
        for key, ticks in (("ArrowUp", 60), ("ArrowLeft", 30)):  # the first starts the clock, too
            hand.page.keyboard.down(key)
            hand.wait(f"state.ticks >= {hand.see('ticks')['ticks'] + ticks}")
            hand.page.keyboard.up(key)
    else:
        hand.press("Start", " ")
        hand.wait("state.ticks >= 60")
        x0, x1, y0, y1 = hand.window()
        hand.tap((x0 + x1) / 2, (y0 + y1) / 2)  # a place in the corridor
        hand.wait("state.ticks >= 120")
    assert not hand.page.get_by_label("Autopilot").is_checked(), "who taps or steers drives"
    hand.slide("Particles", 400)
    hand.press("Pause", " ")
    found = the_filter_agrees(hand)
    assert found["settings"]["particles"] > 300
    for name, key in (("Predict", "p"), ("Score", "s"), ("Score", "s")):
        hand.press(name, key)
    found = the_filter_agrees(hand)
    assert found["nEff"] < 0.95 * found["settings"]["particles"]
    assert np.hypot(*np.subtract(found["estimate"], found["constants"]["START"])[:2]) > 0.4
    hand.press("Resample", "r")
    found = the_filter_agrees(hand)
    assert found["nEff"] == pytest.approx(found["settings"]["particles"])
    hand.press("Start again", "n")
    assert hand.see("trace")["trace"] == []


DRIVE_THERE = f"""([x, y]) => {{
  const drive = {LAB}.state;
  drive.goTo(x, y);
  for (let k = 0; k < 60 * 60 && drive.way.length; k++) drive.tick(false);
  return [drive.refused, Math.hypot(drive.truth[0] - x, drive.truth[1] - y)];
}}"""


def test_a_tapped_place_is_reached_or_refused_in_words(lab):
    page, rng, refused = lab("drive", options={"empty": True}).page, np.random.default_rng(0), 0
    for place in rng.uniform([0.0, 0.0], [9.0, 6.0], (60, 2)).tolist():
        words, away = page.evaluate(DRIVE_THERE, place)
        refused += bool(words)
        assert words in ("There is no room for the robot.", "No way leads there.") or away < 0.7
    assert 0 < refused < 12
    assert page.evaluate(DRIVE_THERE, [8.3, 5.3])[0], "inside a box"
    assert page.evaluate(DRIVE_THERE, [6.0, 7.0])[0], "outside the building"


def test_who_was_carried_away_is_told_and_put_back(lab):
    hand = lab("drive", options={"small": True})
    hand.press("Now you drive", "5")
    hand.wait("state.looks > 20")
    hand.press("Hold", " ")
    before = hand.see("truth", "poses", "grid")
    hand.press("Kidnap", "k")
    hand.hears("the robot was carried away")
    assert hand.see("truth") != before["truth"]
    hand.press("Put it back", "k")
    assert hand.see("truth", "poses", "grid") == before


def test_the_floor_is_painted_where_the_robot_was(lab):
    page = lab("drive", options={"small": True}).page
    page.get_by_role("button", name="Now you drive").click()
    count = f"() => {LAB}.state.floor.data.filter((value, k) => k % 4 === 3 && value).length"
    page.evaluate(f"() => {{ for (let k = 0; k < 120; k++) {LAB}.state.tick(); }}")
    few = page.evaluate(count)
    page.evaluate(f"() => {{ for (let k = 0; k < 3000; k++) {LAB}.state.tick(); }}")
    assert page.evaluate(count) > 5 * few > 0


@pytest.mark.parametrize("name", LABS)
def test_a_swipe_up_scrolls_the_page_and_changes_nothing(open_lab, name):
    page = open_lab(name, **PHONE, below="<div style='height: 3000px'></div>")
    state = f"""() => JSON.stringify({LAB}.state, (key, value) =>
      ['trace', 'parts', 'picture', 'canvas'].includes(key) ? null
      : ArrayBuffer.isView(value) ? Array.from(value) : value)"""
    canvas = page.locator(".pfslam-plan canvas").first
    canvas.scroll_into_view_if_needed()
    box, before, top = canvas.bounding_box(), page.evaluate(state), page.evaluate("scrollY")
    x, y = box["x"] + 0.05 * box["width"], box["y"] + 0.9 * box["height"]
    list(touching(page, [(x, y - 12 * k) for k in range(16)]))
    page.wait_for_function(f"scrollY > {top} + 50")
    assert page.evaluate(state) == before
    assert page.evaluate(f"!{LAB}.stage.beat?.running")


@pytest.mark.parametrize("name", ["calibrate", "drive"])
def test_a_swipe_across_a_slider_scrolls_the_page_and_leaves_it_where_it_was(open_lab, name):
    page = open_lab(name, **PHONE, below="<div style='height: 3000px'></div>")
    slider = page.get_by_role("slider").first
    slider.scroll_into_view_if_needed()
    page.evaluate("scrollBy(0, 60)")
    box, before, top = slider.bounding_box(), slider.input_value(), page.evaluate("scrollY")
    x, y = box["x"] + 0.25 * box["width"], box["y"] + box["height"] / 2
    list(touching(page, [(x + 2 * k, y - 12 * k) for k in range(16)]))
    page.wait_for_function(f"scrollY > {top} + 50")
    assert slider.input_value() == before


@pytest.mark.parametrize(
    ("name", "pose", "thing", "sheet"),
    [
        ("slide", "[...state.shift, state.turn]", "state.pose", 0),
        ("journey", "state.settings.pitch", f"{LAB}.ring(state.settings.pitch)", 1),
        ("lost", "[state.settings.pushed, ...state.truth]", "state.heart", 0),
        ("lost", "[state.settings.pushed, ...state.truth]", "state.truth", 0),
    ],
)
def test_a_second_finger_cancels_what_the_first_has_begun(open_lab, name, pose, thing, sheet):
    page = open_lab(name, **PHONE)
    pose = f"(({{state}}) => {pose})({LAB})"
    before, canvas = page.evaluate(pose), page.locator(".pfslam-plan canvas").nth(sheet)
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    x, y = page.evaluate(f"(({{state, stage}}) => stage.sheets[{sheet}].at(...{thing}))({LAB})")
    first, second = (box["x"] + x, box["y"] + y), (box["x"] + x + 60, box["y"] + y + 60)
    session = page.context.new_cdp_session(page)

    def touch(kind, *points):
        session.send(
            "Input.dispatchTouchEvent",
            {"type": kind, "touchPoints": [{"x": px, "y": py, "id": k} for k, (px, py) in enumerate(points)]},
        )

    touch("touchStart", first)
    touch("touchMove", (first[0] - 8, first[1]))
    assert page.evaluate(pose) != before
    touch("touchStart", (first[0] - 8, first[1]), second)
    for k in range(2, 10):
        touch("touchMove", (first[0] - 8 * k, first[1]), (second[0] + 8 * k, second[1]))
    touch("touchEnd")
    assert page.evaluate(pose) == before


def test_a_laboratory_that_is_built_before_its_style_sheet_is_not_black(open_lab):
    page = open_lab("grow")
    dark = """() => { const {canvas} = document.querySelector('figure.pfslam-lab').lab.stage.sheets[0];
      const {data} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
      let black = 0; for (let k = 0; k < data.length; k += 4) black += data[k] + data[k + 1] + data[k + 2] < 3;
      return black / (data.length / 4); }"""
    assert page.evaluate(dark) < 0.2
    page.evaluate("""() => {
      const sheets = [...document.querySelectorAll('link[rel=stylesheet]')];
      const old = document.querySelector('figure.pfslam-lab');
      sheets.forEach(sheet => { sheet.disabled = true; });
      const figure = document.createElement('figure'), options = old.lab.stage.options;
      figure.className = 'pfslam-lab';
      pfslam.mount(figure, 'grow', options);  // as in JupyterLab: not yet on the page, and no style sheet
      setTimeout(() => { old.replaceWith(figure); }, 50);
      setTimeout(() => sheets.forEach(sheet => { sheet.disabled = false; }), 400);
    }""")
    page.wait_for_timeout(1200)
    assert page.evaluate(dark) < 0.2


@nightly
def test_the_same_seed_has_the_same_end(open_lab):
    def end(seed):
        page = open_lab("drive", {"seed": seed, "empty": True})
        return page.evaluate(
            f"() => {{ for (let k = 0; k < 300; k++) {LAB}.state.tick(); return [...{LAB}.state.poses]; }}"
        )

    assert end(1) == end(1) != end(2)


@nightly
def test_the_truth_the_thieves_and_the_walkers_are_seen(lab):
    hand = lab("drive")
    hand.page.evaluate(f"() => {{ for (let k = 0; k < 300; k++) {LAB}.state.tick(); }}")
    picture = hand.page.locator(".pfslam-plan canvas")
    pictures = [picture.evaluate("c => c.toDataURL()")]
    for name in ("Show the truth", "People", "Slippery patch", "Look closely"):
        hand.choose(name)
        hand.page.evaluate(PAINTED)
        pictures.append(picture.evaluate("c => c.toDataURL()"))
    assert len(set(pictures)) == len(pictures)
    before = hand.see("truth")
    hand.press("Kidnap", "k")
    assert hand.see("truth") != before
    hand.hears("off by")


# ---- Fifteen cells: the histogram and the particles of chapter 03


def the_corridor_agrees(hand: Hand, actions: str) -> dict:
    """Belief, cells and weights after looks (l), moves (m) and resamplings (r) are those of the package."""
    found = hand.see("belief", "cells", "weights", "doors", "settings", "trace")
    belief, truth, dice = np.full(CELLS, 1 / CELLS), TRUE_START, iter(found["trace"])
    cells, weights, steps = np.arange(30) // 2, np.full(30, 1 / 30), np.cumsum(list(STEP.values()))
    at_door, at_wall = found["settings"]["atDoor"], found["settings"]["atWall"]
    for action in actions:
        if action == "m":
            truth, belief = (truth + 1) % CELLS, predict_belief(belief, STEP)
            cells = (cells + np.searchsorted(steps, next(dice), "right")) % CELLS
        elif action == "r":
            drawn = np.searchsorted(np.cumsum(weights), next(dice), "right")
            cells, weights = cells[drawn], np.full(30, 1 / 30)
        else:
            likelihood = np.where(np.isin(np.arange(CELLS), found["doors"]), at_door, at_wall)
            likelihood = likelihood if truth in found["doors"] else 1 - likelihood
            belief, weights = (
                update_belief(belief, likelihood),
                update_belief(weights, likelihood[cells]),
            )
    np.testing.assert_allclose(found["belief"], belief, atol=1e-12)
    np.testing.assert_array_equal(found["cells"], cells)
    np.testing.assert_allclose(found["weights"], weights, atol=1e-12)
    hand.hears(f"cell is {np.argmax(belief)} with {belief.max():.2f}")
    return found


@by_each_hand
def test_fifteen_cells(lab, by):
    hand = lab("cells", by, {"trace": True})
    if by == "key":  # away with the doors at 10 and 4, new ones at 7 and 3
        for key, times in (("ArrowRight", 7), ("ArrowRight", 3), ("ArrowLeft", 6), ("ArrowLeft", 1)):
            hand.keys(*times * [key], "Enter")
    else:
        above = hand.window()[3] - 0.3
        hand.tap(10, above)
        hand.tap(7, above)
        hand.drag((4, above), (3, above))
    hand.slide("Right at a door", 0.9)
    for name, key in zip(("Look", "Move", "Look", "Resample", "Move", "Look"), "lmlrml", strict=True):
        hand.press(name, key)
    assert set(the_corridor_agrees(hand, "lmlrml")["doors"]) == {1, 3, 7}
    hand.press("Start again", "n")
    assert hand.see("looks", "moves") == {"looks": 0, "moves": 0}


@nightly
def test_fifteen_cells_without_particles_and_with_chance(lab):
    hand = lab("cells", "key", {"dots": False})
    assert hand.page.get_by_role("button", name="Resample").count() == 0
    hand.choose("The robot slips")
    hand.keys(*40 * ["m"])
    assert hand.see("moves")["moves"] == 40
    assert hand.see("truth")["truth"] != (TRUE_START + 40) % CELLS


# ---- A map for each particle, in fifteen cells with unknown doors


def the_walk_agrees(hand: Hand) -> dict:
    """Particles, weights and maps are those of the package along the record; what is said is true of them."""
    found = hand.see(
        "trace", "cells", "weights", "maps", "settings", "truth", "doors", "chosen", "looks", "moves"
    )
    n, steps = found["settings"]["particles"], np.cumsum(list(fifteen_cells.STEP.values()))
    cells, weights, maps = np.zeros(n, dtype=int), np.full(n, 1 / n), fifteen_cells.blank_maps(n)
    for event in found["trace"]:
        if "numbers" in event:
            cells = (cells + np.searchsorted(steps, event["numbers"], "right")) % CELLS
        elif "sees" in event:
            weights, maps = fifteen_cells.look(
                cells, weights, maps, event["sees"], event["truth"] == 0, not event["shared"]
            )
        else:
            chosen = systematic_resample(weights, Handed(event["u"]))
            cells, weights, maps = cells[chosen], np.full(n, 1 / n), maps[chosen]
    np.testing.assert_array_equal(found["cells"], cells)
    np.testing.assert_allclose(found["weights"], weights, atol=1e-12)
    np.testing.assert_allclose(found["maps"], maps, atol=1e-12)
    right = np.sum((weights @ maps > 0.5) == np.isin(np.arange(CELLS), found["doors"]))
    here = weights[cells == found["truth"]].sum()
    hand.hears(f"{here:.2f} of the weight is in the robot's cell {found['truth']}. ")
    hand.hears(f"right: {right} of {CELLS}.")
    return found


@by_each_hand
def test_a_map_for_each_particle(lab, by):
    hand = lab("maps", by, {"empty": True, "trace": True})
    buttons = {"l": "Look", "m": "Move", "r": "Resample"}
    for key in "lmlmlrml":
        hand.press(buttons[key], key)
    found = the_walk_agrees(hand)
    assert (found["looks"], found["moves"]) == (4, 3)
    if by == "key":
        hand.keys(" ")
        hand.wait("state.moves >= 6")
        hand.keys(" ", "ArrowRight", "ArrowRight", "Enter", "ArrowDown")
    else:
        hand.press("Step", ".", times=20)
        hand.tap(14, hand.window()[3] - 0.2)  # in the corridor
        hand.tap(7, 0.05)  # the last row
    found = the_walk_agrees(hand)
    assert set(found["doors"]) == {1, 4, 10, 3 if by == "key" else 14}
    assert found["chosen"] == (1 if by == "key" else 39)
    hand.choose("One shared map")
    for key in "lmlrl":
        hand.press(buttons[key], key)
    assert len({tuple(one) for one in the_walk_agrees(hand)["maps"]}) == 1


@nightly
def test_the_histories_of_a_round_die_out_and_a_shared_map_goes_wrong(lab):
    hand, right = lab("maps"), {}
    for shared in (False, True):
        left = hand.page.evaluate(
            f"""shared => {{ const walk = {LAB}.state, left = [];
            walk.settings.shared = shared; walk.reset();
            while (walk.moves < 44) {{ walk.step(); left.push([walk.round, walk.histories]); }}
            return left; }}""",
            shared,
        )
        right[shared] = hand.see("right")["right"]
        histories = [count for number, count in left if number == 2]
        assert histories[0] > 2 * histories[-1]
    assert right[False] == CELLS > right[True] + 2


# ---- The journey of a pixel to the floor


def the_pixel_agrees(hand: Hand) -> dict:
    """The pixel at which the laboratory stands goes where the package takes it."""
    found, settings = hand.see("journey")["journey"], hand.see("settings")["settings"]
    others = hand.see("pose", "constants")
    camera, spec = replace(RgbdModel(), pitch=settings["pitch"]), spec_of(others["constants"])
    u, v, d = found["u"], found["v"], found["d"]
    depth = depth_from_disparity(d, camera)
    if not np.isfinite(depth):
        assert found["end"] == "no reading"
        return found
    point_o = back_project(u, v, depth, camera.K)
    point_w = to_world(point_o, np.array(others["pose"]), camera)[0]
    np.testing.assert_allclose(found["colour"], associate_rgb(u, v, d, camera), rtol=1e-12)
    np.testing.assert_allclose(found["optical"], point_o[0], atol=1e-12)
    np.testing.assert_allclose(found["world"], point_w, atol=1e-12)
    floor = abs(point_w[2]) <= settings["tolerance"]
    assert found["end"] == ("floor" if floor else "not floor")
    if floor:
        assert found["cell"] == spec.world_to_cell(point_w[None, :2])[0].tolist()
    hand.hears(f"Pixel {u}, {v}:")
    return found


def line_of_sight(hand: Hand, degrees: float) -> list:
    """Where the ring is, in the side view, that changes the pitch, once it has this pitch."""
    return hand.page.evaluate(f"degrees => {LAB}.ring(degrees * Math.PI / 180)", degrees)


@by_each_hand
def test_the_journey_of_a_pixel(lab, by):
    hand = lab("journey", by)
    distance = hand.page.evaluate(f"{LAB}.state.view(310, 413).depth")
    assert hand.see("journey")["journey"]["depth"] == pytest.approx(distance, abs=0.003), (
        "it is seen where it is"
    )
    if by == "key":
        hand.keys("ArrowRight", "ArrowRight", "ArrowUp", "ArrowLeft", "ArrowDown", "ArrowDown")
    else:
        hand.tap(311.5, -414.5)
    found = the_pixel_agrees(hand)
    assert abs(found["u"] - 311) + abs(found["v"] - 414) <= (0 if by == "key" else 4)
    assert found["end"] == "floor"
    if by == "key":
        hand.keys(*24 * ["ArrowDown"], plan=1)
    else:
        hand.drag(line_of_sight(hand, 18.0), line_of_sight(hand, 20.4), sheet=1)
    tilted = the_pixel_agrees(hand)
    assert np.degrees(hand.see("settings")["settings"]["pitch"]) == pytest.approx(20.4, abs=0.2)
    hand.hears("computed with a pitch of 20.")
    assert tilted["world"][2] < -0.01
    assert tilted["end"] == "not floor"
    hand.slide("Tolerance", 15)
    the_pixel_agrees(hand)
    hand.page.evaluate(f"""() => {{
      const {{state, stage}} = {LAB}, [hole] = state.holes;
      state.choose(hole % 640, Math.floor(hole / 640));
      stage.redraw();
    }}""")
    found = the_pixel_agrees(hand)
    assert (found["d"], found["end"]) == (NO_READING, "no reading")


# ---- A scan slides over the map: the score and its landscape


def the_fit_agrees(hand: Hand) -> dict:
    """The share and the scores of all shifts are those of the package at the pose that the browser shows."""
    found = hand.see("place", "kind", "turn", "shift", "share", "surface", "points_b", "start", "constants")
    spec, points_b = spec_of(found["constants"]), np.reshape(found["points_b"], (-1, 2))
    occupied = np.reshape(found["constants"]["occupied"], spec.shape) > 0
    field = score_field(occupied) / TOP if found["kind"] == "distance" else occupied

    def share(dx, dy):
        pose = np.array(found["start"]) + [dx, dy, np.deg2rad(found["turn"])]
        cells = spec.world_to_cell(transform_points(pose, points_b))
        ix, iy = cells[spec.contains(cells)].T
        return field[iy, ix].sum() / len(cells)

    assert found["share"] == pytest.approx(share(*found["shift"]), abs=1.5 / len(points_b))
    steps = 0.05 * np.arange(-8, 9)
    expected = [share(dx, dy) for dy in steps for dx in steps]
    np.testing.assert_allclose(found["surface"], expected, atol=1.5 / len(points_b))
    return found


@by_each_hand
def test_the_scan_slides(lab, by):
    hand = lab("slide", by)
    before = the_fit_agrees(hand)["share"]
    if by == "key":
        hand.keys(*11 * ["ArrowRight"], "ArrowLeft", *11 * ["ArrowDown"], "ArrowUp")
    else:
        x0, x1, y0, y1 = hand.window()
        x, y = (x0 + x1) / 2, (y0 + y1) / 2
        hand.drag((x, y), (x + 0.8, y), (x + 0.1, y - 0.1))
    hand.slide("Turn", 2.0)
    found = the_fit_agrees(hand)
    np.testing.assert_allclose(found["shift"], [0.1, -0.1], atol=0.025)
    assert found["share"] > 0.6 > before
    hand.press("Start again", "n")
    assert the_fit_agrees(hand)["share"] == before
    if by == "key":
        hand.keys(*5 * ["ArrowRight"], "ArrowUp", "q", "q", "e", "q", plan=1)
        here = [2.6, 4.9, np.deg2rad(10)]
    else:
        hand.tap(4.4, 2.9, sheet=1)
        here = [4.4, 2.9, 0.0]
    found = hand.see("place", "here", "share", "surface")
    assert found["place"] == "anywhere"
    np.testing.assert_allclose(found["here"], here, atol=1e-9 if by == "key" else 0.15)
    assert found["share"] > 0.4, "the beams of one's own place end on the walls of the map"
    if by != "key":
        rows = np.reshape(found["surface"], (17, 17))
        assert rows[8].mean() > 2 * rows[:, 8].mean(), "a ridge along the corridor"
    hand.choose("corridor")
    hand.choose("likelihood field")
    found = the_fit_agrees(hand)
    assert (found["place"], found["kind"], found["share"] > 0.8) == ("corridor", "distance", True)


# ---- A map grows: what each scan says about each cell


def standing(spec: GridSpec, walls: list[float]) -> np.ndarray:
    """Cells of a map through which a wall runs, or along whose border, by points two centimetres apart."""
    cells, beside = np.zeros(spec.shape, dtype=bool), 1e-6 * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    for begin, end in np.reshape(walls, (-1, 2, 2)):
        steps = int(np.ceil(np.hypot(*(end - begin)) / 0.02))
        points = begin + np.arange(steps + 1)[:, None] / steps * (end - begin)
        ix, iy = spec.world_to_cell((points[:, None] + beside).reshape(-1, 2)).T
        cells[iy, ix] = True
    return cells


def the_map_agrees(hand: Hand) -> dict:
    """Map, worn walls and diary are those of the package for the scans that the browser has cast."""
    found = hand.see(
        "trace", "settings", "cell", "diary", "pose", "level", "worn", "area", "grid", "walls", "constants"
    )
    spec, lidar = spec_of(found["constants"]), lidar_of(found["constants"])
    amounts = {name: value * LOG_4 for name, value in found["settings"].items()}
    config = MapConfig(spec.resolution, **amounts, rays="bresenham")
    (ix, iy), diary = found["cell"], []
    grid, hits = OccupancyGrid.empty(spec), np.zeros(spec.shape, dtype=int)
    for number, scan in enumerate(found["trace"], start=1):
        ranges, pose = np.array(scan["ranges"]), np.array(scan["pose"])
        points_w = transform_points(pose, scan_points(ranges, lidar))
        sensor = transform_points(pose, np.array([lidar.position_b[:2]]))[0]
        beams = np.flatnonzero(lidar.valid(ranges))
        alone = OccupancyGrid.empty(spec)
        for one in (alone, grid):
            integrate_scan(one, points_w, beams, sensor, config)
        hits += alone.occupied
        if alone.log_odds[iy, ix]:
            level = pytest.approx(grid.log_odds[iy, ix] / LOG_4)
            diary.append({"scan": number, "hit": bool(alone.occupied[iy, ix]), "level": level})
    np.testing.assert_array_equal(found["grid"]["logOdds"], grid.log_odds.ravel())
    assert found["diary"] == diary
    wall = (hits >= found["constants"]["SEEN"]) & standing(spec, found["walls"])
    assert found["worn"] == pytest.approx(np.mean(~grid.occupied[wall]) if wall.any() else 0.0)
    assert found["area"] == pytest.approx(np.count_nonzero(grid.free) * spec.resolution**2)
    hand.hears(f": {found['area']:.1f} square metres free")
    hand.hears(f"Cell {ix}, {iy}: ")
    return found


@by_each_hand
def test_a_map_grows(lab, by):
    hand = lab("grow", by, {"trace": True})
    hand.press("Step", ".", times=4)
    assert the_map_agrees(hand)["level"] == pytest.approx(2.0), "the door, at the clamp"
    hand.choose("Door open")
    hand.press("Step", ".", times=3)
    before = the_map_agrees(hand)
    assert [entry["hit"] for entry in before["diary"]] == 5 * [True] + 3 * [False]
    assert before["level"] == pytest.approx(-1.0)
    if by == "key":
        hand.keys(*10 * ["ArrowRight"], *18 * ["ArrowDown"], *18 * ["ArrowUp"], *60 * ["ArrowRight"])
    else:
        hand.drag(before["pose"][:2], (1.7, 3.0), (1.7, 1.2), (1.7, 3.0), (7.6, 3.0))
    found = the_map_agrees(hand)
    assert np.hypot(*np.subtract(found["pose"][:2], (7.6, 3.0))) < 0.2
    assert min(scan["pose"][1] for scan in found["trace"]) < 1.5, "through the open door"
    assert found["area"] > before["area"] + 5
    assert found["worn"] > 0.02, "walls wear off where beams graze them"
    hand.slide("Free", 0.1)
    rewritten = the_map_agrees(hand)
    assert len(rewritten["trace"]) == len(found["trace"])
    assert rewritten["worn"] < 0.5 * found["worn"], "weak clearing leaves the walls, in all scans"
    if by == "key":
        hand.keys("d", "d", "w", "a", "s", *9 * ["ArrowDown"])
        found, cell = the_map_agrees(hand), [39, 52]
        assert found["pose"][1] > 2.47, "the wall is in the way"
    else:
        hand.tap(3.0, 3.0)
        found, cell = the_map_agrees(hand), [68, 68]
        assert {entry["hit"] for entry in found["diary"]} == {False}
    assert found["cell"] == cell
    hand.press("New map", "n")
    assert len(the_map_agrees(hand)["trace"]) == 1


# ---- A robot is calibrated


def path_error(hand: Hand) -> dict:
    """How far the path is off (m, degrees), and it is said."""
    error = hand.see("error")["error"]
    hand.hears(f"is {error['ateRmse']:.2f} metres (rms)")
    return error


@by_each_hand
def test_the_robot_is_calibrated(lab, by):
    hand = lab("calibrate", by)
    assert path_error(hand)["ateRmse"] > 1
    answer = hand.see("answer")["answer"]
    for name, value in (("Gyro bias", "bias"), ("Gyro scale", "gyro"), ("Wheel scale", "wheels")):
        hand.slide(name, answer[value])
    assert path_error(hand)["ateRmse"] < (0.1 if by == "key" else 0.4)
    hand.choose("Tell the numbers")
    hand.hears(f"The right numbers: gyro bias {answer['bias']:.4f}")
    truth = np.reshape(hand.see("truth")["truth"], (-1, 3))[:, :2]
    if by == "key":
        hand.keys("ArrowLeft", "ArrowLeft", "ArrowRight", "ArrowLeft")
        assert hand.see("moment")["moment"] == len(truth) - 1 - 40
    else:
        hand.tap(*truth[len(truth) // 2])
        assert np.hypot(*(truth[hand.see("moment")["moment"]] - truth[len(truth) // 2])) < 0.15
    hand.press("Another robot", "r")
    other = hand.see("answer")["answer"]
    assert other != answer
    hand.choose("the wheels alone")
    assert not hand.page.get_by_role("slider", name="Gyro bias").is_visible()
    assert path_error(hand)["headingRmse"] > 50, "the tape measure is far off"
    hand.slide("Track width", other["track"])
    assert path_error(hand)["headingRmse"] < 20
    the_path_is_the_packages(hand)


def the_path_is_the_packages(hand: Hand) -> None:
    """What the wheels alone say is added up as the package does, and is as far from the truth."""
    found = hand.see("readings", "guess", "dt", "poses", "truth", "error")
    left, right = (found["guess"]["wheels"] * np.array(found["readings"][side]) for side in ("left", "right"))
    t = found["dt"] * np.arange(len(left) + 1)
    speed, turn = (left + right) / 2 / found["dt"], (right - left) / found["guess"]["track"] / found["dt"]
    path, truth = integrate(Controls(t, speed, turn)), np.reshape(found["truth"], (-1, 3))
    poses = compose(truth[0], path.poses)
    np.testing.assert_allclose(np.reshape(found["poses"], (-1, 3))[:, :2], poses[:, :2], atol=1e-9)
    error = trajectory_error(Trajectory(t, poses), Trajectory(t, truth))
    assert found["error"]["ateRmse"] == pytest.approx(error.ate_rmse_m)


# ---- A cloud grows


def the_cloud_agrees(hand: Hand) -> dict:
    """The particles are those of the package with the same random numbers; what is said is true of them."""
    found = hand.see("poses", "controls", "dice", "noise", "step", "spread", "end", "settings")
    found |= found["controls"]
    noise, n = found["noise"], found["settings"]["particles"]
    noise = ControlNoise(noise["sigmaV"], noise["sigmaOmega"], per_root_second=True)
    cloud = Particles.at(found["start"], n)
    driven = zip(found["v"], found["omega"], found["dice"][: found["step"]], strict=False)
    for v, omega, dice in driven:
        cloud = predict(cloud, v, omega, found["dt"], noise, Handed(dice[:n], dice[n:]))
    np.testing.assert_allclose(np.reshape(found["poses"], (-1, 3)), cloud.poses, atol=1e-9)
    metres = np.sqrt(np.var(cloud.poses[:, :2], axis=0).sum())
    turns = wrap_angle(cloud.poses[:, 2] - average_pose(cloud.poses, cloud.weights)[2])
    assert found["spread"]["metres"] == pytest.approx(metres)
    assert found["spread"]["heading"] == pytest.approx(np.sqrt(np.mean(turns**2)))
    hand.hears(f"are {metres:.2f} metres away")
    return found


def end_of_dead_reckoning(found: dict) -> np.ndarray:
    pose = np.array(found["start"], dtype=float)
    for v, omega in zip(found["v"][: found["step"]], found["omega"], strict=False):
        pose = motion_model(pose, v, omega, found["dt"])
    return pose


@by_each_hand
def test_the_cloud_grows(lab, by):
    hand = lab("cloud", by)
    hand.slide("Particles", 60)
    early = the_cloud_agrees(hand)
    hand.slide("Driven", 80)
    late = the_cloud_agrees(hand)
    assert late["step"] > 2 * early["step"]
    assert late["spread"]["metres"] > 1.2 * early["spread"]["metres"]
    assert late["spread"]["heading"] > 1.2 * early["spread"]["heading"]
    hand.press("New dice", "d")
    assert the_cloud_agrees(hand)["dice"] != late["dice"]
    hand.slide("Yaw rate noise", 0)
    assert the_cloud_agrees(hand)["spread"]["heading"] == pytest.approx(0, abs=1e-9)
    if by == "key":
        hand.keys(*6 * ["ArrowUp"], *6 * ["ArrowLeft"], "ArrowUp")
        there = end_of_dead_reckoning(the_cloud_agrees(hand))
        np.testing.assert_allclose(there[[0, 2]], [3.7, np.pi / 2], atol=1e-9)
        assert 3.4 < there[1] < 3.5 + 1e-9, "a stride, or as far as the wall lets it"
        hand.keys("Backspace")
        assert hand.see("controls")["controls"]["v"] == []
    else:
        hand.drag((1.0, 1.5), (1.7, 1.5), (1.7, 3.0), (5.0, 3.0))
        hand.wait("state.settings.part > 3 && state.settings.part < 90")
        hand.press("Pause", " ")  # the path is driven anew from its beginning
        drawn = the_cloud_agrees(hand)
        np.testing.assert_allclose(drawn["end"][:2], [5.0, 3.0], atol=0.5)
        hand.tap(7.3, 4.8)
        drawn = the_cloud_agrees(hand)
        np.testing.assert_allclose(drawn["end"][:2], [7.3, 4.8], atol=0.2)
        np.testing.assert_allclose(end_of_dead_reckoning(drawn), drawn["end"], atol=1e-9)
    assert hand.page.get_by_label("your own").is_checked()
    hand.choose("through the building")
    hand.press("Back to the start", "n")
    hand.press("Start", " ")
    hand.wait("state.settings.part > 3")
    hand.press("Pause", " ")
    assert the_cloud_agrees(hand)["step"] > 10


# ---- Lost: a known map, and particles all over it


def test_who_is_lost_is_found_as_the_package_finds(lab):
    hand = lab("lost", options={"first": 4000, "trace": True})
    found = hand.see("trace", "constants")
    c, (first,) = found["constants"], found["trace"]
    spec = spec_of(c)
    grid = OccupancyGrid(spec, np.reshape(np.array(c["logOdds"], dtype=np.float32), spec.shape))
    known = KnownMap.of(grid, LocalizationConfig())
    names = ("sigma", "random", "beams")
    assert [c["MODEL"][name] for name in names] == [0.2, 0.1, known.config.effective_beams]

    def weighed(event, log_weights):
        poses, points = (np.reshape(event[name], (-1, n)) for name, n in (("poses", 3), ("points", 2)))
        cloud, _ = reweight(Particles(poses, log_weights), known.log_likelihood(poses, points))
        np.testing.assert_allclose(event["logWeights"], cloud.log_weights, atol=1e-4)

    weighed(first, np.full(4000, -np.log(4000)))
    hand.press("Step", ".", times=6)
    trace, said = hand.see("trace")["trace"], c["NOISE"]
    ours = {"xy_per_metre": "xyPerMetre", "yaw_per_radian": "yawPerRadian", "yaw_per_metre": "yawPerMetre"}
    names = {name: said[theirs] for name, theirs in ({"xy": "xy", "yaw": "yaw"} | ours).items()}
    moves = [event for event in trace if "motion" in event]
    assert len(moves) >= 4
    for event in moves:
        before, normals = (np.reshape(event[name], (-1, 3)) for name in ("before", "normals"))
        motion, noise = np.array(event["motion"]), MotionNoise(**names)
        xy, yaw = noise.sigmas(np.hypot(*motion[:2]), abs(motion[2]))
        after = trace[trace.index(event) + 1]["poses"]
        moved = compose(before, motion + normals * [xy, xy, yaw])
        np.testing.assert_allclose(np.reshape(after, (-1, 3)), moved, atol=1e-9)


def test_a_look_of_twenty_thousand_is_done_in_parts_that_find_the_same_and_no_dot_is_drawn_alone(lab):
    """No frame has to weigh or draw them all: a phone would stand still."""
    weighed, apart, at_once, drawn = lab("lost").page.evaluate("""() => {
      const {core} = pfslam, {lab} = document.querySelector('figure.pfslam-lab'), s = lab.state;
      const counted = (object, names, size) => {
        let sum = 0;
        for (const name of names) {
          const real = object[name];
          object[name] = function (...given) { sum += size(given); return real.apply(this, given); };
        }
        return act => { sum = 0; act(); return sum; };
      };
      const end = () => JSON.stringify([[...s.poses], [...s.logWeights], s.history, s.injected]);
      const drive = (act = () => {}) => {
        s.reset();
        return Array.from({length: 6 * 12 - 1}, () => weighed(() => { s.tick(); act(); }));
      };
      const weighed = counted(core, ['lostLogLikelihood'], given => given[4].length / 3);
      const most = Math.max(...drive()), apart = end();
      drive(() => s.finish());
      const at_once = end(), many = s.poses.length / 3;
      const drawn = counted(CanvasRenderingContext2D.prototype, ['fillRect', 'rect', 'arc'], () => 1);
      return [[most, many], apart, at_once, drawn(() => lab.draw())];
    }""")
    assert weighed[0] <= 4000 < 15000 < weighed[1]
    assert apart == at_once
    assert 100 < drawn < 1000


@by_each_hand
def test_a_door_decides_and_a_kidnapped_robot_is_found_again(lab, by):
    hand = lab("lost", by)
    drive = f"() => {{ for (let k = 0; k < 60 * 40; k++) {LAB}.state.tick(); {LAB}.stage.redraw(); }}"
    hand.page.evaluate(drive)
    here, there = hand.see("shares")["shares"]
    assert here > 0.9 > 0.1 > there
    hand.press("Kidnap", "k")
    hand.wait("state.injected > 0")
    hand.page.evaluate(drive)
    hand.page.evaluate(drive)
    assert sum(hand.see("shares")["shares"]) > 0.8, "at the robot, or at its twin"
    hand.page.evaluate(f"() => {{ {LAB}.state.goTo(7.3, 5); }}")
    assert hand.see("auto")["auto"] is False


@by_each_hand
def test_the_cupboard_is_pushed_and_the_map_does_not_know_it(lab, by):
    hand = lab("lost", by)
    old, walls = hand.see("heart", "walls")["heart"], hand.see("walls")["walls"]
    if by == "key":
        hand.keys(*20 * ["q"])
    else:
        hand.drag(old, (4.5, 3.0), (0.2, 3.4))
    found = hand.see("heart", "walls", "settings", "auto")
    assert found["settings"]["pushed"] == pytest.approx(100, abs=2)
    assert np.sum(np.not_equal(found["walls"], walls).reshape(-1, 4).any(axis=1)) == 4, "one box has moved"
    assert found["auto"], "who pushes does not drive"
    np.testing.assert_allclose(np.add(found["heart"], old), [9, 6], atol=0.2)  # half a turn round
    hand.hears("the map does not know it")
    hand.page.evaluate(f"() => {{ {LAB}.state.carry([0.9, 3.2, 0]); {LAB}.state.push(90); }}")
    assert hand.see("heart")["heart"] == found["heart"], "the robot is in its way"
    thief = "state.carry([4.5, 3, 0]); state.push(90); state.kidnaps = 1; state.kidnap();"
    hand.page.evaluate(f"() => {{ const {{state}} = {LAB}; {thief} }}")
    assert hand.see("truth")["truth"] == [7.4, 5, -1.6], "the cupboard stands at the second place"


# ---- Springs: a pose graph


def relaxed(graph: dict, constants: dict, robust: bool) -> np.ndarray:
    """The poses of the graph by the package's steps, from the same poses as driven."""
    edges, n = graph["edges"], len(graph["poses"])
    made = Edges(
        np.array([e["i"] for e in edges]),
        np.array([e["j"] for e in edges]),
        np.array([e["z"] for e in edges]),
        np.array([np.diag(e["information"]) for e in edges]),
        np.zeros(len(edges)),
        np.array([e["loop"] for e in edges]),
    )
    poses, scale = np.array(graph["poses"]), np.zeros(n)
    widths = [k or np.inf for k in constants["KERNELS"]] if robust else [np.inf] * 10
    for width in np.repeat(widths, constants["ITERATIONS"]):
        chi2 = chi_square(made, poses, scale)
        poses, scale = gauss_newton_step(
            made, poses, scale, np.where(made.doubtful, robust_weights(chi2, width), 1.0)
        )
    return poses


@pytest.mark.parametrize(
    ("boxes", "robust"), [(["True loop"], False), (["True loop", "False loop", "Robust kernel"], True)]
)
def test_springs_settle_where_the_package_says(lab, boxes, robust):
    hand = lab("springs")
    # All at once, so that both begin from the poses as driven.
    names = {"True loop": "honest", "False loop": "false", "Robust kernel": "robust"}
    for name in boxes:
        hand.page.evaluate(f"{LAB}.state.settings['{names[name]}'] = true")
    before = hand.see("poses", "edges", "constants")
    hand.page.evaluate(f"() => {{ {LAB}.state.shake(); {LAB}.stage.redraw(); }}")
    hand.wait("state.settled")
    expected = relaxed(before, before["constants"], robust)
    np.testing.assert_allclose(hand.see("poses")["poses"], expected, atol=1e-3)


@by_each_hand
def test_a_pose_is_pulled_and_a_false_loop_is_let_go(lab, by):
    hand = lab("springs", by)
    start = hand.see("error")["error"]
    hand.choose("True loop")
    hand.wait("state.settled")
    closed = hand.see("error", "poses")
    assert closed["error"] < 0.2 < 1.0 < start
    hand.choose("False loop")
    hand.wait("state.settled")
    assert hand.see("error")["error"] > 1.0
    hand.choose("Robust kernel")
    hand.wait("state.settled")
    assert hand.see("error")["error"] < 0.3
    hand.hears("counts 0.00")
    if by == "key":
        hand.keys("ArrowRight", "ArrowUp", "ArrowUp")
        hand.wait("state.held && state.settled")
        hand.keys("ArrowDown")
    else:
        x, y, _ = hand.see("poses")["poses"][4]
        hand.drag((x, y), (x + 0.5, y - 0.5), (x + 1.0, y - 1.0))
    hand.wait("!state.held && state.settled")
    assert hand.see("error")["error"] < 0.3, "let go, it springs back"


# ---- What happens is seen as it happens; the state is there at once


@pytest.mark.parametrize(("name", "keys"), [("cells", "lrm"), ("maps", "lmlr"), ("grow", ".")])
def test_a_change_is_seen_as_it_happens_and_the_state_is_there_at_once(lab, name, keys):
    hand = lab(name)
    hand.page.clock.install()
    hand.page.clock.pause_at(10**12)
    for key in keys:
        hand.keys(key)
        state = hand.page.evaluate(f"() => JSON.stringify({LAB}.state.weights || {LAB}.state.level)")
        pictures = []
        for _ in range(4):
            pictures.append(hand.page.evaluate(f"() => {{ {LAB}.draw(); return {FIRST_PICTURES}; }}"))
            hand.page.clock.run_for(300)
        after = hand.page.evaluate(f"() => JSON.stringify({LAB}.state.weights || {LAB}.state.level)")
        assert after == state
    assert len(set(pictures)) > 2, "on its way, and there"
    still = [hand.page.evaluate(f"() => {{ {LAB}.draw(); return {FIRST_PICTURES}; }}") for _ in range(2)]
    assert still[0] == still[1] == pictures[-1]


@pytest.mark.parametrize("name", ["cells", "maps"])
def test_with_less_motion_it_is_over_at_once(open_lab, name):
    page = open_lab(name, reduced_motion="reduce")
    for key in "lmlr":
        page.locator(".pfslam-plan").press(key)
        page.evaluate(PAINTED)
    pictures = page.evaluate(FIRST_PICTURES)
    page.wait_for_timeout(300)
    assert page.evaluate(f"() => {{ {LAB}.draw(); return {FIRST_PICTURES}; }}") == pictures


@pytest.mark.parametrize("by", ["mouse", pytest.param("finger", marks=nightly)])
def test_the_end_of_the_path_is_pulled_onto_the_truth(lab, by):
    hand = lab("calibrate", by)
    before = hand.see("apart", "guess")
    here, there = (
        hand.page.evaluate(f"[...{LAB}.state.at({LAB}.state.{way})]") for way in ("poses", "truth")
    )
    hand.drag(here[:2], [(a + b) / 2 for a, b in zip(here[:2], there[:2], strict=True)], there[:2])
    after = hand.see("apart", "guess", "moment")
    assert after["apart"] < 0.2 * before["apart"]
    for number, slider in (("bias", "Gyro bias"), ("gyro", "Gyro scale")):
        assert after["guess"][number] != before["guess"][number]
        shown = float(hand.page.get_by_role("slider", name=slider).input_value())
        assert shown == pytest.approx(after["guess"][number])
    assert after["guess"]["wheels"] == before["guess"]["wheels"]


def test_what_is_the_readers_own_says_so_above_the_picture(lab):
    page = lab("drive", options={"empty": True}).page
    page.evaluate("""() => {
      const figure = document.createElement('figure');
      figure.className = 'pfslam-lab';
      document.querySelector('figure.pfslam-lab').replaceWith(figure);
      pfslam.mount(figure, 'drive', {}, {resample: (poses, weights) => [poses, weights]});
    }""")
    page.wait_for_function(
        "() => document.querySelector('.pfslam-line').textContent.includes('Yours: resample')"
    )


# ---- Each fits its screen


IN_SIGHT = """() => {
  const figure = document.querySelector('figure.pfslam-lab');
  const controls = 'button, .pfslam-slider, fieldset, .pfslam-check';
  return [[...figure.querySelectorAll(controls)].filter(e => e.checkVisibility({contentVisibilityAuto: true})).length,
          figure.getBoundingClientRect().height];
}"""
# Words that a picture writes beyond its canvas, in pixels of the page.
BEYOND = f"""() => {{
  const beyond = [], write = CanvasRenderingContext2D.prototype.fillText;
  CanvasRenderingContext2D.prototype.fillText = function (words, x, y) {{
    const box = this.measureText(words), at = this.getTransform();
    const ends = [[x - box.actualBoundingBoxLeft, y - box.actualBoundingBoxAscent],
                  [x + box.actualBoundingBoxRight, y + box.actualBoundingBoxDescent]].map(
      ([px, py]) => at.transformPoint({{x: px, y: py}}));
    const {{width, height}} = this.canvas, [xs, ys] = ['x', 'y'].map(axis => ends.map(end => end[axis]));
    if (Math.min(...xs, ...ys) < -2 || Math.max(...xs) > width + 2 || Math.max(...ys) > height + 2) beyond.push(words);
    write.call(this, words, x, y);
  }};
  {LAB}.draw();
  CanvasRenderingContext2D.prototype.fillText = write;
  return beyond;
}}"""
BAR = 56  # pixels of the bar above a page


@pytest.mark.parametrize("name", LABS)
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_a_whole_laboratory_is_seen_at_once_with_three_controls_and_no_words_cut_off(
    open_lab, name, width, height
):
    phone = {"has_touch": True, "is_mobile": True} if width < 500 else {}
    page = open_lab(name, width=width, height=height, below="<div style='height: 2000px'></div>", **phone)
    page.evaluate("document.querySelectorAll('details').forEach(box => { box.open = false; })")
    controls, high = page.evaluate(IN_SIGHT)
    assert controls <= 3
    assert high <= height - BAR
    assert page.evaluate(BEYOND) == []
    if phone:  # and what is folded is turned with the picture in sight
        page.evaluate("document.querySelectorAll('details').forEach(box => { box.open = true; })")
        plan = page.locator(".pfslam-plan").first
        body = page.locator(".pfslam-lab-body").bounding_box()
        page.evaluate(f"scrollTo(0, {plan.bounding_box()['y']} + 60)")
        assert plan.bounding_box()["y"] == pytest.approx(BAR, abs=1) or body["height"] < height


# ---- For an hour: nothing grows without bound

SIZE = """function size(thing, seen = new Set()) {
  if (!thing || typeof thing !== 'object' || seen.has(thing) || thing instanceof Node) return 0;
  seen.add(thing);
  if (ArrayBuffer.isView(thing)) return thing.length;
  const parts = thing instanceof Map || thing instanceof Set ? [...thing.values()] : Object.values(thing);
  return parts.reduce((sum, part) => sum + size(part, seen), parts.length);
}"""


@pytest.mark.parametrize(
    ("name", "options", "step", "times"),
    [
        ("cells", {}, "state.move(); state.look(); state.resample();", 200),
        ("maps", {}, "state.step();", 200),
        ("grow", {}, "state.scan();", 700),
        ("drive", {"particles": 20, "empty": True}, "state.tick(false); state.remember();", 8000),
        ("lost", {"first": 500}, "state.look();", 200),
        ("cloud", {"particles": 20}, "state.extend(1.7, 3); state.extend(7, 3);", 20),
    ],
)
def test_nothing_grows_for_an_hour(open_lab, name, options, step, times):
    page = open_lab(name, options)
    many = f"""() => {{
      {SIZE}
      const {{state}} = {LAB};
      for (let k = 0; k < {times}; k++) {{ {step} }}
      return size(state);
    }}"""
    once, twice = page.evaluate(many), page.evaluate(many)
    assert twice <= 1.02 * once


# ---- A link holds the settings


# What a reader sets, and what the link then says; a choice that sets a slider back is set before it.
SET = {
    "calibrate": ({"Turns from": "wheels", "Track width": 0.7}, "&track-width=0.7&turns-from=wheels"),
    "cells": (
        {"Right at a door": 0.6, "The robot slips and errs": True, "Particles": 50, "New dice": None},
        "",
    ),
    "cloud": ({"Driven": 50, "Particles": 40, "New dice": None}, "&driven=50&particles=40&seed=2"),
    "drive": ({"Autopilot": False, "Particles": 500, "Show the truth": True}, ""),
    "grow": ({"Door open": True, "Second door open": True}, "&door-open=1&second-door-open=1"),
    "journey": ({"Pitch": 17}, "&pitch=17"),
    "lost": (
        {"Particles at first": 500, "Cupboard pushed": 40, "New dice": None},
        "&particles-at-first=500&cupboard-pushed=40&seed=2",
    ),
    "maps": ({"One shared map": True, "Particles": 20, "New dice": None}, ""),
    "slide": (
        {"Place": "corridor", "Score by": "distance", "Turn": 2.5},
        "&place=corridor&score-by=distance&turn=2.5",
    ),
    "springs": ({"True loop": True, "Drift of a motion": -0.02}, ""),
}
PUT = f"""settings => {{
  const {{stage}} = {LAB}, control = name => document.getElementById(
    `${{stage.id}}-${{name.replace(/\\W+/g, '-').toLowerCase()}}`);
  const press = (kind, name) => [...document.querySelectorAll(kind)].find(
    e => e.textContent.trim().startsWith(name)).click();
  for (const [name, value] of Object.entries(settings)) {{
    if (value === null) press('button', name);
    else if (typeof value === 'boolean') press('label', name);
    else if (typeof value === 'string') control(name).querySelector(`[value=${{value}}]`).click();
    else {{ control(name).value = value; control(name).dispatchEvent(new Event('input')); }}
  }}
}}"""
PICTURES = f"() => {{ {LAB}.draw(); return {FIRST_PICTURES}; }}"
CALM = {"reduced_motion": "reduce"}


def settled(page) -> str:
    """The pictures, once nothing moves."""
    page.wait_for_function(f"() => {LAB}.state.settled !== false && {LAB}.state.ready !== false")
    page.evaluate(PAINTED)
    return page.evaluate(PICTURES)


def follow(page, asked: str) -> None:
    """Change the address of the open page, which loads it anew."""
    with page.expect_event("load"):
        page.evaluate("asked => { location.hash = asked; }", asked)
    page.wait_for_function(READY)


@pytest.mark.parametrize("name", LABS)
def test_a_link_brings_back_what_was_set(open_lab, name):
    settings, said = SET[name]
    page = open_lab(name, {"empty": True} if name == "drive" else None, **CALM)
    before = settled(page)
    page.evaluate(PUT, settings)
    there = settled(page)
    assert there != before
    page.get_by_role("button", name="Link", exact=True).click()
    page.wait_for_function(f"() => {STATUS}.includes('link to th')")
    address = page.url
    assert f"#lab={name}&" in address
    assert said in address
    assert address.count("=") == 1 + len(settings), "only what differs"
    page.reload()
    page.wait_for_function(READY)
    assert settled(page) == there
    page.evaluate("document.querySelectorAll('details').forEach(box => { box.open = true; })")
    page.get_by_role("button", name="Link", exact=True).click()
    assert page.url == address


@pytest.mark.parametrize(
    ("name", "asked", "said"),
    [
        ("drive", "particles=99999&noise=&speed=1e999&people=2&autopilot=true&seed=-1", "particles"),
        ("slide", "turn=NaN&place=%22%3E%3Cimg+src%3Dx%3E&score-by=constructor", "score-by"),
        ("cells", "__proto__=1&constructor=2&%3Cscript%3Ealert(1)%3C/script%3E", "something unknown"),
    ],
)
def test_what_a_link_may_not_ask_for_is_as_usual_and_said(open_lab, name, asked, said):
    page = open_lab(name, **CALM)
    before = settled(page)
    follow(page, f"lab={name}&{asked}")
    assert settled(page) == before
    status = page.locator("p[role=status]")
    assert "cannot be here" in status.text_content()
    assert said in status.text_content()
    assert status.bounding_box()["height"] > 15, "for everybody"
    page.locator(".pfslam-plan").first.press("Shift")
    assert status.bounding_box()["height"] < 2
    follow(page, f"lab=other&{asked}")
    assert "cannot" not in status.text_content()
    assert settled(page) == before


def test_a_link_leads_to_the_laboratory_it_means(open_lab):
    one = lab_page("cells").split("</h1>")[1].split("</main>")[0]
    page = open_lab("cells", below=2 * one + "<p style='height: 2000px'>End</p>")
    follow(page, "lab=cells-3&particles=50")
    figures = "[...document.querySelectorAll('figure.pfslam-lab')]"
    assert page.evaluate(f"{figures}.map(f => f.lab.state.settings.particles)") == [30, 30, 50]
    assert abs(page.evaluate(f"{figures}[2].getBoundingClientRect().top")) < 2


# ---- All of them


with_pictures = pytest.mark.parametrize("name", sorted(MOMENTS))


@nightly
@with_pictures
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_it_is_for_everybody(open_lab, name, theme):
    page = open_lab(name, theme=theme, width=390)
    assert violations(page) == []
    assert page.evaluate(WIDTH_BEYOND_SCREEN) <= 0
    controls = page.locator(".pfslam-lab :is(button, input[type=range], label:has(input))")
    for control in controls.locator("visible=true").all():
        assert control.bounding_box()["height"] >= 40, control.text_content()
    for target in page.locator(".pfslam-plan, .pfslam-lab :is(button, input)").all():
        if target.is_visible() and target.is_enabled():
            target.focus()
            assert target.evaluate("e => e === document.activeElement")


@nightly
@with_pictures
def test_who_asked_for_less_motion_steps(open_lab, name):
    page = open_lab(name, reduced_motion="reduce")
    if page.evaluate(f"{LAB}.stage.beat === undefined"):
        return  # nothing in it moves by itself
    assert page.get_by_role("button", name="Start", exact=True).count() == 0
    before = page.evaluate(FIRST_PICTURES)
    page.get_by_role("button", name="Step").click()
    page.evaluate(PAINTED)
    after = page.evaluate(FIRST_PICTURES)
    assert after != before
    page.wait_for_timeout(200)
    assert page.evaluate(FIRST_PICTURES) == after, "it moves on by itself"


@nightly
def test_out_of_view_it_rests(open_lab):
    page = open_lab("drive", below="<div style='height: 3000px'></div><p>End</p>")
    page.get_by_role("button", name="Start", exact=True).click()
    page.wait_for_function(f"() => {LAB}.state.ticks >= 10")
    page.get_by_text("End", exact=True).scroll_into_view_if_needed()
    page.wait_for_timeout(300)
    ticks = page.evaluate(f"{LAB}.state.ticks")
    page.wait_for_timeout(300)
    assert page.evaluate(f"{LAB}.state.ticks") == ticks
    page.locator(".pfslam-plan").scroll_into_view_if_needed()
    page.wait_for_function(f"ticks => {LAB}.state.ticks >= ticks + 10", arg=ticks)


@nightly
@with_pictures
def test_paper_and_pages_without_script_show_the_stored_picture(chromium, open_lab, tmp_path, name):
    page = open_lab(name)
    still = page.locator(".pfslam-still img")
    assert not still.is_visible()
    page.emulate_media(media="print")
    still.wait_for()  # it is read when it is first wanted
    assert not page.locator(".pfslam-lab-body").is_visible()
    place = tmp_path / "plain.html"
    place.write_text(lab_page(name), encoding="utf-8")
    context = chromium.new_context(java_script_enabled=False)
    plain = context.new_page()
    plain.goto(place.as_uri())
    box = plain.locator(".pfslam-still img").bounding_box()
    assert min(box["width"], box["height"]) > 100
    context.close()


def test_the_colours_are_those_of_the_figures():
    css = viewer.source("lab.css")
    light = dict(re.findall(r"--lab-(\w+): (#\w+)", css[: css.index("}")]))
    for name in ("truth", "odometry", "estimate", "particles", "hits", "highlight"):
        assert light[name] == COLOURS[name], name
    assert light["clear"] == COLOURS["free"]
