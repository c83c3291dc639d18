"""The stored tables of studies, as chapters read them."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.files import read_text, write_text
from pfslam.study.table import Table
from pfslam.study.table import read_table as read_table_file

STUDIES = Path(__file__).parent / "studies"
ERROR = "ate_rmse_m"
"""The column with the error that the chapters speak of: position, root mean square, by the first pose."""


def stored_studies() -> list[str]:
    """The names of all studies whose tables are stored."""
    return sorted(path.stem for path in STUDIES.glob("*.csv"))


def read_table(name: str) -> Table:
    """The stored table ``name``: an array for each column, numbers as float, text as str."""
    path = STUDIES / f"{name}.csv"
    if not path.is_file():
        raise DataError("read_table", "name", repr(name), f"one of {', '.join(stored_studies())}")
    return read_table_file(path)


def read_provenance(name: str) -> dict[str, Any]:
    """What made the stored table ``name``: command, configuration, versions, machine."""
    return json.loads((STUDIES / f"{name}.json").read_text(encoding="utf-8"))


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


def refresh(name: str, folder: Path, jobs: int = -1) -> None:
    """Run what is missing of the study ``name`` in ``folder`` and store its table and provenance for the chapters."""
    from tqdm import tqdm

    from pfslam.study import run_study

    table = run_study(
        STUDIES / f"{name}.toml", folder, jobs=jobs, progress=lambda runs, **n: tqdm(runs, name, **n)
    )
    for path in (table, table.with_suffix(".json")):
        write_text(STUDIES / path.name, read_text(path))


def main(names: list[str]) -> None:
    """``make studies``: refresh the tables of all studies, or of the named ones."""
    for name in names or sorted(path.stem for path in STUDIES.glob("*.toml")):
        refresh(name, Path("out/studies"))


if __name__ == "__main__":
    main(sys.argv[1:])
