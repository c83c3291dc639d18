"""Chapter 09: the floor texture, one improvement after the other, on both drives. Makes and reads a stored table.

``python -m pfslam.teaching.ch09_texture`` makes the table anew: it needs the images, which take minutes to render.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path

from pfslam.files import read_text, write_text
from pfslam.teaching import ch06
from pfslam.texture import TextureConfig, map_texture

TABLE = Path(__file__).parent / "ch09_texture.csv"
EVERY = 48
"""Of the image pairs; chapter 06 takes twice as many."""
COLUMNS = ("drive", "step", "coverage", "beyond_floor", "position_median_cells", "colour_mean")


def measured_steps(drive_name: str, every: int = EVERY, steps: tuple[str, ...] | None = None) -> list[dict]:
    """One row per step from the report's settings to the refined ones, on poses of the refined filter."""
    drive = ch06.load_drive(drive_name, every)
    result = ch06.cheap_run(drive)
    judge = ch06.judge_for(drive, result.grid.spec)
    rows = []
    for name, config in TextureConfig.steps().items():
        if steps is None or name in steps:
            texture = map_texture(drive.recording, result.trajectory, result.grid, config)
            error = judge.error(texture)
            found = {column: round(getattr(error, column), 4) for column in COLUMNS[2:]}
            rows.append({"drive": drive_name, "step": name} | found)
    return rows


def read_steps() -> list[dict]:
    """The stored rows, numbers as float."""
    rows = list(csv.DictReader(io.StringIO(read_text(TABLE))))
    return [{k: v if k in COLUMNS[:2] else float(v) for k, v in row.items()} for row in rows]


def steps_lines() -> str:
    """The stored table: coverage, paint off the floor, shift of the pattern and colour error, for both drives."""
    rows = read_steps()
    names = list(dict.fromkeys(row["step"] for row in rows))
    lines = [f"{'':32s} {'hall':31s} ramp", f"{'':32s} " + 2 * "covered   off shift colour     "]
    for name in names:
        cells = []
        for row in (row for row in rows if row["step"] == name):
            shares = f"{100 * row['coverage']:5.0f} % {100 * row['beyond_floor']:4.0f} %"
            cells.append(f"{shares} {row['position_median_cells']:5.2f} {row['colour_mean']:6.0f}    ")
        lines.append(f"{name:32s} " + " ".join(cells).rstrip())
    return "\n".join(line.rstrip() for line in lines)


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
