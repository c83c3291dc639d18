"""Chapter 12: what closing loops did on simulated drives and a real log, stored.

The studies ``ch12_loops`` and ``ch12_intel`` made the arrays.
"""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from pfslam.beyond.loops.graph import Edges
from pfslam.grid import GridSpec, OccupancyGrid

TABLES = Path(__file__).parent
FALSE = 0.5
"""A loop is false if it is further from the truth than this (m)."""


@cache
def arrays(path: Path) -> dict[str, np.ndarray]:
    """Return what a file holds."""
    with np.load(path, allow_pickle=False) as file:
        return dict(file)


def stored(name: str) -> SimpleNamespace:
    """Return key poses and maps, before and after, of the drive "ring", "corridor" or "intel"."""
    of = arrays(TABLES / f"{name}.npz")
    maps = {}
    for when in ("before", "after"):
        signs, (x, y, resolution) = of[f"{when}_map"], of[f"{when}_corner"]
        spec = GridSpec((float(x), float(y)), float(resolution), signs.shape)
        maps[f"{when}_map"] = OccupancyGrid(spec, signs.astype(float))
    return SimpleNamespace(
        **of | {f"{w}_path": of[f"{w}_path"].astype(float) for w in ("before", "after")} | maps
    )


def edges(name: str) -> list[Edges]:
    """Return the graph of the drive "ring" or "corridor": its chain, scans matched to near ones, and its loops."""
    of = arrays(TABLES / f"{name}.npz")
    parts = [[of[f"{part}_{field.name}"] for field in fields(Edges)] for part in ("chain", "near", "loops")]
    return [Edges(*(v.astype(float) if v.dtype == np.float32 else v for v in values)) for values in parts]
