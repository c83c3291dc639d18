"""The built site, served on this machine and opened from its files, in a real Chromium."""

import functools
import http.server
import os
import shutil
import threading
from dataclasses import dataclass, field
from pathlib import Path

import pytest

SITE = Path(__file__).resolve().parents[2] / "_build" / "html"
PAGES = sorted(str(p.relative_to(SITE)) for p in SITE.rglob("*.html") if "_static" not in p.parts)
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


def missing(what: str):
    """Skip, unless this run must not skip."""
    (pytest.fail if REQUIRED else pytest.skip)(what)


def explorer_pages() -> list[str]:
    return [name for name in PAGES if "pfslam-explorer" in (SITE / name).read_text(encoding="utf-8")]


def pytest_generate_tests(metafunc):
    if "page_name" in metafunc.fixturenames:
        metafunc.parametrize("page_name", PAGES or ["no site"])
    if "explorer_page" in metafunc.fixturenames:
        metafunc.parametrize("explorer_page", explorer_pages() or ["no explorer"])


@pytest.fixture(scope="session")
def site() -> Path:
    if not PAGES:
        missing("the site is not built: make book")
    return SITE


class QuietHandler(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@pytest.fixture(scope="session")
def addresses(site):
    """How to reach the site: over HTTP on this machine, and as files."""
    handler = functools.partial(QuietHandler, directory=str(site))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield {"http": f"http://127.0.0.1:{server.server_port}/", "file": site.as_uri() + "/"}
    server.shutdown()


@pytest.fixture(scope="session")
def chromium():
    """A headless Chromium that can resolve no name but this machine's address."""
    sync_api = pytest.importorskip("playwright.sync_api")
    executable = shutil.which("chromium") or shutil.which("google-chrome")
    if executable is None:
        missing("no Chromium on this machine")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=CHROMIUM_FLAGS)
        yield browser
        browser.close()


@dataclass
class Visit:
    """One opened page and everything it complained about or asked for from elsewhere."""

    page: object
    complaints: list[str] = field(default_factory=list)
    strangers: list[str] = field(default_factory=list)


@pytest.fixture
def visit(chromium, addresses):
    """Open a page of the site: `visit("book/index.html", scheme="file", width=390)`."""
    contexts = []

    def open_page(name: str, scheme: str = "http", width: int = 1280, **options) -> Visit:
        context = chromium.new_context(viewport={"width": width, "height": 900}, **options)
        contexts.append(context)
        page, base = context.new_page(), addresses[scheme]
        seen = Visit(page)

        def on_request(request):
            if not request.url.startswith((base, "data:", "blob:")):
                seen.strangers.append(request.url)

        page.on("request", on_request)
        page.on("requestfailed", lambda r: seen.complaints.append(f"failed: {r.url}"))
        page.on("pageerror", lambda error: seen.complaints.append(f"script error: {error}"))
        page.on("console", lambda m: m.type == "error" and seen.complaints.append(f"console: {m.text}"))
        page.goto(base + name, wait_until="load")
        page.wait_for_function(
            "!window.MathJax?.startup?.promise || MathJax.startup.promise.then(() => true)"
        )
        return seen

    yield open_page
    for context in contexts:
        context.close()
