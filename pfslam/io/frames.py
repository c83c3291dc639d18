"""The tree of frames of a robot that runs ROS: transforms between pairs of frames, chained to what is asked for."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from pfslam.io.messages import TF, Log, Topic, nanoseconds
from pfslam.poses import invert_transform, quaternion_to_rotation

Frames = dict[tuple[str, str], tuple[Topic, np.ndarray]]
"""For each pair (parent, child) its messages and their transforms ``(K, 4, 4)``."""
EDGE = ("translation xyz", "rotation xyzw")
MOVED = 0.01
"""A pair of frames whose transform changes by more than this (m, or in an entry of its rotation) is not fixed."""
FARTHEST = 1e8
"""Metres from the origin that a robot may drive."""


def read_frames(log: Log, topics: Iterable[Topic]) -> Frames:
    """Collect the transforms of TFMessages."""
    rows: dict[tuple[str, str], list[tuple[int, int, Any]]] = {}
    for arrived, message in (
        pair for topic in topics for pair in zip(topic.arrived, topic.contents, strict=True)
    ):
        for edge in message.transforms:
            pair = frame_of(edge), edge.child_frame_id.lstrip("/")
            rows.setdefault(pair, []).append((nanoseconds(edge.header), arrived, edge.transform))
    return {
        pair: transforms(log, Topic.of(f"/tf ({' -> '.join(pair)})", TF, rows[pair]), *EDGE) for pair in rows
    }


def chain(frames: Frames, base: str, frame: str) -> np.ndarray | None:
    """Return the transform ``(4, 4)`` of ``frame`` in ``base`` if pairs at rest join them."""
    still = {pair: T[0] for pair, (_, T) in frames.items() if np.abs(T - T[0]).max() <= MOVED}
    reached = {base: np.eye(4)}
    for _ in still:
        for (parent, child), T in still.items():
            if parent in reached:
                reached.setdefault(child, reached[parent] @ T)
            elif child in reached:
                reached[parent] = reached[child] @ invert_transform(T)
    return reached.get(frame)


def frame_of(message: Any) -> str:
    """Return the frame of a message, without the slash that old robots write before it."""
    return message.header.frame_id.lstrip("/")


def transforms(log: Log, topic: Topic, position: str, turn: str) -> tuple[Topic, np.ndarray]:
    """Keep the messages whose position and quaternion are a pose, and return their transforms ``(K, 4, 4)``."""
    rows = topic.numbers(position, turn)
    length = np.linalg.norm(np.clip(rows[:, 3:], -2.0, 2.0), axis=1)
    good = (np.abs(rows) < FARTHEST).all(axis=1) & (np.abs(length - 1.0) < 0.01)
    topic = log.keep(topic, good, "that are no poses", "finite numbers, a quaternion of length 1")
    T = np.tile(np.eye(4), (len(topic.t), 1, 1))
    T[:, :3, :3] = quaternion_to_rotation(rows[good, 3:] / length[good, None])
    T[:, :3, 3] = rows[good, :3]
    return topic, T
