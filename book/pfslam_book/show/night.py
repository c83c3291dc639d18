"""The same figure on dark paper, for the dark theme: every colour passes the renderer, which gives the other one.

Nothing that is drawn knows of it. Hues stay, so that a colour keeps its name; black and white change places;
photographs, painted floors and colours that are data stay. The new ones are those of the laboratories (`labs/lab.css`).
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

import numpy as np
from matplotlib.backend_bases import GraphicsContextBase
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.colors import LinearSegmentedColormap, to_hex, to_rgb
from matplotlib.figure import Figure

from .style import COLOURS

PAPER = "#14161a"  # of the page
WHITE = "#fcfcfa"
BRIGHTER = {
    "odometry": "#ff9a4d",
    "estimate": "#3d9ce6",
    "particles": "#a5dcff",
    "hits": "#ff8cc6",
    "free": "#4fd6ab",
    "highlight": "#e69f00",
    "unknown": "#6f7782",
    "report": "#c99a76",
    "particle A": "#b38cf0",
    "particle B": "#cbbb3f",
    "particle C": "#ee6f85",
}
UNSEEN = "#b8bcc3"  # stands for the colour of unseen cells where it is the ground of a map and no line
NIGHT = {**{COLOURS[name]: colour for name, colour in BRIGHTER.items()}, UNSEEN: "#24282e"}
# The cells of a map: seen by nobody, free, occupied.
CELLS = {**NIGHT, COLOURS["unknown"]: NIGHT[UNSEEN], "#ffffff": "#3a414a", COLOURS["truth"]: WHITE}
MAPS = {
    name: LinearSegmentedColormap.from_list(f"{name} at night", [PAPER, end])
    for name, end in {"Blues": "#a5dcff", "Greys": WHITE}.items()
}
NEUTRAL = 0.06  # a colour whose channels differ by less is a grey
DARKEST, LIGHTEST = 0.12, 0.985  # greys that become white and the paper


def luminance(colour) -> float:
    """Relative luminance of an RGB colour, from 0 for black to 1 for white."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(colour)]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


def contrast(one, other) -> float:
    """How much one colour stands out from another: from 1 to 21."""
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def is_data(colour) -> bool:
    """Whether a colour is neither of the code nor a grey: it stands for a value, and stays."""
    return to_hex(colour) not in NIGHT and max(colour) - min(colour) >= NEUTRAL


@lru_cache(4096)
def at_night(colour: tuple[float, float, float]) -> tuple[float, float, float]:
    """The colour, RGB from 0 to 1, that stands for this one on dark paper."""
    if known := NIGHT.get(to_hex(colour)):
        return to_rgb(known)
    if is_data(colour):
        return colour
    share = np.clip((sum(colour) / 3 - DARKEST) / (LIGHTEST - DARKEST), 0, 1)
    red, green, blue = (1 - share) * np.array(to_rgb(WHITE)) + share * np.array(to_rgb(PAPER))
    return float(red), float(green), float(blue)


def _pen(colour):
    """A colour as Matplotlib hands it over, or None, with the opacity that it has."""
    return None if colour is None else (*at_night(tuple(map(float, colour[:3]))), *colour[3:])


def _pens(colours):
    """The same for those of a collection, (N, 4); its greys are data where others are."""
    different, which = np.unique(np.asarray(colours, dtype=float).reshape(-1, 4), axis=0, return_inverse=True)
    if len(different) == 0 or any(is_data(tuple(colour)) for colour in different[:, :3]):
        return colours
    return np.array([_pen(colour) for colour in different])[which.ravel()]


def _cells(image: np.ndarray) -> np.ndarray:
    """A picture (H, W, 4) of nothing but cells in the colour code as it is at night, and any other as it is."""
    packed = np.ascontiguousarray(image).view(np.uint32)[..., 0]
    if len(np.unique(packed[::5, ::5])) > len(CELLS):
        return image
    different, which = np.unique(packed, return_inverse=True)
    colours = different[:, None].view(np.uint8)  # (N, 4)
    for colour in colours:
        if colour[3] == 0:
            continue
        near = [night for day, night in CELLS.items() if np.abs(_bytes(day) - colour[:3]).max() <= 1]
        if not near:
            return image
        colour[:3] = _bytes(near[0])
    return colours[which.ravel()].reshape(image.shape)


def _bytes(colour: str) -> np.ndarray:
    return np.rint(255 * np.array(to_rgb(colour))).astype(int)


class NightContext(GraphicsContextBase):
    """A pen that knows what its colour was by day."""

    _rgb: Any
    day: Any = (0.0, 0.0, 0.0)

    def set_foreground(self, fg, isRGBA=False):
        """Take up a colour."""
        super().set_foreground(fg, isRGBA)
        self.day = self._rgb[:3]
        self._rgb = _pen(self._rgb)

    def set_alpha(self, alpha):
        """Take up an opacity, for which Matplotlib takes up the colour once more."""
        self._rgb = (*self.day, *self._rgb[3:])
        super().set_alpha(alpha)

    def copy_properties(self, gc):
        """Become the same pen as another."""
        super().copy_properties(gc)
        self.day = gc.day


class NightRenderer(RendererAgg):
    """Draws each colour as that of the night."""

    def _update_methods(self):
        super()._update_methods()
        for name in ("draw_markers", "draw_path_collection", "draw_image"):
            delattr(self, name)  # Matplotlib sets the compiled ones here; ours below call them

    def draw_markers(self, gc, marker_path, marker_trans, path, trans, rgbFace=None):
        """Draw one marker at many places."""
        self._renderer.draw_markers(gc, marker_path, marker_trans, path, trans, _pen(rgbFace))

    def draw_path_collection(self, gc, *what, **more):
        """Draw many outlines: ``what`` is five things that say where, the colours of faces and edges, and more."""
        *where, faces, edges = what[:7]
        self._renderer.draw_path_collection(gc, *where, _pens(faces), _pens(edges), *what[7:], **more)

    def draw_image(self, gc, x, y, im, transform=None):
        """Draw a map in other colours, a photograph in its own."""
        self._renderer.draw_image(gc, x, y, _cells(im))

    def new_gc(self):
        """A pen of the night."""
        return NightContext()

    def draw_path(self, gc, path, transform, rgbFace=None):
        """Draw an outline and what it holds."""
        super().draw_path(gc, path, transform, _pen(rgbFace))

    def draw_text(self, gc, x, y, s, prop, angle, ismath=False, mtext=None):
        """Write in the colour of day or night, whichever is easier to read where the words stand."""
        row, column = int(np.clip(y - 6, 0, self.height - 1)), int(np.clip(x + 6, 0, self.width - 1))
        behind = tuple(np.asarray(self.buffer_rgba())[row, column, :3] / 255)
        if contrast(gc.day, behind) > contrast(gc._rgb[:3], behind):
            gc._rgb = (*gc.day, *gc._rgb[3:])
        super().draw_text(gc, x, y, s, prop, angle, ismath, mtext)


@contextmanager
def _as_laid_out(figure: Figure) -> Iterator[None]:
    """Places as the drawing by day found them, and the maps of the night for colours that begin at white."""
    engine, changed = figure.get_layout_engine(), []
    figure.set_layout_engine("none")
    coloured: list[Any] = figure.findobj(lambda artist: hasattr(artist, "get_cmap"))
    for artist in coloured:
        if artist.get_cmap().name in MAPS:
            changed.append((artist, artist.get_cmap()))
            artist.set_cmap(MAPS[artist.get_cmap().name])
    grounds = [axes for axes in figure.axes if to_hex(axes.get_facecolor()) == COLOURS["unknown"]]
    for axes in grounds:
        axes.set_facecolor(UNSEEN)
    try:
        yield
    finally:
        for axes in grounds:
            axes.set_facecolor(COLOURS["unknown"])
        for artist, colours in changed:
            artist.set_cmap(colours)
        figure.set_layout_engine(engine)


def draw_at_night(figure: Figure) -> np.ndarray:
    """Rasterise a figure that has been drawn by day to (H, W, 3) uint8, in the colours of the night."""
    width, height = figure.canvas.get_width_height(physical=True)
    renderer = NightRenderer(width, height, figure.dpi)
    with _as_laid_out(figure):
        figure.draw(renderer)
    return np.asarray(renderer.buffer_rgba())[..., :3].copy()
