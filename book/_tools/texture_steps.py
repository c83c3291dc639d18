"""The table of the floor texture for chapter 09: one improvement after the other, on both drives.

``python book/_tools/texture_steps.py`` makes it anew: it renders the images, which takes minutes.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator

import numpy as np

from pfslam.config import SlamConfig
from pfslam.io.files import write_text
from pfslam.runs import run_slam
from pfslam.teaching.ch06.pairs import judge_for, load_drive
from pfslam.teaching.ch09.texture import COLUMNS, FIGURES, TABLE
from pfslam.texture.mapping import TextureConfig, map_texture

SEEDS = range(10)


def measured_steps(
    drive_name: str, seeds: Iterable[int] = SEEDS, steps: tuple[str, ...] | None = None
) -> Iterator[dict]:
    """One row per seed and step, from the report's settings to the refined ones, on poses of the refined filter."""
    drive = load_drive(drive_name)
    for seed in seeds:
        rng = np.random.default_rng(seed)
        result = run_slam(drive.recording, SlamConfig.refined(), rng=rng, keep_particles=False)
        judge = judge_for(drive, result.grid.spec)
        for name, config in TextureConfig.steps().items():
            if steps is None or name in steps:
                texture = map_texture(drive.recording, result.trajectory, result.grid, config)
                error = judge.error(texture)
                found = {column: round(getattr(error, column), 4) for column in FIGURES}
                yield {"drive": drive_name, "step": name, "seed": seed} | found


def main() -> None:
    """Measure both drives and store the table."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for drive in ("hall", "ramp"):
        writer.writerows(measured_steps(drive))
    write_text(TABLE, text.getvalue())


if __name__ == "__main__":
    main()
