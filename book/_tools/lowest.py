"""``make lowest``: print the lowest version of everything that pyproject.toml asks for, as constraints for pip."""

import re
import tomllib
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2] / "pyproject.toml"


def lowest(project: dict) -> list[str]:
    """Turn each ``name>=version`` of the dependencies and extras into ``name==version``."""
    extras = project["optional-dependencies"].values()
    wanted = [*project["dependencies"], *(line for extra in extras for line in extra)]
    bounds = (re.fullmatch(r"([\w.-]+)>=([\w.]+)", line) for line in wanted)
    return sorted({f"{bound[1]}=={bound[2]}" for bound in bounds if bound})


if __name__ == "__main__":
    print(*lowest(tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]), sep="\n")
