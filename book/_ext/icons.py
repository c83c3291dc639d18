"""The dozen icons that the pages show, of two thousand: Font Awesome's style sheet and font, cut to them."""

import re
from pathlib import Path

from fontTools import subset
from fontTools.ttLib import TTFont

NAME = re.compile(r"\bfa-[a-z0-9-]+")
# What draws an icon: `.fa-bars:before,.fa-navicon:before{content:"\f0c9"}`.
ICON = re.compile(r'(?<=\})((?:\.fa-[a-z0-9-]+:before,?)+)\{content:"\\([0-9a-f]+)"\}')
FACE = re.compile(r"@font-face\{[^}]*\}")
SIGN = re.compile(r"\\(f[0-9a-f]{3})\b")
USED = "fa-solid-900"


def cut_icons(site: Path) -> None:
    """Keep the icons that a page, a script or another style sheet names, in one font, and drop the rest."""
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

    def face(found: re.Match) -> str:
        source = rf'src:url(../webfonts/{USED}.woff) format("woff")'
        return re.sub(r"src:[^;}]*", source, found[0]) if USED in found[0] else ""

    text = FACE.sub(face, ICON.sub(needed, sheet.read_text(encoding="utf-8")))
    sheet.write_text(text, encoding="utf-8", newline="\n")
    fonts = sheet.parents[1] / "webfonts"
    font, cutter = TTFont(fonts / f"{USED}.ttf", recalcTimestamp=False), subset.Subsetter()
    cutter.populate(unicodes=[int(sign, 16) for sign in signs])
    cutter.subset(font)
    font.flavor = "woff"
    font.save(fonts / f"{USED}.woff")
    for path in [*fonts.glob("*.ttf"), *fonts.glob("*.woff2")]:
        path.unlink()
