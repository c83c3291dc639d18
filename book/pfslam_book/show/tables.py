"""The stored tables of studies as chapters read them, and tables as a cell shows them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.study.table import Table
from pfslam.study.table import read_table as read_table_file
from pfslam_book.show.pictures import output_mode

CHAPTERS = Path(__file__).resolve().parents[1]
ERROR = "ate_rmse_m"
"""The column with the error that the chapters speak of: position, root mean square, by the first pose."""


def stored_studies() -> list[str]:
    """The names of all studies whose tables are stored."""
    return sorted(path.stem for path in CHAPTERS.glob("*/studies/*.csv"))


def study_file(name: str, suffix: str = ".toml") -> Path:
    """The file of the stored study ``name`` that ends so: its definition, its table or what made it."""
    found = next(CHAPTERS.glob(f"*/studies/{name}{suffix}"), None)
    if found is None:
        raise DataError("study", "name", repr(name), f"one of {', '.join(stored_studies())}")
    return found


def read_table(name: str) -> Table:
    """The stored table ``name``: an array for each column, numbers as float, text as str."""
    return read_table_file(study_file(name, ".csv"))


def read_provenance(name: str) -> dict[str, Any]:
    """What made the stored table ``name``: command, configuration, versions, machine."""
    return json.loads(study_file(name, ".json").read_text(encoding="utf-8"))


def select(table: Table, **wanted: Any) -> Table:
    """The rows in which each named column has the given value, or one of the values of a list.

    A column with a dot in its name is given as ``**{"map.free": 0.139}``.
    """
    keep = np.ones(len(next(iter(table.values()))), dtype=bool)
    for column, value in wanted.items():
        if column not in table:
            raise DataError("select", "column", repr(column), f"one of {', '.join(table)}")
        values = value if isinstance(value, (list, tuple, np.ndarray)) else [value]
        keep &= np.isin(table[column], np.asarray(values, dtype=table[column].dtype))
    return {column: cells[keep] for column, cells in table.items()}


def labels_of(table: Table) -> list[str]:
    """The labels of a table in the order of their first rows."""
    return list(dict.fromkeys(table["label"].tolist()))


def errors_by_label(table: Table, column: str = ERROR) -> dict[str, np.ndarray]:
    """The values of one column, one array for each label."""
    return {label: select(table, label=label)[column] for label in labels_of(table)}


class Shown:
    """A table as the last expression of a cell: aligned text in a committed notebook, a real table on a page.

    The first column, and any other that ``left`` names, is set to the left, the others to the right as numbers are.
    """

    def __init__(self, head: Sequence[str], rows: Iterable[Sequence[str]], left: Sequence[int] = ()):
        self.head, self.rows, self.left = list(head), [list(row) for row in rows], {0, *left}
        for row in self.rows:
            if len(row) != len(self.head):
                raise ValueError(f"a row has {len(row)} cells, expected {len(self.head)}: {row}")

    def __repr__(self) -> str:
        lines = [self.head, *self.rows]
        widths = [max(len(line[k]) for line in lines) for k in range(len(self.head))]
        return "\n".join(
            "  ".join(
                cell.ljust(width) if k in self.left else cell.rjust(width)
                for k, (cell, width) in enumerate(zip(line, widths, strict=True))
            ).rstrip()
            for line in lines
        )

    def markdown(self) -> str:
        """The table in Markdown."""
        rule = [":--" if k in self.left else "--:" for k in range(len(self.head))]
        lines = (self.head, rule, *self.rows)
        return "\n".join(
            "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines
        )

    def _repr_mimebundle_(self, include=None, exclude=None) -> dict[str, str]:
        if output_mode() == "text":
            return {"text/plain": repr(self)}
        return {"text/plain": repr(self), "text/markdown": self.markdown()}
