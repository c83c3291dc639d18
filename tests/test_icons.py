"""Icons that a page names are drawn by a font of the site, and the rest is left out."""

import re
import shutil
import sys
from pathlib import Path

import pydata_sphinx_theme
import pytest
from fontTools.ttLib import TTFont

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "book" / "_ext"))
from icons import cut_icons  # noqa: E402

(SHEET,) = Path(pydata_sphinx_theme.__file__).parent.rglob("fontawesome/**/all.min.css")
BARS, GITHUB, GITLAB = 0xF0C9, 0xF09B, 0xF296


@pytest.mark.parametrize(
    ("icons", "drawn"),
    [
        ("fas fa-bars", {"fa-solid-900": {BARS}}),
        ("fas fa-bars fab fa-github", {"fa-solid-900": {BARS}, "fa-brands-400": {GITHUB}}),
        ("fas fa-bars fab fa-gitlab", {"fa-solid-900": {BARS}, "fa-brands-400": {GITLAB}}),
    ],
)
def test_the_fonts_draw_what_a_page_names_and_nothing_else(icons, drawn, tmp_path):
    vendor = shutil.copytree(SHEET.parents[1], tmp_path / "_static" / "vendor" / "fontawesome")
    (tmp_path / "index.html").write_text(f'<i class="{icons}"></i>', encoding="utf-8")
    cut_icons(tmp_path)
    fonts = {path.stem: set(TTFont(path).getBestCmap()) for path in (vendor / "webfonts").iterdir()}
    assert fonts == drawn
    text = (vendor / "css" / "all.min.css").read_text(encoding="utf-8")
    assert set(re.findall(r"webfonts/([\w-]+)", text)) == set(drawn)
    assert {int(sign, 16) for sign in re.findall(r'content:"\\(f[0-9a-f]+)"', text)} == set.union(
        *drawn.values()
    )
