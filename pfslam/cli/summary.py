"""The summary of a run: ``summary.json``, and a closing line for the user."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pfslam.evaluation.calibration import calibrate
from pfslam.evaluation.checkup import check_up
from pfslam.evaluation.cloud import covariance_consistency
from pfslam.evaluation.trajectory import trajectory_error
from pfslam.poses import Trajectory
from pfslam.recording import Recording
from pfslam.refined.health import Distrust, alarms
from pfslam.run import SlamResult
from pfslam.texture import FloorTexture

if TYPE_CHECKING:
    from pfslam.beyond.loops.closing import Revision


def summarise(
    recording: Recording,
    odometry: Trajectory,
    result: SlamResult | None,
    texture: FloorTexture | None,
    revision: Revision | None = None,
) -> dict[str, Any]:
    """Collect the figures of a run: counts, what was dropped and why, and the errors where the truth is known."""
    parts = [recording.dropped, result.dropped if result else {}, texture.dropped if texture else {}]
    summary: dict[str, Any] = {
        "scans_recorded": 0 if recording.lidar is None else len(recording.lidar.t),
        "scans": len(result.trajectory) if result else 0,
        "updates": result.updates if result else 0,
        "resamplings": result.resamplings if result else 0,
        "lost": len(alarms(result.infos)) if result else 0,
        "second_look": bool(result and result.config.outliers),
        "distrust": result.distrust if result else [],
        "covariance": _covariance(result, recording.truth) if result else None,
        "dropped": {reason: count for part in parts for reason, count in part.items()},
        "notes": list(recording.notes),
        "checks_failed": [asdict(finding) for finding in check_up(recording) if finding.ok is False],
    }
    if recording.encoders is not None and recording.imu is not None:
        summary["calibration"] = {"applied": False} | asdict(calibrate(recording, result))
    if texture is not None:
        summary["image_pairs"] = texture.pairs
    estimates = {"odometry": odometry} | ({"slam": result.trajectory} if result else {})
    if revision is not None and result is not None:
        summary["loops"] = _loops(revision, result.trajectory)
        estimates["revised"] = revision.trajectory
    if recording.truth is None:
        return summary
    known = recording.truth.covers(odometry.t)
    if not known.all():
        summary["dropped"]["poses outside the truth's time, not compared"] = int(np.count_nonzero(~known))
    if known.any():
        summary |= {
            name: asdict(trajectory_error(poses, recording.truth)) for name, poses in estimates.items()
        }
    return summary


def _covariance(result: SlamResult, truth: Trajectory | None) -> dict[str, float] | None:
    """Say how well the run knows its poses (m, deg), and with truth whether it is right about that."""
    covariances = result.covariances
    if covariances is None:
        return None
    position = np.sqrt(covariances[:, 0, 0] + covariances[:, 1, 1])
    heading = np.rad2deg(np.sqrt(covariances[:, 2, 2]))
    found = {
        "sigma_end_m": float(position[-1]),
        "sigma_max_m": float(position.max()),
        "heading_sigma_end_deg": float(heading[-1]),
        "heading_sigma_max_deg": float(heading.max()),
    }
    if truth is not None and np.count_nonzero(truth.covers(result.trajectory.t)) > 1:
        against = covariance_consistency(result.infos, truth)
        found |= {"nees": float(against.nees.mean()), "truth_within_90": against.inside[0.9]}
    return found


def _loops(revision: Revision, before: Trajectory) -> dict[str, Any]:
    """Say how many places were compared and found to be the same, and how far the path was moved (m)."""
    moved = np.hypot(*(revision.trajectory.poses - before.poses)[:, :2].T)
    return {
        "key_scans": len(revision.keys),
        "candidates": revision.candidates,
        "accepted": len(revision.loops),
        "largest_move_m": float(moved.max()),
    }


def said_by_the_loader(recording: Recording) -> list[str]:
    """List what the loader of a recording decided, and what it left out."""
    lines = [f"note: {note}" for note in recording.notes]
    return lines + [f"left out: {count} {reason}" for reason, count in recording.dropped.items()]


def closing_words(recording: Recording, summary: dict[str, Any], out: Path) -> str:
    """Write a few lines for the user: what the loader said, and how the run ended."""
    lines = said_by_the_loader(recording)
    lines += [] if recording.lidar is not None else ["no LiDAR in this data set: dead reckoning only"]
    if summary.get("second_look"):
        lines.append("people, glass or noise misled the scans: the run was done again with care")
    for check in summary.get("checks_failed", ()):
        lines.append(f"check failed: {check['question']} {check['found']}, expected {check['expected']}")
    if stretches := summary["distrust"]:
        lines.append(_warning(stretches, recording.scans().t[0]))
    errors = [
        f"{name} {summary[name]['ate_rmse_m']:.3f} m"
        for name in ("odometry", "slam", "revised")
        if name in summary
    ]
    found = f" ({', '.join(errors)} from the truth, root mean square)" if errors else ""
    return "\n".join([*lines, f"results are in {out}{found}"])


def _warning(stretches: list[Distrust], begin: float) -> str:
    """Say in one sentence when and why not to trust the run, in seconds after the first scan."""
    first = stretches[0]
    since, to = first["from"] - begin, first["to"]
    when = f"from {since:.0f} s on" if to is None else f"from {since:.0f} s to {to - begin:.0f} s"
    others = f"; {len(stretches) - 1} more in summary.json" if len(stretches) > 1 else ""
    return f"do not trust path and map {when}: {first['reason']}{others}"
