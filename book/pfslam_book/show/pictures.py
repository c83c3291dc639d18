"""Pictures with a description: a figure, its alt text, and how each reader gets both."""

import base64
import html
import io
import json
import os
from collections.abc import Mapping

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from .edges import drawn
from .night import draw_at_night

MODES = ("live", "static", "text")
CSS_DPI = 100  # CSS pixels per inch of figure
FOR_PHONES = 0.72  # a sheet so much smaller: on half the width of a figure, words are still read
RASTER = 2  # raster pixels per CSS pixel, for sharp print and dense screens
WEBP_QUALITY = 80
# The site makes a file of each address with this mark (`book_site.py`), which is fetched when it comes near.
APART = "data:image/webp;apart=1;base64,"
FRAME_QUALITY = 60  # of the pictures under a page's sliders, of which there are many
# Each row less the row above it: half the bytes of the default, and a search for the best filter takes twice as long.
# These are cv2.IMWRITE_PNG_FILTER and ..._UP; OpenCV before 4.12 has no such names, and passes the numbers over.
PNG_ROW_ABOVE = [19, 32]


def output_mode(environment: Mapping[str, str] = os.environ) -> str:
    """How outputs are shown: `live` with a kernel, `static` in the built book, `text` in committed notebooks.

    Read from the variable `PFSLAM_WIDGETS`; the book and the test run set it.
    """
    mode = environment.get("PFSLAM_WIDGETS", "live")
    if mode not in MODES:
        raise ValueError(f"PFSLAM_WIDGETS: found {mode!r}, expected one of {', '.join(MODES)}")
    return mode


def to_rgb(drawing: Figure | np.ndarray, room: float = 1.0, strict: bool = False) -> np.ndarray:
    """Rasterise a figure to (H, W, 3) uint8; an array of that kind is returned as it is.

    With ``room`` below 1 the figure gets a sheet that is by this factor smaller, and as many pixels: its words are
    larger. ``strict`` makes an error of words that do not fit.
    """
    if isinstance(drawing, Figure):
        drawing.set_size_inches(*(room * drawing.get_size_inches()))
        drawing.set_dpi(CSS_DPI * RASTER / room)
        image, wrong = drawn(drawing)
        if wrong:  # the first layout is for the ticks that were there before it
            image, wrong = drawn(drawing)
        if wrong and strict:
            raise ValueError("in this figure " + "; ".join(wrong))
        return cv2.cvtColor(image, cv2.COLOR_RGBA2RGB)
    image = np.asarray(drawing)
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise TypeError(f"expected a Figure or an (H, W, 3) uint8 array, found {image.dtype} {image.shape}")
    return image


def encode(image: np.ndarray, quality: int = WEBP_QUALITY) -> bytes:
    """Encode an (H, W, 3) uint8 RGB image as WebP."""
    return _encoded(image, ".webp", [cv2.IMWRITE_WEBP_QUALITY, quality])


def _encoded(image: np.ndarray, kind: str, options: list[int]) -> bytes:
    done, data = cv2.imencode(kind, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)
    if not done:
        raise RuntimeError(f"could not encode an image as {kind[1:]}")
    return data.tobytes()


def data_uri(image: np.ndarray, quality: int = WEBP_QUALITY, head: str = "data:image/webp;base64,") -> str:
    """An image as a `data:` address, so that a notebook needs no second file."""
    return head + base64.b64encode(encode(image, quality)).decode("ascii")


def night_uri(drawing: Figure | np.ndarray, quality: int = WEBP_QUALITY) -> str:
    """The address of the picture for the dark theme of a figure that `to_rgb` has drawn; "" for a photograph."""
    if not isinstance(drawing, Figure):
        return ""
    data = io.BytesIO()  # Pillow can be told to hurry: half of OpenCV's time for a twelfth more bytes
    Image.fromarray(draw_at_night(drawing)).save(data, "WEBP", quality=quality, method=2)
    return APART + base64.b64encode(data.getvalue()).decode("ascii")


def quick_uri(image: np.ndarray) -> str:
    """The same as PNG: larger and without loss, in a seventh of the time, for pictures that nobody keeps."""
    return "data:image/png;base64," + base64.b64encode(_encoded(image, ".png", PNG_ROW_ABOVE)).decode("ascii")


def image_tag(uri: str, alt: str, shape: tuple[int, ...], night: str = "", more: str = "") -> str:
    """An `<img>` of the right size on the page, which gives way on a narrow screen; `night.js` knows the other one."""
    height, width = shape[0] // RASTER, shape[1] // RASTER
    style = "max-width:100%;height:auto"
    late = ' loading="lazy"' if uri.startswith(APART) else ""
    return (
        f'<img class="pfslam-picture"{late} src="{uri}" alt="{html.escape(alt)}" '
        f'width="{width}" height="{height}" style="{style}"{_at_night(night)}{more}>'
    )


def _at_night(address: str) -> str:
    return f' data-night="{address}"' if address else ""


def _to_sketch_on(axes: Axes | None) -> str:
    """What `sketch.js` must know of axes that have been drawn: their box in shares of the picture, and their scales."""
    if axes is None:
        return ""
    box = axes.get_position()
    told: dict = {"box": [box.x0, 1 - box.y1, box.width, box.height]}
    for name, axis in (("across", axes.xaxis), ("up", axes.yaxis)):
        low, high = axis.get_view_interval()
        ticks = axis.get_ticklocs().tolist()
        told[name] = {"name": axis.get_label_text(), "from": low, "to": high, "ticks": ticks}
    return f' data-sketch="{html.escape(json.dumps(told))}"'


def _for_phones(figure: Figure, axes: Axes | None) -> str:
    """The `<source>` of the same figure with larger words; in committed notebooks it is drawn to be looked through."""
    image = to_rgb(figure, FOR_PHONES, strict=True)
    if output_mode() == "text":
        return ""
    uri = data_uri(image, FRAME_QUALITY, APART)
    more = _at_night(night_uri(figure, FRAME_QUALITY)) + _to_sketch_on(axes)
    return f'<source media="(max-width: 600px)" srcset="{uri}"{more}>'


class Picture:
    """A figure with its alt text. Make it the last expression of a cell.

    Where the book is made and tested, words that do not fit are an error; who draws in a kernel sees them as they are.

    The alt text says what the figure shows, numbers included, in one to three sentences. In committed
    notebooks it stands for the figure, so that the test run compares it word by word.

    ``sketch`` are the axes on which a reader of the site draws a prediction first. Their scales are linear.
    """

    def __init__(self, drawing: Figure | np.ndarray, alt: str, sketch: Axes | None = None):
        if not alt.strip():
            raise ValueError("a picture needs an alt text that says what it shows")
        strict = output_mode() != "live"
        self.image, self.alt = to_rgb(drawing, strict=strict), " ".join(alt.split())
        self.night = self.phone = self.sketch = ""
        if output_mode() == "static":
            self.night, self.sketch = night_uri(drawing), _to_sketch_on(sketch)
        if isinstance(drawing, Figure) and strict:
            self.phone = _for_phones(drawing, sketch)

    def __repr__(self) -> str:
        return f"[picture: {self.alt}]"

    def _repr_mimebundle_(self, include=None, exclude=None) -> dict[str, str]:
        bundle = {"text/plain": repr(self)}
        if output_mode() == "live":
            bundle["text/html"] = image_tag(data_uri(self.image), self.alt, self.image.shape)
        if output_mode() == "static":
            uri = data_uri(self.image, head=APART)
            image = image_tag(uri, self.alt, self.image.shape, self.night, self.sketch)
            bundle["text/html"] = f"<picture>{self.phone}{image}</picture>"
        return bundle
