"""Draw the stored pictures of the laboratories: `lab_stills.py drive ...`, or all of them.

The picture stands where no script runs, and in print. Each laboratory is opened in a headless Chromium, brought to the
moment in ``MOMENTS``, and its first canvas is written beside its script as ``NAME.webp``.
"""

import base64
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np
from pfslam_book.show import lab

from pfslam.io.datasets import load
from pfslam.io.files import atomic_write
from pfslam.sensors import RgbdModel

# What to do with the laboratory, here called `lab`, before its picture is taken.
MOMENTS = {
    "drive": "",
    "cells": "lab.state.look(); for (let k = 0; k < 3; k++) { lab.state.move(); lab.state.look(); }",
    "cloud": "",
    "maps": "for (let k = 0; k < 6; k++) lab.state.step(); lab.state.resample();",
    "calibrate": "",
    "grow": "lab.state.drive(5, 3);",
    "journey": "",
    "slide": "",
    "lost": "for (let k = 0; k < 6 * 60; k++) lab.state.tick();",
    "beam": "",
    "blur": "",
    "dot": "",
    "lever": "",
    "late": "lab.stage.set({'clock-offset': '100'});",
    "scrub": "lab.stage.set({'time': '62'});",
    "sharpness": "",
    "smoothing": "",
    "turn": "lab.stage.set({'turned-by': '360'});",
    "springs": "lab.state.settings.honest = true; for (let k = 0; k < 9; k++) lab.state.step();",
}
WIDTH, QUALITY = 688, 0.85
DRAWN = """async ([name, moment, quality]) => {
  const lab = document.querySelector('figure.pfslam-lab').lab;
  new Function('lab', moment)(lab);
  lab.draw();
  return lab.stage.sheets[0].canvas.toDataURL('image/webp', quality);
}"""


@cache
def default_options(name: str) -> dict:
    """What a laboratory cannot do without."""
    if lab.scripts(name)[-1].startswith("picture_"):
        return picture_options(name)
    if name != "journey":
        return {}
    from pfslam_book.ch06.live import journey_options

    return journey_options(RgbdModel())


def picture_options(name: str) -> dict:
    """What the chapters hand to the pictures with a slider."""
    from pfslam_book import ch00, ch01, ch04, ch08, ch13
    from pfslam_book.ch06.live import dot_options
    from pfslam_book.show import faults
    from pfslam_book.show.drives import scans_along

    from pfslam.correlation import map_correlation
    from pfslam.motion import controls, dead_reckoning
    from pfslam.poses import transform_points

    hall = load("hall")
    if name == "sharpness":
        corner = ch04.place_at(hall, 14.5)
        cloud = corner.pose + np.random.default_rng(0).normal(0, [0.02, 0.02, 0.004], (200, 3))
        walls, points = (corner.grid.occupied, corner.grid.spec), transform_points(cloud, corner.points_b)
        shares = [map_correlation(*walls, points_w) / len(points_w) for points_w in points]
        return ch04.sharpness_options(cloud, np.array(shares))
    if name == "blur":
        half_turn = faults.scans_between(hall, *ch08.TURNS)
        some = scans_along(half_turn, dead_reckoning(half_turn), range(0, len(half_turn.lidar.t), 16))
        return {"cell": 0.05, "window": (2, 13, 13.5, 24.5), **some}
    if name == "lever":
        return ch13.lever_options(hall, dead_reckoning(hall), np.arange(3382, 3542, 8))
    return {
        "beam": lambda: {"end": [7, 3]},
        "dot": lambda: dot_options(RgbdModel()),
        "late": lambda: ch00.late_options(hall),
        "scrub": lambda: ch00.scrub_options(hall),
        "smoothing": lambda: ch01.smoothing_options(controls(hall)),
        "turn": ch00.turn_options,
    }[name]()


def page(name: str, options: dict | None = None, theme: str = "light") -> str:
    """A page with one laboratory and nothing else, whose scripts are the files of this package."""
    style = (Path(__file__).parents[1] / "_static" / "pfslam.css").as_uri()
    tags = "".join(
        f'<script defer src="{lab.asset(script).as_uri()}"></script>' for script in lab.scripts(name)
    )
    figure = lab.page_fragment(
        lab.Laboratory(name, name, "The stored picture.", options or default_options(name))
    )
    return f"""<!doctype html><html lang="en" data-theme="{theme}"><head><meta charset="utf-8"><title>{name}</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="stylesheet" href="{style}"><link rel="stylesheet" href="{lab.asset("lab.css").as_uri()}">
<style>html {{--pst-color-primary: #0f57bd}} body {{max-width: 688px; margin: 0 auto; font: 16px sans-serif}}
html[data-theme=dark] {{background: #121212; color: #eee; --pst-color-text-base: #eee; --pst-color-primary: #7db2f7}}
</style></head>
<body><main><h1>{name}</h1>{figure}</main>{tags}</body></html>"""


@contextmanager
def chromium() -> Iterator:
    """A headless Chromium that is closed at the end."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox", "--disable-gpu"]
        )
        yield browser
        browser.close()


def main(names: list[str]) -> None:
    """Write the picture of each laboratory that is named."""
    with chromium() as browser:
        for name in names or MOMENTS:
            target = lab.FOLDER / f"{name}.webp"
            place = target.with_suffix(".html")
            context = browser.new_context(
                viewport={"width": WIDTH, "height": 900}, device_scale_factor=1.5, reduced_motion="reduce"
            )
            place.write_text(page(name), encoding="utf-8")
            try:
                sheet = context.new_page()
                sheet.goto(place.as_uri())
                sheet.wait_for_function("() => document.querySelector('figure.pfslam-lab').lab?.stage.fitted")
                sheet.wait_for_function(
                    "() => document.querySelector('figure.pfslam-lab').lab.state.ready !== false"
                )
                picture = sheet.evaluate(DRAWN, [name, MOMENTS[name], QUALITY])
            finally:
                place.unlink()
            with atomic_write(target) as file:
                file.write(base64.b64decode(picture.partition(",")[2]))
            print(target, target.stat().st_size)


if __name__ == "__main__":
    main(sys.argv[1:])
