"""``pfslam lab``: copy the chapters beside the reader's own work, and open one of them in JupyterLab."""

from __future__ import annotations

import argparse
import importlib.util
import subprocess
import sys
from pathlib import Path

from pfslam.errors import DataError, need
from pfslam.io.files import atomic_write


def lab_command(arguments: argparse.Namespace) -> int:
    """Copy the chapters that are not there yet into a folder and open one of them, or all, in JupyterLab.

    Returns 0, or the exit code of JupyterLab.
    """
    chapters = available_chapters()
    chosen = chosen_chapter(chapters, arguments.chapter)
    copied = copy_missing(chapters, arguments.folder)
    print(f"{arguments.folder}: {len(copied)} chapters copied, {len(chapters) - len(copied)} were there")
    page = arguments.folder / chosen.name if chosen else arguments.folder
    if arguments.copy_only:
        print(f"open {page} in JupyterLab")
        return 0
    need("jupyterlab", "lab")
    sys.stdout.flush()
    server = subprocess.Popen([sys.executable, "-m", "jupyterlab", str(page)])
    while True:
        try:
            return server.wait()
        except KeyboardInterrupt:  # JupyterLab gets it too, asks whether to stop, and ends its kernels
            continue


def available_chapters() -> list[Path]:
    """Find the notebooks that came with the book, in their order: copies in a released wheel, or those of a checkout.

    The book is found and not imported: the package does not depend on it.
    """
    spec = importlib.util.find_spec("pfslam_book")
    if spec is None or not spec.submodule_search_locations:
        expected = "the book, which comes with a released wheel"
        raise DataError("pfslam lab", "package", "no pfslam_book", expected)
    book = Path(spec.submodule_search_locations[0])
    for shelf in (book / "chapters", book.parents[1] / "notebooks"):
        if chapters := sorted(shelf.glob("[0-9][0-9]_*.ipynb")):
            return chapters
    expected = (
        f"notebooks in {book / 'chapters'}, as a wheel of `make release` has them (in a clone: `make lab`)"
    )
    raise DataError("pfslam lab", "chapters", "none", expected)


def chosen_chapter(chapters: list[Path], number: str | None) -> Path | None:
    """Choose the chapter with a number such as "05" or "5"; None without a number."""
    if number is None:
        return None
    by_number = {path.name[:2]: path for path in chapters}
    if not number or f"{number:0>2}" not in by_number:
        raise DataError("pfslam lab", "chapter", number, f"one of {', '.join(by_number)}")
    return by_number[f"{number:0>2}"]


def copy_missing(chapters: list[Path], folder: Path) -> list[Path]:
    """Copy what is missing in ``folder``; a file that is there is the reader's own work and stays as it is."""
    missing = [path for path in chapters if not (folder / path.name).exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for path in missing:
        with atomic_write(folder / path.name) as file:
            file.write(path.read_bytes())
    return missing
