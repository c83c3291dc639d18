"""Chapter 09: the floor texture, one improvement after the other, on both drives. Makes and reads a stored table.

``python -m pfslam.teaching.ch09_texture`` makes the table anew: it renders the images, which takes minutes.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from pfslam.config import SlamConfig
from pfslam.files import read_text, write_text
from pfslam.recording import nearest_stamp
from pfslam.runs import run_slam
from pfslam.teaching import ch06
from pfslam.texture import TextureConfig, map_texture

TABLE = Path(__file__).parent / "ch09_texture.csv"
EVERY = 60
"""Of the scans: the image pair nearest to each is taken. Every 60th scan updates the filter, so that the report's way,
where a state takes the image nearest to it, is as near as it is with all images."""
SEEDS = range(10)
COLUMNS = ("drive", "step", "seed", "coverage", "beyond_floor", "position_median_cells", "colour_mean")
FIGURES = COLUMNS[3:]


def thinned(drive: ch06.Drive, every: int = EVERY) -> ch06.Drive:
    """The drive with the image pair nearest to every ``every``-th scan."""
    stream, scans = drive.stream, drive.recording.scans().t[::every]
    chosen = np.unique(nearest_stamp(stream.disparity_t[stream.disparity_index], scans))
    few = replace(stream, disparity_index=stream.disparity_index[chosen], rgb_index=stream.rgb_index[chosen])
    return replace(drive, recording=replace(drive.recording, camera=few), stream=few)


def measured_steps(
    drive_name: str, seeds: Iterable[int] = SEEDS, steps: tuple[str, ...] | None = None
) -> Iterator[dict]:
    """One row per seed and step, from the report's settings to the refined ones, on poses of the refined filter."""
    drive = thinned(ch06.load_drive(drive_name, 1))
    for seed in seeds:
        rng = np.random.default_rng(seed)
        result = run_slam(drive.recording, SlamConfig.refined(), rng=rng, keep_particles=False)
        judge = ch06.judge_for(drive, result.grid.spec)
        for name, config in TextureConfig.steps().items():
            if steps is None or name in steps:
                texture = map_texture(drive.recording, result.trajectory, result.grid, config)
                error = judge.error(texture)
                found = {column: round(getattr(error, column), 4) for column in FIGURES}
                yield {"drive": drive_name, "step": name, "seed": seed} | found


def read_steps() -> list[dict]:
    """The stored rows, figures as float."""
    rows = list(csv.DictReader(io.StringIO(read_text(TABLE))))
    return [{k: float(v) if k in FIGURES else v for k, v in row.items()} for row in rows]


def steps_lines() -> str:
    """Medians over the seeds: coverage, paint off the floor, shift of the pattern and colour error, for both drives."""
    rows = read_steps()
    head = "covered   off  shift  colour"
    lines = [f"{'':32s}{'hall':31s}ramp", f"{'':32s}{head}   {head}"]
    for name in dict.fromkeys(row["step"] for row in rows):
        cells = []
        for drive in dict.fromkeys(row["drive"] for row in rows):
            covered, off, shift, colour = (np.median(values_of(rows, drive, name, f)) for f in FIGURES)
            cells.append(f"{100 * covered:5.0f} % {100 * off:3.0f} %  {shift:5.2f}  {colour:6.0f}")
        lines.append(f"{name:32s}" + "   ".join(cells))
    return "\n".join(lines)


def values_of(rows: list[dict], drive: str, step: str, figure: str) -> list[float]:
    """One figure over the seeds."""
    return [row[figure] for row in rows if (row["drive"], row["step"]) == (drive, step)]


def largest_spread(figure: str) -> float:
    """How far the seeds of one drive and step lie apart at most."""
    rows = read_steps()
    places = dict.fromkeys((row["drive"], row["step"]) for row in rows)
    return float(max(np.ptp(values_of(rows, *place, figure)) for place in places))


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
