"""What one student's kernel needs: `python book/_tools/measure_classroom.py NOTEBOOKS... --out TABLE.csv`.

Each notebook runs from its first cell to its last in a kernel of its own, one after another. Start-up is the time
until a fresh kernel answers, seconds the time that its cells take, memory the most that its process ever held.
"""

import argparse
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient

from pfslam.io.files import write_text

MEMORY = "import resource; print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
COLUMNS = ("chapter", "startup_s", "run_s", "memory_mb")


def measure(path: Path) -> dict[str, object]:
    """One row of the table: what running the chapter takes."""
    notebook = nbformat.read(path, as_version=4)
    probes = [nbformat.v4.new_code_cell("1"), *notebook.cells, nbformat.v4.new_code_cell(MEMORY)]
    notebook.cells = probes
    client = NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(path.parent)}})
    begin = time.perf_counter()
    with client.setup_kernel():
        client.execute_cell(probes[0], 0)
        ready = time.perf_counter()
        for index, cell in enumerate(probes[1:], start=1):
            if cell.cell_type == "code":
                client.execute_cell(cell, index)
        done = time.perf_counter()
    kilobytes = int(probes[-1].outputs[0].text)
    return {
        "chapter": path.stem,
        "startup_s": round(ready - begin, 1),
        "run_s": round(done - ready, 1),
        "memory_mb": round(kilobytes / 1024),
    }


def main(arguments: list[str] | None = None) -> None:
    """Measure every notebook named and write the table."""
    parser = argparse.ArgumentParser(prog="python book/_tools/measure_classroom.py", description=__doc__)
    parser.add_argument("notebooks", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, required=True, help="the table, CSV")
    options = parser.parse_args(arguments)
    rows = [measure(path) for path in sorted(options.notebooks)]
    lines = [",".join(COLUMNS), *(",".join(str(row[name]) for name in COLUMNS) for row in rows)]
    write_text(options.out, "\n".join(lines) + "\n")
    print(options.out)


if __name__ == "__main__":
    main()
