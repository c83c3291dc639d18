"""How long a laboratory works on one frame: `python book/_tools/frame_time.py [NAME ...]`, all of them by default.

Each laboratory runs in a headless Chromium as wide as a phone, whose processor is slowed down four times, for three
seconds: by its clock if it has one, else with its first slider moved before every frame. At 60 frames a second there
are 16.7 ms for a frame. The figures depend on the machine and on what else it does, and nothing is asserted.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from lab_stills import MOMENTS, chromium, page

SLOWER, SECONDS = 4, 3
RUN = """async ([seconds]) => {
  const {stage} = document.querySelector('figure.pfslam-lab').lab, frame = stage.frame.bind(stage), times = [];
  stage.frame = now => { const begin = performance.now(); frame(now); times.push(performance.now() - begin); };
  const slider = stage.body.querySelector('input[type=range]'), low = Number(slider.min), high = Number(slider.max);
  if (stage.beat) stage.beat.start();
  const end = performance.now() + 1000 * seconds;
  for (let k = 0; performance.now() < end; k++) {
    if (!stage.beat) {
      slider.value = low + (high - low) * (0.5 + 0.5 * Math.sin(0.05 * k));
      slider.dispatchEvent(new Event('input'));
    }
    await new Promise(requestAnimationFrame);
  }
  return times;
}"""


def frame_times(browser, name: str, folder: Path) -> np.ndarray:
    """The time (ms) that each frame of a laboratory took in the running state."""
    place = folder / f"{name}.html"
    place.write_text(page(name), encoding="utf-8")
    context = browser.new_context(viewport={"width": 390, "height": 844}, device_scale_factor=2)
    sheet = context.new_page()
    sheet.goto(place.as_uri())
    sheet.wait_for_function("() => document.querySelector('figure.pfslam-lab').lab?.stage.fitted")
    sheet.wait_for_function("() => document.querySelector('figure.pfslam-lab').lab.state.ready !== false")
    context.new_cdp_session(sheet).send("Emulation.setCPUThrottlingRate", {"rate": SLOWER})
    times = sheet.evaluate(RUN, [SECONDS])
    context.close()
    return np.array(times)


def main(names: list[str]) -> None:
    """Print a line for each laboratory."""
    print(f"work for one frame, processor {SLOWER} times slower, 390 px wide")
    with chromium() as browser, tempfile.TemporaryDirectory() as folder:
        for name in names or MOMENTS:
            times = frame_times(browser, name, Path(folder))
            median, late = np.percentile(times, [50, 95])
            print(
                f"{name:10s} median {median:5.1f} ms, 95 % below {late:5.1f} ms, {len(times)} frames",
                flush=True,
            )


if __name__ == "__main__":
    main(sys.argv[1:])
