"""``make studies``: run what is missing of the stored studies and refresh the tables that the chapters read."""

from __future__ import annotations

import sys
from pathlib import Path

from pfslam_book.show.tables import stored_studies, study_file
from tqdm import tqdm

from pfslam.io.files import read_text, write_text
from pfslam.study import run_study


def refresh(name: str, folder: Path, jobs: int = -1) -> None:
    """Run what is missing of the study ``name`` in ``folder``; store its table and provenance beside its file."""
    definition = study_file(name)
    table = run_study(definition, folder, jobs=jobs, progress=lambda runs, **n: tqdm(runs, name, **n))
    for path in (table, table.with_suffix(".json")):
        write_text(definition.with_name(path.name), read_text(path))


if __name__ == "__main__":
    for study in sys.argv[1:] or stored_studies():
        refresh(study, Path("out/studies"))
