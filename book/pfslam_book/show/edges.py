"""Where the words of a figure stand: on the sheet, whole, and on no other words; else the book is not built."""

from itertools import combinations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.transforms import Bbox

SLACK = 1.0  # pixels by which a letter may be said to be larger than it is


class NotingRenderer(RendererAgg):
    """Draws as Matplotlib does, and keeps each piece of text with the box that it fills and what cuts it."""

    def __init__(self, width, height, dpi):
        super().__init__(width, height, dpi)
        self.words: list[tuple[str, Bbox, Bbox]] = []

    def draw_text(self, gc, x, y, s, prop, angle, ismath=False, mtext=None):
        """Write, and note where."""
        super().draw_text(gc, x, y, s, prop, angle, ismath, mtext)
        wide, high, below = self.get_text_width_height_descent(s, prop, ismath)
        corners = np.array([(a, b) for a in (0, wide) for b in (-below, high - below)])
        turn = np.deg2rad(angle)
        turned = corners @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
        box = Bbox([turned.min(axis=0), turned.max(axis=0)]).translated(x, self.height - y)
        sheet = Bbox.from_bounds(0, 0, self.width, self.height)
        cut = gc.get_clip_rectangle() or sheet
        if cut is sheet or Bbox.intersection(box, cut):  # words of what lies beyond the axes are not drawn
            self.words.append((s, box, cut))


def drawn(figure: Figure) -> tuple[np.ndarray, list[str]]:
    """Rasterise a figure to (H, W, 4) uint8, and say in words what is wrong with the places of its texts."""
    canvas = FigureCanvasAgg(figure)
    renderer = NotingRenderer(*canvas.get_width_height(physical=True), figure.dpi)
    figure.draw(renderer)
    words = [(s, box, cut) for s, box, cut in renderer.words if s.strip()]
    wrong = [f"{s!r} is cut off" for s, box, cut in words if not _inside(box, cut)]
    wrong += [f"{a[0]!r} lies on {b[0]!r}" for a, b in combinations(words, 2) if _overlap(a[1], b[1])]
    for legend in figure.findobj(Legend):
        frame = legend.get_window_extent(renderer)
        under = [s for s, box, _ in words if _overlap(box, frame) and not _inside(box, frame)]
        wrong += [f"{s!r} lies under the edge of a legend" for s in under]
    return np.asarray(renderer.buffer_rgba()), wrong


def _inside(box: Bbox, frame: Bbox) -> bool:
    low, high = np.asarray(frame.min) - SLACK, np.asarray(frame.max) + SLACK
    return bool((low <= box.min).all() and (box.max <= high).all())


def _overlap(one: Bbox, other: Bbox) -> bool:
    common = Bbox.intersection(one, other)
    return common is not None and min(common.width, common.height) > SLACK
