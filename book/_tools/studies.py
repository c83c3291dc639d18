"""``make studies``: run what is missing of the stored studies and refresh the tables that the book reads.

A study is a TOML file beside its table, or, where it measures something else than a run of a filter, a ``Study`` in
``measure/``. Recordings that are not part of the book are looked for in ``$PFSLAM_DATA``.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

from pfslam_book.show.tables import CHAPTERS, stored_studies
from tqdm import tqdm

from pfslam.io.files import read_text, write_text
from pfslam.study import Study, read_study, run_study

MEASURED = ("ch05", "ch09", "ch10", "ch12", "elimination", "intel", "logs", "trust", "robots", "unseen")
"""Modules of ``measure`` with studies of their own."""


def definition(name: str) -> tuple[Study, Path]:
    """Return a study, and the folder in which its table is stored."""
    if file := next(CHAPTERS.glob(f"*/studies/{name}.toml"), None):
        return read_study(file), file.parent
    for module in map(importlib.import_module, (f"measure.{m}" for m in MEASURED)):
        for study in module.STUDIES:
            if study.name == name:
                chapter = name.partition("_")[0]
                return study, CHAPTERS / (chapter if chapter.startswith("ch") else "show") / "studies"
    raise SystemExit(f"no study {name}; there are {', '.join(stored_studies())}")


def refresh(name: str, folder: Path, jobs: int = -1) -> None:
    """Run what is missing of the study ``name`` in ``folder``; store its table and what made it."""
    study, stored = definition(name)
    table = run_study(study, folder, jobs=jobs, progress=lambda runs, **n: tqdm(runs, name, **n))
    for path in (table, table.with_suffix(".json")):
        write_text(stored / path.name, read_text(path))


if __name__ == "__main__":
    for study in sys.argv[1:] or stored_studies():
        refresh(study, Path("out/studies"))
    for module in ("trust", "unseen"):
        importlib.import_module(f"measure.{module}").write_tables()
