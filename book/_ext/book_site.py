"""What the site needs beyond Jupyter Book: no foreign host, no dead machinery, notebooks to take away.

What draws formulas is a file of its own, ``formulas.py``.
"""

import base64
import hashlib
import json
import os
import re
import shutil
import sys
from html import escape, unescape
from pathlib import Path
from typing import ClassVar

import yaml
from docutils import nodes
from docutils.parsers.rst import directives
from myst_nb.ext.eval import EvalRoleAny
from sphinx import addnodes
from sphinx.directives.patches import MathDirective
from sphinx.transforms import SphinxTransform
from sphinx.util.parallel import make_chunks

sys.path.insert(0, str(Path(__file__).parents[1] / "_tools"))

import api_pages
import copies
import plain
from addresses import COLAB, Addresses, addresses
from hero import write_hero
from icons import cut_icons
from pfslam_book.show import lab
from pfslam_book.show.pictures import APART as APART_MARK
from styles import cut_styles

import pfslam

# Thebe wants a server on the network and throws without it; preloading a font is forbidden from file://. Font Awesome's
# script draws the icons that its style sheet and fonts have drawn already, and weighs more than the rest of a page.
DEAD_MARKUP = re.compile(
    r"""[ \t]*(?:
        <script>const\ THEBE_JS_URL.*?</script>
      | <script\ type="text/x-thebe-config">.*?</script>
      | <script[^>]*sphinx-thebe[^>]*></script>
      | <link[^>]*sphinx-thebe[^>]*>
      | <script[^>]*fontawesome[^>]*></script>
      | <link\ rel="preload"\ as="font"[^>]*>
    )\n?""",
    re.VERBOSE | re.DOTALL,
)
# Set twice on every page.
TWICE = (
    "<script>var togglebuttonSelector = '.toggle, .admonition.dropdown';</script>",
    '<meta name="viewport" content="width=device-width, initial-scale=1" />',
    '<meta name="viewport" content="width=device-width, initial-scale=1"/>',
)
# Who comes for the first time has a theme from the first line on: a page that gets it later is styled twice.
FIRST_THEME = (
    'localStorage.getItem("theme") || "auto"',
    'localStorage.getItem("theme") || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")',
)
# What a screen reader would stumble over: a name other than the words shown, a place outside all landmarks,
# a role that is no more.
BETTER_MARKUP = (
    (r'(<button class="[^"]*search-button-field[^"]*"[^>]*?) aria-label="Search"', r"\1"),
    (r'(<summary) aria-label="Toggle hidden content"', r"\1"),
    (r'(<div class="bd-sidebar-primary bd-sidebar")', r'\1 role="navigation" aria-label="Book"'),
    (r'<summary>(?=<span class="toctree-toggle")', '<summary aria-label="Pages of this section">'),
    (r'role="doc-biblioentry"', 'role="listitem"'),
    (r"<p>✅</p>", "<p>done</p>"),  # not every machine has this letter
    # What the foot of each page leads to is not told in the sidebar, too.
    (r'(?s)<p [^>]*><span class="caption-text">In the foot of each page</span>.*?(?=\s*</div>\s*</nav>)', ""),
)

# Of the words of code that Pygments marks two thirds have the colour of those that it does not mark.
UNCOLOURED = re.compile(r'<span class="(?:n|nn|p|w)">([^<]*)</span>')
DOUBLED_TITLE = re.compile(r"<title>(.+?) &#8212; \1</title>")

CODE = re.compile(
    r'(?s)(?<=highlight-ipython3 notranslate"><div class="highlight"><pre><span></span>).*?(?=</pre>)'
)
PHONE_COLUMNS = 43  # letters of code in a line of a fold, in a window of 390 pixels
MODULE_LIST = re.compile(
    r"(All modules for which code is available</h1>\s*)(<ul>.*</ul>)(?=\s*</article>)", re.DOTALL
)
TABLE = re.compile(r"<table.*?</table>", re.DOTALL)
NAME = re.compile(r'(?<=<span class="(?:pre|doc)">)[^<]+')
JOINT = re.compile(r"(?<=[._/])(?=[A-Za-z])")
LISTED = re.compile(r'(?<=<span class="pre">)pfslam[\w.]+(?=</span></code></a></li>)')  # in the sidebar
COLUMNS = re.compile(r"\S {2,}\S")

LABORATORY = re.compile(r'class="pfslam-lab" data-lab="(\w+)"')
CHAPTER = re.compile(r"notebooks/(\d\d)_")


def clean_page(page: str) -> str:
    """One built page without dead and doubled markup, and readable without eyes."""
    page = DEAD_MARKUP.sub("", page)
    for markup in TWICE:
        first, found, rest = page.partition(markup)
        keep = "" if markup.startswith("<meta") else markup
        page = first + (keep if found else "") + rest.replace(markup, "")
    page = page.replace(*FIRST_THEME)
    for pattern, better in BETTER_MARKUP:
        page = re.sub(pattern, better, page)
    page = UNCOLOURED.sub(r"\1", page)
    page = DOUBLED_TITLE.sub(r"<title>\1</title>", page)
    page = TABLE.sub(lambda table: NAME.sub(lambda name: JOINT.sub("<wbr>", name[0]), table[0]), page)
    page = LISTED.sub(lambda name: JOINT.sub("<wbr>", name[0]), page)
    page = CODE.sub(lambda code: "".join(map(hung, code[0].splitlines(keepends=True))), page)
    return MODULE_LIST.sub(one_list, page)


def hung(line: str) -> str:
    """A line of code that is longer than a phone is wide, marked with its indent: there its rest goes on below."""
    text = unescape(re.sub(r"<[^>]+>", "", line)).rstrip("\n")
    if len(text) <= PHONE_COLUMNS:
        return line
    return f'<span class="pfslam-line" style="--indent: {len(text) - len(text.lstrip())}">{line}</span>'


APART = re.compile(re.escape(APART_MARK) + r"([A-Za-z0-9+/=]+)")


def set_pictures_apart(page: str, site: Path, depth: int) -> str:
    """One built page whose figures for the dark theme, and under sliders, are files that are fetched when wanted."""

    def as_file(found: re.Match) -> str:
        data = base64.b64decode(found[1])
        name = f"_static/figures/{hashlib.sha256(data).hexdigest()[:16]}.webp"
        (site / name).write_bytes(data)
        return "../" * depth + name

    (site / "_static" / "figures").mkdir(parents=True, exist_ok=True)
    return APART.sub(as_file, page)


def one_list(found: re.Match) -> str:
    """The list of modules as one list: Sphinx puts a list where only its entries may stand.

    It also names Python's own module, of which it writes no page.
    """
    entries = re.findall(r'<li>(?!<a href="builtins.html").*?</li>', found[2], re.DOTALL)
    return f"{found[1]}<ul>{''.join(entries)}</ul>"


def finish_site(app, error) -> None:
    """Clean every page, drop what no page asks for."""
    if error is not None or app.builder.format != "html":
        return
    site = Path(app.outdir)
    for path in site.rglob("*.html"):
        page = clean_page(path.read_text(encoding="utf-8"))
        page = set_pictures_apart(page, site, len(path.relative_to(site).parts) - 1)
        path.write_text(page, encoding="utf-8", newline="\n")
    for dead in (site / "_static").glob("*thebe*"):
        dead.unlink()
    for dead in (site / "_static" / "vendor" / "fontawesome").rglob("*.js*"):
        dead.unlink()
    cut_icons(site)
    cut_styles(site)


def number_equations(app, doctree) -> None:
    """An equation labelled `eq-N` is number N, as in the report, whatever its place in the book."""
    equations = app.env.get_domain("math").equations
    for node in doctree.findall(nodes.math_block):
        label = re.fullmatch(r"eq-(\d+)", node.get("label") or "")
        if label:
            node["number"] = int(label[1])
            equations[label[0]] = (app.env.docname, int(label[1]))


def anchor_sources(app, doctree) -> None:
    """A source is found by its key, as in ``bibliography.md#thrun2005``: JupyterLab shows the bare key of a role."""
    if app.env.docname == "book/bibliography":
        slugs = app.env.metadata[app.env.docname].setdefault("myst_slugs", {})
        for listed in app.env.get_domain("cite").bibliographies.values():
            slugs.update({key: (0, key, key) for key in listed.citation_nodes})


def number_figures(app, env) -> list[str]:
    """Figures are numbered by chapter, the second of chapter 03 as 3.2, so that a teacher can name one.

    On every other page they count from 1.
    """
    for page, kinds in env.toc_fignumbers.items():
        chapter = CHAPTER.match(page)
        for number, name in enumerate(kinds.get("figure", {}), start=1):
            kinds["figure"][name] = (int(chapter[1]), number) if chapter else (number,)
    return list(env.toc_fignumbers)


def wrap_sentences(app, doctree) -> None:
    """Output without columns is sentences, which wrap on a phone; a table would not survive that."""
    for block in doctree.findall(nodes.literal_block):
        if "output" in block["classes"] and not COLUMNS.search(block.astext()):
            block["classes"].append("pfslam-sentences")


class Eval(EvalRoleAny):
    """``{eval}`` that also notes what it wrote, for the copies of the chapter."""

    def run(self):
        found, messages = super().run()
        env = self.document.settings.env
        if env.temp_data.get("slides"):  # the copies have no slides
            return found, messages
        numbers = env.metadata[env.docname].setdefault("numbers", [])
        numbers.append("".join(node.astext() for node in found))
        return found, messages


class Math(MathDirective):
    """``{math}`` that says its number, or that it has none, for JupyterLab, which would count from 1."""

    option_spec: ClassVar = {
        **MathDirective.option_spec,
        "enumerator": directives.unchanged,
        "enumerated": directives.unchanged,
    }


class LinkToSource(SphinxTransform):
    """A link to a module leads to the page that shows it, where the reference has one, and not to a download."""

    default_priority = 500

    def apply(self):
        known = set(api_pages.modules(Path(self.env.srcdir) / "book" / "api.md"))
        for link in list(self.document.findall(addnodes.download_reference)):
            path = Path(self.env.relfn2path(link["reftarget"], self.env.docname)[0])
            module = path.parent if path.stem == "__init__" else path.with_suffix("")
            if ".".join(module.parts) in known:
                page = "../" * self.env.docname.count("/") + plain.address(path)
                link.replace_self(nodes.reference("", "", *link.children, refuri=page, internal=True))


def name_command(app, doctree) -> None:
    """Under its heading a chapter says how to run it; in JupyterLab, where it runs already, it does not."""
    chapter = CHAPTER.match(app.env.docname)
    if chapter:
        line = nodes.paragraph("", "Run this chapter: ", classes=["pfslam-run"])
        for words, address in known_addresses(app).runs(app.env.docname).items():
            line += [nodes.reference("", words, refuri=address), nodes.Text(", ")]
        line += nodes.literal("", f"pfslam lab {chapter[1]}")
        line += nodes.Text(" (")
        line += nodes.reference("", "how to", refuri="../book/install.html", internal=True)
        line += nodes.Text(")")
        title = next(iter(doctree.findall(nodes.title)))
        title.parent.insert(title.parent.index(title) + 1, line)


def known_addresses(app) -> Addresses:
    """What the settings of the book name, or the host on which it is built."""
    settings = yaml.safe_load(Path(app.confdir, "_config.yml").read_text(encoding="utf-8"))
    return addresses(settings, os.environ)


def show_addresses(app, config) -> None:
    """A button for the repository appears with its address, and whatever needs the address of the site.

    Jupyter Book hands the theme either its own options or ours, not both.
    """
    known = known_addresses(app)
    config.html_baseurl = known.site
    if known.repository:
        found = {"repository_url": known.repository, "repository_branch": known.branch}
        found |= {"repository_provider": known.provider}
        config.html_theme_options |= found | {"use_repository_button": True, "use_issues_button": True}


def describe_page(app, pagename, templatename, context, doctree) -> None:
    """What a message or a forum shows of a page that somebody links: its title, first sentences and a picture."""
    if doctree is None:
        return
    first = next((p for p in doctree.findall(nodes.paragraph) if "pfslam-run" not in p["classes"]), None)
    words = " ".join(first.astext().split()) if first else ""
    card = {"og:type": "article", "og:title": context["title"], "og:site_name": app.config.html_title}
    card["og:description"] = words if len(words) <= 200 else words[:200].rsplit(" ", 1)[0] + " ..."
    if app.config.html_baseurl:  # a picture needs a whole address
        card["og:image"] = f"{app.config.html_baseurl.rstrip('/')}/_static/readme.webp"
    tags = (
        f'<meta property="{escape(name)}" content="{escape(plain_title(value))}" />'
        for name, value in card.items()
    )
    context["metatags"] = context.get("metatags", "") + "\n" + "\n".join(tags)


def reach_tables(app, pagename, templatename, context, doctree) -> None:
    """A table that is wider than a phone scrolls, and who has no mouse must be able to stand in it."""
    box = '<div class="pst-scrollable-table-container"'
    if "body" in context:
        context["body"] = context["body"].replace(f"{box}>", f'{box} tabindex="0">')


def plain_title(text: str) -> str:
    """A title without the markup that the theme has put into it."""
    return unescape(re.sub(r"<[^>]+>", "", text))


def set_captions_in_margin(app, doctree) -> None:
    """A caption stands beside its figure; the theme folds its table of contents while there is one in that place."""
    for caption in doctree.findall(nodes.caption):
        if isinstance(caption.parent, nodes.figure):
            caption["classes"].append("margin-caption")


def offer_notebooks(app, error) -> None:
    """The notebook that a page offers reads right anywhere: numbers and references are words in it."""
    if error is not None or app.builder.format != "html":
        return
    place = copies.Place(Path(app.srcdir), site=app.config.html_baseurl)
    colab, known = Path(app.outdir).parent / "colab", known_addresses(app)
    for page in app.env.found_docs:
        path = Path(app.env.doc2path(page))
        if path.suffix == ".ipynb":
            numbers = app.env.metadata[page].get("numbers", [])
            chapter = json.loads(path.read_text(encoding="utf-8"))
            offered = Path(app.outdir, "_sources", f"{page}.ipynb")
            copies.write_notebook(offered, copies.full_copy(chapter, numbers, place))
            copies.write_numbers(path, numbers)
            if COLAB in known.runs(page):
                copies.write_notebook(colab / f"{page}.ipynb", copies.colab_copy(chapter, numbers, place))


def draw_hero(app, error) -> None:
    """Run the filter for the moving picture on the first page."""
    if error is None and app.builder.format == "html":
        write_hero(Path(app.outdir) / "_static")


def copy_laboratories(app) -> None:
    """The scripts and the style of the laboratories into the site."""
    if app.builder.format == "html":
        target = Path(app.outdir) / "_static" / "labs"
        target.mkdir(parents=True, exist_ok=True)
        for source in [
            *lab.FOLDER.glob("*.js"),
            *(lab.asset(name) for name in ("core.js", "view.js", "lab.css")),
        ]:
            shutil.copyfile(source, target / source.name)


def load_laboratories(app, pagename, templatename, context, doctree) -> None:
    """Only a page with a laboratory loads the scripts, after it has been read."""
    names = list(dict.fromkeys(LABORATORY.findall(context.get("body", ""))))
    if names:
        app.add_css_file("labs/lab.css")
        app.add_js_file("layers.js", loading_method="defer")
    for script in dict.fromkeys(script for name in names for script in lab.scripts(name)):
        app.add_js_file(f"labs/{script}", loading_method="defer")


def name_version(app, docname, source) -> None:
    """Name the wheel of this version where a page says how to install it."""
    source[0] = source[0].replace("pfslam-VERSION-", f"pfslam-{pfslam.__version__}-")


def read_in_parallel(app, config) -> None:
    """Let the cores share the chapters; two extensions that change no page as it is read do not say that they can."""
    for name in ("sphinx_multitoc_numbering", "sphinx_jupyterbook_latex"):
        app.extensions[name].parallel_read_safe = True
    app.parallel = max(app.parallel, min(os.cpu_count() or 1, 4))


def deal_out(app, env, docnames) -> None:
    """Pages in turn to as many hands as Sphinx makes heaps: in their own order one heap would get all the chapters."""
    heaps = len(make_chunks(docnames, app.parallel))
    docnames[:] = [name for hand in range(heaps) for name in docnames[hand::heaps]]


def take_over_eval(app) -> None:
    """After MyST-NB has registered its own role."""
    app.add_role("eval", Eval(), override=True)


def setup(app):
    os.environ["PFSLAM_WIDGETS"] = "static"  # the kernels that run the notebooks inherit it
    app.add_css_file("pfslam.css")
    app.add_js_file("print.js", loading_method="defer")
    app.add_js_file("sketch.js", loading_method="defer")
    app.add_js_file("predict.js", loading_method="defer")
    app.add_js_file("beside.js", loading_method="defer")
    app.add_js_file("night.js", loading_method="defer")
    app.add_js_file("zoom.js", loading_method="defer")
    app.add_js_file("wide.js", loading_method="defer")
    app.add_directive("math", Math, override=True)
    app.add_transform(LinkToSource)
    app.connect("config-inited", read_in_parallel)
    app.connect("env-before-read-docs", deal_out)
    app.connect("doctree-read", number_equations)
    app.connect("doctree-read", anchor_sources)
    app.connect("env-get-updated", number_figures, priority=900)  # after Sphinx has counted through the book
    app.connect("doctree-read", wrap_sentences)
    app.connect("doctree-read", set_captions_in_margin)
    app.connect("doctree-read", name_command)
    app.connect("config-inited", show_addresses)
    app.connect("html-page-context", describe_page)
    app.connect("html-page-context", reach_tables)
    app.connect("source-read", name_version)
    app.connect("builder-inited", copy_laboratories)
    app.connect("html-page-context", load_laboratories)
    app.connect("build-finished", finish_site)
    app.connect("build-finished", offer_notebooks)
    app.connect("build-finished", draw_hero)
    app.connect("builder-inited", take_over_eval)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
