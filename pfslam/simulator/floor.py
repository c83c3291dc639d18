"""The floor's appearance, painted as a picture of the plan at 1 cm a pixel.

There are parquet, tiles with inlaid words, a compass rose and mats. Patterns are functions of the plan coordinates x, y
(m) that return colours; words and the rose are drawn on top.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pfslam.grid import GridSpec
from pfslam.poses import transform_points
from pfslam.simulator.plan import FloorPlan

PIXEL = 0.01  # m
COARSE = 4  # a second, smaller picture serves the distant floor, which would flicker otherwise
WORDS = ("PARTICLE FILTER", "TEXTURE MAP", "PARTICLE FILTER", "TEXTURE MAP")
LETTER_HEIGHT, ROSE = 0.78, 0.86  # letters, and the radius of the compass rose (m)
STRIP = 4096  # rows at a time: OpenCV looks up no more than 32767
LIGHT, JOINT = np.array([222, 213, 196]), np.array([172, 162, 146])
BANDS = np.array([[44, 92, 140], [196, 110, 42], [52, 124, 92], [142, 62, 92]])
INK = np.array([52, 48, 58])


@dataclass(frozen=True, eq=False)
class Floor:
    """A painted floor.

    ``fine (H, W, 3)`` is a picture of the plan, uint8 RGB, row 0 at y_min, and ``coarse`` the same at a quarter of the
    size. ``origin (2,)`` is the outer corner of pixel [0, 0] in the plan frame (m).
    """

    fine: np.ndarray
    coarse: np.ndarray
    origin: np.ndarray

    def colours(self, x: np.ndarray, y: np.ndarray, distant: bool = False) -> np.ndarray:
        """Interpolate colours ``(H, W, 3)`` uint8 at plan coordinates ``(H, W)`` float32 (m)."""
        picture, size = (self.coarse, COARSE * PIXEL) if distant else (self.fine, PIXEL)
        u = (x - np.float32(self.origin[0])) * np.float32(1.0 / size) - np.float32(0.5)
        v = (y - np.float32(self.origin[1])) * np.float32(1.0 / size) - np.float32(0.5)
        return cv2.remap(picture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    def image(self, spec: GridSpec, pose_pw: np.ndarray) -> np.ndarray:
        """Average the colour over every cell of a grid in the world, ``(H, W, 3)`` uint8.

        ``pose_pw (3,)`` is the pose of the world frame in the plan.
        """
        fold = max(int(np.ceil(spec.resolution / PIXEL)), 1)
        h, w = spec.shape
        step = spec.resolution / fold
        y, x = np.meshgrid(*((np.arange(n * fold) + 0.5) * step for n in (h, w)), indexing="ij")
        points = transform_points(pose_pw, np.column_stack([x.ravel(), y.ravel()]) + spec.origin)
        px, py = (points[:, axis].reshape(h * fold, w * fold).astype(np.float32) for axis in (0, 1))
        strips = range(0, h * fold, STRIP)
        colours = np.vstack([self.colours(px[i : i + STRIP], py[i : i + STRIP]) for i in strips])
        return colours.reshape(h, fold, w, fold, 3).mean(axis=(1, 3)).round().astype(np.uint8)


def paint_floor(plan: FloorPlan, rng: np.random.Generator) -> Floor:
    """Paint the floor of a plan."""
    low, high = plan.areas[:, :2].min(axis=0) - 0.2, plan.areas[:, 2:].max(axis=0) + 0.2
    width, height = np.ceil((high - low) / PIXEL / COARSE).astype(int) * COARSE
    picture = np.empty((height, width, 3), dtype=np.float32)
    picture[:] = JOINT
    corridor = 0
    for area, kind in zip(plan.areas, plan.kinds, strict=True):
        patch, x, y = _window(picture, low, area)
        if kind == "corridor":
            patch[:] = _corridor(x, y, area, BANDS[corridor % 4])
            _inlay(picture, low, area, WORDS[corridor % 4], BANDS[corridor % 4])
            corridor += 1
        else:
            patch[:] = {"room": _parquet, "lobby": _diamonds, "hall": _fans}.get(kind, _mat)(x, y)
    if "lobby" in plan.kinds:
        patch, x, y = _window(picture, low, ROSE * np.array([-1.0, -1.0, 1.0, 1.0]))
        colours, inside = _rose(x, y, ROSE)
        patch[inside] = colours[inside]
    cv2.GaussianBlur(picture, (0, 0), 0.7, dst=picture)  # no jagged edges
    picture *= _terrazzo(picture.shape, rng)
    fine = np.clip(picture, 0, 255).astype(np.uint8)
    coarse = cv2.resize(fine, (width // COARSE, height // COARSE), interpolation=cv2.INTER_AREA)
    return Floor(fine, coarse, low)


def _window(picture: np.ndarray, origin, area) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cut a rectangle ``(4,)`` of the plan out of a picture with corner ``origin``; also its pixels' x and y (m)."""
    c0, r0, c1, r1 = np.round((area - np.tile(origin, 2)) / PIXEL).astype(int)
    x, y = (origin[k] + (np.arange(*ends) + 0.5) * PIXEL for k, ends in enumerate(((c0, c1), (r0, r1))))
    return picture[r0:r1, c0:c1], x[None, :], y[:, None]


def _inlay(picture: np.ndarray, origin: np.ndarray, area: np.ndarray, text: str, colour: np.ndarray) -> None:
    """Inlay a word along the middle of a corridor, so that it reads along the corridor's direction."""
    size, mask = area[2:] - area[:2], _lettering(text)
    upright = size[1] > size[0]
    if upright:
        mask = np.rot90(mask)  # reads from the bottom to the top
    mask = np.flipud(mask)  # row 0 of the picture is y_min
    middle = area[:2] + size * (0.5, 0.58) if upright else area[:2] + size * (0.56, 0.5)
    c0, r0 = np.round((middle - origin) / PIXEL).astype(int) - np.array(mask.shape[::-1]) // 2
    if min(size) < LETTER_HEIGHT or mask.shape[0] * PIXEL > size[1] or mask.shape[1] * PIXEL > size[0]:
        return
    patch = picture[r0 : r0 + mask.shape[0], c0 : c0 + mask.shape[1]]
    patch += mask[..., None] * (0.35 * colour + 0.65 * INK - patch)


def _lettering(text: str) -> np.ndarray:
    """A word as a mask (0 to 1) of float32, row 0 at its top."""
    scale, thick = LETTER_HEIGHT / PIXEL / 22.0, int(0.12 / PIXEL)
    (width, height), base = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, scale, thick)
    mask = np.zeros((height + base + 2 * thick, width + 2 * thick), dtype=np.uint8)
    place = (thick, height + thick)
    cv2.putText(mask, text, place, cv2.FONT_HERSHEY_DUPLEX, scale, 255, thick, cv2.LINE_AA)
    filled = np.flatnonzero(mask.any(axis=1))
    return mask[filled[0] : filled[-1] + 1].astype(np.float32) / 255.0


def _choose(condition, this, other) -> np.ndarray:
    return np.where(np.asarray(condition)[..., None], this, other)


def _shade(x, y, amount: float) -> np.ndarray:
    """Give each pair of whole numbers (x, y) a fixed factor near 1, so that no two tiles are quite alike."""
    mixed = (np.asarray(x, dtype=np.int64) * 73856093) ^ (np.asarray(y, dtype=np.int64) * 19349663)
    return 1.0 + amount * (((mixed >> 3) % 256) / 128.0 - 1.0)


def _corridor(x, y, area, band) -> np.ndarray:
    """Half-metre tiles, a coloured band along both walls, and chevrons across at both ends."""
    side = 0.48
    tile = _shade(np.floor(x / side), np.floor(y / side), 0.035)[..., None] * LIGHT
    joint = (x % side < 0.018) | (y % side < 0.018)
    colour = _choose(joint, JOINT, tile)
    along_x = area[2] - area[0] > area[3] - area[1]
    across = np.minimum(y - area[1], area[3] - y) if along_x else np.minimum(x - area[0], area[2] - x)
    across = across + 0.0 * (x + y)
    middle = np.abs(y - 0.5 * (area[1] + area[3])) if along_x else np.abs(x - 0.5 * (area[0] + area[2]))
    to_end = (area[2] - x if along_x else area[3] - y) + middle
    chevron = (to_end > 0.4) & (to_end < 2.2) & (to_end % 0.6 < 0.28)
    colour = _choose(chevron, band * 0.9 + 20.0, colour)
    colour = _choose((across > 0.10) & (across < 0.24), band, colour)
    return _choose((across > 0.27) & (across < 0.30), INK, colour)


def _parquet(x, y) -> np.ndarray:
    """Oak planks, 14 cm wide and 1.1 m long, each row shifted."""
    row = np.floor(y / 0.14)
    shifted = x + 0.37 * (row % 3) + 0.11 * (row % 5)
    plank = np.floor(shifted / 1.1)
    grain = 1.0 + 0.035 * np.sin(90.0 * (y + 0.02 * np.sin(3.0 * shifted + plank)))
    colour = (_shade(plank, row, 0.13) * grain)[..., None] * np.array([176, 126, 78])
    return _choose((y % 0.14 < 0.01) | (shifted % 1.1 < 0.012), np.array([104, 70, 42]), colour)


def _diamonds(x, y) -> np.ndarray:
    """A chequered floor set at 45 degrees."""
    a, b = np.floor((x + y) / 0.6), np.floor((x - y) / 0.6)
    colour = _choose((a + b) % 2 == 0, np.array([232, 226, 210]), np.array([58, 118, 122]))
    return _shade(a, b, 0.04)[..., None] * colour


def _fans(x, y) -> np.ndarray:
    """Fish scales: staggered rows of discs with two-coloured rings, each row half covered by the one below."""
    radius = 0.45
    row = np.floor(y / (0.5 * radius))
    best = np.full(np.broadcast_shapes(x.shape, y.shape), radius)
    for step in (2, 1, 0, -1, -2):
        line = row + step
        u = (x / (2.0 * radius) + 0.5 * (line % 2)) % 1.0 - 0.5
        r = np.hypot(u * 2.0 * radius, y - line * 0.5 * radius)
        best = np.where(r < radius, r, best)
    ring = np.floor(best / 0.09) % 2 == 0
    return _choose(ring, np.array([222, 196, 142]), np.array([138, 78, 68]))


def _mat(x, y) -> np.ndarray:
    """A dark coir mat with a weave."""
    weave = 1.0 + 0.12 * np.sin(x * 160.0) * np.sin(y * 160.0)
    return weave[..., None] * np.array([92, 70, 56])


def _rose(x, y, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """A sixteen-sided star on a disc: colours, and where they hold."""
    r, angle = np.hypot(x, y), np.arctan2(y, x)
    colour = _choose(r > 0.93 * radius, BANDS[0], np.array([236, 229, 212]) + 0.0 * r[..., None])
    for turn, long, dark in ((np.pi / 4, 0.62, BANDS[1]), (0.0, 0.9, BANDS[0])):
        around = (angle - turn + np.pi / 4) % (np.pi / 2) - np.pi / 4
        narrow = 0.22 * long * radius  # half width of a ray where it leaves the centre
        u, v = r * np.cos(around), np.abs(r * np.sin(around))
        ray = (v < narrow * (1.0 - u / (long * radius))) & (u > 0.0) & (v < u)
        colour = _choose(ray, _choose(around > 0.0, dark, np.array([244, 238, 224])), colour)
        colour = _choose(ray & (v > narrow * (1.0 - u / (long * radius)) - 0.012), INK, colour)
    return colour, r < radius


def _terrazzo(shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    """Speckle of stone chips and slow stains, a factor near 1 per pixel, ``(H, W, 1)`` float32."""
    h, w = shape[:2]
    chips = cv2.GaussianBlur(rng.standard_normal((h, w), dtype=np.float32), (0, 0), 1.0)
    coarse = rng.standard_normal((h // 60 + 2, w // 60 + 2), dtype=np.float32)
    stains = cv2.resize(coarse, (w, h), interpolation=cv2.INTER_CUBIC)
    return (1.0 + 0.09 * chips + 0.025 * stains)[..., None]
