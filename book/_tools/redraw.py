"""How long a move of a slider takes the kernel: ``python book/_tools/redraw.py NOTEBOOKS...``.

Each notebook runs in a kernel of its own. Then every widget is drawn at all its stops, as a move draws it. What counts
is the processor's time, which other programs lengthen by a half at most, and the clock on the wall by any amount. Each
stop is drawn once: what a widget remembers of it would make the second time too short.
"""

import argparse
import os
import time
from pathlib import Path

import nbformat
import numpy as np
from nbclient import NotebookClient
from pfslam_book.show.widgets import Explorer

HEAD = f"{'ms of processor time for a move':56s} stops  median    95 %"
# IPython keeps what each cell has shown.
PROBE = f"""import sys
sys.path.insert(0, {str(Path(__file__).resolve().parent)!r})
import redraw
print(*(redraw.line(shown) for shown in list(Out.values()) if isinstance(shown, redraw.Explorer)), sep="\\n")"""


def move_ms(explorer: Explorer) -> np.ndarray:
    """Processor time ``(stops,)`` (ms) of a move to each stop, once the widget has been shown."""
    explorer.tag(**explorer.values(explorer.start))
    times = []
    for state in explorer.states():
        begin = time.process_time()
        explorer.tag(**explorer.values(state))
        times.append(1000 * (time.process_time() - begin))
    return np.array(times)


def line(explorer: Explorer) -> str:
    """One line of the table."""
    ms = move_ms(explorer)
    return f"{explorer.title[:56]:56s} {len(ms):5d} {np.median(ms):7.0f} {np.percentile(ms, 95):7.0f}"


def measure(path: Path) -> str:
    """The lines of one notebook's widgets."""
    notebook = nbformat.read(path, as_version=4)
    notebook.cells.append(nbformat.v4.new_code_cell(PROBE))
    client = NotebookClient(notebook, timeout=1200, resources={"metadata": {"path": str(path.parent)}})
    client.execute(env=os.environ | {"PFSLAM_WIDGETS": "text"})
    return notebook.cells[-1].outputs[0].text.rstrip()


def main(arguments: list[str] | None = None) -> None:
    """Measure every notebook named and print the table."""
    parser = argparse.ArgumentParser(prog="python book/_tools/redraw.py", description=__doc__)
    parser.add_argument("notebooks", nargs="+", type=Path)
    for path in parser.parse_args(arguments).notebooks:
        print(f"{HEAD}   {path.stem}\n{measure(path)}\n", flush=True)


if __name__ == "__main__":
    main()
