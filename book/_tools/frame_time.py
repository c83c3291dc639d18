"""How long a laboratory works on one frame: `python book/_tools/frame_time.py [NAME ...]`, all of them by default.

Each laboratory runs in a headless Chromium as wide as a phone, for three seconds of its own at 30 frames a second: by
its clock if it has one, else with its first slider moved before every frame. Counted is the time that the processor
spends on the page, its scripts, layout and painting, so that other programs do not count. A processor that is four
times slower spends four times as much, and has 33 ms for a frame. ``--after 3600`` lets a laboratory tick for an hour
first. Nothing is asserted.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from lab_stills import MOMENTS, chromium, page

SLOWER, RATE, SECONDS = 4, 30, 3
LABORATORIES = {name: (name, None, "") for name in MOMENTS} | {
    "hero": ("drive", {"small": True}, "lab.story.show(2);"),  # scans choose, from an empty map
}
# Frames come when they are asked for, and each brings the ticks of its share of a second.
HOLD = """([after, begin]) => {
  const {lab} = document.querySelector('figure.pfslam-lab'), {stage} = lab;
  new Function('lab', begin)(lab);
  stage.redraw = () => {};
  if (!stage.beat) return;
  for (let tick = after * stage.beat.hertz; tick > 0; tick--) stage.beat.tick();
  stage.beat.start();
  stage.beat.last = 0;
}"""
FRAME = """([now, share]) => new Promise(done => requestAnimationFrame(() => {
  const {stage} = document.querySelector('figure.pfslam-lab').lab;
  const slider = stage.body.querySelector('input[type=range]');
  if (now && !stage.beat) {
    slider.value = Number(slider.min) + share * (slider.max - slider.min);
    slider.dispatchEvent(new Event('input'));
  }
  if (now) stage.frame(now);
  done();
}))"""


def processor_time(session) -> float:
    """How long the processor has worked on the page in its main thread, ms."""
    metrics = session.send("Performance.getMetrics")["metrics"]
    return 1000 * next(metric["value"] for metric in metrics if metric["name"] == "ThreadTime")


def frame_times(browser, name: str, folder: Path, after: float = 0) -> tuple[float, np.ndarray]:
    """The time (ms) until a laboratory is ready, and that of each frame, on this processor."""
    lab, options, begin = LABORATORIES[name]
    place = folder / f"{name}.html"
    place.write_text(page(lab, options), encoding="utf-8")
    context = browser.new_context(viewport={"width": 390, "height": 844}, device_scale_factor=2)
    sheet = context.new_page()
    session = context.new_cdp_session(sheet)
    session.send("Performance.enable")
    sheet.goto(place.as_uri())
    sheet.wait_for_function("() => document.querySelector('figure.pfslam-lab').lab?.stage.fitted")
    sheet.wait_for_function("() => document.querySelector('figure.pfslam-lab').lab.state.ready !== false")
    start = processor_time(session)
    sheet.evaluate(HOLD, [after, begin])

    def spent(frame: int) -> float:
        before = processor_time(session)
        sheet.evaluate(FRAME, [1000 * frame / RATE, 0.5 + 0.5 * np.sin(0.1 * frame)])
        return processor_time(session) - before

    asking = np.median([spent(0) for _ in range(RATE)])  # what it costs to ask for a frame
    times = np.array([spent(frame) for frame in range(1, SECONDS * RATE + 1)]) - asking
    context.close()
    return start, times


def main() -> None:
    """Print a line for each laboratory."""
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--after", type=float, default=0, help="seconds that the laboratory has run before")
    asked = parser.parse_args()
    print(
        f"processor {SLOWER} times slower, 390 px wide: ready, and a frame, of which there are {RATE} a second"
    )
    with chromium() as browser, tempfile.TemporaryDirectory() as folder:
        for name in asked.names or LABORATORIES:
            start, times = frame_times(browser, name, Path(folder), asked.after)
            median, late, worst = SLOWER * np.percentile(times, [50, 95, 100])
            print(
                f"{name:10s} {SLOWER * start:5.0f} ms; "
                f"median {median:5.1f} ms, 95 % below {late:5.1f} ms, worst {worst:5.1f} ms",
                flush=True,
            )


if __name__ == "__main__":
    main()
