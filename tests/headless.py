"""The browser of the tests: a headless Chromium that can resolve no name but this machine's address."""

import os
import shutil
from collections.abc import Iterator

import pytest

WIDTH_BEYOND_SCREEN = "document.documentElement.scrollWidth - document.documentElement.clientWidth"

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
