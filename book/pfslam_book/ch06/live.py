"""Chapter 06: one pixel's journey as a laboratory in the page, and a dot of light from beside."""

from __future__ import annotations

import base64

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pfslam.grid import GridSpec
from pfslam.sensors import RgbdModel
from pfslam.texture import disparity_from_depth
from pfslam_book.ch06.drives import Shot
from pfslam_book.show.lab import Laboratory, show_lab
from pfslam_book.show.pictures import steady
from pfslam_book.show.style import COLOURS, INK, new_figure
from pfslam_book.show.widgets import Explorer, Slider

ALT = """A colour image from a corridor with letters on its floor. A circle marks a pixel on the nearest letter and a
cross its partner in the colour image; a green veil lies on what counts as floor. Below, all points of the image from
the side: the floor as a green line, the walls as grey dots above it, and the ray from the camera to the point of the
pixel."""
COLOUR_QUALITY = 85


def webp(image: np.ndarray, quality: int) -> str:
    """Write an image ``(H, W, 3)`` as an address that holds it; a quality of 101 loses nothing."""
    _, packed = cv2.imencode(".webp", image, [cv2.IMWRITE_WEBP_QUALITY, quality])
    return "data:image/webp;base64," + base64.b64encode(packed.tobytes()).decode("ascii")


def journey_options(shot: Shot, spec: GridSpec) -> dict:
    """Give what the script needs: both images, the camera, the pose and the cells of the map."""
    c, d = shot.camera, shot.disparity
    two_bytes = np.stack([np.zeros_like(d), d & 255, d >> 8], axis=-1).astype(
        np.uint8
    )  # OpenCV writes blue first
    camera = {
        "width": c.width,
        "height": c.height,
        "focalU": c.focal_u,
        "focalV": c.focal_v,
        "centreU": c.centre_u,
        "centreV": c.centre_v,
        "disparitySlope": c.disparity_slope,
        "disparityOffset": c.disparity_offset,
        "depthScale": c.depth_scale,
        "rgbFocal": c.rgb_focal,
        "rgbBaseline": c.rgb_baseline,
        "rgbOffsetU": c.rgb_offset_u,
        "rgbOffsetV": c.rgb_offset_v,
        "rgbDivisor": c.rgb_divisor,
        "position": list(c.position_b),
        "pitch": c.pitch,
    }
    return {
        "camera": camera,
        "pose": shot.pose.tolist(),
        "spec": {"origin": list(spec.origin), "resolution": spec.resolution, "shape": list(spec.shape)},
        "disparity": webp(two_bytes, 101),
        "rgb": webp(np.ascontiguousarray(shot.rgb[..., ::-1]), COLOUR_QUALITY),
    }


def journey_lab(shot: Shot, spec: GridSpec) -> Laboratory:
    """Make the laboratory in which the reader follows any pixel and tilts the camera."""
    return show_lab("journey", "The journey of one pixel", ALT, **journey_options(shot, spec))


def structured_light_explorer(camera: RgbdModel) -> Explorer:
    """Move a wall and watch one dot of the projected pattern shift in the image."""
    focal_times_baseline = (
        abs(camera.depth_scale / camera.disparity_slope) / 8
    )  # reported in eighths of a pixel
    baseline = focal_times_baseline / camera.focal_u

    def shift(z: float) -> float:
        return focal_times_baseline / z

    def draw(z: float) -> Figure:
        figure, (above, below) = new_figure(5.4, 4.8, rows=2)
        _draw_triangle(above, z, baseline)
        depths = np.linspace(0.45, 8.2, 200)
        below.plot(depths, disparity_from_depth(depths, camera), color=COLOURS["estimate"])
        below.plot(z, disparity_from_depth(z, camera), "o", markersize=11, color=COLOURS["hits"])
        below.axhline(1089, color=COLOURS["truth"], linestyle=":", linewidth=1.2)
        below.text(8.3, 1100, "1089: infinitely far", ha="right", va="bottom")
        below.set(xlabel="depth $Z$ [m]", ylabel="raw disparity $d$", xlim=(-2.1, 8.4), ylim=(300, 1210))
        above.set_title(
            f"shift {shift(z):.1f} px, raw disparity {float(disparity_from_depth(z, camera)):.0f}"
        )
        return figure

    def alt(z: float) -> str:
        return (
            f"A wall at {z:g} m. From above: the projector sends one dot straight ahead, the camera {baseline:.3f} m "
            f"beside it sees it {shift(z):.1f} pixels away from where a dot at infinity would be. Below, the raw "
            f"disparity against depth, rising from 383 at 0.5 m towards 1089: here "
            f"{disparity_from_depth(z, camera):.0f}."
        )

    slider = Slider("z", [0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0], 2, "Wall at", "m", live=(0.5, 8.0, 0.1))
    return Explorer(
        steady(draw), [slider], alt=alt, title="A dot of light, seen from beside", play="z", pause=900
    )


def _draw_triangle(axes: Axes, z: float, baseline: float) -> None:
    """Projector, camera, wall and the dot, from above; sideways distances are stretched."""
    axes.plot([z, z], [-0.03, 0.11], color=COLOURS["truth"], linewidth=4)
    axes.plot([0, z], [baseline, baseline], color=COLOURS["hits"])
    axes.plot([0, z], [0, baseline], color=COLOURS["estimate"])
    axes.plot([0, 8.4], [0, 0], color=COLOURS["estimate"], linestyle=":", linewidth=1.4)
    axes.plot(0, baseline, "s", markersize=10, color=COLOURS["hits"])
    axes.plot(0, 0, "s", markersize=10, color=COLOURS["estimate"])
    axes.plot(z, baseline, "o", markersize=9, color=COLOURS["hits"], markeredgecolor=INK)
    axes.text(-0.2, baseline, "projector", color=COLOURS["hits"], ha="right", va="center")
    axes.text(-0.2, 0, "camera", color=COLOURS["estimate"], ha="right", va="center")
    axes.text(8.3, -0.006, "to a dot at infinity", ha="right", va="top", color=COLOURS["estimate"])
    axes.set(xlim=(-2.1, 8.4), ylim=(-0.035, 0.115), xlabel="ahead [m]", ylabel="sideways [m]")
    axes.set_xticks(range(0, 9, 2))
