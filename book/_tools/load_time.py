"""How heavy each chapter is, and when it can be read: `python book/_tools/load_time.py [SITE ...]`.

Every chapter of every built site is opened in turn in a headless Chromium as wide as a phone, whose processor is slowed
down four times, and nobody touches it. *Ready* is when the browser has loaded the page and all scripts have set it up.
*Blocked* is how much of that time the page could answer nobody: of each task, what is beyond 50 ms. The median of three
visits counts. The times depend on the machine and on what else it does, so that two sites are compared in one run;
nothing is asserted.
"""

import functools
import http.server
import sys
import threading
from pathlib import Path

import numpy as np
from lab_stills import chromium

SLOWER, VISITS, PHONE = 4, 3, {"width": 390, "height": 844}
WATCH = """window.tasks = [];
new PerformanceObserver(seen => tasks.push(...seen.getEntries().map(task => task.duration)))
  .observe({type: 'longtask', buffered: true});"""
# The time from the first request to the end of loading, the time blocked until then (ms), and the elements of the page.
FOUND = """async () => {
  await new Promise(done => setTimeout(done, 300));
  const ready = performance.getEntriesByType('navigation')[0].loadEventEnd;
  return [ready, tasks.reduce((sum, task) => sum + task - 50, 0), document.querySelectorAll('*').length];
}"""


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Serves a site and says nothing."""

    def log_message(self, *_):
        """Every request would be a line."""


def served(site: Path) -> str:
    """The address of a site that is served on this machine for as long as the tool runs."""
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(site)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return f"http://127.0.0.1:{server.server_port}/"


def visit(browser, address: str) -> list[float]:
    """Bytes that were sent, time until the page was ready and time blocked (ms), elements: of one visit."""
    context, sent = browser.new_context(viewport=PHONE, device_scale_factor=2), []
    page = context.new_page()
    page.add_init_script(WATCH)
    session = context.new_cdp_session(page)
    session.on("Network.loadingFinished", lambda event: sent.append(event["encodedDataLength"]))
    session.send("Network.enable")
    session.send("Emulation.setCPUThrottlingRate", {"rate": SLOWER})
    page.goto(address, wait_until="load")
    found = page.evaluate(FOUND)
    context.close()
    return [sum(sent), *found]


def main(sites: list[str]) -> None:
    """Print a line for each chapter of each site."""
    roots = [Path(site) for site in sites or ["_build/html"]]
    addresses = [served(root) for root in roots]
    print(f"processor {SLOWER} times slower, {PHONE['width']} px wide: size, ready, blocked, elements")
    with chromium() as browser:
        for name in sorted(path.name for path in roots[0].glob("notebooks/*.html")):
            visits = [[visit(browser, f"{at}notebooks/{name}") for at in addresses] for _ in range(VISITS)]
            for size, ready, blocked, elements in np.median(visits, axis=0):
                times = f"{ready / 1000:5.2f} s  {blocked / 1000:5.2f} s"
                print(f"{name[:2]}  {size / 1e6:5.2f} MB  {times}  {elements:6.0f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
