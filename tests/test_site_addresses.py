"""Addresses that are filled in appear on the site: the repository, the cloud, the card that a message shows."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
CHAPTER = "notebooks/00_robot_and_data"
TOC = {
    "format": "jb-book",
    "root": "book/install",
    "chapters": [{"file": CHAPTER}, {"file": "book/bibliography"}],
}

pytestmark = pytest.mark.nightly


def build(folder: Path, **addresses) -> tuple[str, str]:
    """Build two pages with some addresses, no cell run; return the chapter's page and the first page."""
    for name in ("book", "pfslam", "notebooks"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    settings = yaml.safe_load((ROOT / "_config.yml").read_text(encoding="utf-8"))
    settings["execute"]["execute_notebooks"] = "off"
    for name, (key, value) in addresses.items():
        settings[name][key] = value
    (folder / "_config.yml").write_text(yaml.safe_dump(settings), encoding="utf-8")
    (folder / "_toc.yml").write_text(yaml.safe_dump(TOC), encoding="utf-8")
    done = subprocess.run(
        [str(Path(sys.executable).with_name("jupyter-book")), "build", str(folder)],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": str(folder)},
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    site = folder / "_build" / "html"
    return tuple((site / f"{name}.html").read_text(encoding="utf-8") for name in (CHAPTER, "book/install"))


def test_filled_in_they_appear_on_every_chapter(tmp_path):
    chapter, first = build(
        tmp_path,
        repository=("url", "https://gitlab.example/someone/pfslam"),
        launch_buttons=("binderhub_url", "https://binder.example"),
        html=("baseurl", "https://book.example/"),
    )
    assert 'href="https://gitlab.example/someone/pfslam"' in chapter
    assert "https://binder.example/v2/git/" in chapter
    assert f"{CHAPTER}.ipynb" in chapter
    assert '<meta property="og:image" content="https://book.example/_static/readme.webp"' in first
    assert 'href="https://gitlab.example/someone/pfslam"' in first
