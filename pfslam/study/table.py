"""One tidy table: a row for each run, in the order of the cases, as CSV.

Numbers are written so that they read back to the last bit. A cell without a value is empty.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.io.files import read_text, write_csv

TEXT_COLUMNS = ("label", "dataset", "data_dir", "method", "error")
Table = dict[str, np.ndarray]


def write_table(path: Path, rows: list[dict[str, Any]], settings: Iterable[str]) -> None:
    """Write the rows as CSV: first the columns of settings, then the others, in the order in which they occur."""
    columns = list(dict.fromkeys(["label", *settings, *(key for row in rows for key in row)]))
    write_csv(path, [columns, *([_cell(row.get(column)) for column in columns] for row in rows)])


def _cell(value: Any) -> str:
    """Write a value as text: nothing for None, true and false, lists as in JSON."""
    if value is None:
        return ""
    return value if isinstance(value, str) else json.dumps(value)


def read_table(path: str | Path) -> Table:
    """Read the columns of a table: numbers as float (NaN where empty, true as 1), everything else as text."""
    rows = list(csv.reader(io.StringIO(read_text(path))))
    if not rows or not rows[0]:
        raise DataError(path, "table", "nothing", "a first line with the names of the columns")
    head, body = rows[0], rows[1:]
    for number, row in enumerate(body, start=2):
        if len(row) != len(head):
            raise DataError(path, f"line {number}", f"{len(row)} cells", f"{len(head)} cells")
    return {name: _column(name, [row[i] for row in body]) for i, name in enumerate(head)}


def _column(name: str, cells: list[str]) -> np.ndarray:
    words = {"": np.nan, "true": 1.0, "false": 0.0}
    if name not in TEXT_COLUMNS and any(cells):
        with suppress(ValueError):  # a column with a word in it is a column of words
            return np.array([words[cell] if cell in words else float(cell) for cell in cells])
    return np.array(cells, dtype=str)
