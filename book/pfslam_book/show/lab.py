"""A laboratory: a picture that computes in the page, with buttons, sliders, mouse, finger and keys.

Equations and stage are those of ``pfslam.cli.viewer``. In the folder ``labs`` each laboratory is a file of its own,
``lab_NAME.js``. A picture with a slider is less: ``picture.js`` draws axes, and ``picture_NAME.js``
computes what stands in them. On the site they work without a kernel. In JupyterLab they need ``anywidget``; without
it, without script and in print the reader sees the stored picture ``NAME.webp``.
"""

import base64
import html
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.cli import viewer
from pfslam.sensors import LidarModel

from .pictures import APART, output_mode

FOLDER = Path(__file__).parent / "labs"
TWO_BYTES = 2**15 - 1


@dataclass(frozen=True)
class Laboratory:
    """A laboratory on the page: its ``name``, its ``title``, and ``alt``, what the stored picture shows.

    ``options`` go to the script as they are. ``parts`` are functions of the reader that take the place of ours where
    there is a kernel; what they are called with is said where the laboratory is made.
    """

    name: str
    title: str
    alt: str
    options: Mapping[str, Any] = field(default_factory=dict)
    parts: Mapping[str, Callable] = field(default_factory=dict)

    def __repr__(self) -> str:
        if scripts(self.name)[-1].startswith("picture_"):
            return f"[picture: {self.title}; {' '.join(self.alt.split())}]"
        return f"[laboratory: {self.title}; it runs on the site and in JupyterLab]"

    def _repr_mimebundle_(self, include=None, exclude=None) -> dict:
        mode = output_mode()
        if mode == "live" and find_spec("anywidget"):
            return {**live_lab(self)._repr_mimebundle_()[0], "text/plain": repr(self)}
        if mode == "text":
            return {"text/plain": repr(self)}
        return {"text/plain": repr(self), "text/html": page_fragment(self)}


def show_lab(
    name: str, title: str, alt: str, *, parts: Mapping[str, Callable] | None = None, **options
) -> Laboratory:
    """Show the laboratory ``lab_NAME.js`` or the picture ``picture_NAME.js``; make it the last expression of a cell."""
    if not FOLDER.joinpath(scripts(name)[-1]).is_file():
        raise ValueError(f"laboratory {name!r}: no file lab_{name}.js and no picture_{name}.js")
    return Laboratory(name, title, alt, options, parts or {})


def page_fragment(lab: Laboratory) -> str:
    """The laboratory as HTML: the stored picture, until the page's scripts put the stage in its place."""
    options = html.escape(json.dumps(dict(lab.options), sort_keys=True), quote=True)
    alt, picture = html.escape(" ".join(lab.alt.split())), FOLDER.joinpath(f"{lab.name}.webp")
    still = base64.b64encode(picture.read_bytes()).decode("ascii") if picture.is_file() else ""
    return f"""<figure class="pfslam-lab" data-lab="{lab.name}" data-options="{options}">
<figcaption>{html.escape(lab.title)}</figcaption>
<div class="pfslam-still">
<img class="pfslam-picture" loading="lazy" src="{APART}{still}" alt="{alt}" width="688">
<p class="pfslam-note">A stored picture: the laboratory runs on the site, and in JupyterLab with the package
<code>anywidget</code>.</p>
</div>
</figure>"""


def scripts(name: str) -> list[str]:
    """The files that a page with this laboratory, or picture, loads, in order."""
    own = f"lab_{name}.js"
    if FOLDER.joinpath(own).is_file():
        return ["core.js", "view.js", "world.js", *(["story.js"] if name == "drive" else []), own]
    return ["core.js", "view.js", "picture.js", f"picture_{name}.js"]


def asset(name: str) -> Path:
    """The file of a script or style: the book's own, or the package's viewer's."""
    return next(folder / name for folder in (FOLDER, viewer.FOLDER) if (folder / name).is_file())


def packed(values: np.ndarray, unit: float | None = None) -> dict:
    """Numbers for a script as whole numbers of two bytes times ``unit``; without one, the largest number just fits."""
    values = np.asarray(values, dtype=float).ravel()
    unit = unit or max(float(np.abs(values).max()), 1e-9) / TWO_BYTES
    whole = np.rint(values / unit)
    if np.abs(whole).max() > TWO_BYTES:
        raise ValueError(f"packed: found {np.abs(values).max():g}, expected at most {TWO_BYTES * unit:g}")
    return {"unit": unit, "base64": base64.b64encode(whole.astype("<i2").tobytes()).decode("ascii")}


def packed_scan(ranges: np.ndarray, lidar: LidarModel) -> dict:
    """Ranges in whole millimetres; what is no measurement is 0."""
    return packed(np.where(lidar.valid(ranges), ranges, 0.0), 0.001)


def lidar_options(lidar: LidarModel) -> dict:
    """A LiDAR as the scripts know it."""
    return {
        "angleMin": lidar.angle_min,
        "angleMax": lidar.angle_max,
        "beams": lidar.beams,
        "rangeMin": lidar.range_min,
        "rangeMax": lidar.range_max,
        "position": list(lidar.position_b[:2]),
    }


def live_lab(lab: Laboratory):
    """The same laboratory as a widget of JupyterLab, which can call functions of the kernel."""
    import anywidget
    import traitlets

    class LiveLab(anywidget.AnyWidget):
        _esm = module(lab.name)
        _css = viewer.source("lab.css")
        name = traitlets.Unicode(lab.name).tag(sync=True)
        title = traitlets.Unicode(lab.title).tag(sync=True)
        options = traitlets.Dict(dict(lab.options)).tag(sync=True)
        parts = traitlets.List(list(lab.parts)).tag(sync=True)

    widget = LiveLab()
    widget.on_msg(lambda _, message, buffers: widget.send(answer(lab.parts, message)))
    return widget


def module(name: str) -> str:
    """The scripts of a laboratory as one module, as anywidget loads it; ``host.js`` is what calls the kernel."""
    return "\n".join(asset(script).read_text(encoding="utf-8") for script in [*scripts(name), "host.js"])


def answer(parts: Mapping[str, Callable], message: Mapping) -> dict:
    """Call the reader's function that the laboratory asks for; an error comes back as its text."""
    try:
        arguments = [np.array(value, dtype=float) for value in message["arguments"]]
        result = parts[message["part"]](*arguments)
        results = result if isinstance(result, tuple) else (result,)
        return {"id": message["id"], "result": [np.asarray(r, dtype=float).tolist() for r in results]}
    except Exception as error:  # whatever a reader's function does
        return {"id": message["id"], "error": f"{type(error).__name__}: {error}"}
