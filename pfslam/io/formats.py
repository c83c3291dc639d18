"""Common file formats: TUM trajectories, ROS map_server maps, placed floor textures, benchmark relations.

Row 0 of an image is y_max, while row 0 of our grids is y_min: this module holds the only flip in the package.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pfslam.errors import DataError, naming_source
from pfslam.grid import CELL_SIZES, MAX_CELLS, GridSpec, OccupancyGrid
from pfslam.io.files import (
    PNG_MAGIC,
    atomic_write,
    decode_map_png,
    read_bytes,
    read_text,
    write_png,
    write_text,
)
from pfslam.poses import Trajectory
from pfslam.recording import nearest_stamp

OCCUPIED, FREE, UNKNOWN = 0, 254, 205
OCCUPIED_THRESH, FREE_THRESH = 0.65, 0.196
GAP = rb"(?:\s|#.*\n)+"
PNM_HEADER = re.compile(
    rb"P([56])" + GAP + rb"(\d{1,9})" + GAP + rb"(\d{1,9})" + GAP + rb"255[^\S\n]*(?:#.*)?\n"
)
"""Kind, width and height of a binary PGM or PPM image with 255 values; there may be comments between the words."""


def write_tum(path: str | Path, trajectory: Trajectory) -> None:
    """Write a TUM file: ``t x y z qx qy qz qw``, one pose a line, with t in full, 9 decimals of m and 12 of q."""
    half = 0.5 * trajectory.poses[:, 2]
    rows = zip(trajectory.t, *trajectory.poses[:, :2].T, np.sin(half), np.cos(half), strict=True)
    lines = (f"{_stamp(t)} {x:.9f} {y:.9f} 0 0 0 {z:.12f} {w:.12f}\n" for t, x, y, z, w in rows)
    write_text(path, "".join(lines))


def _stamp(t: float) -> str:
    return np.format_float_positional(t, unique=True, min_digits=6)


def read_tum(path: str | Path) -> Trajectory:
    """Read the planar trajectory of a TUM file: x, y and the yaw of the quaternion. Comments begin with #."""
    t, x, y, _, qx, qy, qz, qw = _rows(path, "poses", "t x y z qx qy qz qw").T
    norm = np.sqrt(qx**2 + qy**2 + qz**2 + qw**2)
    if (np.abs(norm - 1.0) > 1e-3).any():
        at = int(np.argmax(np.abs(norm - 1.0)))
        raise DataError(path, f"pose {at}", f"a quaternion of length {norm[at]:g}", "length 1")
    yaw = np.arctan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy**2 + qz**2))
    with naming_source(path):
        return Trajectory(t, np.column_stack([x, y, yaw]))


COVARIANCE_COLUMNS = "t xx xy xtheta yy ytheta thetatheta"


def write_covariances(path: str | Path, t: np.ndarray, covariances: np.ndarray) -> None:
    """Write pose covariances ``(K, 3, 3)`` (m^2, m rad, rad^2), one a line: the stamp and the upper triangle."""
    upper = covariances[:, *np.triu_indices(3)]
    rows = (" ".join([_stamp(at), *(f"{v:.9e}" for v in row)]) for at, row in zip(t, upper, strict=True))
    write_text(path, "\n".join([f"# {COVARIANCE_COLUMNS}", *rows]) + "\n")


def read_covariances(path: str | Path) -> tuple[np.ndarray, np.ndarray]:
    """Read the stamps ``(K,)`` and covariances ``(K, 3, 3)`` of a file that ``write_covariances`` wrote."""
    table = _rows(path, "covariances", COVARIANCE_COLUMNS)
    return table[:, 0], table[:, 1:][:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)


def _rows(path: str | Path, what: str, columns: str) -> np.ndarray:
    """Read the lines of a text file, but those that begin with #, as a table with these columns."""
    lines = [(i, line.split()) for i, line in enumerate(read_text(path).splitlines(), start=1)]
    count = len(columns.split())
    rows = [numbers(path, f"line {i}", line, count) for i, line in lines if line and line[0][0] != "#"]
    if not rows:
        raise DataError(path, what, "none", f"lines of {columns}")
    return np.array(rows)


def numbers(path: str | Path, place: str, words: list[str], count: int) -> list[float]:
    """Convert words of a file to ``count`` finite numbers; ``DataError`` names the place and the word."""
    if len(words) != count:
        raise DataError(path, place, f"{len(words)} values", f"{count} values")
    values = []
    for word in words:
        try:
            values.append(float(word))
        except ValueError:
            raise DataError(path, place, repr(word)[:60], "a number") from None
    if not np.isfinite(values).all():
        bad = words[int(np.argmin(np.isfinite(values)))]
        raise DataError(path, place, bad[:60], "a finite number")
    return values


def map_pixels(grid: OccupancyGrid) -> np.ndarray:
    """Draw the map as an image ``(H, W)`` uint8, row 0 at y_max: 0 occupied, 254 free, 205 unknown.

    A cell is what the run itself takes it for: what is more likely than not.
    """
    probability = grid.probability
    pixels = np.full(grid.spec.shape, UNKNOWN, dtype=np.uint8)
    pixels[probability > 0.5] = OCCUPIED
    pixels[probability < 0.5] = FREE
    return pixels[::-1]


def write_map(path: str | Path, grid: OccupancyGrid) -> None:
    """Write a ROS map_server map: ``path`` is the ``.yaml`` file, the image goes beside it as ``.pgm``."""
    path = _yaml_name(path)
    pixels = map_pixels(grid)
    with atomic_write(path.with_suffix(".pgm")) as file:
        file.write(b"P5\n%d %d\n255\n" % pixels.shape[::-1])
        file.write(pixels.tobytes())
    keys = {"negate": 0, "occupied_thresh": OCCUPIED_THRESH, "free_thresh": FREE_THRESH}
    write_text(path, _yaml(path.with_suffix(".pgm").name, grid.spec, keys))


def _yaml_name(path: str | Path) -> Path:
    """Return the path; ``DataError`` for a name under which the text would be written over its image."""
    if Path(path).suffix not in (".yaml", ".yml"):
        raise DataError(path, "file name", Path(path).suffix or "no extension", "a name that ends in .yaml")
    return Path(path)


def _yaml(image: str, spec: GridSpec, keys: dict[str, float]) -> str:
    content = {"image": image, "resolution": float(spec.resolution), "origin": [*spec.origin, 0.0]} | keys
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=float("inf"))


def _yaml_keys(path: Path) -> dict[str, Any]:
    """Read the keys of a map's text; aliases, with which a few lines can mean billions of values, are refused."""
    text = read_text(path)
    try:
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, yaml.SafeLoader)):
            raise yaml.YAMLError("an alias")
        keys = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # a date that is none is a ValueError
        raise DataError(path, "file", error, "YAML, as map_server writes it") from None
    return keys if isinstance(keys, dict) else {}


def read_map(path: str | Path) -> tuple[GridSpec, np.ndarray]:
    """Read a ROS map_server map from its ``.yaml``: the grid, and int8 ``(H, W)``, 1 occupied, -1 free, 0 unknown.

    Row 0 is y_min, as in all our grids. Rotated maps (a third origin value) are refused.
    """
    path = Path(path)
    keys = _yaml_keys(path)
    needed = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
    if missing := [key for key in needed if key not in keys]:
        raise DataError(path, "keys", ", ".join(map(str, keys)) or "none", f"a key named {missing[0]}")
    resolution, negate, occupied, free = (
        numbers(path, key, [str(keys[key])], 1)[0]
        for key in ("resolution", "negate", "occupied_thresh", "free_thresh")
    )
    origin = keys["origin"] if isinstance(keys["origin"], list) else [keys["origin"]]
    x, y, yaw = numbers(path, "origin", list(map(str, origin)), 3)
    if negate not in (0.0, 1.0):
        raise DataError(path, "negate", keys["negate"], "0 or 1")
    if not 0.0 <= free < occupied <= 1.0:
        found = f"{keys['free_thresh']}, {keys['occupied_thresh']}"
        raise DataError(path, "free_thresh, occupied_thresh", found, "probabilities, the lesser first")
    if not CELL_SIZES.low <= resolution <= CELL_SIZES.high:
        expected = f"metres a cell, from {CELL_SIZES.low:g} to {CELL_SIZES.high:g}"
        raise DataError(path, "resolution", keys["resolution"], expected)
    if yaw != 0.0:
        raise DataError(path, "origin", f"a map rotated by {yaw:g} rad", "a third value of 0")
    if (mode := keys.get("mode", "trinary")) != "trinary":
        raise DataError(path, "mode", mode, "trinary, as map_server writes it")
    pixels = _read_pixels(path.parent / str(keys["image"]))
    share = pixels[::-1] / 255.0 if negate else (255.0 - pixels[::-1]) / 255.0
    cells = (share > occupied).astype(np.int8) - (share < free).astype(np.int8)
    with naming_source(path):
        spec = GridSpec((x, y), resolution, pixels.shape)
    return spec, cells


def read_known_map(path: str | Path) -> OccupancyGrid:
    """Read a ROS map_server map as a grid to localize in: log-odds 1, -1 and 0 for occupied, free and unknown.

    Raises ``DataError`` for what ``read_map`` refuses, and for a map without walls or without free cells.
    """
    spec, cells = read_map(path)
    for value, what in ((1, "occupied"), (-1, "free")):
        if not (cells == value).any():
            raise DataError(path, "image", f"no {what} cell", "a map with walls and with free floor")
    return OccupancyGrid(spec, cells.astype(np.float32))


def _read_pixels(path: Path) -> np.ndarray:
    """Read the pixels ``(H, W)`` uint8 of a binary PGM or PPM image, or of a PNG image; of colours, the mean."""
    data = read_bytes(path, 3 * MAX_CELLS + 4096)
    pixels = decode_map_png(path, data, MAX_CELLS) if data.startswith(PNG_MAGIC) else _pnm_pixels(path, data)
    return pixels if pixels.ndim == 2 else (pixels.sum(axis=2, dtype=np.uint16) // 3).astype(np.uint8)


def _pnm_pixels(path: Path, data: bytes) -> np.ndarray:
    """Take the pixels ``(H, W)`` or ``(H, W, 3)`` uint8 out of the bytes of a binary PGM or PPM image."""
    header = PNM_HEADER.match(data[:4096])
    if header is None:
        expected = "a binary PGM or PPM image (P5, P6) with 255 values, or a PNG image"
        raise DataError(path, "header", repr(data[:20]), expected)
    (kind, width, height), at = map(int, header.groups()), header.end()
    channels = 3 if kind == 6 else 1
    if len(data) - at != width * height * channels or width * height == 0:
        raise DataError(
            path, "pixels", f"{len(data) - at} bytes", f"{width} x {height} of {channels}, at least one"
        )
    shape = (height, width, channels) if channels == 3 else (height, width)
    return np.frombuffer(data, dtype=np.uint8, offset=at).reshape(shape)


def write_texture(path: str | Path, spec: GridSpec, rgb: np.ndarray, seen: np.ndarray) -> None:
    """Write the floor texture: ``path`` is the ``.yaml`` file, the RGBA image goes beside it as ``.png``.

    ``rgb (H, W, 3)`` uint8 and ``seen (H, W)`` bool are in grid order; alpha is 0 where nothing was seen. The
    yaml file holds image, resolution and origin, as for a map.
    """
    path = _yaml_name(path)
    rgba = np.dstack([rgb, np.where(seen, 255, 0).astype(np.uint8)])
    write_png(path.with_suffix(".png"), rgba[::-1])
    write_text(path, _yaml(path.with_suffix(".png").name, spec, {}))


@dataclass(frozen=True, eq=False)
class Relations:
    """Known motions: ``poses (R, 3)`` at times ``t2 (R,)`` seen from the poses at ``t1 (R,)``; m, rad, s."""

    t1: np.ndarray
    t2: np.ndarray
    poses: np.ndarray

    def at_stamps(self, stamps: np.ndarray) -> Relations:
        """Keep those with both ends within a millisecond of one of ``stamps (K,)``, moved onto them."""
        t1, t2 = (stamps[nearest_stamp(stamps, t)] for t in (self.t1, self.t2))
        near = (np.abs(t1 - self.t1) <= 1e-3) & (np.abs(t2 - self.t2) <= 1e-3)
        return Relations(t1[near], t2[near], self.poses[near])


def read_relations(path: str | Path) -> Relations:
    """Read a relations file: lines of t1 t2 dx dy dz roll pitch yaw, of which the planar part is kept."""
    table = _rows(path, "relations", "t1 t2 dx dy dz roll pitch yaw")
    return Relations(table[:, 0], table[:, 1], table[:, [2, 3, 7]])
