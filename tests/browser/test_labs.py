"""The laboratories: driven by mouse, finger and key, each story ends where the package says; for everybody; quiet."""

import re
from dataclasses import replace
from functools import cache
from importlib.resources import files

import numpy as np
import pytest
from lab_stills import page as lab_page
from pfslam_book import ch04, ch06
from pfslam_book.ch01 import calibrate_options, true_path
from pfslam_book.ch03.corridor import CELLS, STEP, TRUE_START, predict_belief, update_belief
from pfslam_book.ch04 import live
from pfslam_book.ch05 import cells as ch05_cells
from pfslam_book.show.drives import Place
from pfslam_book.show.figures import map_along
from pfslam_book.show.lab import FOLDER
from pfslam_book.show.style import COLOURS

from pfslam.correlation import score_field
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.grid import LOG_4, GridSpec, MapConfig, OccupancyGrid, integrate_scan
from pfslam.io.datasets import load
from pfslam.motion import Controls, dead_reckoning, integrate, motion_model
from pfslam.particles import (
    ControlNoise,
    Particles,
    effective_sample_size,
    predict,
    reweight,
    systematic_resample,
)
from pfslam.poses import average_pose, compose, transform_points, wrap_angle
from pfslam.sensors import ImuModel, LidarModel, scan_points
from pfslam.simulator import DEFAULT_SEED, HALL
from pfslam.simulator.ground import rotations
from pfslam.simulator.lidar import Sensor, cast
from pfslam.simulator.world import make_world
from pfslam.texture.floor import NO_READING, associate_rgb, back_project, depth_from_disparity, to_world

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("laboratories")]

AXE = files("axe_playwright_python").joinpath("axe.min.js").read_text(encoding="utf-8")
FINDINGS = """async () => (await axe.run(document, {preload: false})).violations.flatMap(
  v => v.nodes.map(n => v.id + ': ' + n.html.slice(0, 160)))"""
LABS = sorted(path.name[4:-3] for path in FOLDER.iterdir() if path.name.startswith("lab_"))
LAB = "document.querySelector('figure.pfslam-lab').lab"
STATUS = "document.querySelector('[role=status]').textContent"
PAINTED = "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
READY = f"() => {LAB}?.stage.fitted"
# Everything that the state holds, with typed arrays as lists.
RECORD = f"""() => {{
  const plain = value => ArrayBuffer.isView(value) ? Array.from(value) : value;
  const each = event => Object.fromEntries(Object.entries(event).map(([name, value]) => [name, plain(value)]));
  const {{state, constants}} = {LAB};
  return {{trace: state.trace.map(each), poses: plain(state.poses), weights: plain(state.weights), nEff: state.nEff,
           estimate: state.estimate, logOdds: plain(state.grid.logOdds), particles: state.settings.particles,
           constants}};
}}"""


@pytest.fixture
def open_lab(chromium, opener, tmp_path):
    """Open one laboratory on a page of its own: ``open_lab("drive", {"small": True}, width=390)``."""
    visits, contexts = [], []

    def go(name: str, options=None, theme: str = "light", width: int = 1280, below: str = "", **context):
        place = tmp_path / f"{name}-{len(visits)}.html"
        place.write_text(
            lab_page(name, options, theme).replace("</main>", below + "</main>"), encoding="utf-8"
        )
        contexts.append(chromium.new_context(viewport={"width": width, "height": 900}, **context))
        visits.append(opener(contexts[-1], place.as_uri(), "file:///"))
        visits[-1].page.wait_for_function(READY)
        return visits[-1].page

    yield go
    for seen in visits:
        assert seen.complaints + seen.strangers == []
    for context in contexts:
        context.close()


class Handed:
    """Random numbers that the browser has drawn, in the place of a generator."""

    def __init__(self, *numbers):
        self.numbers = list(numbers)

    def standard_normal(self, n):
        return np.array(self.numbers.pop(0)[:n])

    def random(self):
        return self.numbers.pop(0)


class Replay:
    """The filter of ``lab_drive.js``, from the package's functions, along the record of a drive."""

    def __init__(self, constants: dict, particles: int):
        spec, lidar = constants["SPEC"], constants["LIDAR"]
        self.spec = GridSpec(tuple(spec["origin"]), spec["resolution"], tuple(spec["shape"]))
        self.lidar = LidarModel(
            angle_min=lidar["angleMin"],
            angle_max=lidar["angleMax"],
            beams=lidar["beams"],
            range_min=lidar["rangeMin"],
            range_max=lidar["rangeMax"],
            position_b=(*lidar["position"], 0.0),
        )
        self.constants, self.grid = constants, OccupancyGrid.empty(self.spec)
        self.cloud = Particles.at(constants["START"], particles)
        self.points_b = np.zeros((0, 2))

    @property
    def estimate(self) -> np.ndarray:
        return average_pose(self.cloud.poses, self.cloud.weights)

    def take(self, event: dict) -> None:
        if "normals" in event:
            n, noise = len(self.cloud), event["sigmas"]
            dice = Handed(event["normals"][:n], event["normals"][n:])
            noise = ControlNoise(noise["sigmaV"], noise["sigmaOmega"], noise["perRootSecond"])
            self.cloud = predict(self.cloud, event["v"], event["omega"], event["dt"], noise, dice)
        elif "ranges" in event:
            self.ranges = np.array(event["ranges"])
            self.points_b = scan_points(self.ranges, self.lidar)
        elif "sharpness" in event:
            self.score(event["sharpness"])
        elif "u" in event:
            ancestors = systematic_resample(self.cloud.weights, Handed(event["u"]))
            self.cloud = Particles(self.cloud.poses[ancestors], np.zeros(len(self.cloud)))
        elif "free" in event:
            self.draw(event["free"])
        elif "particles" in event:
            chosen = np.arange(event["particles"]) % len(self.cloud)
            self.cloud = Particles(self.cloud.poses[chosen], self.cloud.log_weights[chosen])

    def score(self, sharpness: float) -> None:
        few = self.points_b[:: self.constants["EVERY"]]
        field, scores = score_field(self.grid.occupied, "distance"), []
        for points_w in transform_points(self.cloud.poses, few):
            cells = self.spec.world_to_cell(points_w)
            ix, iy = cells[self.spec.contains(cells)].T
            scores.append(field.values[iy, ix].sum())
        self.cloud, _ = reweight(self.cloud, sharpness * np.array(scores) / (len(few) * field.top))

    def draw(self, free: float) -> None:
        config = MapConfig(
            self.spec.resolution, self.constants["HIT"], free, self.constants["CLAMP"], rays="bresenham"
        )
        sensor = transform_points(self.estimate, np.array([self.lidar.position_b[:2]]))[0]
        points_w = transform_points(self.estimate, self.points_b)
        beams = np.flatnonzero(self.lidar.valid(self.ranges))
        self.grid, _ = integrate_scan(self.grid, points_w, beams, sensor, config)


def assert_the_package_agrees(page) -> dict:
    """What the browser shows is what the package computes from the same moves and the same random numbers."""
    found = page.evaluate(RECORD)
    replay = Replay(found["constants"], 200)
    for event in found["trace"]:
        replay.take(event)
    np.testing.assert_allclose(found["estimate"], replay.estimate, atol=1e-9)
    np.testing.assert_allclose(np.reshape(found["poses"], (-1, 3)), replay.cloud.poses, atol=1e-9)
    assert found["nEff"] == pytest.approx(effective_sample_size(replay.cloud.weights))
    np.testing.assert_array_equal(found["logOdds"], replay.grid.log_odds.ravel())
    assert len(replay.cloud) == found["particles"]
    return found


def moved(found: dict) -> float:
    """How far the estimate is from the start (m)."""
    return float(np.hypot(*np.subtract(found["estimate"], found["constants"]["START"])[:2]))


def wait_for_ticks(page, ticks: int) -> None:
    page.wait_for_function(f"ticks => {LAB}.state.ticks >= ticks", arg=ticks)


def test_drive_by_mouse(open_lab):
    page = open_lab("drive", {"trace": True})
    page.get_by_role("button", name="Start", exact=True).click()
    wait_for_ticks(page, 60)
    box = page.locator(".pfslam-plan canvas").bounding_box()
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])  # a place in the corridor
    wait_for_ticks(page, 120)
    particles = page.get_by_role("slider", name="Particles")
    particles.scroll_into_view_if_needed()
    slider = particles.bounding_box()
    page.mouse.click(slider["x"] + 0.2 * slider["width"], slider["y"] + 0.5 * slider["height"])
    wait_for_ticks(page, 160)
    page.get_by_role("button", name="Pause").click()
    found = assert_the_package_agrees(page)
    assert found["particles"] > 300
    assert moved(found) > 0.8
    assert not page.get_by_label("Autopilot").is_checked(), "who taps drives"


def test_drive_by_finger(open_lab):
    page = open_lab("drive", {"trace": True}, width=390, has_touch=True, is_mobile=True)
    page.get_by_role("button", name="Start", exact=True).tap()
    wait_for_ticks(page, 30)
    plan = page.locator(".pfslam-plan canvas")
    box = plan.bounding_box()
    plan.tap(position={"x": 0.4 * box["width"], "y": 0.5 * box["height"]})
    wait_for_ticks(page, 110)
    page.get_by_role("button", name="Pause").tap()
    for name in ("Predict", "Score", "Score", "Resample"):
        page.get_by_role("button", name=name).tap()
    found = assert_the_package_agrees(page)
    assert moved(found) > 0.6
    assert found["nEff"] == pytest.approx(200)


def test_drive_by_key(open_lab):
    page = open_lab("drive", {"trace": True})
    page.locator(".pfslam-plan").focus()
    page.keyboard.down("ArrowUp")  # which starts the clock, too
    wait_for_ticks(page, 60)
    page.keyboard.down("ArrowLeft")
    # Counted from here, not from the start: on a busy machine many ticks may have passed before the key was down.
    wait_for_ticks(page, page.evaluate(f"{LAB}.state.ticks") + 30)
    page.keyboard.up("ArrowLeft")
    page.keyboard.press("Space")
    assert not page.evaluate(f"{LAB}.stage.beat.running")
    for key in "pss":
        page.keyboard.press(key)
    found = assert_the_package_agrees(page)
    assert moved(found) > 0.4
    assert found["estimate"][2] > 0.3, "it turned left"
    assert found["nEff"] < 190
    page.keyboard.up("ArrowUp")
    page.keyboard.press("n")
    again = page.evaluate(RECORD)
    assert again["trace"] == []
    assert moved(again) < 1e-9


def test_the_same_moves_have_the_same_end(open_lab):
    def end(seed):
        page = open_lab("drive", {"seed": seed})
        page.evaluate(f"() => {{ for (let k = 0; k < 300; k++) {LAB}.state.tick(); }}")
        return page.evaluate(RECORD)["poses"]

    assert end(1) == end(1)
    assert end(1) != end(2)


def test_the_truth_the_thieves_and_the_walkers_are_seen(open_lab):
    page = open_lab("drive")
    page.evaluate(f"() => {{ for (let k = 0; k < 300; k++) {LAB}.state.tick(); }}")
    pictures = [page.locator(".pfslam-plan canvas").evaluate("c => c.toDataURL()")]
    for name in ("Show the truth", "People", "Slippery patch", "Look closely"):
        page.get_by_label(name).check()
        page.evaluate(PAINTED)
        pictures.append(page.locator(".pfslam-plan canvas").evaluate("c => c.toDataURL()"))
    assert len(set(pictures)) == len(pictures)
    before = page.evaluate(f"{LAB}.state.truth")
    page.get_by_role("button", name="Kidnap").click()
    assert page.evaluate(f"{LAB}.state.truth") != before
    page.wait_for_function("() => /off by/.test(document.querySelector('[role=status]').textContent)")


@pytest.mark.parametrize("name", LABS)
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_it_is_for_everybody(open_lab, name, theme):
    page = open_lab(name, theme=theme, width=390)
    page.evaluate(AXE)
    assert page.evaluate(FINDINGS) == []
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    controls = page.locator(".pfslam-lab :is(button, input[type=range], label:has(input))")
    for control in controls.locator("visible=true").all():
        assert control.bounding_box()["height"] >= 40, control.text_content()
    for target in page.locator(".pfslam-plan, .pfslam-lab :is(button, input)").all():
        if target.is_visible() and target.is_enabled():
            target.focus()
            assert target.evaluate("e => e === document.activeElement")


@pytest.mark.parametrize("name", LABS)
def test_who_asked_for_less_motion_steps(open_lab, name):
    page = open_lab(name, reduced_motion="reduce")
    if page.evaluate(f"{LAB}.stage.beat === undefined"):
        return  # nothing in it moves by itself
    assert page.get_by_role("button", name="Start", exact=True).count() == 0
    picture = "() => [...document.querySelectorAll('canvas')].map(c => c.toDataURL()).join()"
    before = page.evaluate(picture)
    page.get_by_role("button", name="Step").click()
    page.evaluate(PAINTED)
    after = page.evaluate(picture)
    assert after != before
    page.wait_for_timeout(200)
    assert page.evaluate(picture) == after, "it moves on by itself"


def test_out_of_view_it_rests(open_lab):
    page = open_lab("drive", below="<div style='height: 3000px'></div><p>End</p>")
    page.get_by_role("button", name="Start", exact=True).click()
    wait_for_ticks(page, 10)
    page.get_by_text("End", exact=True).scroll_into_view_if_needed()
    page.wait_for_timeout(300)
    ticks = page.evaluate(f"{LAB}.state.ticks")
    page.wait_for_timeout(300)
    assert page.evaluate(f"{LAB}.state.ticks") == ticks
    page.locator(".pfslam-plan").scroll_into_view_if_needed()
    wait_for_ticks(page, ticks + 10)


@pytest.mark.parametrize("name", LABS)
def test_paper_and_pages_without_script_show_the_stored_picture(chromium, open_lab, tmp_path, name):
    page = open_lab(name)
    still = page.locator(".pfslam-still img")
    assert not still.is_visible()
    page.emulate_media(media="print")
    assert still.is_visible()
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
    css = FOLDER.joinpath("lab.css").read_text(encoding="utf-8")
    light = dict(re.findall(r"--lab-(\w+): (#\w+)", css[: css.index("}")]))
    for name in ("truth", "odometry", "estimate", "particles", "hits", "highlight"):
        assert light[name] == COLOURS[name], name
    assert light["clear"] == COLOURS["free"]


STATE = f"() => JSON.parse(JSON.stringify({LAB}.state, (_, v) => ArrayBuffer.isView(v) ? Array.from(v) : v))"


def corridor_after(found: dict, actions: str, doors, at_door: float = 0.8) -> tuple:
    """Belief, particles' cells and weights after looks (l), moves (m) and resamplings (r), by the package."""
    belief, truth, dice = np.full(CELLS, 1 / CELLS), TRUE_START, iter(found["trace"])
    cells = np.arange(30) % CELLS
    weights = np.full(30, 1 / 30)
    for action in actions:
        if action == "m":
            truth, belief = (truth + 1) % CELLS, predict_belief(belief, STEP)
            cells = (cells + np.searchsorted(np.cumsum(list(STEP.values())), next(dice), "right")) % CELLS
        elif action == "r":
            cells, weights = cells[systematic_resample(weights, Handed(next(dice)))], np.full(30, 1 / 30)
        else:
            likelihood = np.where(np.isin(np.arange(CELLS), doors), at_door, 0.1)
            likelihood = likelihood if truth in doors else 1 - likelihood
            belief = update_belief(belief, likelihood)
            weights = update_belief(weights, likelihood[cells])
    return belief, cells, weights


def assert_the_corridor_agrees(page, actions: str, doors, at_door: float = 0.8) -> None:
    found = page.evaluate(STATE)
    belief, cells, weights = corridor_after(found, actions, doors, at_door)
    np.testing.assert_allclose(found["belief"], belief, atol=1e-12)
    np.testing.assert_array_equal(found["cells"], cells)
    np.testing.assert_allclose(found["weights"], weights, atol=1e-12)
    said = f"() => /cell is {np.argmax(belief)} with {belief.max():.2f}/.test({STATUS})"
    page.wait_for_function(said)


def test_fifteen_cells_by_mouse(open_lab):
    page = open_lab("cells")
    box = page.locator(".pfslam-plan canvas").bounding_box()
    x, y = [box["x"] + (cell + 0.5) * box["width"] / CELLS for cell in range(CELLS)], box["y"] + 12
    page.mouse.click(x[10], y)  # away with the door at 10, and a new one at 7
    page.mouse.click(x[7], y)
    page.mouse.move(x[4], y)
    page.mouse.down()
    page.mouse.move(x[3], y, steps=3)  # the door at 4 goes to 3
    page.mouse.up()
    for name in ("Look", "Move", "Look", "Resample", "Move", "Look"):
        page.get_by_role("button", name=name).click()
    assert_the_corridor_agrees(page, "lmlrml", [1, 3, 7])


def test_fifteen_cells_by_finger(open_lab):
    page = open_lab("cells", width=390, has_touch=True, is_mobile=True)
    plan = page.locator(".pfslam-plan canvas")
    plan.tap(position={"x": 2.5 * plan.bounding_box()["width"] / CELLS, "y": 15})
    for name in ("Look", "Move", "Look", "Resample", "Move"):
        page.get_by_role("button", name=name).tap()
    assert_the_corridor_agrees(page, "lmlrm", [1, 2, 4, 10])


def test_fifteen_cells_by_key(open_lab):
    page = open_lab("cells")
    page.locator(".pfslam-plan").focus()
    for key in ("ArrowRight", "Enter", "ArrowLeft", "ArrowLeft", "Enter"):  # no door at 1, one at 14
        page.keyboard.press(key)
    page.get_by_role("slider", name="Right at a door").focus()
    for _ in range(10):
        page.keyboard.press("ArrowRight")
    for key in "lmmlr":
        page.keyboard.press(key)
    assert_the_corridor_agrees(page, "lmmlr", [4, 10, 14], at_door=0.9)
    page.keyboard.press("n")
    assert page.evaluate(STATE)["looks"] == 0


def test_fifteen_cells_without_particles_and_with_chance(open_lab):
    page = open_lab("cells", {"dots": False})
    assert page.get_by_role("button", name="Resample").count() == 0
    page.get_by_label("slips and errs").check()
    for _ in range(40):
        page.keyboard.press("m")
    found = page.evaluate(STATE)
    assert found["moves"] == 40
    assert found["truth"] != (TRUE_START + 40) % CELLS


@cache
def shot_of_the_still():
    """The image pair that the laboratory of the journey has in these tests."""
    return ch06.take_shot(ch06.load_drive("hall"))


def assert_the_pixel_agrees(page, u: int, v: int) -> dict:
    """The laboratory stands at this pixel, and takes it where the package takes it."""
    shot, found = shot_of_the_still(), page.evaluate(f"() => {LAB}.state.journey()")
    settings, spec = page.evaluate(f"() => {LAB}.state.settings"), GridSpec((-5.0, -5.0), 0.05, (600, 600))
    camera = replace(shot.camera, pitch=settings["pitch"])
    d = int(shot.disparity[v, u])
    assert (found["u"], found["v"], found["d"]) == (u, v, d)
    depth = depth_from_disparity(d, camera)
    if not np.isfinite(depth):
        assert found["end"] == "no reading"
        return found
    point_o = back_project(u, v, depth, camera.K)
    point_w = to_world(point_o, shot.pose, camera)[0]
    np.testing.assert_allclose(found["colour"], associate_rgb(u, v, d, camera), rtol=1e-12)
    np.testing.assert_allclose(found["optical"], point_o[0], atol=1e-12)
    np.testing.assert_allclose(found["world"], point_w, atol=1e-12)
    floor = abs(point_w[2]) <= settings["tolerance"]
    assert found["end"] == ("floor" if floor else "not floor")
    if floor:
        assert found["cell"] == spec.world_to_cell(point_w[None, :2])[0].tolist()
    page.wait_for_function(f"() => {STATUS}.startsWith('Pixel {u}, {v}:')")
    return found


def open_journey(open_lab, **options):
    page = open_lab("journey", **options)
    page.wait_for_function(f"() => {LAB}.state.ready")
    return page


def test_the_journey_of_a_pixel_by_mouse(open_lab):
    page = open_journey(open_lab)
    np.testing.assert_array_equal(
        page.evaluate(f"() => Array.from({LAB}.state.disparity)"), shot_of_the_still().disparity.ravel()
    )
    box = page.locator(".pfslam-plan canvas").bounding_box()
    x, y = (box["x"] + 300.5 * box["width"] / 640, box["y"] + 390.5 * box["height"] / 480)
    page.mouse.move(x, y)  # pointing is enough
    found = page.evaluate(f"() => {LAB}.state.pixel")
    assert abs(found["u"] - 300) <= 1
    assert abs(found["v"] - 390) <= 1
    assert assert_the_pixel_agrees(page, found["u"], found["v"])["end"] == "floor"
    pitch = page.get_by_role("slider", name="Pitch")
    pitch.scroll_into_view_if_needed()
    slider = pitch.bounding_box()
    page.mouse.click(slider["x"] + 0.8 * slider["width"], slider["y"] + 0.5 * slider["height"])
    tilted = assert_the_pixel_agrees(page, found["u"], found["v"])
    assert tilted["world"][2] < -0.01
    assert tilted["end"] == "not floor"


def test_the_journey_of_a_pixel_by_finger(open_lab):
    page = open_journey(open_lab, width=390, has_touch=True, is_mobile=True)
    plan = page.locator(".pfslam-plan canvas")
    box = plan.bounding_box()
    plan.tap(position={"x": 0.47 * box["width"], "y": 0.1 * box["height"]})
    pixel = page.evaluate(f"() => {LAB}.state.pixel")
    assert abs(pixel["u"] - 0.47 * 640) < 4
    assert abs(pixel["v"] - 0.1 * 480) < 4
    assert_the_pixel_agrees(page, pixel["u"], pixel["v"])


def test_the_journey_of_a_pixel_by_key(open_lab):
    page = open_journey(open_lab)
    page.locator(".pfslam-plan").focus()
    for key in ("ArrowRight", "ArrowRight", "ArrowUp", "ArrowLeft", "ArrowDown", "ArrowDown"):
        page.keyboard.press(key)
    assert_the_pixel_agrees(page, 311, 414)
    page.get_by_role("slider", name="Tolerance").focus()
    page.keyboard.press("End")
    page.get_by_role("slider", name="Pitch").focus()
    page.keyboard.press("ArrowRight")
    assert page.evaluate(f"() => {LAB}.state.settings.tolerance") == pytest.approx(0.15)
    assert_the_pixel_agrees(page, 311, 414)
    v, u = np.argwhere(shot_of_the_still().disparity == NO_READING)[0].tolist()
    page.evaluate(f"([u, v]) => {{ {LAB}.state.choose(u, v); {LAB}.stage.redraw(); }}", [u, v])
    assert_the_pixel_agrees(page, u, v)


@cache
def map_of_the_hall():
    return map_along(load("hall"), load("hall").true_path(), every=10)


def place_of_the_scan(page, name: str) -> Place:
    """The map, the scan and the pose at a place; a scan of one's own place is what the simulator's beams meet."""
    hall = load("hall")
    if name == "corner":
        return ch04.place_at(hall, 14.5).lost(-0.1, 0.1, np.deg2rad(-2))
    if name == "corridor":
        return ch04.place_at(hall, 27.0)
    here = page.evaluate(f"{LAB}.state.here")
    points = np.reshape(page.evaluate(f"Array.from({LAB}.state.points_b)"), (-1, 2))
    lidar = replace(hall.robot.lidar, beams=live.BEAMS)
    sensor = transform_points(here, np.array([lidar.position_b[:2]]))
    world = make_world(HALL, np.random.SeedSequence(DEFAULT_SEED))
    pose_p = compose(world.pose_pw, np.array([*sensor[0], here[2]]))
    turned = rotations(np.zeros(1), np.zeros(1), pose_p[None, 2])
    met = cast(
        world, Sensor(np.zeros(1), np.array([[*pose_p[:2], 0.5]]), turned), lidar.angles, only_walls=True
    )[0]
    found = np.hypot(*(points - lidar.position_b[:2]).T)
    assert np.abs(found - met[lidar.valid(met)]).max() < 5 * live.NOISE + 0.01
    return Place(map_of_the_hall(), points, np.array(here))


def assert_the_fit_agrees(page) -> dict:
    """The share and the scores of all shifts are those of the package at the pose that the browser shows."""
    found = page.evaluate(
        f"() => (({{place, kind, turn, shift, pose, share, surface}}) => "
        f"({{place, kind, turn, shift, pose, share}}))({LAB}.state)"
    )
    surface = page.evaluate(f"() => Array.from({LAB}.state.surface())")
    start = place_of_the_scan(page, found["place"])
    field = score_field(start.grid.occupied, found["kind"])

    def share(dx, dy):
        cells = start.grid.spec.world_to_cell(start.moved(dx, dy, np.deg2rad(found["turn"])))
        ix, iy = cells[start.grid.spec.contains(cells)].T
        return field.values[iy, ix].sum() / (field.top * len(cells))

    assert found["share"] == pytest.approx(share(*found["shift"]), abs=1.5 / len(start.points_b))
    steps = 0.05 * np.arange(-8, 9)
    expected = [share(dx, dy) for dy in steps for dx in steps]
    np.testing.assert_allclose(surface, expected, atol=1.5 / len(start.points_b))
    return found


def on_the_plan(overview, x: float, y: float) -> dict:
    """The pixel of a place (m) on the plan of the building."""
    x0, x1, _, y1 = live.WINDOW
    scale = overview.bounding_box()["width"] / (x1 - x0)
    return {"x": (x - x0) * scale, "y": (y1 - y) * scale}


def test_the_scan_slides_by_mouse(open_lab):
    page = open_lab("slide")
    before = assert_the_fit_agrees(page)["share"]
    box = page.locator(".pfslam-plan canvas").first.bounding_box()
    metre = box["width"] / 7.0
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 0.1 * metre, y + 0.1 * metre, steps=4)
    page.mouse.up()
    found = assert_the_fit_agrees(page)
    np.testing.assert_allclose(found["shift"], [0.1, -0.1], atol=0.011)
    turn = page.get_by_role("slider", name="Turn")
    turn.scroll_into_view_if_needed()
    turn.focus()
    for _ in range(20):
        page.keyboard.press("ArrowRight")
    found = assert_the_fit_agrees(page)
    assert found["turn"] == pytest.approx(2.0)
    assert found["share"] > 0.6 > 2 * before
    overview = page.locator(".pfslam-plan canvas").nth(1)
    overview.scroll_into_view_if_needed()
    overview.click(position=on_the_plan(overview, 12.0, -0.8))
    assert page.get_by_label("anywhere").is_checked()
    np.testing.assert_allclose(page.evaluate(f"{LAB}.state.here"), [12.0, -0.8, 0.0], atol=0.1)
    assert assert_the_fit_agrees(page)["place"] == "anywhere"
    surface = page.evaluate(f"() => Array.from({LAB}.state.surface())")
    rows = np.reshape(surface, (17, 17))
    assert rows[8].mean() > 2 * rows[:, 8].mean(), "a ridge along the corridor"


def test_the_scan_slides_by_finger(open_lab):
    page = open_lab("slide", width=390, has_touch=True, is_mobile=True)
    page.get_by_label("corridor").tap()
    page.get_by_label("likelihood field").tap()
    found = assert_the_fit_agrees(page)
    assert (found["place"], found["kind"]) == ("corridor", "distance")
    assert found["share"] > 0.8
    page.locator(".pfslam-plan canvas").first.evaluate(
        """c => { const b = c.getBoundingClientRect(), at = (type, x) => c.dispatchEvent(new PointerEvent(type,
          {pointerId: 1, pointerType: 'touch', button: 0, clientX: b.left + x, clientY: b.top + 60, bubbles: true}));
          c.setPointerCapture = () => {}; at('pointerdown', 100); at('pointermove', 115); at('pointerup', 115); }"""
    )
    assert assert_the_fit_agrees(page)["shift"][0] > 0.2
    overview = page.locator(".pfslam-plan canvas").nth(1)
    overview.tap(position=on_the_plan(overview, 0.5, 0.0))
    found = assert_the_fit_agrees(page)
    assert (found["place"], found["turn"]) == ("anywhere", 0)


def test_the_scan_slides_by_key(open_lab):
    page = open_lab("slide")
    page.locator(".pfslam-plan").first.focus()
    for key in ["q"] * 4 + ["ArrowRight"] * 10 + ["ArrowDown"] * 11 + ["ArrowUp", "e", "q"]:
        page.keyboard.press(key)
    found = assert_the_fit_agrees(page)
    np.testing.assert_allclose([*found["shift"], found["turn"]], [0.1, -0.1, 2.0], atol=1e-9)
    assert found["share"] > 0.6
    page.keyboard.press("n")
    assert assert_the_fit_agrees(page)["turn"] == 0
    page.locator(".pfslam-plan").nth(1).focus()
    for key in ["ArrowRight"] * 5 + ["ArrowUp", "q", "q", "e", "q"]:
        page.keyboard.press(key)
    np.testing.assert_allclose(page.evaluate(f"{LAB}.state.here"), [0.5, 0.1, np.deg2rad(10)], atol=1e-9)
    assert assert_the_fit_agrees(page)["place"] == "anywhere"
    page.get_by_role("slider", name="Stand facing").press("End")
    np.testing.assert_allclose(page.evaluate(f"{LAB}.state.here[2]"), np.pi)
    assert_the_fit_agrees(page)


def walk_after(found: dict) -> tuple:
    """Cells, weights and maps of the particles with a map each, by the package, along the record of a walk."""
    n, steps = found["settings"]["particles"], np.cumsum(list(ch05_cells.STEP.values()))
    cells, weights, maps = np.zeros(n, dtype=int), np.full(n, 1 / n), ch05_cells.blank_maps(n)
    for event in found["trace"]:
        if "numbers" in event:
            cells = (cells + np.searchsorted(steps, event["numbers"], "right")) % CELLS
        elif "sees" in event:
            weights, maps = ch05_cells.look(
                cells, weights, maps, event["sees"], event["truth"] == 0, not event["shared"]
            )
        else:
            chosen = systematic_resample(weights, Handed(event["u"]))
            cells, weights, maps = cells[chosen], np.full(n, 1 / n), maps[chosen]
    return cells, weights, maps


def assert_the_walk_agrees(page, doors=ch05_cells.DOORS) -> dict:
    """Particles, weights and maps are those of the package; what is said is true of them."""
    found = page.evaluate(STATE)
    cells, weights, maps = walk_after(found)
    np.testing.assert_array_equal(found["cells"], cells)
    np.testing.assert_allclose(found["weights"], weights, atol=1e-12)
    np.testing.assert_allclose(found["maps"], maps, atol=1e-12)
    right = np.sum((weights @ maps > 0.5) == np.isin(np.arange(CELLS), doors))
    here = weights[cells == found["truth"]].sum()
    said = f"{here:.2f} of the weight is in the robot's cell {found['truth']}. "
    page.wait_for_function(f"said => {STATUS}.includes(said)", arg=said)
    assert page.locator("[role=status]").text_content().endswith(f"right: {right} of {CELLS}.")
    return found


def test_a_map_for_each_particle_by_mouse(open_lab):
    page = open_lab("maps")
    for name in ("Look", "Move", "Look", "Move", "Look", "Resample", "Move", "Look"):
        page.get_by_role("button", name=name, exact=False).first.click()
    found = assert_the_walk_agrees(page)
    assert (found["looks"], found["moves"]) == (4, 3)
    for _ in range(41):
        page.get_by_role("button", name="Step").click()
    assert assert_the_walk_agrees(page)["moves"] == 44
    box = page.locator(".pfslam-plan canvas").bounding_box()
    page.mouse.click(box["x"] + 0.6 * box["width"], box["y"] + 0.99 * box["height"])
    assert page.evaluate(f"{LAB}.state.chosen") == 39
    page.mouse.click(box["x"] + 0.99 * box["width"], box["y"] + 8)  # a door at 14
    assert page.evaluate(f"[...{LAB}.state.doors]") == [1, 4, 10, 14]


def test_a_map_for_each_particle_by_finger(open_lab):
    page = open_lab("maps", width=390, has_touch=True, is_mobile=True)
    page.get_by_label("One shared map").tap()
    for _ in range(20):
        page.get_by_role("button", name="Step").tap()
    found = assert_the_walk_agrees(page)
    assert all(event["shared"] for event in found["trace"] if "sees" in event)
    assert len({tuple(one) for one in found["maps"]}) == 1
    plan = page.locator(".pfslam-plan canvas")
    plan.tap(position={"x": 200, "y": plan.bounding_box()["height"] - 4})
    assert page.evaluate(f"{LAB}.state.chosen") == 39


def test_a_map_for_each_particle_by_key(open_lab):
    page = open_lab("maps")
    slider = page.get_by_role("slider", name="Particles")
    slider.focus()
    slider.press("End")
    page.locator(".pfslam-plan").focus()
    for key in ["ArrowRight", "ArrowRight", "Enter", "ArrowDown", *"lmlmlrml", *[" "]]:
        page.keyboard.press(key)
    page.wait_for_function(f"() => {LAB}.state.moves >= 5")
    page.keyboard.press(" ")
    found = assert_the_walk_agrees(page, doors=[1, 3, 4, 10])
    assert len(found["cells"]) == 100
    assert found["chosen"] == 1
    assert page.evaluate(f"[...{LAB}.state.doors]") == [1, 4, 10, 3]
    page.keyboard.press("n")
    assert page.evaluate(STATE)["trace"] == []


def test_the_histories_of_a_round_die_out_and_a_shared_map_goes_wrong(open_lab):
    page, right = open_lab("maps"), {}
    for shared in (False, True):
        left = page.evaluate(
            """([shared]) => { const walk = document.querySelector('figure.pfslam-lab').lab.state, left = [];
            walk.settings.shared = shared; walk.reset();
            while (walk.moves < 44) { walk.step(); left.push([walk.round, walk.histories]); }
            return left; }""",
            [shared],
        )
        right[shared] = page.evaluate(f"{LAB}.state.right")
        histories = [count for number, count in left if number == 2]
        assert histories[0] > 2 * histories[-1]
    assert right[False] == CELLS > right[True] + 2


def assert_the_map_agrees(page) -> dict:
    """Map, worn walls and diary are those of the package for the scans that the browser has cast."""
    found = page.evaluate(
        f"""() => {{
          const {{state, constants}} = {LAB}, {{settings, cell, diary, pose, level, worn, area}} = state;
          const trace = state.trace.map(scan => ({{...scan, ranges: Array.from(scan.ranges)}}));
          const logOdds = Array.from(state.grid.logOdds);
          return {{trace, settings, cell, diary, pose, level, worn, area, logOdds, constants}};
        }}"""
    )
    spec, lidar = found["constants"]["SPEC"], found["constants"]["LIDAR"]
    grid = OccupancyGrid.empty(GridSpec(tuple(spec["origin"]), spec["resolution"], tuple(spec["shape"])))
    lidar = LidarModel(
        angle_min=lidar["angleMin"],
        angle_max=lidar["angleMax"],
        beams=lidar["beams"],
        range_min=lidar["rangeMin"],
        range_max=lidar["rangeMax"],
        position_b=(0.0, 0.0, 0.0),
    )
    amounts = {name: value * LOG_4 for name, value in found["settings"].items()}
    config = MapConfig(spec["resolution"], **amounts, rays="bresenham")
    (ix, iy), diary, hits = found["cell"], [], np.zeros(grid.spec.shape, dtype=int)
    for number, scan in enumerate(found["trace"], start=1):
        ranges, pose = np.array(scan["ranges"]), np.array(scan["pose"])
        points_w = transform_points(pose, scan_points(ranges, lidar))
        beams = np.flatnonzero(lidar.valid(ranges))
        alone, _ = integrate_scan(OccupancyGrid.empty(grid.spec), points_w, beams, pose[:2], config)
        hits += alone.log_odds > 0
        grid, _ = integrate_scan(grid, points_w, beams, pose[:2], config)
        if alone.log_odds[iy, ix]:
            hit, level = bool(alone.log_odds[iy, ix] > 0), grid.log_odds[iy, ix] / LOG_4
            diary.append({"scan": number, "hit": hit, "level": pytest.approx(level)})
    np.testing.assert_array_equal(found["logOdds"], grid.log_odds.ravel())
    assert found["diary"] == diary
    wall = hits >= found["constants"]["SEEN"]
    assert found["worn"] == pytest.approx(np.mean(~grid.occupied[wall]) if wall.any() else 0.0)
    assert found["area"] == pytest.approx(np.count_nonzero(grid.free) * spec["resolution"] ** 2)
    page.wait_for_function(f"() => {STATUS}.includes(': {found['area']:.1f} square metres free')")
    page.wait_for_function(f"() => {STATUS}.includes('Cell {ix}, {iy}: ')")
    return found


def place_in_the_building(page, x: float, y: float) -> dict:
    """The pixel of a place (m) on the canvas of the growing map."""
    return dict(zip("xy", page.evaluate(f"([x, y]) => {LAB}.stage.sheets[0].at(x, y)", [x, y]), strict=True))


def test_a_map_grows_by_mouse(open_lab):
    page = open_lab("grow", {"trace": True})
    plan = page.locator(".pfslam-plan canvas")
    before = assert_the_map_agrees(page)
    assert before["diary"] == [{"scan": 1, "hit": True, "level": pytest.approx(1.0)}], "the door"
    begin, end = (place_in_the_building(page, *place) for place in (before["pose"][:2], (4.55, 1.0)))
    box = plan.bounding_box()
    page.mouse.move(box["x"] + begin["x"], box["y"] + begin["y"])
    page.mouse.down()
    page.mouse.move(box["x"] + end["x"], box["y"] + end["y"], steps=12)
    page.mouse.up()
    found = assert_the_map_agrees(page)
    assert np.hypot(*np.subtract(found["pose"][:2], (4.55, 1.0))) < 0.15
    assert len(found["trace"]) > 30
    assert found["worn"] > 0.02, "walls wear off where beams graze them"
    free = page.get_by_role("slider", name="Free")
    free.click(position=at_part(free, 0.05))
    rewritten = assert_the_map_agrees(page)
    assert len(rewritten["trace"]) == len(found["trace"])
    assert rewritten["worn"] < 0.5 * found["worn"], "weak clearing leaves the walls, in all scans"
    plan.click(position=place_in_the_building(page, 2.55, 0.95))
    floor = assert_the_map_agrees(page)
    assert floor["cell"] == [25, 9]
    assert {page["hit"] for page in floor["diary"]} == {False}


def test_a_map_grows_by_finger(open_lab):
    page = open_lab("grow", {"trace": True}, width=390, has_touch=True, is_mobile=True)
    for _ in range(4):
        page.get_by_role("button", name="Step").tap()
    assert assert_the_map_agrees(page)["level"] == pytest.approx(2.0), "at the clamp"
    page.get_by_label("Door open").tap()
    for _ in range(3):
        page.get_by_role("button", name="Step").tap()
    found = assert_the_map_agrees(page)
    assert [entry["hit"] for entry in found["diary"]] == 5 * [True] + 3 * [False]
    assert found["level"] == pytest.approx(-1.0)
    places = [place_in_the_building(page, *place) for place in (found["pose"][:2], (1.9, 1.0), (1.9, 2.8))]
    page.locator(".pfslam-plan canvas").evaluate(
        """(c, places) => {
          const b = c.getBoundingClientRect(), finger = {pointerId: 1, pointerType: 'touch', button: 0, bubbles: true};
          const at = (type, {x, y}) => c.dispatchEvent(
            new PointerEvent(type, {...finger, clientX: b.left + x, clientY: b.top + y}));
          c.setPointerCapture = () => {};
          at('pointerdown', places[0]);
          for (const place of places) at('pointermove', place);
          at('pointerup', places[2]);
        }""",
        places,
    )
    through = assert_the_map_agrees(page)
    assert through["pose"][1] > 2.5, "through the open door"
    assert through["area"] > found["area"] + 5
    page.locator(".pfslam-plan canvas").tap(position=place_in_the_building(page, 5.05, 4.05))
    assert assert_the_map_agrees(page)["cell"] == [50, 40]


def test_a_map_grows_by_key(open_lab):
    page = open_lab("grow", {"trace": True})
    page.locator(".pfslam-plan").focus()
    for key in ["ArrowRight"] * 6 + ["ArrowDown"] * 2 + ["ArrowLeft"] + ["d", "d", "w", "a", "s"]:
        page.keyboard.press(key)
    found = assert_the_map_agrees(page)
    np.testing.assert_allclose(found["pose"][:2], [1.45, 0.8], atol=1e-9)
    assert found["cell"] == [20, 17]
    assert len(found["trace"]) == 10
    page.keyboard.press("ArrowDown")
    for _ in range(8):
        page.keyboard.press("ArrowDown")
    assert assert_the_map_agrees(page)["pose"][1] > 0.44, "the wall is in the way"
    page.get_by_role("slider", name="Clamp").focus()
    page.keyboard.press("End")
    page.locator(".pfslam-plan").focus()
    for key in ("ArrowRight", "o", ".", ".", "."):  # it does not see what is behind it
        page.keyboard.press(key)
    high = assert_the_map_agrees(page)
    assert high["level"] > 5, "without a clamp it takes long"
    page.keyboard.press("Space")
    page.wait_for_function(f"() => {LAB}.state.level < 0")
    page.keyboard.press("Space")
    assert_the_map_agrees(page)
    page.keyboard.press("n")
    assert len(assert_the_map_agrees(page)["trace"]) == 1


@cache
def drive_of_the_calibration() -> tuple[dict, object]:
    """What the page gets of the drive, and the true path in it."""
    options = calibrate_options(load("hall"))
    return options, true_path(options)


def assert_the_path_agrees(page) -> dict:
    """Path and errors are those of the package, for the robot and the numbers that the browser shows."""
    found = page.evaluate(
        f"() => (({{by, robot, guess, answer, error, apart, moment}}) => "
        f"({{by, robot, guess, answer, error, apart, moment}}))({LAB}.state)"
    )
    options, truth = drive_of_the_calibration()
    guess, answer, right, dt = found["guess"], found["answer"], options["right"], 1 / options["hertz"]
    left, across, turned = (
        options["units"][name] * np.array(options["steps"][name]) for name in ("left", "right", "turned")
    )
    size = guess["wheels"] * right["wheels"] / answer["wheels"]  # what the reader's robot counts, in metres
    v = size * (left + across) / 2 / dt
    if found["by"] == "gyro":
        true_rate = ImuModel(gyro_bias=right["bias"], gyro_scale=right["gyro"]).yaw_rate(
            np.column_stack(3 * [turned / dt])
        )
        measured = true_rate / answer["gyro"] + answer["bias"]
        gyro = ImuModel(gyro_bias=guess["bias"], gyro_scale=guess["gyro"])
        omega = gyro.yaw_rate(np.column_stack(3 * [measured]))
    else:
        omega = size * (across - left) * answer["track"] / right["track"] / guess["track"] / dt
    path = integrate(Controls(truth.t, v, omega))
    error = trajectory_error(path, truth)
    assert found["error"]["ateRmse"] == pytest.approx(error.ate_rmse_m, rel=1e-9)
    assert found["error"]["headingRmse"] == pytest.approx(error.heading_rmse_deg, rel=1e-9)
    k = found["moment"]
    assert found["apart"] == pytest.approx(np.hypot(*(path.poses[k] - truth.poses[k])[:2]), rel=1e-9)
    page.wait_for_function(f"() => {STATUS}.includes('is {error.ate_rmse_m:.2f} metres (rms)')")
    return found


def at_part(slider, part: float) -> dict:
    """Where to press on a slider to set it to this part of its range, about."""
    box = slider.bounding_box()
    return {"x": part * box["width"], "y": 0.5 * box["height"]}


def test_the_robot_is_calibrated_by_mouse(open_lab):
    page = open_lab("calibrate")
    assert assert_the_path_agrees(page)["error"]["ateRmse"] > 3
    sliders = {
        name: page.get_by_role("slider", name=name) for name in ("Gyro bias", "Gyro scale", "Wheel scale")
    }
    answer = page.evaluate(f"{LAB}.state.answer")
    wanted = {"Gyro bias": answer["bias"], "Gyro scale": answer["gyro"], "Wheel scale": answer["wheels"]}
    for name, slider in sliders.items():
        low, high = float(slider.get_attribute("min")), float(slider.get_attribute("max"))
        slider.click(position=at_part(slider, (wanted[name] - low) / (high - low)))
        assert float(slider.input_value()) == pytest.approx(wanted[name], abs=0.06 * (high - low))
    found = assert_the_path_agrees(page)
    assert found["error"]["ateRmse"] < 1.5
    page.get_by_label("Tell the numbers").check()
    page.wait_for_function(f"() => {STATUS}.includes('The right numbers: gyro bias {answer['bias']:.4f}')")
    plan = page.locator(".pfslam-plan canvas")
    plan.click(position={"x": 0.2 * plan.bounding_box()["width"], "y": 10})
    moment = page.evaluate(f"{LAB}.state.moment")
    truth = drive_of_the_calibration()[1].poses[:, :2]
    place = page.evaluate(f"() => {LAB}.stage.sheets[0].world({0.2 * plan.bounding_box()['width']}, 10)")
    away = np.hypot(*(truth - place).T)
    assert away[moment] == pytest.approx(away.min(), abs=0.15)
    assert_the_path_agrees(page)
    page.get_by_role("button", name="Another robot").click()
    assert assert_the_path_agrees(page)["answer"] != answer


def test_the_robot_is_calibrated_by_finger(open_lab):
    page = open_lab("calibrate", width=390, has_touch=True, is_mobile=True)
    page.get_by_label("the wheels alone").tap()
    assert not page.get_by_role("slider", name="Gyro bias").is_visible()
    assert assert_the_path_agrees(page)["error"]["headingRmse"] > 50, "the tape measure is far off"
    track = page.get_by_role("slider", name="Track width")
    part = (page.evaluate(f"{LAB}.state.answer.track") - 0.3) / 0.9
    track.tap(position=at_part(track, part))
    found = assert_the_path_agrees(page)
    assert found["by"] == "wheels"
    assert found["error"]["headingRmse"] < 20
    page.get_by_label("the one of the drive hall").tap()
    assert assert_the_path_agrees(page)["guess"]["track"] == pytest.approx(0.394)


def test_the_robot_is_calibrated_by_key(open_lab):
    page = open_lab("calibrate")
    page.get_by_label("the one of the drive hall").focus()
    page.keyboard.press("Space")
    before = assert_the_path_agrees(page)
    whole = trajectory_error(dead_reckoning(load("hall")), load("hall").true_path())
    assert before["error"]["ateRmse"] == pytest.approx(whole.ate_rmse_m, abs=0.02), (
        "the drive as chapter 01 has it"
    )
    for name, presses in (("Gyro bias", 25), ("Gyro scale", 60), ("Wheel scale", -16)):
        page.get_by_role("slider", name=name).focus()
        for _ in range(abs(presses)):
            page.keyboard.press("ArrowRight" if presses > 0 else "ArrowLeft")
    found = assert_the_path_agrees(page)
    np.testing.assert_allclose(
        [found["guess"][name] for name in ("bias", "gyro", "wheels")], [0.0005, 1.03, 0.992], atol=1e-9
    )
    assert found["error"]["ateRmse"] < 0.1
    page.locator(".pfslam-plan").focus()
    for key in ("ArrowLeft", "ArrowLeft", "ArrowRight", "ArrowLeft"):
        page.keyboard.press(key)
    found = assert_the_path_agrees(page)
    assert found["moment"] == len(drive_of_the_calibration()[1].t) - 1 - 40
    page.keyboard.press("n")
    assert assert_the_path_agrees(page)["error"] == before["error"]


CLOUD = f"""() => {{ const fan = {LAB}.state, {{v, omega, dt, start}} = fan.controls;
  const poses = Array.from(fan.poses()), dice = fan.dice.slice(0, fan.step).map(numbers => Array.from(numbers));
  return {{v, omega, dt, start, dice, noise: fan.noise, step: fan.step,
           poses, spread: fan.spread, points: fan.points, settings: fan.settings}}; }}"""


def assert_the_cloud_agrees(page) -> dict:
    """The particles are those of the package with the same random numbers; what is said is true of them."""
    found, n = page.evaluate(CLOUD), page.evaluate(f"{LAB}.state.settings.particles")
    noise = ControlNoise(found["noise"]["sigmaV"], found["noise"]["sigmaOmega"], per_root_second=True)
    cloud = Particles.at(found["start"], n)
    for v, omega, dice in zip(found["v"], found["omega"], found["dice"], strict=False):
        cloud = predict(cloud, v, omega, found["dt"], noise, Handed(dice[:n], dice[n:]))
    np.testing.assert_allclose(np.reshape(found["poses"], (-1, 3)), cloud.poses, atol=1e-9)
    metres = np.sqrt(np.var(cloud.poses[:, :2], axis=0).sum())
    turns = wrap_angle(cloud.poses[:, 2] - average_pose(cloud.poses, cloud.weights)[2])
    assert found["spread"]["metres"] == pytest.approx(metres)
    assert found["spread"]["heading"] == pytest.approx(np.sqrt(np.mean(turns**2)))
    page.wait_for_function(f"said => {STATUS}.includes(said)", arg=f"are {metres:.2f} metres away")
    return found


def end_of_dead_reckoning(found: dict) -> np.ndarray:
    pose = np.array(found["start"], dtype=float)
    for v, omega in zip(found["v"][: found["step"]], found["omega"], strict=False):
        pose = motion_model(pose, v, omega, found["dt"])
    return pose


def test_the_cloud_grows_by_mouse(open_lab):
    page = open_lab("cloud")
    early = assert_the_cloud_agrees(page)
    driven = page.get_by_role("slider", name="Driven")
    driven.scroll_into_view_if_needed()
    box = driven.bounding_box()
    page.mouse.click(box["x"] + 0.8 * box["width"], box["y"] + 0.5 * box["height"])
    late = assert_the_cloud_agrees(page)
    assert late["step"] > 2 * early["step"]
    assert late["spread"]["metres"] > 1.2 * early["spread"]["metres"]
    assert late["spread"]["heading"] > 1.2 * early["spread"]["heading"]
    page.get_by_role("button", name="New dice").click()
    assert assert_the_cloud_agrees(page)["dice"] != late["dice"]
    plan = page.locator(".pfslam-plan canvas")
    plan.scroll_into_view_if_needed()
    box = plan.bounding_box()
    page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 0.7 * box["height"])
    page.mouse.down()
    for across, down in ((0.5, 0.7), (0.6, 0.5), (0.4, 0.3)):
        page.mouse.move(box["x"] + across * box["width"], box["y"] + down * box["height"], steps=8)
    page.mouse.up()
    drawn = assert_the_cloud_agrees(page)
    assert page.get_by_label("your own").is_checked()
    np.testing.assert_allclose(end_of_dead_reckoning(drawn)[:2], drawn["points"][-1], atol=1e-9)
    np.testing.assert_allclose(drawn["points"][-1], [-14 + 0.4 * 45, 23.5 - 0.3 * 32], atol=0.5)


def test_the_cloud_grows_by_finger(open_lab):
    page = open_lab("cloud", width=390, has_touch=True, is_mobile=True)
    plan = page.locator(".pfslam-plan canvas")
    box = plan.bounding_box()
    for across, down in ((0.6, 0.6), (0.6, 0.2)):
        plan.tap(position={"x": across * box["width"], "y": down * box["height"]})
    found = assert_the_cloud_agrees(page)
    assert (found["settings"]["path"], len(found["points"])) == ("own", 3)
    np.testing.assert_allclose(end_of_dead_reckoning(found)[:2], [13.0, 23.5 - 0.2 * 32], atol=0.3)
    page.get_by_label("the drive hall").tap()
    assert assert_the_cloud_agrees(page)["step"] > 1000


def test_the_cloud_grows_by_key(open_lab):
    page = open_lab("cloud")
    for name, key in (("Yaw rate noise", "Home"), ("Particles", "End")):
        page.get_by_role("slider", name=name).focus()
        page.keyboard.press(key)
    found = assert_the_cloud_agrees(page)
    assert found["spread"]["heading"] == pytest.approx(0, abs=1e-9)
    assert len(found["poses"]) == 3000
    page.locator(".pfslam-plan").focus()
    for key in ["ArrowUp"] * 6 + ["ArrowLeft"] * 6 + ["ArrowUp"] * 4:
        page.keyboard.press(key)
    found = assert_the_cloud_agrees(page)
    np.testing.assert_allclose(end_of_dead_reckoning(found), [3.0, 2.0, np.pi / 2], atol=1e-9)
    page.keyboard.press("Backspace")
    assert page.evaluate(CLOUD)["points"] == []
    page.keyboard.press("n")
    page.get_by_label("the drive hall").check()
    page.locator(".pfslam-plan").focus()
    page.keyboard.press("Space")
    page.wait_for_function(f"() => {LAB}.state.settings.part > 3")
    page.keyboard.press("Space")
    assert_the_cloud_agrees(page)
