"""How heavy each chapter is, and when it can be read: `python book/_tools/load_time.py [SITE ...]`.

Every chapter of every built site is opened in turn in a headless Chromium as wide as a phone, and nobody touches it:
once as a phone opens it, which is Story, and once by a reader who has chosen Workshop before.
Counted is the time that the processor spends on the page, its scripts, layout and painting, so that other programs do
not count; a processor that is four times slower spends four times as much. *Ready* is all of that until the browser
has loaded the page and all scripts have set it up. *Blocked* is how much of it the page could answer nobody: of each
task, what is beyond 50 ms. The median of three visits counts. Nothing is asserted.
"""

import functools
import http.server
import json
import sys
import threading
from pathlib import Path

import numpy as np
from lab_stills import chromium

SLOWER, VISITS, PHONE = 4, 3, {"width": 390, "height": 844}
WAYS = ("story", "workshop")
TRACED = ["devtools.timeline", "disabled-by-default-devtools.timeline"]
SETTLED = 300  # ms after loading, in which the page sets itself up
BEYOND = 50  # ms of a task, during which a reader does not feel that the page answers late


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Serves a site and says nothing."""

    def log_message(self, *_):
        """Every request would be a line."""


def served(site: Path) -> str:
    """The address of a site that is served on this machine for as long as the tool runs."""
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(site)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return f"http://127.0.0.1:{server.server_port}/"


def visit(browser, address: str, way: str) -> list[float]:
    """Bytes that were sent, time until the page was ready and time blocked (ms), elements: of one visit."""
    context, sent = browser.new_context(viewport=PHONE, device_scale_factor=2), []
    context.add_init_script(f"localStorage['pfslam:read'] = '{way}'")
    page = context.new_page()
    session = context.new_cdp_session(page)
    session.on("Network.loadingFinished", lambda event: sent.append(event["encodedDataLength"]))
    session.send("Network.enable")
    browser.start_tracing(page=page, categories=TRACED)
    page.goto(address, wait_until="load")
    page.wait_for_timeout(SETTLED)
    ready, blocked = times(json.loads(browser.stop_tracing())["traceEvents"])
    elements = page.evaluate("document.querySelectorAll('*').length")
    context.close()
    return [sum(sent), ready, blocked, elements]


def times(events: list[dict]) -> tuple[float, float]:
    """Until the page was ready, and blocked (ms, on the slower processor), from what the browser has traced."""
    *_, loaded = (event for event in events if event["name"] == "MarkLoad")  # after the empty page's
    tasks = [
        event
        for event in events
        if event["name"] == "RunTask" and all(event[name] == loaded[name] for name in ("pid", "tid"))
    ]
    spent = SLOWER / 1000 * np.array([task.get("tdur", 0) for task in tasks])
    before = np.array([task["ts"] < loaded["ts"] for task in tasks])
    return spent[before].sum(), np.maximum(spent - BEYOND, 0).sum()


def main(sites: list[str]) -> None:
    """Print a line for each chapter of each site."""
    roots = [Path(site) for site in sites or ["_build/html"]]
    addresses = [served(root) for root in roots]
    print(f"processor {SLOWER} times slower, {PHONE['width']} px wide: size, ready, blocked, elements")
    with chromium() as browser:
        for name in sorted(path.name for path in roots[0].glob("notebooks/*.html")):
            for way in WAYS:
                rounds = range(VISITS)
                visits = [[visit(browser, f"{at}notebooks/{name}", way) for at in addresses] for _ in rounds]
                for size, ready, blocked, elements in np.median(visits, axis=0):
                    spent = f"{ready / 1000:5.2f} s  {blocked / 1000:5.2f} s"
                    print(f"{name[:2]}  {way:8}  {size / 1e6:5.2f} MB  {spent}  {elements:6.0f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
