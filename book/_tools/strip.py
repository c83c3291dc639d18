"""Bring notebooks to the form in which they are committed: `python book/_tools/strip.py [--check] NOTEBOOK...`.

Only text outputs stay. Pictures, widgets and the numbers in the sentences are made again whenever the book is built; in
the repository they would only bloat the history and hide what changed. What the site folds by its tag, JupyterLab folds
too.
"""

import argparse
import json
import sys
from pathlib import Path

KEPT_METADATA = ("kernelspec", "language_info")
KEPT_LANGUAGE = ("name", "pygments_lexer", "file_extension", "mimetype")
KEPT_OF_A_CELL = ("tags", "jupyter", "mystnb")
FOLDED = {  # what JupyterLab folds, by the tag that folds it on the site
    "hide-input": {"jupyter": {"source_hidden": True}},
    "remove-input": {"jupyter": {"source_hidden": True}},
    "hide-cell": {"jupyter": {"outputs_hidden": True, "source_hidden": True}},
    "slides": {"jupyter": {"source_hidden": True}},
}


def strip_notebook(notebook: dict) -> dict:
    """Return the notebook without pictures, widget state and tool metadata, its cells counted from 1."""
    metadata = {k: v for k, v in notebook.get("metadata", {}).items() if k in KEPT_METADATA}
    if "language_info" in metadata:
        language = metadata["language_info"]
        metadata["language_info"] = {k: v for k, v in language.items() if k in KEPT_LANGUAGE}
    cells, count = [], 0
    for cell in notebook["cells"]:
        count += cell["cell_type"] == "code" and bool("".join(cell["source"]).strip())
        cells.append(_strip_cell(cell, count))
    return {**notebook, "metadata": metadata, "cells": cells}


def folded(metadata: dict) -> dict:
    """The metadata of a cell, folded in JupyterLab if its tags fold it on the site, and open otherwise."""
    rest = {k: v for k, v in metadata.items() if k != "jupyter"}
    hidden = [FOLDED[tag] for tag in metadata.get("tags", []) if tag in FOLDED]
    return {**hidden[0], **rest} if hidden else rest


def _strip_cell(cell: dict, count: int) -> dict:
    metadata = folded({k: v for k, v in cell["metadata"].items() if k in KEPT_OF_A_CELL})
    if cell["cell_type"] != "code":
        return {**cell, "metadata": metadata}
    number = count if "".join(cell["source"]).strip() else None
    outputs: list[dict] = []
    for kept in filter(None, (_strip_output(output, number) for output in cell["outputs"])):
        if outputs and kept["output_type"] == outputs[-1]["output_type"] == "stream":
            # A busy machine writes the lines of one cell in several pieces.
            text = "".join(outputs[-1]["text"]) + "".join(kept["text"])
            outputs[-1] = {**outputs[-1], "text": text.splitlines(keepends=True)}
        else:
            outputs.append(kept)
    return {**cell, "metadata": metadata, "execution_count": number, "outputs": outputs}


def _strip_output(output: dict, count: int | None) -> dict | None:
    """Streams and errors stay; of a result its text stays, if it has one."""
    if output["output_type"] == "stream":
        return None if output["name"] == "stderr" else output
    if output["output_type"] == "error":
        return output
    data = {
        kind: value for kind, value in output["data"].items() if kind.split("/")[-2:] == ["text", "plain"]
    }
    if not data:
        return None
    stripped = {**output, "data": data}
    if "execution_count" in stripped:
        stripped["execution_count"] = count
    return stripped


def main(arguments: list[str] | None = None) -> int:
    """Strip the notebooks named on the command line."""
    parser = argparse.ArgumentParser(prog="python book/_tools/strip.py", description=__doc__)
    parser.add_argument("notebooks", nargs="+", type=Path)
    parser.add_argument(
        "--check", action="store_true", help="change nothing; fail if something is left to strip"
    )
    options = parser.parse_args(arguments)
    unclean = 0
    for path in options.notebooks:
        notebook = json.loads(path.read_text(encoding="utf-8"))
        stripped = strip_notebook(notebook)
        if stripped == notebook:
            continue
        unclean += 1
        print(f"{path}: {'holds more than text outputs' if options.check else 'stripped'}")
        if not options.check:
            path.write_text(json.dumps(stripped, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return 1 if options.check and unclean else 0


if __name__ == "__main__":
    sys.exit(main())
