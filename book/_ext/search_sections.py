"""What the search page knows: every section and every word of the glossary, with the place that it opens.

Sphinx finds pages; a chapter is twenty screens long. Written as a script, because a page opened from its file may not
fetch anything. ``search_order.js`` reads it.
"""

import json
import re
from collections import Counter
from pathlib import Path

import yaml
from docutils import nodes
from snowballstemmer import stemmer
from sphinx import addnodes
from sphinx.search.en import english_stopwords
from sphinx.util import logging

SYNONYMS = Path(__file__).with_name("synonyms.yml")
SCRIPT = "search_sections.js"
EXCERPT = 170
N_EFF = re.compile(r"N_\{?\\(?:text|mathrm)\{eff\}\}?")
# What is shown only somewhere else, or is no text: its words would be found where nobody sees them.
SILENT = (nodes.raw, nodes.comment, nodes.meta, nodes.title, addnodes.index)
ELSEWHERE = (nodes.section, addnodes.glossary, addnodes.desc)  # these have places of their own


def words(text: str) -> list[str]:
    """The stems of a text, as the search page makes them of a query."""
    found = re.findall(r"[^\W_]+", text.lower())
    return stemmer("porter").stemWords([word for word in found if word not in english_stopwords])


def own_text(node: nodes.Node, formulas: bool = False) -> str:
    """The text of a section without its subsections and without output; with ``formulas`` also what they name."""
    if isinstance(node, nodes.math | nodes.math_block):
        return ("N_eff Neff ESS" if N_EFF.search(node.astext()) else " ") if formulas else "…"
    if isinstance(node, SILENT) or (isinstance(node, nodes.literal_block) and not formulas):
        return " "
    if isinstance(node, nodes.Text):
        return str(node)
    inner = [own_text(child, formulas) for child in node.children if not isinstance(child, ELSEWHERE)]
    return ("" if isinstance(node, nodes.TextElement) else " ").join(inner)


def entry(page: str, anchor: str, titles: list[str], *parts: nodes.Node) -> dict:
    """One place that a search may open."""
    excerpt = " ".join(" ".join(own_text(part) for part in parts).split())
    if len(excerpt) > EXCERPT:
        excerpt = excerpt[:EXCERPT].rsplit(" ", 1)[0] + " ..."
    text = " ".join(own_text(part, formulas=True) for part in parts)
    return {"page": page, "anchor": anchor, "titles": titles, "text": excerpt, "words": Counter(words(text))}


def sections(page: str, doctree: nodes.document) -> list[dict]:
    """The places of one page: its sections in their order, and the entries of a glossary."""
    found = []
    for section in doctree.findall(nodes.section):
        title = section.next_node(nodes.title).astext()
        whole = section.parent is doctree
        found.append(entry(page, "" if whole else section["ids"][0], [title], section))
    for item in doctree.findall(nodes.definition_list_item):
        terms = [term for term in item.findall(nodes.term) if term["ids"]]
        if terms and item.parent.parent.__class__ is addnodes.glossary:
            found.append(entry(page, terms[0]["ids"][0], [t.astext() for t in terms], item[-1]))
    return found


def add_synonyms(places: list[dict], synonyms: dict[str, list[str]]) -> list[str]:
    """Give each place the students' words for it; the names of places that are not there."""
    known = {f"{place['page']}#{place['anchor']}".rstrip("#"): place for place in places}
    for name, others in synonyms.items():
        if name in known:
            known[name]["titles"] += others
    return [name for name in synonyms if name not in known]


def as_script(places: list[dict]) -> str:
    """Places, and for each stem the places and how often it stands there."""
    stems: dict[str, list[int]] = {}
    for number, place in enumerate(places):
        for stem, count in sorted(place["words"].items()):
            stems.setdefault(stem, []).extend((number, count))
    pages = {place["page"]: place["titles"][0] for place in reversed(places) if not place["anchor"]}
    rows = [[place[key] for key in ("page", "anchor", "titles", "text")] for place in places]
    found = {"pages": pages, "places": rows, "stems": stems}
    return f"const SECTIONS = {json.dumps(found, ensure_ascii=False, separators=(',', ':'))};\n"


def collect(app, doctree, docname) -> None:
    app.pfslam_places[docname] = sections(docname, doctree)


def write(app, error) -> None:
    if error is None and app.builder.format == "html":
        places = [place for page in sorted(app.pfslam_places) for place in app.pfslam_places[page]]
        for name in add_synonyms(places, yaml.safe_load(SYNONYMS.read_text(encoding="utf-8"))):
            logging.getLogger(__name__).warning("%s: the book has no place %s", SYNONYMS.name, name)
        (Path(app.outdir) / "_static" / SCRIPT).write_text(as_script(places), encoding="utf-8")


def load(app, pagename, templatename, context, doctree) -> None:
    if pagename == "search":
        app.add_js_file(SCRIPT)


def setup(app):
    app.pfslam_places = {}
    app.config["html_search_scorer"] = str(Path(__file__).with_name("search_order.js"))
    app.connect("doctree-resolved", collect)
    app.connect("html-page-context", load)
    app.connect("build-finished", write)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
