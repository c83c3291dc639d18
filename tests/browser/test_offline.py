"""The packed book: unpacked anywhere, it opens from its files."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.browser

PACK = Path(__file__).resolve().parents[2] / "book" / "_tools" / "pack.py"


@pytest.fixture(scope="module")
def unpacked(site, tmp_path_factory) -> Path:
    """The archive's top folder, in a place with a blank and an accent in its name."""
    archive = tmp_path_factory.mktemp("packed") / "site.zip"
    subprocess.run([sys.executable, PACK, "zip", site, archive], check=True, capture_output=True)
    folder = tmp_path_factory.mktemp("my bücher")
    with zipfile.ZipFile(archive) as packed:
        packed.extractall(folder)
    return folder / "site"


def test_every_file_arrives(site, unpacked):
    for path in site.rglob("*"):
        if path.is_file():
            assert (unpacked / path.relative_to(site)).stat().st_size == path.stat().st_size


@pytest.mark.parametrize("start", ["index.html", "search.html?q=particle"])
def test_it_opens_from_there(chromium, opener, unpacked, start):
    context = chromium.new_context()
    seen = opener(context, f"{unpacked.as_uri()}/{start}", unpacked.as_uri() + "/")
    if start == "index.html":
        seen.page.wait_for_url("**/book/index.html")
        seen.page.locator(".prev-next-area a.right-next").click()
        seen.page.wait_for_selector("article h1")
    else:
        seen.page.wait_for_selector("#search-results li a")
    assert seen.complaints == []
    assert seen.strangers == []
    context.close()
