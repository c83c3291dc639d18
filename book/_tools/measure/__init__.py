"""Studies that measure something else than one run of a filter over a recording; ``make studies`` runs them."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any

from pfslam.study import Case


def cases(label: str, **settings: Iterable[Any]) -> tuple[Case, ...]:
    """Return a case for each combination of values; ``label`` names the setting that labels a row, or is the label."""
    grid = {name: list(values) for name, values in settings.items()}
    found = (dict(zip(grid, values, strict=True)) for values in itertools.product(*grid.values()))
    return tuple(Case(str(case.get(label, label)), tuple(case.items())) for case in found)
