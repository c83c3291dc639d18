"""The dozen icons that the pages show, of two thousand: Font Awesome's style sheet and fonts, cut to them."""

import re
from pathlib import Path

from fontTools import subset
from fontTools.ttLib import TTFont

NAME = re.compile(r"\bfa-[a-z0-9-]+")
# What draws an icon: `.fa-bars:before,.fa-navicon:before{content:"\f0c9"}`.
ICON = re.compile(r'(?<=\})((?:\.fa-[a-z0-9-]+:before,?)+)\{content:"\\([0-9a-f]+)"\}')
FACE = re.compile(r"@font-face\{[^}]*\}")
SIGN = re.compile(r"\\(f[0-9a-f]{3})\b")
FONTS = ("fa-solid-900", "fa-brands-400")
"""The font of almost all icons, and that of GitHub's and GitLab's, which a page shows once it knows its repository."""


def cut_icons(site: Path) -> None:
    """Keep the icons that a page, a script or another style sheet names, and the fonts that draw them."""
    (sheet,) = (site / "_static" / "vendor" / "fontawesome").rglob("all.min.css")
    others = [path for path in (site / "_static").rglob("*.css") if path != sheet]
    pages = [*site.rglob("*.html"), *(site / "_static" / "scripts").rglob("*.js")]
    named = {name for path in pages for name in NAME.findall(path.read_text(encoding="utf-8"))}
    signs = {sign for path in others for sign in SIGN.findall(path.read_text(encoding="utf-8"))}

    def needed(icon: re.Match) -> str:
        if named.isdisjoint(NAME.findall(icon[1])):
            return ""
        signs.add(icon[2])
        return icon[0]

    text = ICON.sub(needed, sheet.read_text(encoding="utf-8"))
    fonts = sheet.parents[1] / "webfonts"
    kept = [name for name in FONTS if cut_font(fonts / f"{name}.ttf", {int(sign, 16) for sign in signs})]

    def face(found: re.Match) -> str:
        source = [f'src:url(../webfonts/{name}.woff) format("woff")' for name in kept if name in found[0]]
        return re.sub(r"src:[^;}]*", source[0], found[0]) if source else ""

    sheet.write_text(FACE.sub(face, text), encoding="utf-8", newline="\n")
    for path in [*fonts.glob("*.ttf"), *fonts.glob("*.woff2")]:
        path.unlink()


def cut_font(path: Path, signs: set[int]) -> bool:
    """Write beside a font one that has these signs alone; not if it has none of them."""
    font, cutter = TTFont(path, recalcTimestamp=False), subset.Subsetter()
    found = signs & font.getBestCmap().keys()
    if found:
        cutter.populate(unicodes=found)
        cutter.subset(font)
        font.flavor = "woff"
        font.save(path.with_suffix(".woff"))
    return bool(found)
