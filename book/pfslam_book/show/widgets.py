"""One widget for the whole book: a picture that sliders redraw.

With a kernel, as in JupyterLab, the sliders are ipywidgets and every move draws afresh. In the built book
there is no kernel: all pictures are drawn once while the book is made, and the page shows the one that the
sliders ask for (`page_fragment`). The reader sees the same thing.
"""

import gc
import hashlib
import html
import itertools
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from . import pictures as shown
from .pictures import FRAME_QUALITY, image_tag, output_mode

MAX_FRAMES = 60  # about 1 MB on the page
TRACK = 1000  # places on the track of a slider whose stops are not evenly spaced
TOO_CLOSE = 0.08  # of the track, between two stops


@dataclass(frozen=True)
class Slider:
    """One control: the name of the argument of `draw` that it sets, and the values it takes.

    values : the stops in the built book, in order: numbers on a slider, or words, which become radio buttons.
    start : index of the stop shown first, and in print.
    label, unit : how the page names it; `form` formats the value.
    live : (low, high, step) of a continuous slider in JupyterLab; without it the same stops are used.
    """

    name: str
    values: Sequence
    start: int = 0
    label: str = ""
    unit: str = ""
    form: str = ""
    live: tuple[float, float, float] | None = None

    def __post_init__(self):
        object.__setattr__(
            self, "values", tuple(v.item() if isinstance(v, np.generic) else v for v in self.values)
        )
        if len(self.values) < 2:
            raise ValueError(f"slider {self.name!r}: found {len(self.values)} value, expected two or more")
        if not 0 <= self.start < len(self.values):
            raise ValueError(f"slider {self.name!r}: start {self.start} is not an index of its values")

    @property
    def title(self) -> str:
        return self.label or self.name

    @property
    def is_choice(self) -> bool:
        """Whether the values are words, which a reader must see all at once to choose from."""
        return all(isinstance(value, str) for value in self.values)

    @property
    def places(self) -> tuple[int, ...]:
        """Where each stop lies on the track, as whole numbers from 0.

        Evenly spaced values, and values that do not increase, are counted. All others lie where a linear scale has
        them, or a logarithmic one where positive values would stand too close on a linear one.
        """
        counted = tuple(range(len(self.values)))
        if not all(isinstance(value, (int, float)) for value in self.values):
            return counted
        values = np.asarray(self.values, dtype=float)
        steps = np.diff(values)
        if not np.isfinite(steps).all() or (steps <= 0).any():
            return counted
        if values[0] > 0 and steps.min() < TOO_CLOSE * steps.sum() and not _even(steps):
            values = np.log(values)
        if _even(np.diff(values)):
            return counted
        return tuple(int(place) for place in np.rint(TRACK * (values - values[0]) / np.ptp(values)))

    def text(self, value) -> str:
        """A value as the reader sees it, with its unit."""
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        shown = format(value, self.form or ("g" if number else ""))
        return f"{shown} {self.unit}".strip().replace("-", "\N{MINUS SIGN}" if number else "-")


def _even(steps: np.ndarray) -> bool:
    """Whether steps are equal but for rounding."""
    return bool(np.ptp(steps) < 0.05 * steps.max())


class Explorer:
    """A picture and the sliders that redraw it. Make it the last expression of a cell.

    Parameters
    ----------
    draw : pure function of the sliders' values, by keyword, to a Figure or an (H, W, 3) uint8 image.
    controls : the sliders.
    alt : what the picture shows: a function of the same keywords, or one sentence, to which the values
        are added.
    title : the line under the picture; it also tells two widgets on one page apart.
    play : name of the slider that a play button runs through, or None.
    frames : "all" for every combination of the stops; "axes" to vary one slider at a time around the
        start values, where all combinations would be too many (the page then says so).
    pause : milliseconds per frame while playing.
    """

    def __init__(
        self,
        draw: Callable[..., Figure | np.ndarray],
        controls: Sequence[Slider],
        *,
        alt: str | Callable[..., str],
        title: str,
        play: str | None = None,
        frames: str = "all",
        pause: int = 300,
        max_frames: int = MAX_FRAMES,
    ):
        self.draw, self.controls, self.title, self.pause = draw, tuple(controls), title, pause
        self.one_at_a_time = {"all": False, "axes": True}[frames]
        self._alt = alt
        names = [control.name for control in self.controls]
        if not names or len(set(names)) != len(names):
            raise ValueError(f"expected sliders with different names, found {names}")
        if play is not None and play not in names:
            raise ValueError(f"play: found {play!r}, expected one of {names}")
        self.play = None if play is None else names.index(play)
        if len(self.states()) > max_frames:
            raise ValueError(
                f"{title!r}: {len(self.states())} frames, at most {max_frames} fit on a page: "
                'give the sliders fewer values, or use frames="axes"'
            )

    @property
    def start(self) -> tuple[int, ...]:
        return tuple(control.start for control in self.controls)

    def states(self) -> list[tuple[int, ...]]:
        """The slider positions that the built page can show, as indices into their values."""
        everything = itertools.product(*(range(len(control.values)) for control in self.controls))
        if not self.one_at_a_time:
            return list(everything)
        return [s for s in everything if sum(a != b for a, b in zip(s, self.start, strict=True)) <= 1]

    def values(self, state: Sequence[int]) -> dict:
        """The arguments of `draw` at a slider position."""
        return {control.name: control.values[i] for control, i in zip(self.controls, state, strict=True)}

    def alt(self, **values) -> str:
        """What the picture shows at these values."""
        if callable(self._alt):
            return " ".join(self._alt(**values).split())
        settings = ", ".join(f"{c.title} {c.text(values[c.name])}" for c in self.controls)
        return f"{self._alt.rstrip('. ')}. {settings}."

    def frame(self, **values) -> np.ndarray:
        """The picture at these values, (H, W, 3) uint8."""
        with garbage_swept():
            return shown.to_rgb(self.draw(**values), shown.FOR_PHONES)

    def tag(self, **values) -> str:
        """The `<img>` that a move of a slider sends to JupyterLab."""
        frame = self.frame(**values)
        return image_tag(shown.quick_uri(frame), self.alt(**values), frame.shape)

    def frames(self) -> dict[tuple[int, ...], tuple[np.ndarray, str]]:
        """Every picture of the built page, by slider position, and the address of the one for the dark theme."""
        pictures = {}
        for state in self.states():
            with garbage_swept():
                drawing = self.draw(**self.values(state))
                pictures[state] = (
                    shown.to_rgb(drawing, shown.FOR_PHONES),
                    shown.night_uri(drawing, FRAME_QUALITY),
                )
        return pictures

    def __repr__(self) -> str:
        start = self.values(self.start)
        settings = ", ".join(f"{c.title} {c.text(start[c.name])}" for c in self.controls)
        return f"[explorer: {self.title}; {settings}; {self.alt(**start)}]"

    def _repr_mimebundle_(self, include=None, exclude=None) -> dict:
        mode = output_mode()
        if mode == "live":
            return {**live_view(self)._repr_mimebundle_(), "text/plain": repr(self)}
        if mode == "static":
            return {"text/plain": repr(self), "text/html": page_fragment(self)}
        return {"text/plain": repr(self)}


@contextmanager
def garbage_swept() -> Iterator[None]:
    """Free what a block leaves behind at its end, while it is young.

    A figure is a knot of references that only the garbage collector can undo. Left to its own times, it looks
    through every object of the kernel at each tenth figure or so, which takes as long as drawing one.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.collect(0)
        if was_on:
            gc.enable()


def live_view(explorer: Explorer):
    """The same widget as ipywidgets, drawn by the kernel at every move."""
    import ipywidgets

    sliders = [_live_slider(control, k == explorer.play) for k, control in enumerate(explorer.controls)]
    image = ipywidgets.HTML()  # rather than ipywidgets.Image, which has no alt text
    caption = ipywidgets.HTML(f"<b>{explorer.title}</b>")

    def redraw(change=None):
        image.value = explorer.tag(
            **{c.name: slider.value for c, slider in zip(explorer.controls, sliders, strict=True)}
        )

    for slider in sliders:
        slider.observe(redraw, "value")
    redraw()
    rows: list = [image, caption, *sliders]
    if explorer.play is not None:
        last = len(explorer.controls[explorer.play].values) - 1
        player = ipywidgets.Play(min=0, max=last, value=sliders[explorer.play].index, interval=explorer.pause)
        ipywidgets.jslink((player, "value"), (sliders[explorer.play], "index"))
        rows.append(player)
    return ipywidgets.VBox(rows)


def _live_slider(control: Slider, plays: bool):
    import ipywidgets

    look: dict[str, Any] = {
        "description": control.title,
        "style": {"description_width": "initial"},
        "layout": {"width": "34em", "max_width": "100%"},
    }
    if control.live is not None and not plays:
        low, high, step = control.live
        start = control.values[control.start]
        return ipywidgets.FloatSlider(value=start, min=low, max=high, step=step, readout_format=".3g", **look)
    options = [(control.text(value), value) for value in control.values]
    if control.is_choice:
        look["style"]["button_width"] = "auto"
        return ipywidgets.ToggleButtons(options=options, index=control.start, **look)
    return ipywidgets.SelectionSlider(options=options, index=control.start, **look)


# ---- the page without a kernel: labelled range inputs and radio buttons, pictures as data, and a short script


def page_fragment(explorer: Explorer) -> str:
    """The widget as HTML that needs no network and no kernel.

    Identifiers follow from the title and the sliders alone, so that the same notebook gives the same page.
    """
    identifier = _identifier(explorer)
    pictures = explorer.frames()
    uris = {
        state: (shown.data_uri(image, FRAME_QUALITY, shown.APART), night)
        for state, (image, night) in pictures.items()
    }
    alts = {state: explorer.alt(**explorer.values(state)) for state in pictures}
    start = explorer.start
    rows = "\n".join(_row(f"{identifier}-{k}", c) for k, c in enumerate(explorer.controls))
    title = html.escape(explorer.title)
    return f"""<figure class="pfslam-explorer" id="{identifier}">
{image_tag(uris[start][0], alts[start], pictures[start][0].shape, uris[start][1])}
<div class="pfslam-controls">
{rows}
{_buttons(explorer)}</div>
<p class="pfslam-status" role="status" aria-live="polite"></p>
<figcaption>{title}</figcaption>
<noscript><p>The controls need JavaScript; the picture shows their first position.</p></noscript>
<script type="application/json">{_json(_data(explorer, uris, alts))}</script>
<script>{files("pfslam_book.show").joinpath("explorer.js").read_text(encoding="utf-8")}</script>
</figure>"""


def _identifier(explorer: Explorer) -> str:
    key = repr((explorer.title, [(c.name, c.values) for c in explorer.controls]))
    return "explorer-" + hashlib.sha256(key.encode()).hexdigest()[:10]


def _row(identifier: str, control: Slider) -> str:
    if control.is_choice:
        return _choice(identifier, control)
    text = html.escape(control.text(control.values[control.start]))
    widest = max(len(control.text(value)) for value in control.values)  # or the slider would grow and shrink
    marks = "".join(f'<option value="{place}"></option>' for place in control.places)
    return (
        f'<label for="{identifier}">{html.escape(control.title)}</label>'
        f'<output for="{identifier}" style="min-width:{widest}ch">{text}</output>'
        f'<input type="range" id="{identifier}" list="{identifier}-stops" min="0" max="{control.places[-1]}" step="1" '
        f'value="{control.places[control.start]}" autocomplete="off" aria-valuetext="{text}">'
        f'<datalist id="{identifier}-stops">{marks}</datalist>'
    )


def _choice(identifier: str, control: Slider) -> str:
    """Radio buttons, so that all words are seen at once."""
    buttons = "".join(
        f'<label><input type="radio" name="{identifier}" value="{k}" autocomplete="off"'
        f"{' checked' if k == control.start else ''}> {html.escape(control.text(value))}</label>"
        for k, value in enumerate(control.values)
    )
    return f'<fieldset id="{identifier}"><legend>{html.escape(control.title)}</legend>{buttons}</fieldset>'


def _buttons(explorer: Explorer) -> str:
    note = ""
    if explorer.one_at_a_time:
        note = (
            '<p class="pfslam-note">Here one slider moves at a time, the others go back to their start. '
            "In JupyterLab they all move freely.</p>\n"
        )
    if explorer.play is None:
        return note
    return '<button type="button" hidden>Play</button>\n' + note


def _data(explorer: Explorer, uris: dict, alts: dict) -> dict:
    """What the script looks up: equal pictures and descriptions are stored once."""
    frames, texts = list(dict.fromkeys(uris.values())), list(dict.fromkeys(alts.values()))
    return {
        "play": explorer.play,
        "pause": explorer.pause,
        "alone": explorer.one_at_a_time,
        "start": explorer.start,
        "labels": [[c.text(value) for value in c.values] for c in explorer.controls],
        "places": [c.places for c in explorer.controls],
        "states": {",".join(map(str, s)): [frames.index(uris[s]), texts.index(alts[s])] for s in uris},
        "alts": texts,
        "frames": [day for day, _ in frames],
        "nights": [night for _, night in frames],
    }


def _json(data: dict) -> str:
    """JSON that can stand inside a script element."""
    return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
