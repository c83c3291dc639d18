"""Chapter 06: one pixel's journey as a laboratory in the page."""

from __future__ import annotations

import base64

import cv2
import numpy as np

from pfslam.grid import GridSpec
from pfslam_book.ch06.pairs import Shot
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
