"""What a data set holds and whether its instruments agree, as lines of text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from pfslam.cli.summary import said_by_the_loader
from pfslam.evaluation.checkup import Finding
from pfslam.io.bags import TF, Topic
from pfslam.recording import Recording

VERDICTS = {True: "ok", False: "FAILED", None: "-"}
RATES = ("seconds", "per second", "longest gap")


def text_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Set a table in columns of text."""
    table = [headings, *rows]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return "\n".join(
        "  ".join(word.ljust(width) for word, width in zip(row, widths, strict=True)).rstrip()
        for row in table
    )


def check_table(findings: Iterable[Finding]) -> str:
    """Set the answers of a check-up as a table."""
    rows = ((VERDICTS[f.ok], f.question, f.found, f.expected) for f in findings)
    return text_table(("verdict", "question", "found", "expected"), rows)


def topic_table(topics: Mapping[str, Topic], chosen: Iterable[str]) -> str:
    """Set the topics of a bag as a table, by when their messages reached the bag."""
    used = {*chosen, *(name for name, topic in topics.items() if topic.kind == TF)}
    rows = (
        (name, topic.kind.replace("/msg/", "/"), *_rates(topic.t), "yes" if name in used else "no")
        for name, topic in topics.items()
    )
    return text_table(("topic", "type", "messages", *RATES, "used"), rows)


def _rates(t: np.ndarray) -> tuple[str, str, str, str]:
    """Put stamps ``(K,)`` into words: how many, over which time, how often, and the longest gap."""
    if len(t) < 2:
        return str(len(t)), "-", "-", "-"
    span = float(t[-1] - t[0])
    often = f"{(len(t) - 1) / span:.1f}" if span > 0 else "-"
    return str(len(t)), f"{span:.1f}", often, f"{np.diff(t).max():.2f} s"


def describe(recording: Recording) -> str:
    """Say what a recording holds: its streams, its LiDAR, what was left out and what its loader had to say."""
    parts = {name: getattr(recording, name) for name in ("encoders", "imu", "odometry", "lidar", "truth")}
    stamps = {name: part.t for name, part in parts.items() if part is not None}
    if recording.camera is not None:
        stamps |= {"depth images": recording.camera.disparity_t, "colour images": recording.camera.rgb_t}
    lines = [text_table(("stream", "readings", *RATES), ((name, *_rates(t)) for name, t in stamps.items()))]
    lines.append(
        f"time: {min(t[0] for t in stamps.values()):.6f} to {max(t[-1] for t in stamps.values()):.6f} s"
    )
    moves = "the odometry's poses" if recording.odometry is not None else "encoders and gyro"
    lines.append(f"motion: from {moves}")
    none = ["lidar: none, so there is dead reckoning only"]
    lines += none if recording.lidar is None else _lidar(recording)
    lines += said_by_the_loader(recording)
    return "\n".join(lines)


def _lidar(recording: Recording) -> list[str]:
    lidar = recording.robot.lidar
    low, high = np.degrees([lidar.angle_min, lidar.angle_max])
    limits = f"{lidar.range_min:g} to {lidar.range_max:g} m"
    x, y, z = lidar.position_b
    return [
        f"lidar: {lidar.beams} beams from {low:.1f} to {high:.1f} deg, {limits}",
        f"place of the lidar: x {x:.3f}, y {y:.3f}, z {z:.3f} m",
        f"sweep: {lidar.sweep:g} s from first beam to last" if lidar.sweep else "sweep: all beams at once",
        f"scans that a run uses: one in {recording.default_every}",
    ]
