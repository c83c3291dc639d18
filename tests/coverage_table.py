"""How much of the core the unit tests run, by module: the table of ``make coverage``, and whether it is enough.

Lines and branches are counted together: a share is (lines run + branches taken) / (lines + branches). The core is the
package without its figures (``teaching``) and its stop watch (``bench``), which other commands run.
"""

import csv
import json
import sys
from pathlib import Path

TABLE = Path(__file__).resolve().parents[1] / "book" / "tables" / "coverage.csv"
EACH, ALL = 95.0, 97.0
"""The least share of a module and of the whole core, in per cent."""


def row(name: str, counts: dict) -> tuple[str, int, int, float]:
    """Name, lines, branches, share in per cent; ``counts`` as Coverage's JSON has them."""
    every = counts["num_statements"] + counts["num_branches"]
    run = counts["covered_lines"] + counts["covered_branches"]
    return name, counts["num_statements"], counts["num_branches"], 100.0 * run / every if every else 100.0


def table(report: dict) -> list[tuple[str, int, int, float]]:
    """One row for each module, then the whole core."""
    files = sorted((Path(path).with_suffix(""), entry) for path, entry in report["files"].items())
    modules = [row(path.relative_to("pfslam").as_posix(), entry["summary"]) for path, entry in files]
    return [*modules, row("all", report["totals"])]


def main(report: str) -> int:
    """Write the table, or, if a module or the whole is below its floor, leave the old one and return 1."""
    rows = table(json.loads(Path(report).read_text(encoding="utf-8")))
    for name, _, _, share in rows:
        print(f"{share:6.1f} %  {name}")
    low = [name for name, _, _, share in rows if share < (ALL if name == "all" else EACH)]
    if low:
        print("too little: " + ", ".join(low))
        return 1
    with open(TABLE, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["module", "lines", "branches", "share"])
        writer.writerows([name, lines, branches, f"{share:.1f}"] for name, lines, branches, share in rows)
    print(f"each at least {EACH:.0f} %, all at least {ALL:.0f} %")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
