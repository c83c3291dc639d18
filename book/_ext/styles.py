"""The style sheets of the theme, cut to the classes that the site knows: most of their rules style nothing here."""

import re
from pathlib import Path

SHEETS = ("styles/bootstrap.css", "styles/pydata-sphinx-theme.css", "sphinx-design.min.css", "mystnb.*.css")
COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
NOTICE = re.compile(r"/\*!.*?\*/", re.DOTALL)  # of a licence: it stays
RULE = re.compile(r"([^{}]+)\{([^{}]*)\}")
EMPTY = re.compile(r"@(?:media|supports)[^{}]*\{\s*\}")
KEYFRAME = re.compile(r"\s*(?:from|to|[\d.]+%)")
CLASS = re.compile(r"\.(-?[A-Za-z_][\w-]*)")
WORD = re.compile(r"[A-Za-z_][\w-]*")


def cut_sheet(style: str, known: set[str]) -> str:
    """A style sheet without the selectors that name a class, outside of ``:not()``, of which nobody has heard."""

    def needed(rule: re.Match) -> str:
        if rule[1].lstrip().startswith("@") or KEYFRAME.match(rule[1]):
            return rule[0]
        selectors = [one for one in split(rule[1]) if known.issuperset(CLASS.findall(without_choices(one)))]
        return f"{','.join(selectors)}{{{rule[2]}}}" if selectors else ""

    return "".join(NOTICE.findall(style)) + EMPTY.sub("", RULE.sub(needed, COMMENT.sub("", style)))


def split(selectors: str) -> list[str]:
    """The selectors of a rule; commas within brackets separate none."""
    return re.split(r",(?![^(]*\))", selectors)


def without_choices(selector: str) -> str:
    """A selector without what ``:not()``, ``:is()`` and ``:where()`` say: there a class need not be known."""
    return re.sub(r":(?:not|is|where)\((?:[^()]|\([^()]*\))*\)", "", selector)


def cut_styles(site: Path) -> None:
    """Keep the rules of the theme for classes that a page or a script names."""
    sources = [*site.rglob("*.html"), *(site / "_static").rglob("*.js")]
    known = {word for path in sources for word in WORD.findall(path.read_text(encoding="utf-8"))}
    for path in (path for sheet in SHEETS for path in (site / "_static").glob(sheet)):
        path.write_text(cut_sheet(path.read_text(encoding="utf-8"), known), encoding="utf-8", newline="\n")
