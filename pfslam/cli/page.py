"""A run that one can look at: one HTML file that needs no network."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from html import escape
from math import ceil, sqrt
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import numpy as np

from pfslam import __version__
from pfslam.cli import viewer
from pfslam.cli.figures import picture_of_run
from pfslam.events import ScanEvent
from pfslam.grid import GridSpec, OccupancyGrid, free_cells
from pfslam.io.files import write_png, write_text
from pfslam.io.formats import FREE, OCCUPIED, map_pixels
from pfslam.particles import Particles
from pfslam.poses import Trajectory, compose, invert, transform_points
from pfslam.recording import Recording
from pfslam.refined.health import IMPROBABLE, departures
from pfslam.refined.run import RefinedResult
from pfslam.settings import plain
from pfslam.texture import FloorTexture

if TYPE_CHECKING:
    from pfslam.beyond.loops.closing import Revision

MOMENTS, CLOUD, BEAMS, PIXELS = 1000, 100, 120, 1_200_000
"""The most that a page holds: moments of a run, particles and beams of each, pixels of a map or a floor."""


def moments(count: int) -> np.ndarray:
    """Choose the scans ``(F,)`` out of ``count`` that a page shows: evenly spread, and the last."""
    return np.unique(np.append(np.arange(0, count, ceil(count / MOMENTS)), count - 1))


class Clouds:
    """A ``progress`` for ``run_slam`` that keeps a thinned cloud of each moment, and asks another for the bar."""

    def __init__(self, progress: Callable):
        self.progress = progress
        self.runs: list[list[tuple[np.ndarray, np.ndarray]]] = []

    def __call__(self, steps, total: int) -> Iterator:
        kept: list[tuple[np.ndarray, np.ndarray]] = []
        self.runs.append(kept)
        wanted = set(moments(total).tolist())
        for k, (belief, step) in enumerate(self.progress(steps, total=total)):
            if k in wanted:
                kept.append((step.estimate, thinned(step.particles, step.estimate)))
            yield belief, step

    def of(self, result: RefinedResult) -> np.ndarray:
        """Return the clouds ``(F, CLOUD, 2)`` of the run that was kept: a second look has clouds of its own."""
        run = next(run for run in self.runs if run[0][0] is result.infos[0].estimate)
        return np.array([cloud for _, cloud in run])


def thinned(particles: Particles, pose: np.ndarray) -> np.ndarray:
    """Choose ``(CLOUD, 2)`` int16 of a cloud, in mm from a pose, evenly by weight: a heavy particle comes often."""
    total = np.cumsum(particles.weights)
    at = np.searchsorted(total, total[-1] * (np.arange(CLOUD) + 0.5) / CLOUD)
    return whole(particles.poses[at, :2] - pose[:2], 0.001)


def whole(values: np.ndarray, unit: float) -> np.ndarray:
    """Round to int16 in a unit; what lies beyond becomes the largest."""
    return np.rint(values / unit).clip(-32767, 32767).astype(np.int16)


def packed(values: np.ndarray) -> dict[str, str]:
    """Pack an array for the page, numbers with a point as float32."""
    values = values.astype(np.float32) if values.dtype == float else values
    return {"type": values.dtype.name, "data": b64encode(values.tobytes()).decode()}


class Outcome(NamedTuple):
    """What came out of a run."""

    recording: Recording
    odometry: Trajectory
    result: RefinedResult | None
    texture: FloorTexture | None
    revision: Revision | None

    @property
    def path(self) -> Trajectory:
        """The filter's path, without a LiDAR that of the odometry."""
        return self.odometry if self.result is None else self.result.trajectory


def write_pictures(out: Path, about: dict[str, Any], outcome: Outcome, clouds: Clouds) -> list[str]:
    """Write the maps with their paths, and the page; return the names of the files.

    ``about`` is the run's summary, without times and files.
    """
    files, paths = [], paths_of(outcome)
    for part, suffix, other in ((outcome.result, "", "revised"), (outcome.revision, "_revised", "estimate")):
        if part is not None:
            files.append(f"map{suffix}.png")
            drawn = {name: poses for name, poses in paths.items() if name != other}
            write_png(out / files[-1], picture_of_run(part.grid, drawn))
    write_text(out / "index.html", page(about, outcome, paths, clouds))
    return [*files, "index.html"]


def page(about: dict[str, Any], outcome: Outcome, paths: dict[str, np.ndarray], clouds: Clouds) -> str:
    """Write the page of a run as HTML, with all that it needs inside."""
    t, at, texture = outcome.path.t, moments(len(outcome.path)), outcome.texture
    shown: dict[str, Any] = {"about": about | {"version": __version__}, "t": t[at] - t[0], "scans": len(t)}
    shown |= {"numbers": at.astype(np.int32), "paths": {name: poses[at] for name, poses in paths.items()}}
    shown["distrust"] = [d | {e: d[e] and d[e] - t[0] for e in ("from", "to")} for d in about["distrust"]]
    if outcome.result is not None:
        shown |= filter_data(outcome.result, at) | scan_data(outcome, outcome.result, at)
        shown["cloud"] = clouds.of(outcome.result)
    if texture is not None:
        n = ceil(sqrt(texture.seen.size / PIXELS))
        pixels = np.dstack([texture.rgb[..., ::-1], 255 * texture.seen.astype(np.uint8)])[::n, ::n]
        shown["floor"] = placed(texture.spec, pixels, ".webp", [cv2.IMWRITE_WEBP_QUALITY, 80])
    names = {"core": "core.js", "view": "view.js", "run": "run.js", "style": "lab.css", "frame": "run.html"}
    parts = {name: viewer.source(file) for name, file in names.items()}
    data = json.dumps(plain(shown), default=packed).replace("<", "\\u003c")
    # Names need not be UTF-8.
    title = escape(outcome.recording.name).encode("ascii", "xmlcharrefreplace").decode()
    return Template(parts["frame"]).substitute(parts, title=title, data=data)


def paths_of(outcome: Outcome) -> dict[str, np.ndarray]:
    """Return the paths ``(K, 3)`` of a run by name, moved onto one first pose; NaN where no truth is known."""
    base, paths = outcome.path, {"odometry": outcome.odometry.poses}
    if (truth := outcome.recording.truth) is not None and (known := truth.covers(base.t)).any():
        paths["truth"] = np.full_like(base.poses, np.nan)
        paths["truth"][known] = truth.at(base.t[known])
    for name, poses in paths.items():
        first = int(np.argmax(np.isfinite(poses[:, 0])))
        paths[name] = compose(compose(base.poses[first], invert(poses[first])), poses)
    paths |= {} if outcome.result is None else {"estimate": base.poses}
    return paths | ({} if outcome.revision is None else {"revised": outcome.revision.trajectory.poses})


def filter_data(result: RefinedResult, at: np.ndarray) -> dict[str, Any]:
    """Collect what the steps say; of those from one moment to the next, the worst."""
    infos, covariances = result.infos, result.covariances
    departure, sigma = departures(infos)
    effective = np.array([info.effective_sample_size for info in infos])
    return {
        "particles": result.config.particles,
        "effective": np.minimum.reduceat(effective, at),
        "departure": np.maximum.reduceat(departure, at),
        "improbable": IMPROBABLE * sigma[at],
        "covariance": None if covariances is None else covariances[at][:, [0, 0, 1], [0, 1, 1]],
    }


def scan_data(outcome: Outcome, result: RefinedResult, at: np.ndarray) -> dict[str, Any]:
    """Collect the scans, the maps as they grew, and which scans were found to see the same place."""
    used = result.config.used_scans(outcome.recording)
    of_each = [name for name in ("scans", "t", "tilt", "motion") if hasattr(used, name)]
    events = list(replace(used, **{name: getattr(used, name)[at] for name in of_each}).events())
    scans = np.full((len(at), BEAMS, 2), -32768, np.int16)
    for scan, event in zip(scans, events, strict=True):
        points = event.points_b[:: ceil(len(event.points_b) / BEAMS) or 1]
        scan[: len(points)] = whole(points, 0.01)
    drawn = [(k, event) for k, event in enumerate(events) if not result.infos[at[k]].rejected]
    maps = {"estimate": growth(result.grid, drawn, result.trajectory.poses[at])}
    shown: dict[str, Any] = {"scan": scans, "maps": maps}
    if (revision := outcome.revision) is not None:
        maps["revised"] = growth(revision.grid, drawn, revision.trajectory.poses[at])
        shown["loops"] = revision.keys[np.column_stack([revision.loops.i, revision.loops.j])].astype(np.int32)
    return shown


def growth(grid: OccupancyGrid, drawn: list[tuple[int, ScanEvent]], poses: np.ndarray) -> dict[str, Any]:
    """Draw a map: blue is 0, 127, 254 for unknown, free and wall, 256 red + green the moment when it was first seen.

    A map with too many cells is thinned, and walls win.
    """
    n = ceil(sqrt(grid.log_odds.size / PIXELS))
    grey = map_pixels(grid)[::-1]
    kinds = np.uint8(127) * (grey == FREE) + np.uint8(254) * (grey == OCCUPIED)
    kinds = np.pad(kinds, [(0, -size % n) for size in kinds.shape])
    kinds = kinds.reshape(len(kinds) // n, n, -1, n).max(axis=(1, 3))
    spec = GridSpec(grid.spec.origin, grid.spec.resolution * n, kinds.shape)
    seen = np.full(spec.shape, len(poses) - 1, dtype=np.int16)
    for k, event in reversed(drawn):
        ends = transform_points(poses[k], np.vstack([event.points_b, event.sensor_b]))
        inside = spec.contains(spec.world_to_cell(ends))
        if inside[-1] and len(ends := ends[inside]) > 1:
            mask, rectangle = free_cells(spec, ends[:-1], event.beams[inside[:-1]], ends[-1], "polygon")
            np.copyto(seen[rectangle], k, where=mask.view(bool))
    first = cv2.erode(seen, np.ones((3, 3), np.uint8))  # a wall was seen together with the floor before it
    return placed(spec, np.dstack([kinds, first % 256, first // 256]).astype(np.uint8), ".png")


def placed(spec: GridSpec, pixels: np.ndarray, kind: str, how: Sequence[int] = ()) -> dict[str, Any]:
    """Return a picture ``(H, W, C)`` BGR(A) in grid order, with its place in the world (x0, x1, y0, y1)."""
    data = cv2.imencode(kind, np.ascontiguousarray(pixels[::-1]), how)[1].tobytes()
    return {"extent": spec.extent, "image": f"data:image/{kind[1:]};base64,{b64encode(data).decode()}"}
