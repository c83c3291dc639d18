"""What the commands say: tables, closing words, and the figures of a run for ``summary.json``."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pfslam.beyond.localization import EXPLAINED_SHARE, LocalizationResult
from pfslam.errors import printable
from pfslam.evaluation.calibration import calibrate
from pfslam.evaluation.checkup import Finding
from pfslam.evaluation.cloud import covariance_consistency
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.io.topics import TF
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.refined.floor import UNREADABLE
from pfslam.refined.health import Distrust, alarms
from pfslam.refined.run import RefinedResult
from pfslam.refined.scan_odometry import unaided
from pfslam.texture import FloorTexture

if TYPE_CHECKING:
    from pfslam.beyond.loops.closing import Revision

INFINITE = "that are infinite"
RATES = ("seconds", "per second", "longest gap")

# Tables: what a data set holds, and whether its instruments agree


def text_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Set a table in columns of text."""
    table = [headings, *([printable(cell) for cell in row] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = ([word.ljust(width) for word, width in zip(row, widths, strict=True)] for row in table)
    return "\n".join("  ".join(line).rstrip() for line in lines)


def check_table(findings: Iterable[Finding]) -> str:
    """Set the answers of a check-up as a table."""
    rows = ((f.severity, f.question, f.found, f.expected) for f in findings)
    return text_table(("verdict", "question", "found", "expected"), rows)


def remedies(findings: Iterable[Finding]) -> list[str]:
    """List the wrong answers for which it is known what to do, each in one line with that."""
    return [f"{f.question} found {f.found}, expected {f.expected}: {f.remedy}" for f in findings if f.remedy]


def stops(findings: Iterable[Finding]) -> list[str]:
    """List the answers that make a run impossible, each in one line with what to do."""
    return remedies(finding for finding in findings if finding.severity == "stop")


def topic_table(topics: Mapping[str, tuple[str, int]], chosen: Collection[str]) -> str:
    """Set the topics of a bag as a table."""
    rows = (
        (name, kind.replace("/msg/", "/"), str(number), "yes" if kind == TF or name in chosen else "no")
        for name, (kind, number) in topics.items()
    )
    return text_table(("topic", "type", "messages", "used"), rows)


def _rates(t: np.ndarray) -> tuple[str, str, str, str]:
    """Put stamps ``(K,)`` into words: how many, over which time, how often, and the longest gap."""
    if len(t) < 2:
        return str(len(t)), "-", "-", "-"
    span = float(t[-1] - t[0])
    often = f"{(len(t) - 1) / span:.1f}" if span > 0 else "-"
    return str(len(t)), f"{span:.1f}", often, f"{np.diff(t).max():.2f} s"


def describe(recording: Recording) -> str:
    """Say what a recording holds: its streams, its LiDAR, what was left out and what its loader had to say."""
    stamps = _stamps(recording)
    begin, end = min(t[0] for t in stamps.values()), max(t[-1] for t in stamps.values())
    source = "the odometry's poses" if recording.motion == "odometry" else recording.motion
    lines = [
        text_table(("stream", "readings", *RATES), ((name, *_rates(t)) for name, t in stamps.items())),
        f"time: {begin:.6f} to {end:.6f} s",
        f"motion: from {source}",
        *_lidar(recording),
    ]
    return "\n".join(lines + said_by_the_loader(recording))


def described(recording: Recording) -> dict[str, Any]:
    """Say what a recording holds, as ``describe`` does, for programs."""
    stamps = _stamps(recording)
    streams = {
        name: {"readings": len(t), "from": float(t[0]), "to": float(t[-1])}
        | ({"longest_gap": float(np.diff(t).max())} if len(t) > 1 else {})
        for name, t in stamps.items()
    }
    content: dict[str, Any] = {"dataset": recording.name, "streams": streams}
    content["motion"] = recording.motion
    if recording.lidar is not None:
        content |= {"lidar": recording.robot.lidar, "every": recording.default_every}
    return content | {"notes": list(recording.notes), "dropped": recording.dropped}


def _stamps(recording: Recording) -> dict[str, np.ndarray]:
    """Return the stamps of every stream, those of images too, by what it holds."""
    stamps = {name: part.t for name, part in recording.streams().items()}
    if recording.camera is not None:
        stamps |= {"depth images": recording.camera.disparity_t, "colour images": recording.camera.rgb_t}
    return stamps


def _lidar(recording: Recording) -> list[str]:
    if recording.lidar is None:
        return ["lidar: none, so a run can only do dead reckoning"]
    lidar = recording.robot.lidar
    low, high = np.degrees([lidar.angle_min, lidar.angle_max])
    x, y, z = lidar.position_b
    return [
        f"lidar: {lidar.beams} beams from {low:.1f} to {high:.1f} deg, {lidar.range_min:g} to {lidar.range_max:g} m",
        f"place of the lidar: x {x:.3f}, y {y:.3f}, z {z:.3f} m",
        f"sweep: {lidar.sweep:g} s from first beam to last" if lidar.sweep else "sweep: all beams at once",
        f"scans that a run uses: one in {recording.default_every}",
    ]


# Summaries: the figures of a run


def summarise(
    recording: Recording,
    odometry: Trajectory,
    result: RefinedResult | None,
    texture: FloorTexture | None,
    revision: Revision | None = None,
    findings: Sequence[Finding] = (),
) -> dict[str, Any]:
    """Collect the figures of a run: counts, what was dropped and why, and the errors where the truth is known."""
    dropped = recording.dropped | (result.dropped if result else {}) | (texture.dropped if texture else {})
    summary: dict[str, Any] = {
        "motion": recording.motion,
        "scans_recorded": 0 if recording.lidar is None else len(recording.lidar.t),
        "scans": len(result.trajectory) if result else 0,
        "updates": result.updates if result else 0,
        "resamplings": result.resamplings if result else 0,
        "lost": len(alarms(result.infos)) if result else 0,
        "second_look": bool(result and result.second_look),
        "distrust": _doubts(recording, odometry, result, findings),
        "covariance": _covariance(result, recording.truth) if result else None,
        "dropped": dropped,
        "notes": list(recording.notes),
        "checks_failed": [asdict(finding) for finding in findings if finding.ok is False],
    }
    if recording.encoders is not None and recording.imu is not None:
        summary["calibration"] = {"applied": False} | asdict(calibrate(recording, result))
    if texture is not None:
        summary["image_pairs"] = texture.pairs
    estimates = {"odometry": odometry} | ({"slam": result.trajectory} if result else {})
    if revision is not None and result is not None:
        summary["loops"] = _loops(revision, result.trajectory)
        estimates["revised"] = revision.trajectory
    if (truth := recording.truth) is not None:
        known = truth.covers(odometry.t)
        if not known.all():
            dropped["poses outside the truth's time, not compared"] = int(np.count_nonzero(~known))
        if known.any():
            summary |= {name: asdict(trajectory_error(path, truth)) for name, path in estimates.items()}
    return summary


def _doubts(
    recording: Recording, odometry: Trajectory, result: RefinedResult | None, findings: Sequence[Finding]
) -> list[Distrust]:
    """List when not to trust a run: what should have stopped it, what it tells itself, what no odometry told."""
    doubts: list[Distrust] = [
        {"from": float(odometry.t[0]), "to": None, "reason": reason} for reason in stops(findings)
    ]
    told = [*result.distrust, *unaided(recording, result.infos)] if result else []
    return doubts + sorted(told, key=lambda doubt: doubt["from"])


def _covariance(result: RefinedResult, truth: Trajectory | None) -> dict[str, float] | None:
    """Say how well the run knows its poses (m, deg), and with truth whether it is right about that."""
    covariances = result.covariances
    if covariances is None:
        return None
    position = np.sqrt(covariances[:, 0, 0] + covariances[:, 1, 1])
    heading = np.rad2deg(np.sqrt(covariances[:, 2, 2]))
    names = "sigma_end_m", "sigma_max_m", "heading_sigma_end_deg", "heading_sigma_max_deg"
    found = dict(
        zip(names, map(float, (position[-1], position.max(), heading[-1], heading.max())), strict=True)
    )
    if truth is not None and np.count_nonzero(truth.covers(result.trajectory.t)) > 1:
        against = covariance_consistency(result.infos, truth)
        found |= {"nees": float(against.nees.mean()), "truth_within_90": against.inside[0.9]}
    return found


def _loops(revision: Revision, before: Trajectory) -> dict[str, Any]:
    """Say how many places were compared and found to be the same, and how far the path was moved (m)."""
    moved = np.hypot(*(revision.trajectory.poses - before.poses)[:, :2].T)
    counts = {"key_scans": len(revision.keys), "candidates": revision.candidates}
    return counts | {"accepted": len(revision.loops), "largest_move_m": float(moved.max())}


def summarise_search(recording: Recording, result: LocalizationResult) -> dict[str, Any]:
    """Collect the figures of a search: when the pose was found, for how long, and with how many particles."""
    numbers, found = [info.number for info in result.infos], result.found_at
    return {
        "scans": len(result.infos),
        "updates": sum(info.used for info in result.infos),
        "found_at": found,
        "seconds_to_find": None if found is None else found - float(result.trajectory.t[0]),
        "located_share": float(result.located.mean()),
        "located_at_end": bool(result.located[-1]),
        "explained": result.explained,
        "explained_needed": EXPLAINED_SHARE,
        "found": result.found,
        "particles": {"most": max(numbers), "fewest": min(numbers), "mean": float(np.mean(numbers))},
        "dropped": recording.dropped | result.dropped,
        "notes": list(recording.notes),
    }


# Closing words: how it went, and where the results are


def said_by_the_loader(recording: Recording) -> list[str]:
    """List what the loader of a recording decided, and what it left out, but for infinite ranges: no return."""
    lines = [f"note: {note}" for note in recording.notes]
    left_out = {reason: count for reason, count in recording.dropped.items() if not reason.endswith(INFINITE)}
    return lines + [f"left out: {count} {reason}" for reason, count in left_out.items()]


def closing_words(recording: Recording, summary: dict[str, Any], out: Path) -> str:
    """Write a few lines for the user: what the loader said, and how the run ended."""
    lines = said_by_the_loader(recording)
    if recording.lidar is None:
        lines.append("no LiDAR in this data set, so this is dead reckoning only")
    if summary.get("second_look"):
        lines.append("people, glass or noise mislead the scans, so the run was made with robust settings")
    dropped = summary.get("dropped", {}).items()
    lines += [f"left out: {count} {reason}" for reason, count in dropped if UNREADABLE in reason]
    for check in summary.get("checks_failed", ()):
        told = "note" if check["severity"] == "note" else "check failed"
        remedy = f": {check['remedy']}" if check["remedy"] else ""
        lines.append(f"{told}: {check['question']} {check['found']}, expected {check['expected']}{remedy}")
    if stretches := summary["distrust"]:
        begin = stretches[0]["from"] if recording.lidar is None else recording.lidar.t[0]
        lines.append(_warning(stretches, begin))
    estimates = [name for name in ("odometry", "slam", "revised") if name in summary]
    errors = ", ".join(f"{name} {summary[name]['ate_rmse_m']:.3f} m" for name in estimates)
    found = f" ({errors} from the truth, root mean square)" if errors else ""
    return "\n".join([*lines, f"results are in {out}{found}"])


def to_look_at(files: Sequence[str], out: Path) -> str:
    """Say which files of a run show it."""
    shown = [str(out / name) for name in ("index.html", "map.png") if name in files]
    return f"to look at the run, open {' or '.join(shown)}"


def _warning(stretches: list, begin: float) -> str:
    """Say in one sentence when and why not to trust the run, in seconds after the first scan."""
    first = stretches[0]
    since, to = first["from"] - begin, first["to"]
    when = f"from {since:.0f} s on" if to is None else f"from {since:.0f} s to {to - begin:.0f} s"
    others = f"; summary.json lists {len(stretches) - 1} more" if len(stretches) > 1 else ""
    return f"do not trust path and map {when}: {first['reason']}{others}"


def closing_words_of_search(recording: Recording, result: LocalizationResult, out: Path) -> str:
    """Write a few lines for the user: what the loader said, when and where the robot was found, and where files are."""
    lines = said_by_the_loader(recording)
    if result.found_at is None:
        lines.append("not found: at no scan did the particles agree on one place")
    else:
        seconds = result.found_at - result.trajectory.t[0]
        x, y, theta = result.trajectory.poses[-1]
        place = f"({x:.2f} m, {y:.2f} m, {np.degrees(theta):.0f} deg)"
        fit = f"the map explains {int(100 * result.explained)} % of the beams on the way"
        needed = f"{100 * EXPLAINED_SHARE:.0f} % are needed"
        if result.found:
            lines.append(f"found after {seconds:.1f} s; now at {place}; {fit} ({needed})")
        elif result.located[-1]:
            lines.append(f"not found: seems to be at {place}, but {fit}, and {needed}")
        else:
            lines.append(f"not sure at the end: seemed found after {seconds:.1f} s; last guess {place}")
            lines.append("is it the map of this building?")
    return "\n".join([*lines, f"results are in {out}"])
