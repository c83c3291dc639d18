"""Formulas are drawn once, when the site is built: no page needs a script for them.

KaTeX comes in one pinned package, and V8, in which it runs, in another one. It writes each formula twice: in letters
and boxes for the eye, and in MathML, which only screen readers see. Style sheet and fonts are files of the site.
"""

import json
import re
from html import unescape
from importlib.resources import files
from pathlib import Path

from py_mini_racer import MiniRacer
from sphinx.errors import ExtensionError
from sphinx.ext.mathjax import html_visit_displaymath, html_visit_math

STYLE = "katex/katex.css"
JOINED = "\u2060"  # a word joiner: between it and its neighbours no line ends
# A line may end after every box of a formula, whatever follows, unless the box stands in a span that must not break.
HELD, BOX = '<span class="pfslam-held">', '<span class="base">'
# As Sphinx writes a formula for a script that would draw it, and what touches it in front; classes of its place in
# the text may stand before its own.
INLINE = re.compile(
    r'(&#?\w+;|[^\s<>]|)(<span class="[^">]*\bmath\b[^>]*>)\\\((.*?)\\\)(</span>(?:</(?:em|strong)>)?)',
    re.DOTALL,
)
DISPLAY = re.compile(r'(<div class="[^">]*\bmath\b[^>]*>.*?)\\\[(.*?)\\\](?=\s*</div>)', re.DOTALL)
HAS_SOME = re.compile(r'<(?:span|div) class="[^">]*\bmath\b')
WORD = re.compile(r'(?:<mi mathvariant="normal">\w</mi>){2,}')
# Returns the drawn formula, or what is wrong with it.
DRAW = """formulas => JSON.stringify(formulas.map(([source, display]) => {
  try { return [katex.renderToString(source, {displayMode: display, strict: "error"}), null]; }
  catch (error) { return [null, error.message]; }
}))"""


def draw(formulas: list[tuple[str, bool]]) -> dict[tuple[str, bool], str]:
    """Draw formulas, each TeX and whether it is displayed, as HTML.

    Raises
    ------
    ExtensionError
        if KaTeX does not understand one of them.
    """
    engine = MiniRacer()
    engine.eval(files("sphinxcontrib").joinpath("katex.min.js").read_text(encoding="utf-8"))
    drawn = {}
    for formula, (markup, wrong) in zip(
        formulas, json.loads(engine.call(f"({DRAW})", formulas)), strict=True
    ):
        if wrong:
            raise ExtensionError(f"the formula {formula[0]!r}: {wrong}")
        drawn[formula] = WORD.sub(one_word, markup)
    return drawn


def one_word(letters: re.Match) -> str:
    """A name of several letters, such as *corr*, is read as a word and not letter by letter."""
    return f"<mi>{re.sub('<[^>]*>', '', letters[0])}</mi>"


def formulas_of(page: str) -> list[tuple[str, bool]]:
    """The formulas of a built page, as ``draw`` takes them."""
    within = [(unescape(found[3]), False) for found in INLINE.finditer(page)]
    return within + [(unescape(found[2]), True) for found in DISPLAY.finditer(page)]


def with_drawn(page: str, drawn: dict[tuple[str, bool], str]) -> str:
    """A built page in which the formulas are drawn. What touches one, such as a full stop, stays on its line."""

    def within(found: re.Match) -> str:
        touching, start, source, end = found.groups()
        before = f"{HELD}{touching}{JOINED}</span>" if touching else ""
        boxes, _, last = drawn[unescape(source), False].rpartition(BOX)
        after = JOINED if page[found.end() : found.end() + 1].strip(" \n<>") else ""
        held = f"{HELD}{BOX}{last}</span>"  # all that is open ends here, and every one with the same tag
        return f"{before}{start}{boxes}{held}{end}{after}"

    drawn_within = INLINE.sub(within, page)
    return DISPLAY.sub(lambda found: found[1] + drawn[unescape(found[2]), True], drawn_within)


def draw_site(site: Path) -> None:
    """Draw the formulas of all pages of a built site."""
    pages = {path: path.read_text(encoding="utf-8") for path in site.rglob("*.html")}
    found = {path: formulas_of(page) for path, page in pages.items() if HAS_SOME.search(page)}
    drawn = draw(list(dict.fromkeys(formula for formulas in found.values() for formula in formulas)))
    for path in found:
        path.write_text(with_drawn(pages[path], drawn), encoding="utf-8", newline="\n")


def add_style(app, pagename, templatename, context, doctree) -> None:
    """Only a page with formulas loads their style sheet."""
    if HAS_SOME.search(context.get("body", "")):
        app.add_css_file(STYLE)


def finish(app, error) -> None:
    """Draw when all pages are written."""
    if error is None and app.builder.format == "html":
        draw_site(Path(app.outdir))


def setup(app):
    app.add_html_math_renderer("katex", (html_visit_math, None), (html_visit_displaymath, None))
    app.config["html_math_renderer"] = "katex"
    app.connect("html-page-context", add_style)
    app.connect("build-finished", finish)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
