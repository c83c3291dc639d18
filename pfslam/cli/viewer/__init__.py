"""What pictures in a browser are drawn with: the page of a run, and the laboratories of the book.

``core.js`` holds the equations, ``view.js`` the stage, ``lab.css`` its style; ``run.js`` and ``run.html`` are the page.
"""

from pathlib import Path

FOLDER = Path(__file__).parent


def source(name: str) -> str:
    """Return the text of one of the files."""
    return (FOLDER / name).read_text(encoding="utf-8")
