"""What the pages print can be typed: imports find what they name, and so do dotted names in the text."""

import ast
import importlib
import re

import pytest
from conftest import ROOT

PAGES = {page.name: page for page in (*sorted((ROOT / "book").glob("*.md")), ROOT / "README.md")}
del PAGES["changelog.md"]  # it also names what is gone
BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
NAME = re.compile(r"`(?P<name>(?:pfslam|pfslam_book|ch\d\d)(?:\.[A-Za-z_]\w*)+)[`(]")
FILES = (".toml", ".csv", ".yml", ".py")


def found(name: str):
    """What a dotted name stands for: the longest part of it that is a module, and the attributes of that."""
    name = f"pfslam_book.{name}" if name.startswith("ch") else name
    parts = name.split(".")
    for n in range(len(parts), 0, -1):
        try:
            thing = importlib.import_module(".".join(parts[:n]))
        except ModuleNotFoundError:
            continue
        for part in parts[n:]:
            thing = getattr(thing, part)
        return thing
    raise ModuleNotFoundError(name)


@pytest.mark.parametrize("page", PAGES)
def test_the_imports_of_a_page_work(page):
    for block in BLOCK.findall(PAGES[page].read_text(encoding="utf-8")):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and node.module.startswith("pfslam"):
                for name in node.names:
                    found(f"{node.module}.{name.name}")


@pytest.mark.parametrize("page", PAGES)
def test_the_names_in_the_text_of_a_page_exist(page):
    for match in NAME.finditer(PAGES[page].read_text(encoding="utf-8")):
        if not match["name"].endswith(FILES):
            found(match["name"])
