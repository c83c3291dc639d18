"""A widget for a page without a kernel: labelled range inputs, pictures as data, and a short script."""

import hashlib
import html
import json
from importlib.resources import files

from .pictures import FRAME_QUALITY, data_uri, image_tag
from .widgets import Explorer, Slider


def page_fragment(explorer: Explorer) -> str:
    """The widget as HTML that needs no network, no kernel and no other file.

    Identifiers follow from the title and the sliders alone, so that the same notebook gives the same page.
    """
    identifier = _identifier(explorer)
    pictures = explorer.frames()
    uris = {state: data_uri(image, FRAME_QUALITY) for state, image in pictures.items()}
    alts = {state: explorer.alt(**explorer.values(state)) for state in pictures}
    start = explorer.start
    rows = "\n".join(_row(f"{identifier}-{k}", c) for k, c in enumerate(explorer.controls))
    title = html.escape(explorer.title)
    return f"""<figure class="pfslam-explorer" id="{identifier}">
{image_tag(uris[start], alts[start], pictures[start].shape)}
<div class="pfslam-controls">
{rows}
{_buttons(explorer)}</div>
<p class="pfslam-status" role="status" aria-live="polite"></p>
<figcaption>{title}</figcaption>
<noscript><p>The sliders need JavaScript; the picture shows their first position.</p></noscript>
<script type="application/json">{_json(_data(explorer, uris, alts))}</script>
<script>{files("pfslam.teaching").joinpath("explorer.js").read_text(encoding="utf-8")}</script>
</figure>"""


def _identifier(explorer: Explorer) -> str:
    key = repr((explorer.title, [(c.name, c.values) for c in explorer.controls]))
    return "explorer-" + hashlib.sha256(key.encode()).hexdigest()[:10]


def _row(identifier: str, control: Slider) -> str:
    text = html.escape(control.text(control.values[control.start]))
    widest = max(len(control.text(value)) for value in control.values)  # or the slider would grow and shrink
    return (
        f'<label for="{identifier}">{html.escape(control.title)}</label>'
        f'<output for="{identifier}" style="min-width:{widest}ch">{text}</output>'
        f'<input type="range" id="{identifier}" min="0" max="{len(control.values) - 1}" step="1" '
        f'value="{control.start}" autocomplete="off" aria-valuetext="{text}">'
    )


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
        "states": {",".join(map(str, s)): [frames.index(uris[s]), texts.index(alts[s])] for s in uris},
        "alts": texts,
        "frames": frames,
    }


def _json(data: dict) -> str:
    """JSON that can stand inside a script element."""
    return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
