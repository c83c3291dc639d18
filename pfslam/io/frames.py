"""The tree of frames of a robot that runs ROS: transforms between pairs of frames, chained to what is asked for."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.poses import invert_transform

MOVED = 0.01
"""A pair of frames whose transform changes by more than this (m, or in an entry of its rotation) is not fixed."""


@dataclass(frozen=True, eq=False)
class Frames:
    """The tree of frames: for each pair (parent, child) its transforms ``(K, 4, 4)``.

    Before them stand the nanoseconds ``(K,)`` at which they were stamped, and at which they reached the bag.
    """

    path: Path
    edges: dict[tuple[str, str], tuple[np.ndarray, np.ndarray, np.ndarray]]

    @classmethod
    def of(cls, path: Path, messages: Iterable[tuple[int, Any]]) -> Frames:
        """Collect the transforms of TFMessages, each given with its nanoseconds of arrival."""
        rows: dict[tuple[str, str], list[list[float]]] = {}
        times: dict[tuple[str, str], list[tuple[int, int]]] = {}
        for arrived, message in messages:
            for edge in message.transforms:
                pair = edge.header.frame_id.lstrip("/"), edge.child_frame_id.lstrip("/")
                times.setdefault(pair, []).append((nanoseconds(edge.header), arrived))
                rows.setdefault(pair, []).append(seven(edge.transform.translation, edge.transform.rotation))
        edges = {}
        for pair, held in rows.items():
            stamped, arrived = np.array(times[pair]).T
            T = transforms(path, f"{pair[0]} -> {pair[1]}", stamped, np.array(held))
            edges[pair] = stamped, arrived, T
        return cls(path, edges)

    def moving(self) -> list[tuple[str, str]]:
        """List the pairs whose transform changes."""
        return [pair for pair, (_, _, T) in self.edges.items() if np.abs(T - T[0]).max() > MOVED]

    def fixed(self, base: str, frame: str) -> np.ndarray | None:
        """Return the transform ``(4, 4)`` of ``frame`` in ``base`` if pairs that do not move join them."""
        reached, ends, moving = {base: np.eye(4)}, [base], self.moving()
        while ends and frame not in reached:
            here = ends.pop(0)
            for (parent, child), (_, _, T) in self.edges.items():
                if here not in (parent, child) or (parent, child) in moving:
                    continue
                there = child if here == parent else parent
                if there not in reached:
                    reached[there] = reached[here] @ (T[0] if here == parent else invert_transform(T[0]))
                    ends.append(there)
        return reached.get(frame)


def seven(place: Any, turn: Any) -> list[float]:
    """List position and quaternion."""
    return [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]


def are_poses(rows: np.ndarray) -> np.ndarray:
    """Tell which rows of position and quaternion ``(K, 7)`` are finite numbers with a quaternion of length 1."""
    return np.isfinite(rows).all(axis=1) & (np.abs(_lengths(rows) - 1.0) < 0.01)


def _lengths(rows: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore"):
        return np.linalg.norm(rows[:, 3:], axis=1)


def transforms(path: Path, what: str, stamps: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Turn rows of position and quaternion ``(K, 7)`` into transforms ``(K, 4, 4)``."""
    length, bad = _lengths(rows), ~are_poses(rows)
    if bad.any():
        at = int(np.argmax(bad))
        found = f"position {rows[at, :3].round(3)}, a quaternion of length {length[at]:.3g}"
        raise DataError(path, f"{what} at {stamps[at] * 1e-9:.3f}", found, "finite numbers, length 1")
    x, y, z, w = (rows[:, 3:] / length[:, None]).T
    T = np.zeros((len(rows), 4, 4))
    T[:, 0, :3] = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], axis=1)
    T[:, 1, :3] = np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], axis=1)
    T[:, 2, :3] = np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=1)
    T[:, :3, 3], T[:, 3, 3] = rows[:, :3], 1.0
    return T


def nanoseconds(header: Any) -> int:
    """Return the stamp of a message's header in whole nanoseconds."""
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def seconds(nanoseconds: np.ndarray) -> np.ndarray:
    """Turn whole nanoseconds into seconds, rounded once."""
    return nanoseconds // 10**9 + nanoseconds % 10**9 * 1e-9
