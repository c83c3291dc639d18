"""The reference, one page a module. ``book/api.md`` names the modules; their pages are written before Sphinx reads.

Nothing stands on such a page but what the module says of itself, so the pages are made and not kept.
"""

import ast
import re
from importlib import import_module
from importlib.util import find_spec
from operator import attrgetter
from pathlib import Path

from sphinx.util.docutils import SphinxDirective

NAMED = re.compile(r"^```\{modules\}\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PAGE = """# `{name}`

```{{eval-rst}}
.. automodule:: {name}
   :members:
```
"""


def modules(reference: Path) -> list[str]:
    """The modules that the reference lists, in its order."""
    return " ".join(NAMED.findall(reference.read_text(encoding="utf-8"))).split()


def write_pages(book: Path) -> None:
    """One page for each module, untouched where it is right already, so that it is not read again."""
    folder, pages = book / "api", {f"{name}.md": PAGE.format(name=name) for name in modules(book / "api.md")}
    folder.mkdir(exist_ok=True)
    for old in folder.glob("*.md"):
        if old.name not in pages:
            old.unlink()
    for name, text in pages.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def first_sentence(name: str) -> str:
    """What a module says first of itself."""
    words = ast.get_docstring(ast.parse(Path(find_spec(name).origin).read_text(encoding="utf-8")))
    return " ".join(re.split(r"(?<=\.)\s", words, maxsplit=1)[0].split()).replace("``", "`")


class Modules(SphinxDirective):
    """``{modules}``: a list of modules, each with its first sentence and a link to its page."""

    has_content = True

    def run(self):
        lines = [f"- [`{name}`](api/{name}.md): {first_sentence(name)}" for name in self.content]
        return self.parse_text_to_nodes("\n".join(lines))


def module_of_owner(app, module: str, name: str) -> str | None:
    """The module in which a name is written, even if its value is of another one's class; functions know their own."""
    owner = name.rpartition(".")[0]
    if owner:
        return attrgetter(owner)(import_module(module)).__module__
    return None if hasattr(getattr(import_module(module), name, None), "__qualname__") else module


def setup(app):
    write_pages(Path(app.srcdir) / "book")  # the table of contents looks for them as soon as all is set up
    app.add_directive("modules", Modules)
    app.connect("viewcode-follow-imported", module_of_owner)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
