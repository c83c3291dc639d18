"""How good is a floor texture: how much floor it shows, how far it is shifted, how wrong its colours are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pfslam.errors import DataError
from pfslam.evaluation.trajectory import share_of
from pfslam.grid import GridSpec
from pfslam.poses import apply_transform, invert_transform, pose_to_transform
from pfslam.sensors import RgbdModel
from pfslam.texture import FloorTexture, associate_rgb, disparity_from_depth


@dataclass(frozen=True)
class TextureError:
    """A texture against the true floor; positions in cells, colours in levels of 0 to 255."""

    coverage: float
    """Share of the floor the camera could have seen that has a colour."""
    beyond_floor: float
    """Share of the coloured cells that are not floor."""
    position_median_cells: float
    position_p95_cells: float
    patches: int
    """Patches whose pattern could be registered; the two positions are over these, NaN if there are none."""
    colour_median: float
    colour_mean: float
    """Absolute difference over the coloured cells of the floor and the three channels."""


def texture_error(
    texture: FloorTexture, true_rgb: np.ndarray, floor: np.ndarray, visible: np.ndarray | None = None
) -> TextureError:
    """Compare a texture with the true colours ``(H, W, 3)`` on the same cells.

    ``floor (H, W)`` marks the cells that are floor; ``visible (H, W)`` those the camera could have seen, all
    of them if None.
    """
    shape = texture.spec.shape
    if true_rgb.shape != (*shape, 3) or floor.shape != shape:
        found = f"shapes {true_rgb.shape}, {floor.shape}"
        raise DataError("texture_error", "true_rgb, floor", found, f"{(*shape, 3)} and {shape}")
    could = floor if visible is None else floor & visible
    right = texture.seen & floor
    shift = np.hypot(*pattern_shifts(texture.rgb, right, true_rgb, floor).T)
    colour = np.abs(texture.rgb[right].astype(float) - true_rgb[right])
    return TextureError(
        coverage=share_of(texture.seen & could, could),
        beyond_floor=share_of(texture.seen & ~floor, texture.seen),
        position_median_cells=float(np.median(shift)) if len(shift) else np.nan,
        position_p95_cells=float(np.quantile(shift, 0.95)) if len(shift) else np.nan,
        patches=len(shift),
        colour_median=float(np.median(colour)) if colour.size else np.nan,
        colour_mean=float(np.mean(colour)) if colour.size else np.nan,
    )


def pattern_shifts(
    rgb, seen, true_rgb, known, patch: int = 20, search: int = 6, contrast: float = 10.0
) -> np.ndarray:
    """Measure how far the pattern of each patch is displaced: ``(M, 2)`` cells, (x, y), below a cell's size.

    Patches of ``patch`` cells a side, at least half seen, are moved by up to ``search`` cells over the true
    colours; the smallest mean squared difference counts, refined by a parabola in each axis. Only patches
    whose true pattern differs from itself by more than ``contrast`` levels (RMS) under every other shift can
    tell.
    """
    cost = _shift_costs(rgb, seen, true_rgb, known, patch, search)
    itself = _shift_costs(true_rgb, seen & known, true_rgb, known, patch, search)
    itself[search, search] = np.inf
    distinct = itself.min(axis=(0, 1)) > contrast**2
    usable = np.argwhere(distinct & np.isfinite(cost).any(axis=(0, 1)))
    return np.array([_best_shift(cost[:, :, row, column]) for row, column in usable]).reshape(-1, 2)


def _shift_costs(rgb, seen, true_rgb, known, patch: int, search: int) -> np.ndarray:
    """Compute mean squared colour differences ``(S, S, rows, columns)`` by shift in y, x and patch; inf: unseen."""
    width, enough = 2 * search + 1, patch * patch / 2
    rows, columns = (n // patch for n in seen.shape)
    costs = np.full((width, width, rows, columns), np.inf)
    every = _patches(seen, patch, 0)
    row, column = np.nonzero(every.sum(axis=(2, 3)) >= enough)  # no shift sees more of a patch than there is
    image = _patches(np.asarray(rgb, dtype=np.float32), patch, 0)[row, column]
    truth = _patches(np.asarray(true_rgb, dtype=np.float32), patch, search)[row, column]
    seen, known = every[row, column], _patches(known, patch, search)[row, column]
    for dy in range(width):
        for dx in range(width):
            # A texture displaced by d shows at p what lies at p - d.
            top, left = width - 1 - dy, width - 1 - dx
            window = slice(None), slice(top, top + patch), slice(left, left + patch)
            both = seen & known[window]
            apart = (image - truth[window]) * both[..., None]
            count = both.sum(axis=(1, 2))
            total = np.einsum("mijc,mijc->m", apart, apart) / 3
            costs[dy, dx, row, column] = np.where(count >= enough, total / np.maximum(count, 1), np.inf)
    return costs


def _patches(picture: np.ndarray, patch: int, border: int) -> np.ndarray:
    """View all whole patches, ``(rows, columns, P, P, ...)``, with ``border`` cells around each, 0 outside."""
    rows, columns = (n // patch for n in picture.shape[:2])
    around = [(border, border)] * 2 + [(0, 0)] * (picture.ndim - 2)
    size = patch + 2 * border
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(picture, around), (size, size), axis=(0, 1))
    chosen = windows[: rows * patch : patch, : columns * patch : patch]
    return chosen if picture.ndim == 2 else np.moveaxis(chosen, 2, -1)


def parabola_peak(before, here, after) -> np.ndarray:
    """Locate the peak of a parabola through three values, in steps from the middle one; 0 where it has none.

    >>> float(parabola_peak(1.0, 4.0, 3.0))
    0.25
    """
    with np.errstate(invalid="ignore"):  # values may be infinite
        curvature, slope = before - 2.0 * here + after, 0.5 * (before - after)
    peaked = np.isfinite(curvature) & (curvature < 0)
    return np.where(peaked, slope, 0.0) / np.where(peaked, curvature, 1.0)


def _best_shift(cost: np.ndarray) -> tuple[float, float]:
    """Find (x, y) of the smallest of the costs ``(S, S)``, in cells from the middle; whole cells on the rim."""
    search = cost.shape[0] // 2
    y, x = np.unravel_index(int(np.argmin(cost)), cost.shape)
    if not (0 < y < 2 * search and 0 < x < 2 * search):
        return float(x - search), float(y - search)
    peaks = parabola_peak(*-cost[y, x - 1 : x + 2]), parabola_peak(*-cost[y - 1 : y + 2, x])
    return float(x - search + peaks[0]), float(y - search + peaks[1])


def visible_floor(
    spec: GridSpec, poses, camera: RgbdModel, blocked: np.ndarray, max_depth: float, min_depth: float = 0.3
) -> np.ndarray:
    """Mark the cells ``(H, W)`` whose centre, at z = 0, both cameras see from some pose of ``poses (K, 3)``.

    The depth lies within the limits (m) and the line of sight, seen from above, meets no cell of
    ``blocked (H, W)``.
    """
    visible = np.zeros(spec.shape, dtype=bool)
    corner = np.hypot(camera.width, camera.height) / 2 / min(camera.focal_u, camera.focal_v)
    reach = max_depth * float(np.hypot(1.0, corner)) + np.hypot(*camera.position_b[:2])
    for pose in np.atleast_2d(np.asarray(poses, dtype=float)):
        low = np.maximum(spec.world_to_cell(pose[:2] - reach), 0)
        high = np.minimum(spec.world_to_cell(pose[:2] + reach) + 1, spec.shape[::-1])
        if (high <= low).any():
            continue
        window = np.argwhere(~(visible | blocked)[low[1] : high[1], low[0] : high[0]])[:, ::-1] + low
        cells = window[_in_both_images(spec.cell_to_world(window), pose, camera, min_depth, max_depth)]
        eye = apply_transform(pose_to_transform(pose) @ camera.T_bc, np.zeros(3))[:2]
        cells = cells[_clear_line(spec, eye, spec.cell_to_world(cells), blocked)]
        visible[cells[:, 1], cells[:, 0]] = True
    return visible


def _in_both_images(points_w, pose, camera, min_depth: float, max_depth: float) -> np.ndarray:
    """Tell which floor points ``(M, 2)`` of the world project into the depth image and into the colour image."""
    T_ow = invert_transform(pose_to_transform(pose) @ camera.T_bo)
    x, y, z = apply_transform(T_ow, np.column_stack([points_w, np.zeros(len(points_w))])).T
    near = (z >= min_depth) & (z <= max_depth)
    u, v, _ = camera.K @ np.stack([x, y, z]) / np.where(near, z, 1.0)
    u_rgb, v_rgb = associate_rgb(u, v, disparity_from_depth(np.where(near, z, 1.0), camera), camera)
    for column, row in ((u, v), (u_rgb, v_rgb)):
        near &= (column >= 0) & (column <= camera.width - 1) & (row >= 0) & (row <= camera.height - 1)
    return near


def _clear_line(spec: GridSpec, eye, points_w, blocked: np.ndarray) -> np.ndarray:
    """Tell which points ``(M, 2)`` can be reached in a straight line from ``eye (2,)`` without a blocked cell."""
    if len(points_w) == 0:
        return np.zeros(0, dtype=bool)
    steps = int(np.ceil(np.hypot(*(points_w - eye).T).max() / (0.5 * spec.resolution))) + 1
    along = np.linspace(0.0, 1.0, steps)[:, None, None]
    cells = spec.world_to_cell(eye + along * (points_w - eye))
    inside = spec.contains(cells)
    hit = np.zeros(inside.shape, dtype=bool)
    hit[inside] = blocked[cells[inside][:, 1], cells[inside][:, 0]]
    return np.logical_not(hit.any(axis=0))
