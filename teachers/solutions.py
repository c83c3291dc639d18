"""Fill the solutions to the open questions with their numbers: `python teachers/solutions.py FOLDER` writes them there.

`solutions.md` holds the words. A number in them is a field such as ``{p03[side]:.2f}``: p03 is computed by
`pencil.py`, d03 was measured by `designs.py` and is kept in `designs.json`.
"""

import json
import sys
from pathlib import Path

from pencil import NUMBERS

HERE = Path(__file__).parent


def solutions() -> str:
    """The words of the solutions with all their numbers."""
    measured = json.loads((HERE / "designs.json").read_text(encoding="utf-8"))
    return (HERE / "solutions.md").read_text(encoding="utf-8").format_map(NUMBERS | measured)


if __name__ == "__main__":
    out = Path(sys.argv[1]) / "open_questions.md"
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(solutions(), encoding="utf-8", newline="\n")
    print(f"the solutions to the open questions are in {out}")
