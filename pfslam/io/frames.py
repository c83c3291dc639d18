"""The tree of frames of a robot that runs ROS: transforms between pairs of frames, chained to what is asked for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pfslam.io.messages import TF, Log, Message, Topic, nanoseconds
from pfslam.poses import invert_transform

POSE = {"translation": "xyz", "rotation": "xyzw"}
MOVED = 0.01
"""A pair of frames whose transform changes by more than this (m, or in an entry of its rotation) is not fixed."""
FARTHEST = 1e8
"""Metres from the origin that a robot may drive."""


@dataclass(frozen=True, eq=False)
class Frames:
    """The tree of frames: the topic of each pair (parent, child), and the transform ``(4, 4)`` of those at rest."""

    topics: dict[tuple[str, str], Topic]
    still: dict[tuple[str, str], np.ndarray]

    @classmethod
    def of(cls, log: Log, topics: Iterable[Topic]) -> Frames:
        """Collect the transforms of TFMessages."""
        held: dict[tuple[str, str], list[Message]] = {}
        for _, arrived, message in (message for topic in topics for message in topic.messages):
            for edge in message.transforms:
                pair = frame_of(edge), edge.child_frame_id.lstrip("/")
                held.setdefault(pair, []).append(Message(nanoseconds(edge.header), arrived, edge.transform))
        found, still = {}, {}
        for pair, messages in held.items():
            found[pair], T = transforms(log, Topic(f"/tf ({pair[0]} -> {pair[1]})", TF, messages), POSE)
            if np.abs(T - T[0]).max() <= MOVED:
                still[pair] = T[0]
        return cls(found, still)

    def fixed(self, base: str, frame: str) -> np.ndarray | None:
        """Return the transform ``(4, 4)`` of ``frame`` in ``base`` if pairs at rest join them."""
        reached = {base: np.eye(4)}
        for _ in self.still:
            for (parent, child), T in self.still.items():
                if parent in reached:
                    reached.setdefault(child, reached[parent] @ T)
                elif child in reached:
                    reached[parent] = reached[child] @ invert_transform(T)
        return reached.get(frame)


def frame_of(message: Any) -> str:
    """Return the frame of a message, without the slash that old robots write before it."""
    return message.header.frame_id.lstrip("/")


def transforms(log: Log, topic: Topic, axes: Mapping[str, str]) -> tuple[Topic, np.ndarray]:
    """Keep the messages whose position and quaternion are a pose, and return their transforms ``(K, 4, 4)``."""
    rows = topic.numbers(axes)
    length = np.linalg.norm(np.clip(rows[:, 3:], -2.0, 2.0), axis=1)
    good = (np.abs(rows) < FARTHEST).all(axis=1) & (np.abs(length - 1.0) < 0.01)
    topic = log.keep(topic, good, "that are no poses", "finite numbers, a quaternion of length 1")
    xyz, turn = rows[good, :3], rows[good, 3:] / length[good, None]
    cross = np.cross(np.eye(3), turn[:, None, :3])
    T = np.tile(np.eye(4), (len(turn), 1, 1))
    T[:, :3, :3] += 2.0 * turn[:, 3, None, None] * cross + 2.0 * cross @ cross
    T[:, :3, 3] = xyz
    return topic, T
