"""Chapter 06: one pixel's journey as a laboratory in the page, and a dot of light from beside."""

from __future__ import annotations

from pfslam.sensors import RgbdModel
from pfslam.texture import disparity_from_depth
from pfslam_book.show.lab import Laboratory, show_lab

ALT = """A colour image from a corridor with letters on its floor. A circle marks a pixel on the nearest letter and a
cross its partner in the colour image; a green veil lies on what counts as floor. Below, all points of the image from
the side: the floor as a green line, the walls as grey dots above it, and the ray from the camera to the point of the
pixel."""


def journey_options(camera: RgbdModel) -> dict:
    """Give what the script needs: the constants of the camera."""
    names = {"width": "width", "height": "height", "pitch": "pitch"}
    names |= {"focalU": "focal_u", "focalV": "focal_v", "centreU": "centre_u", "centreV": "centre_v"}
    names |= {
        "disparitySlope": "disparity_slope",
        "disparityOffset": "disparity_offset",
        "depthScale": "depth_scale",
    }
    names |= {"rgbFocal": "rgb_focal", "rgbBaseline": "rgb_baseline", "rgbDivisor": "rgb_divisor"}
    names |= {"rgbOffsetU": "rgb_offset_u", "rgbOffsetV": "rgb_offset_v"}
    constants = {theirs: getattr(camera, ours) for theirs, ours in names.items()}
    return {"camera": {**constants, "position": list(camera.position_b)}}


def journey_lab(camera: RgbdModel) -> Laboratory:
    """Make the laboratory in which the reader follows any pixel and tilts the camera."""
    return show_lab("journey", "The journey of one pixel", ALT, **journey_options(camera))


def describe_dot(camera: RgbdModel, z: float) -> str:
    """What the picture of a dot of light on a wall at ``z`` metres shows; disparities count eighths of a pixel."""
    focal_times_baseline = abs(camera.depth_scale / camera.disparity_slope) / 8
    baseline = focal_times_baseline / camera.focal_u
    return (
        f"A wall at {z:g} m. From above: the projector sends one dot straight ahead, the camera {baseline:.3f} m "
        f"beside it sees it {focal_times_baseline / z:.1f} pixels away from where a dot at infinity would be. "
        f"Below, the raw disparity against depth, rising from 383 at 0.5 m towards 1089: here "
        f"{disparity_from_depth(z, camera):.0f}."
    )


def dot_options(camera: RgbdModel) -> dict:
    """Give what the script needs of the camera."""
    return {
        "slope": camera.disparity_slope,
        "offset": camera.disparity_offset,
        "scale": camera.depth_scale,
        "focal": camera.focal_u,
    }


def dot_picture(camera: RgbdModel) -> Laboratory:
    """Move a wall and watch one dot of the projected pattern shift in the image."""
    title, alt = "A dot of light, seen from beside", describe_dot(camera, 1.0)
    return show_lab("dot", title, alt, **dot_options(camera))
