"""Known addresses appear on the site: the repository, where a chapter runs, the card that a message shows."""

import json
import os
import re
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


HOSTS = ("GITHUB_", "CI_")


def build(folder: Path, host: dict[str, str], **addresses) -> tuple[str, str]:
    """Build two pages on a host, with some addresses, no cell run; return the chapter's page and the first page."""
    for name in ("book", "pfslam", "notebooks"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    settings = yaml.safe_load((ROOT / "_config.yml").read_text(encoding="utf-8"))
    settings["execute"]["execute_notebooks"] = "off"
    for name, (key, value) in addresses.items():
        settings[name][key] = value
    (folder / "_config.yml").write_text(yaml.safe_dump(settings), encoding="utf-8")
    (folder / "_toc.yml").write_text(yaml.safe_dump(TOC), encoding="utf-8")
    own = {name: value for name, value in os.environ.items() if not name.startswith(HOSTS)}
    done = subprocess.run(
        [str(Path(sys.executable).with_name("jupyter-book")), "build", str(folder)],
        capture_output=True,
        text=True,
        env=own | host | {"PYTHONPATH": str(folder)},
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    site = folder / "_build" / "html"
    return tuple((site / f"{name}.html").read_text(encoding="utf-8") for name in (CHAPTER, "book/install"))


def test_filled_in_they_appear_on_every_chapter(tmp_path):
    chapter, first = build(
        tmp_path,
        {},
        repository=("url", "https://git.example/someone/pfslam"),
        launch_buttons=("binderhub_url", "https://binder.example"),
        html=("baseurl", "https://book.example/"),
    )
    assert 'href="https://git.example/someone/pfslam"' in chapter
    assert "https://binder.example/v2/git/https%3A%2F%2Fgit.example%2Fsomeone%2Fpfslam/main" in chapter
    assert "Open in Colab" not in chapter
    assert not (tmp_path / "_build" / "colab").exists()
    assert '<meta property="og:image" content="https://book.example/_static/readme.webp"' in first
    assert 'href="https://git.example/someone/pfslam"' in first


def test_on_github_a_chapter_opens_with_one_click_and_loads_nothing_from_there(tmp_path):
    host = {
        "GITHUB_SERVER_URL": "https://github.com",
        "GITHUB_REPOSITORY": "ada/slam",
        "GITHUB_REF_NAME": "main",
    }
    chapter, first = build(tmp_path, host)
    (line,) = re.findall(r'<p class="pfslam-run[^"]*">(.*?)</p>', chapter)
    assert re.findall(r'<a [^>]*href="(http[^"]*)">([^<]*)</a>', line) == [
        (f"https://colab.research.google.com/github/ada/slam/blob/colab/{CHAPTER}.ipynb", "Open in Colab"),
        (f"https://mybinder.org/v2/gh/ada/slam/main?urlpath=lab/tree/{CHAPTER}.ipynb", "Binder"),
    ]
    assert 'content="https://ada.github.io/slam/_static/readme.webp"' in first
    copy = json.loads((tmp_path / "_build" / "colab" / f"{CHAPTER}.ipynb").read_text(encoding="utf-8"))
    assert "https://ada.github.io/slam/pfslam-" in "".join(copy["cells"][0]["source"])
    for page in (chapter, first):
        assert re.findall(r'<(?:script|img|iframe)[^>]* src="(?:https?:)?//[^"]*|@import', page) == []
        assert (
            re.findall(r'<link[^>]*rel="(?:stylesheet|preload|icon)"[^>]*href="(?:https?:)?//[^"]*', page)
            == []
        )


def test_without_any_no_page_names_a_host_on_which_it_could_run(tmp_path):
    chapter, first = build(tmp_path, {})
    (line,) = re.findall(r'<p class="pfslam-run[^"]*">(.*?)</p>', chapter)
    assert "http" not in line
    assert "pfslam lab 00" in re.sub(r"<[^>]+>", "", line)
    for page in (chapter, first):
        assert not re.search("mybinder|colab", page)
    assert not (tmp_path / "_build" / "colab").exists()
