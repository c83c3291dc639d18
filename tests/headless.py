"""The browser of the tests: a headless Chromium that can resolve no name but this machine's address."""

import os
import shutil
from collections.abc import Iterator
from importlib.resources import files

import pytest

WIDTH_BEYOND_SCREEN = "document.documentElement.scrollWidth - document.documentElement.clientWidth"

FINDINGS = """async options => {
  const found = await axe.run(document, {...options, resultTypes: ['violations'], preload: false});
  return found.violations.flatMap(v => v.nodes.map(n => v.id + ': ' + n.html.slice(0, 160)));
}"""
PAINTED = "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
PHONE = {"width": 390, "has_touch": True, "is_mobile": True}

REQUIRED = os.environ.get("PFSLAM_REQUIRE_BROWSER") == "1"
CHROMIUM_FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
]


def missing(what: str) -> None:
    """Skip, unless this run must not skip."""
    (pytest.fail if REQUIRED else pytest.skip)(what)


def running_chromium() -> Iterator:
    """The browser, closed when the tests are through."""
    sync_api = pytest.importorskip("playwright.sync_api")
    executable = shutil.which("chromium") or shutil.which("google-chrome")
    if executable is None:
        missing("no Chromium on this machine")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=CHROMIUM_FLAGS)
        yield browser
        browser.close()


def violations(page, **options) -> list[str]:
    """What axe finds on a page that not everybody can use."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(files("axe_playwright_python").joinpath("axe.min.js").read_text(encoding="utf-8"))
    return page.evaluate(FINDINGS, options)


def touching(page, places) -> Iterator[None]:
    """A finger that is put down at the first place (px), goes on to the others one by one, stops and is lifted."""
    session = page.context.new_cdp_session(page)
    for k, (x, y) in enumerate(places):
        kind, points = "touchMove" if k else "touchStart", [{"x": float(x), "y": float(y)}]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        yield
    page.wait_for_timeout(100)  # a finger that stops before it is lifted throws nothing
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
