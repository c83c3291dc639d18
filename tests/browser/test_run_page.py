"""The page that a run leaves, opened from its file in a real browser: by pointer, finger and keys, light and dark."""

from dataclasses import replace

import numpy as np
import pytest
from box_recording import box_recording
from headless import PAINTED, WIDTH_BEYOND_SCREEN, violations

from pfslam.__main__ import main
from pfslam.io.recordings import save

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("laboratories")]

RUN = "document.querySelector('figure.pfslam-lab').lab"
READY = f"() => {RUN}?.stage.fitted && (!{RUN}.state.maps || {RUN}.state.growth.order)"
AT = f"{RUN}.state.at"
PICTURES = "[...document.querySelectorAll('canvas')].map(c => c.toDataURL())"
BLIND = slice(20, 50)  # scans of ten a second


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A drive whose LiDAR is blind for three seconds: odometry alone is more than two seconds of distrust."""
    folder = tmp_path_factory.mktemp("run")
    drive = box_recording(seconds=8.0)
    ranges = drive.lidar.ranges.copy()
    ranges[BLIND] = 0.0
    save(replace(drive, lidar=replace(drive.lidar, ranges=ranges)), folder / "drive.npz")
    save(replace(drive, lidar=None, camera=None), folder / "wheels.npz")
    for name, more in (("drive", ["--loops", "--every", "1"]), ("wheels", [])):
        line = ["run", str(folder / f"{name}.npz"), "--out", str(folder / name), "--quiet", *more]
        assert main(line) == 0
    return folder


@pytest.fixture
def open_run(open_file, results):
    """Open a page: ``open_run("drive", width=390, color_scheme="dark")``."""

    def go(name: str = "drive", **context):
        page = open_file(results / name / "index.html", READY, **context)
        page.evaluate(PAINTED)
        return page

    return go


def pictures(page) -> list[str]:
    page.evaluate(PAINTED)
    return page.evaluate(PICTURES)


def test_keys_go_through_the_run_and_each_moment_is_another_picture(open_run):
    page = open_run()
    last = page.evaluate(f"{RUN}.state.last")
    page.keyboard.press("ArrowLeft")  # nothing has the focus yet
    assert page.evaluate(AT) == last - 1
    seen = []
    for key, at in (("Home", 0), ("ArrowRight", 1), ("PageDown", 11), ("ArrowLeft", 10), ("End", last)):
        page.keyboard.press(key)
        assert page.evaluate(AT) == at
        assert page.locator("input[type=range]").input_value() == str(at + 1)
        seen.append(pictures(page))
    for drawings in zip(*seen, strict=True):  # the map, the view from near, the time line
        assert len(set(drawings)) == len(drawings)
    page.keyboard.press(" ")  # from the end it begins anew, and stops at the end
    page.wait_for_function(f"() => {AT} > 0 && {AT} < {last} && {RUN}.stage.beat.running")
    page.keyboard.press(" ")
    assert page.evaluate(f"{RUN}.stage.beat.running") is False


@pytest.mark.parametrize("by", ["mouse", "finger"])
def test_the_time_line_is_scrubbed(open_run, by):
    page = open_run(width=390 if by == "finger" else 1280, has_touch=by == "finger")
    line = page.locator("canvas").nth(2)
    line.scroll_into_view_if_needed()
    box = line.bounding_box()
    at = []
    for share in (0.25, 0.75):
        place = box["x"] + 8 + share * (box["width"] - 16), box["y"] + 40
        (page.touchscreen.tap if by == "finger" else page.mouse.click)(*place)
        page.evaluate(PAINTED)
        at.append(page.evaluate(AT) / page.evaluate(f"{RUN}.state.last"))
    np.testing.assert_allclose(at, [0.25, 0.75], atol=0.03)
    if by == "mouse":
        page.mouse.move(*place)
        page.mouse.down()
        page.mouse.move(box["x"] + 8, place[1], steps=4)
        assert page.evaluate(AT) == 0
        page.mouse.up()


def test_distrust_is_named_with_its_time_and_leads_there(open_run):
    page = open_run()
    said = page.locator("p.doubt").inner_text()
    assert "Do not trust path and map" in said
    assert "no scan with enough beams" in said
    page.locator("p.doubt button").click()
    first = page.evaluate(f"{RUN}.state.doubts.findIndex(d => d.length)")
    assert abs(page.evaluate(AT) - first) <= 1
    page.evaluate(PAINTED)
    page.keyboard.press("PageDown")
    assert "Not to be trusted: no scan" in page.locator(".pfslam-story").inner_text()
    page.keyboard.press("Home")
    page.evaluate(PAINTED)
    assert "Not to be trusted" not in page.locator(".pfslam-story").inner_text()


def test_checks_change_the_picture(open_run):
    page = open_run()
    before = pictures(page)[0]
    page.locator(".pfslam-plan").first.focus()
    for key in ("l", "f", "s"):  # the floor belongs to the path that loops have not revised
        page.keyboard.press(key)
        after = pictures(page)[0]
        assert after != before, key
        before = after


@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_can_be_read_by_everybody(open_run, width, scheme):
    page = open_run(width=width, color_scheme=scheme)
    assert page.evaluate(WIDTH_BEYOND_SCREEN) == 0
    corner = "document.querySelector('canvas').getContext('2d').getImageData(2, 2, 1, 1).data[0]"
    assert (page.evaluate(corner) < 100) == (scheme == "dark")
    assert violations(page) == []
    page.emulate_media(color_scheme="dark" if scheme == "light" else "light")
    page.evaluate(PAINTED)
    assert (page.evaluate(corner) < 100) == (scheme == "light")


def test_a_link_leads_to_a_moment(open_run):
    page = open_run()
    page.keyboard.press("ArrowLeft")
    page.locator("summary", has_text="More").click()
    page.get_by_role("button", name="Link").click()
    assert "link" in page.locator("[role=status]").inner_text()
    at = page.evaluate(AT)
    assert page.url.endswith(f"#lab=run&moment={at + 1}")
    page.reload()
    page.wait_for_function(READY)
    assert page.evaluate(AT) == at


def test_with_less_motion_it_steps_and_does_not_play(open_run):
    page = open_run(reduced_motion="reduce")
    assert page.get_by_role("button", name="Start").count() == 0
    page.locator(".pfslam-plan").first.focus()
    page.keyboard.press("Home")
    page.keyboard.press(" ")
    assert page.evaluate(AT) == 1


def test_a_drive_without_lidar_shows_its_path(open_run):
    page = open_run("wheels")
    assert "No LiDAR" in page.locator("main").inner_text()
    page.locator(".pfslam-plan").first.focus()
    before = pictures(page)
    page.keyboard.press("Home")
    assert pictures(page) != before
