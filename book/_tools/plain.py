"""MyST as plain Markdown, for notebooks that are read where nothing knows MyST.

Numbers stand in their sentences, references are words or links that lead somewhere, answers are folded. What this
module does not know it refuses, so that no role or directive gets through unseen.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pybtex.database import parse_file

from pfslam.errors import DataError

ROLE = re.compile(r"\{([\w:+-]+)\}`([^`]+)`")
LINK = re.compile(r"(?<!!)\[((?:[^\[\]]|\[[^\[\]]*\])*)\]\(([^()\s]*)\)")
LABELLED = re.compile(r"\n?\$\$ *\((eq-[\w-]+)\) *$", re.MULTILINE)
TARGET = re.compile(r"^\([\w-]+\)= *\n?", re.MULTILINE)
OPENING = re.compile(r"(:{3,}|`{3,})\{([\w:-]+)\} *(.*)")
OPTION = re.compile(r":([\w-]+): *(.*)")
SENTENCES = ("admonition", "note", "tip", "hint", "important", "warning", "caution", "seealso", "dropdown")


@dataclass(frozen=True)
class Place:
    """Where a copy will be read: the files beside it, and the site's address if it has one."""

    root: Path
    beside: frozenset[str] = frozenset()
    site: str = ""

    def link(self, words: str, target: str) -> str:
        """A link to another page of the book as one that leads somewhere from here, or as its words alone."""
        if re.match(r"\w+:", target):
            return f"[{words}]({target})"
        name, _, anchor = target.partition("#")
        if not name:
            return words
        path = (self.root / "notebooks" / name).resolve()
        if not path.is_file():
            raise DataError(target, "link", "no such file", "a page or a module of this book")
        words = words or title(path)
        if path.name in self.beside:
            return f"[{words}]({path.name})"
        page = address(path.relative_to(self.root.resolve())) + (f"#{anchor}" if anchor else "")
        return f"[{words}]({self.site.rstrip('/')}/{page})" if self.site else words


def address(path: Path) -> str:
    """The page of the site that shows a file of the project: ``pfslam/slam.py`` is ``_modules/pfslam/slam.html``."""
    if path.suffix == ".py":
        module = path.parent if path.stem == "__init__" else path
        return f"_modules/{module.with_suffix('.html').as_posix()}"
    return path.with_suffix(".html").as_posix()


def title(path: Path) -> str:
    """The first heading of a page or of a notebook."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        text = "\n".join("".join(cell["source"]) for cell in json.loads(text)["cells"])
    return re.findall(r"^# +(.+)$", text, re.MULTILINE)[0]


def plain_markdown(text: str, numbers: Iterator[str], place: Place) -> str:
    """The same text in plain Markdown; each ``{eval}`` takes the next of the numbers."""
    text = ROLE.sub(lambda role: _words(role[1], role[2], numbers, place), text)
    text = LABELLED.sub(lambda label: rf" \tag{{{_number(label[1])}}}" + "\n$$", text)
    text = "\n".join(_without_directives(text.split("\n")))
    return LINK.sub(lambda link: place.link(link[1], link[2]), TARGET.sub("", text))


def _words(role: str, content: str, numbers: Iterator[str], place: Place) -> str:
    """What a role says, as words."""
    if role == "eval":
        return next(numbers)
    if role == "eq":
        return f"({_number(content)})"
    if role.split(":")[0] == "cite":
        return citation(content, place.root / "book" / "references.bib")
    named = re.fullmatch(r"(.*?) *<(.*)>", content)
    if role in ("term", "ref", "numref") and (named or role == "term"):
        return named[1] if named else content
    if role == "doc":
        words, page = named.groups() if named else ("", content)
        (path,) = (place.root / page.lstrip("/")).parent.glob(f"{Path(page).name}.*")
        return f"[{words}](../{path.relative_to(place.root)})"
    raise DataError(
        f"{{{role}}}`{content}`", "role", "one that has no plain form", "eval, eq, cite, term or doc"
    )


def _number(label: str) -> str:
    return label.removeprefix("eq-")


def citation(keys: str, bibliography: Path) -> str:
    """Authors and year as the site writes them: [Thrun et al., 2005]."""
    entries = parse_file(str(bibliography)).entries
    found = []
    for key in map(str.strip, keys.split(",")):
        people = entries[key].persons["author"]
        names = [" ".join(map(str, [*p.rich_prelast_names, *p.rich_last_names])) for p in people]
        who = " and ".join(names) if len(names) < 3 else f"{names[0]} *et al.*"
        found.append(f"{who}, {entries[key].fields['year']}")
    return f"[{'; '.join(found)}]"


def _without_directives(lines: list[str]) -> Iterator[str]:
    """The lines with each directive as plain Markdown; code between fences stays as it is."""
    rest = iter(lines)
    for line in rest:
        opening = OPENING.fullmatch(line.rstrip())
        if opening:
            yield from _directive(opening[2], opening[3], _until(opening[1], rest))
        elif fence := re.match(r"`{3,}", line):
            yield from (line, *_until(fence[0], rest), fence[0])
        else:
            yield line


def _until(fence: str, rest: Iterator[str]) -> list[str]:
    """The lines before the one that closes the fence."""
    body = []
    for line in rest:
        if line.strip() == fence:
            return body
        body.append(line)
    raise DataError(fence, "directive", "one that is never closed", "a closing fence")


def _directive(name: str, words: str, body: list[str]) -> list[str]:
    options = {}
    while body and (option := OPTION.fullmatch(body[0].strip())):
        options[option[1]] = option[2]
        body = body[1:]
    if name == "math":
        number = options.get("enumerator") or _number(options["label"]) if options.get("label") else ""
        return ["$$", *body, *([rf"\tag{{{number}}}"] if number else []), "$$"]
    if name not in SENTENCES:
        raise DataError(name, "directive", "one that has no plain form", ", ".join(("math", *SENTENCES)))
    heading, inner = words or name.capitalize(), list(_without_directives(body))
    if name == "dropdown" or "dropdown" in options.get("class", ""):
        return [f"<details><summary>{heading}</summary>", "", *inner, "", "</details>"]
    return [f"> **{heading}**", ">", *(f"> {line}".rstrip() for line in inner)]
