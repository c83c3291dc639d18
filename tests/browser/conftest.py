"""The built site, served on this machine and opened from its files, in a real Chromium."""

import functools
import http.server
import threading
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from headless import missing

SITE = Path(__file__).resolve().parents[2] / "_build" / "html"
ALL_PAGES = sorted(p.relative_to(SITE).as_posix() for p in SITE.rglob("*.html") if "_static" not in p.parts)
# The pages of source code hold no widgets and no equations: one test looks at each.
SOURCES = [name for name in ALL_PAGES if name.startswith("_modules/pfslam/")]
# The page for lost visitors has two links and no menu: one test is its own. Slides have tests of their own.
PAGES = [
    name for name in ALL_PAGES if not (name in SOURCES or name == "404.html" or name.startswith("slides/"))
]
# Of each kind the one at which every change is looked at; the others have their turn at night.
KINDS = {"book/index.html", "book/notation.html", "notebooks/03_prediction_only.html"}


def explorer_pages() -> list[str]:
    return [name for name in PAGES if "pfslam-explorer" in (SITE / name).read_text(encoding="utf-8")]


def pytest_generate_tests(metafunc):
    """All tests of one page run in one worker, one after the other: the page is opened once for most of them."""
    chapters = [name for name in PAGES if name.startswith("notebooks/")]
    pages_for = {
        "page_name": PAGES,
        "chapter_page": chapters,
        "explorer_page": explorer_pages(),
        "source_page": SOURCES,
    }
    for argument, names in pages_for.items():
        if argument in metafunc.fixturenames:
            night = {name: [] if name in KINDS else [pytest.mark.nightly] for name in names}
            pages = [
                pytest.param(name, marks=[pytest.mark.xdist_group(name), *night[name]]) for name in names
            ]
            metafunc.parametrize(argument, pages or ["no page"], scope="session")


@pytest.fixture(scope="session")
def site() -> Path:
    if not PAGES:
        missing("the site is not built: make book")
    return SITE


WHOLE = (
    """() => document.readyState === 'complete' && !document.querySelector('meta[http-equiv=refresh i]')"""
)


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


@dataclass
class Visit:
    """One opened page and everything it complained about or asked for from elsewhere."""

    page: object
    complaints: list[str] = field(default_factory=list)
    strangers: list[str] = field(default_factory=list)


def open_page(context, address: str, base: str) -> Visit:
    """Open one page and wait until it is whole: sent on where it only sends on, and read."""
    page = context.new_page()
    seen = Visit(page)

    def on_request(request):
        if not request.url.startswith((base, "data:", "blob:")):
            seen.strangers.append(request.url)

    page.on("request", on_request)
    # A picture that is exchanged for its other theme while it loads is given up by the page itself.
    page.on(
        "requestfailed",
        lambda r: None if r.failure == "net::ERR_ABORTED" else seen.complaints.append(f"failed: {r.url}"),
    )
    page.on("response", lambda r: r.status >= 400 and seen.complaints.append(f"{r.status}: {r.url}"))
    page.on("pageerror", lambda error: seen.complaints.append(f"script error: {error}"))
    page.on("console", lambda m: m.type == "error" and seen.complaints.append(f"console: {m.text}"))
    page.goto(address, wait_until="load")
    page.wait_for_function(WHOLE)
    return seen


@pytest.fixture(scope="session")
def opener():
    """``open_page`` for tests with an address of their own."""
    return open_page


@pytest.fixture
def open_file(chromium):
    """Open a file on a page of its own; at the end none has complained, or asked for something from elsewhere."""
    visits = []

    def go(path: Path, ready: str, width: int = 1280, height: int = 900, **context):
        context = chromium.new_context(viewport={"width": width, "height": height}, **context)
        visits.append(open_page(context, path.as_uri(), "file:///"))
        visits[-1].page.wait_for_function(ready)
        return visits[-1].page

    yield go
    for seen in visits:
        assert seen.complaints + seen.strangers == []
        seen.page.context.close()


@pytest.fixture
def visit(chromium, addresses):
    """Open a page of the site: `visit("book/index.html", scheme="file", width=390, way="workshop")`.

    The way is what the reader has chosen on an earlier visit, if any.
    """
    contexts = []

    def go(
        name: str, scheme: str = "http", width: int = 1280, height: int = 900, way=None, **options
    ) -> Visit:
        context = chromium.new_context(viewport={"width": width, "height": height}, **options)
        contexts.append(context)
        if way:
            context.add_init_script(f"localStorage['pfslam:read'] ??= '{way}'")
        return open_page(context, addresses[scheme] + name, addresses[scheme])

    yield go
    for context in contexts:
        context.close()


@pytest.fixture(scope="session")
def shared_visit(chromium, addresses, page_name):
    """One page over HTTP, opened once for all tests that only look; each sets the width and look that it needs."""
    context = chromium.new_context(viewport={"width": 1280, "height": 900}, reduced_motion="reduce")
    yield open_page(context, addresses["http"] + page_name, addresses["http"])
    context.close()


@pytest.fixture
def shared(shared_visit):
    """That page as it was opened: desktop width, light, on the screen; nothing asked for elsewhere or complained of."""
    page = shared_visit.page
    page.set_viewport_size({"width": 1280, "height": 900})
    page.emulate_media(media="screen")
    page.evaluate("() => { document.documentElement.dataset.theme = 'light'; window.scrollTo(0, 0); }")
    return page
