"""Chapter 06: the static pictures."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from pfslam.grid import GridSpec
from pfslam.sensors import RgbdModel
from pfslam.texture import FloorTexture
from pfslam_book.ch06.pairs import (
    RUNGS,
    CellViews,
    Judge,
    Points,
    Shot,
    chosen_as_floor,
    pitch_sweep,
    points_of,
    registered_colours,
)
from pfslam_book.show.pictures import Picture
from pfslam_book.show.style import COLOURS, metric_axes, new_figure
from pfslam_book.show.texture_error import TextureError, depth_step, nearest_floor

REFINED = tuple(RUNGS)[-1]
WORD_WINDOW = (10.4, 20.4, -2.7, 0.9)  # m: the second word of the hall


def camera_picture(shot: Shot) -> Picture:
    """Draw the question: what the two cameras deliver."""
    figure, axes = new_figure(5.4, 6.8, rows=2)
    axes[0].imshow(shot.rgb)
    axes[0].set_title("Colour image, from 38 cm above the floor")
    depth = np.where(np.isfinite(shot.true_depth), shot.disparity, np.nan).astype(float)
    depth[shot.disparity == 2047] = np.nan
    shown = axes[1].imshow(depth, cmap="cividis_r")
    axes[1].set_title("Disparity image: small is near")
    figure.colorbar(shown, cax=axes[1].inset_axes([1.05, 0, 0.05, 1]), label="raw disparity")
    for ax in axes:
        ax.set_xticks([0, 320, 640])
        ax.set_yticks([0, 240, 480])
        ax.grid(False)
        ax.set_xlabel("u [px]")
        ax.set_ylabel("v [px]")
    low, high = np.nanmin(depth), np.nanquantile(depth, 0.99)
    alt = f"""Above, the colour image from a corridor: dark letters on a light floor run away from the robot
        between two walls. Below, the disparity image of the same moment, raw values from {low:.0f} at the bottom
        to about {high:.0f} at the far wall; single pixels without a reading are scattered over it."""
    return Picture(figure, alt)


def depth_error_picture(shots: list[Shot]) -> tuple[Picture, dict[float, float]]:
    """Draw what a step of disparity is worth against range, and the spread measured in the shots."""
    camera = shots[0].camera
    clouds = [points_of(shot, step=4) for shot in shots]
    true = np.concatenate([s.true_depth[p.v, p.u] for s, p in zip(shots, clouds, strict=True)])
    error = np.concatenate([p.depth for p in clouds]) - true
    centres = np.array([0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0])
    spread = np.array([np.nanstd(error[np.abs(true - z) < 0.05 * z]) for z in centres])
    z = np.linspace(0.5, 6.5, 100)
    figure, axes = new_figure(5.4, 3.8)
    axes.plot(
        z, 1000 * depth_step(z, camera), color=COLOURS["estimate"], label="one disparity step (formula)"
    )
    axes.plot(
        centres, 1000 * spread, "o", color=COLOURS["hits"], label="spread of the measured depth (1 sigma)"
    )
    axes.set_xlabel("depth [m]")
    axes.set_ylabel("error [mm]")
    axes.legend()
    measured = dict(zip(centres.tolist(), (1000 * spread).tolist(), strict=True))
    alt = f"""Depth error against depth. The worth of one disparity step rises as a parabola: 3 mm at 1 m, 27 mm
        at 3 m, 106 mm at 6 m. The measured spread follows it at about six tenths of a step:
        {measured[1.0]:.0f} mm at 1 m, {measured[3.0]:.0f} mm at 3 m, {measured[6.0]:.0f} mm at 6 m."""
    return Picture(figure, alt), measured


def _plan(axes: Axes, points: Points, colours: np.ndarray, chosen: np.ndarray) -> None:
    """Draw chosen pixels from above, in the robot's frame: x ahead is drawn upwards."""
    x, y = points.points_b[chosen, :2].T
    axes.scatter(-y, x, c=colours[chosen] / 255, s=4, linewidths=0, rasterized=True)
    axes.set_aspect("equal")
    axes.grid(False)
    axes.set_xlim(-1.3, 1.3)
    axes.set_ylim(-0.2, 4.6)
    axes.set_xticks([-1, 0, 1])
    axes.set_xlabel("to the right [m]")


def birds_eye_picture(shot: Shot) -> Picture:
    """Draw one image laid flat, and where the floor that it shows begins."""
    points = points_of(shot, step=2)
    chosen, colours = chosen_as_floor(points, 0.01), registered_colours(shot, points)
    ring, camera_x = nearest_floor(shot.camera), shot.camera.position_b[0]
    nearest = points.points_b[chosen & (points.depth < 0.8), 0].min() - camera_x
    figure, axes = new_figure(5.4, 5.0, columns=2, width_ratios=[1.5, 1])
    axes[0].imshow(shot.rgb)
    axes[0].set_title("One image")
    axes[0].axis("off")
    _plan(axes[1], points, colours, chosen)
    axes[1].plot([-1.3, 1.3], [camera_x + ring] * 2, color=COLOURS["highlight"])
    axes[1].plot([0], [0], "^", markersize=13, color=COLOURS["estimate"])
    axes[1].text(-1.2, camera_x + ring - 0.08, "nothing seen\nbelow this", va="top")
    axes[1].set_ylabel("ahead [m]")
    axes[1].set_title("laid on the floor")
    alt = f"""Left, the camera image of the corridor with letters. Right, its {np.count_nonzero(chosen)} floor
        pixels (every second row and column) seen from above: the letters stand upright and undistorted, from
        {nearest:.2f} m in front of the camera on. Below the line, {camera_x + ring:.2f} m ahead of the robot's centre
        (the triangle), nothing is seen."""
    return Picture(figure, alt)


def pitch_picture(shots: list[Shot]) -> tuple[Picture, dict[str, float]]:
    """Draw how much floor is found when the assumed pitch is wrong, for three tolerances."""
    errors = np.array([-3.0, -2.0, -1.5, -1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0])
    settings = {
        "1 cm (report)": (0.01, 0.0, ":"),
        "3 cm": (0.03, 0.0, "--"),
        "1.5 cm + 1 cm per metre": (0.015, 0.01, "-"),
    }
    figure, axes = new_figure(5.4, 4.4)
    shares = {}
    for name, (tolerance, per_metre, style) in settings.items():
        share = shares[name] = 100 * pitch_sweep(shots, errors, tolerance, per_metre)
        axes.plot(errors, np.median(share, axis=1), color=COLOURS["free"], linestyle=style, label=name)
        low, high = share.min(axis=1), share.max(axis=1)
        axes.fill_between(errors, low, high, color=COLOURS["free"], alpha=0.12, linewidth=0)
    axes.set_xlabel("error of the assumed pitch [degrees]")
    axes.set_ylabel("floor found [% of its pixels]")
    axes.set_ylim(0, 103)
    figure.legend(title="tolerance", loc="outside upper center", ncols=2)
    at = {error: i for i, error in enumerate(errors.tolist())}
    off = {name: float(np.median(share[at[1.0]])) for name, share in shares.items()}
    zero = {name: float(np.median(share[at[0.0]])) for name, share in shares.items()}
    names = tuple(settings)
    exact, (one, three, grows) = zero[names[0]], (off[name] for name in names)
    alt = f"""Share of the floor's pixels that are found against the error of the assumed pitch, medians over
        {len(shots)} images with their range. With the right pitch {exact:.0f} % at a tolerance of 1 cm. One degree
        off: {one:.0f} % at 1 cm, {three:.0f} % at 3 cm, {grows:.0f} % with a tolerance that grows with range."""
    return Picture(figure, alt), off


def _show(axes: Axes, spec: GridSpec, rgb: np.ndarray, seen: np.ndarray) -> None:
    image = np.dstack([rgb, np.where(seen, 255, 0).astype(np.uint8)])
    axes.imshow(image, origin="lower", extent=spec.extent, interpolation="antialiased")


def texture_pair_picture(
    name: str, maps: dict[str, tuple[FloorTexture, TextureError]], words: str
) -> Picture:
    """Draw the report's figure 9 for one drive: with its settings, and refined."""
    figure, axes = new_figure(5.4, 3.9, columns=2, sharey=True)
    for ax, rung in zip(axes, ("report", REFINED), strict=True):
        texture = maps[rung][0]
        _show(ax, texture.spec, texture.rgb, texture.seen)
        metric_axes(ax, "refined" if rung == REFINED else rung)
        ax.set_xticks([0, 10, 20])
    axes[1].set_ylabel("")
    report, refined = maps["report"][1], maps[REFINED][1]
    found, off = (100 * report.coverage, 100 * refined.coverage), (report, refined)
    shift = tuple(error.position_median_cells for error in off)
    alt = f"""Floor texture of {name} from above, on the left with the report's settings, on the right refined.
        {words} The report's map covers {found[0]:.0f} % of the visible floor, the refined one {found[1]:.0f} %;
        the pattern is off by {shift[0]:.1f} and {shift[1]:.1f} cells of 5 cm (median)."""
    return Picture(figure, alt)


def word_picture(judge: Judge, maps: dict[str, tuple[FloorTexture, TextureError]]) -> Picture:
    """Draw the same word on the true floor and in two maps."""
    (report, wrong), (refined, right) = maps["report"], maps[REFINED]
    every = np.ones(judge.floor.shape, dtype=bool)
    panels = {
        "the true floor": (judge.colours, every),
        "report's settings": (report.rgb, report.seen),
        "refined": (refined.rgb, refined.seen),
    }
    x0, x1, y0, y1 = WORD_WINDOW
    figure, axes = new_figure(5.4, 6.8, rows=3, sharex=True)
    for ax, (title, (rgb, seen)) in zip(axes, panels.items(), strict=True):
        _show(ax, judge.spec, rgb, seen)
        metric_axes(ax, title)
        ax.set_xlim(x0, x1)
        ax.set_ylim(y0, y1)
        ax.set_yticks([-2, 0])
        ax.set_xlabel("")
    axes[-1].set_xlabel("x [m]")
    alt = f"""Three pictures of the corridor floor with the words TEXTURE MAP. On the true floor they are sharp.
        With the report's settings the letters are ragged, and the colours are off by
        {wrong.colour_mean:.0f} levels of 255 on average over the whole map. Refined, they read with ease; the colours
        are off by {right.colour_mean:.0f} levels."""
    return Picture(figure, alt)


def swapped_picture(
    shot: Shot, wrong_camera: RgbdModel, fitted: RgbdModel
) -> tuple[Picture, dict[str, float]]:
    """Draw the same image laid flat with the right K, and with the swapped one after the floor has been fitted."""
    panels = {"right K": (shot.camera, 0.01), "swapped K, floor fitted": (fitted, 0.03)}
    figure, axes = new_figure(5.4, 5.6, columns=2, sharey=True)
    for ax, (title, (camera, tolerance)) in zip(axes, panels.items(), strict=True):
        points = points_of(shot, camera, step=2)
        _plan(ax, points, registered_colours(shot, points), chosen_as_floor(points, tolerance))
        ax.set_title(title)
    axes[0].set_ylabel("ahead [m]")
    right, wrong = points_of(shot), points_of(shot, wrong_camera)
    moved = points_of(shot, fitted)
    both = chosen_as_floor(right, 0.01) & (np.abs(right.depth - 2.0) < 0.2)
    found = np.count_nonzero(chosen_as_floor(wrong, 0.01)) / np.count_nonzero(chosen_as_floor(right, 0.01))
    sideways = float(np.median((moved.points_b - right.points_b)[both, 1]))
    numbers = {"found_percent": 100 * found, "sideways_m": sideways}
    side = "left" if sideways > 0 else "right"
    alt = f"""One image laid flat twice. With the right K the corridor runs straight ahead. With the swapped K and
        the floor's plane fitted the letters are as sharp, but the corridor is turned to the {side}: two metres ahead
        it lies {abs(sideways):.2f} m aside. Without the fit {100 * found:.0f} % of the floor's pixels would pass."""
    return Picture(figure, alt), numbers


def cell_views_picture(views: CellViews, true_colour: np.ndarray) -> Picture:
    """Draw every look at one cell of the floor: when, from how far, and what colour it had."""
    figure, axes = new_figure(5.4, 3.8)
    axes.scatter(
        views.t, views.depth, s=260, c=views.colours / 255, edgecolors=COLOURS["truth"], linewidths=1
    )
    nearest, last = int(np.argmin(views.depth)), len(views.t) - 1
    for k, words in ((nearest, "nearest view"), (last, "last view")):
        axes.text(views.t[k] + 4, views.depth[k] - 0.55, words, ha="right", va="center")
    axes.scatter([], [], s=200, color=true_colour / 255, edgecolors=COLOURS["truth"], label="true colour")
    axes.set(xlabel="time [s]", ylabel="depth [m]", xlim=(-8, 130), ylim=(0, 6))
    figure.legend(loc="outside upper center")
    off = np.abs(views.colours.astype(float) - true_colour).mean(axis=1)
    return Picture(
        figure,
        f"""One cell of the floor, seen in {len(views.t)} images from {views.depth.min():.1f} to
        {views.depth.max():.1f} m. The colours differ. That of the last view is off by {off[last]:.0f} levels of 255,
        that of the nearest view by {off[nearest]:.0f}.""",
    )
