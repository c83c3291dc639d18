"""Chapter 06: one pixel's journey as a laboratory in the page, and a dot of light from beside."""

from __future__ import annotations

import base64

import cv2
import numpy as np

from pfslam.grid import GridSpec
from pfslam.sensors import RgbdModel
from pfslam.texture import disparity_from_depth
from pfslam_book.ch06.drives import Shot
from pfslam_book.show.lab import Laboratory, show_lab

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
