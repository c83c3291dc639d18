"""Chapter 12, the check of your graph: any way to mend a path is tried on the ring, and scored."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from pfslam.beyond.loops.graph import Edges, relax
from pfslam.poses import between
from pfslam_book.ch12.drives import edges, stored
from pfslam_book.show.checks import Check, attempt, hint, is_unanswered, passed, unanswered

GOOD = 0.05
"""A path counts as mended if it is less than this off (m, RMS)."""
ALIKE = 0.05
"""Two paths are taken for the same answer if no pose differs by more (m)."""


def off(path: np.ndarray) -> float:
    """How far a path ``(K, 3)`` of the ring is from the truth (m, RMS), both from the start."""
    true = between(stored("ring").truth_path[0], stored("ring").truth_path)
    error = (between(path[0], path) - true)[:, :2]
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


def without_parts() -> Iterator[tuple[str, Edges]]:
    """Yield the graph of the ring with a part left out, and the words for it."""
    chain, near, loops = edges("ring")
    everything, rigid = chain.joined(near, loops), chain.joined(loops)
    yield "That is what comes out without the loops.", chain.joined(near)
    yield "That is what comes out without the near edges.", rigid
    held = "That is what comes out if the wheels are believed: their scale is an unknown, too."
    yield held, replace(everything, wheels=0 * everything.wheels)
    yield held, replace(rigid, wheels=0 * rigid.wheels)


def check_graph(theirs: Callable) -> Check:
    """Whether ``graph(edges, poses)`` mends the ring: poses ``(K, 3)`` less than 5 cm off."""
    driven, whole = stored("ring").before_path, edges("ring")[0].joined(*edges("ring")[1:])
    answer = attempt(theirs, whole, driven.copy())
    if isinstance(answer, Check):
        return answer
    if is_unanswered(answer):
        return unanswered()
    if attempt(np.shape, answer) != driven.shape:
        return hint(f"Return the poses alone, {driven.shape}: x, y and heading of each.")
    path = np.asarray(answer, dtype=float)
    if not np.isfinite(path).all():
        return hint(
            "Some poses are not numbers. Do you hold one of them? Otherwise H is singular: leave out the first."
        )
    words = f"The path is {100 * off(path):.1f} cm off (RMS). It began with {100 * off(driven):.0f} cm"
    if off(path) <= GOOD:
        return passed(f"{words}.")
    words += f", and less than {100 * GOOD:.0f} cm are possible."
    if np.array_equal(path, driven):
        return hint(f"{words} These are the poses that you were given.")
    if off(path) > off(driven):
        return hint(f"{words} So it has become worse. Is the sign right? The step d solves H d = -b.")

    def like(some: Edges) -> bool:
        return bool(np.abs(relax(some, driven)[0] - path)[:, :2].max() < ALIKE)

    return hint(" ".join([words, *(said for said, some in without_parts() if like(some))]))
