"""Laboratories without a browser: what a cell shows with a kernel and without, and calls of the reader's functions."""

import base64
import re
import sys
from types import ModuleType

import numpy as np
import pytest
from pfslam_book import ch05
from pfslam_book.show import lab
from pfslam_book.show.lab import FOLDER, answer, asset, module, packed, packed_scan, scripts, show_lab

from pfslam.sensors import LidarModel

FILES = sorted(path.name for path in FOLDER.iterdir() if path.name.startswith(("lab_", "picture_")))


def shown(mode: str, monkeypatch) -> dict:
    monkeypatch.setenv("PFSLAM_WIDGETS", mode)
    return ch05.drive_lab()._repr_mimebundle_()


@pytest.mark.parametrize("mode", ["static", "live"])
def test_without_anywidget_it_is_a_described_picture_that_a_script_may_replace(mode, monkeypatch):
    monkeypatch.setattr(lab, "find_spec", lambda name: None)
    page = shown(mode, monkeypatch)["text/html"]
    assert re.search(r'<figure class="pfslam-lab" data-lab="drive" data-options="{}">', page)
    alt = re.search(r'<img [^>]*alt="([^"]+)"', page)[1]
    assert "particles" in alt
    assert "data:image/webp;apart=1;base64," in page
    assert "http" not in page


def test_with_anywidget_it_is_a_widget_with_the_readers_parts(monkeypatch):
    made = {}

    class AnyWidget:
        def on_msg(self, heard):
            made["heard"] = heard

        def send(self, message):
            made["sent"] = message

        def _repr_mimebundle_(self):
            return {"widget": type(self)._esm}, {}

    stand_in = ModuleType("anywidget")
    stand_in.AnyWidget = AnyWidget
    monkeypatch.setitem(sys.modules, "anywidget", stand_in)
    monkeypatch.setattr(lab, "find_spec", lambda name: object())
    monkeypatch.setenv("PFSLAM_WIDGETS", "live")
    bundle = ch05.drive_lab(update=lambda weights, likelihood: weights * likelihood)._repr_mimebundle_()
    assert "export default" in bundle["widget"]
    made["heard"](None, {"id": 3, "part": "update", "arguments": [[0.5, 0.5], [1.0, 2.0]]}, [])
    assert made["sent"] == {"id": 3, "result": [[0.5, 1.0]]}


def test_a_readers_resampler_gets_poses_and_gives_them_back():
    seen = []

    def resample(poses, weights, rng):
        seen.append((poses.shape, rng.random()))
        return poses[[1, 1]], np.full(2, 0.5)

    parts = ch05.drive_lab(resample=resample).parts
    message = {"id": 1, "part": "resample", "arguments": [[1, 2, 3, 4, 5, 6], [0, 1]]}
    assert answer(parts, message)["result"] == [[[4, 5, 6], [4, 5, 6]], [0.5, 0.5]]
    assert seen[0][0] == (2, 3)


def test_an_error_of_the_reader_comes_back_as_words():
    def update(weights, likelihood):
        raise ValueError("not yet written")

    message = {"id": 1, "part": "update", "arguments": [[1.0], [1.0]]}
    assert answer({"update": update}, message) == {"id": 1, "error": "ValueError: not yet written"}


@pytest.mark.parametrize(("kind", "name"), [file[:-3].split("_") for file in FILES])
def test_every_laboratory_and_picture_is_whole(kind, name):
    assert all(asset(script).is_file() for script in scripts(name))
    assert len(FOLDER.joinpath(f"{name}.webp").read_bytes()) < 80_000
    assert f'{kind}("{name}"' in module(name)
    assert "http" not in module(name), "nothing is fetched"


def test_numbers_are_packed_to_half_a_unit_and_what_does_not_fit_is_refused():
    values = np.array([0.0, -1.5, 0.25, 3.0])
    for unit in (None, 0.001):
        made = packed(values, unit)
        whole = np.frombuffer(base64.b64decode(made["base64"]), "<i2")
        np.testing.assert_allclose(made["unit"] * whole, values, atol=made["unit"] / 2)
    with pytest.raises(ValueError, match="found 33, expected"):
        packed([33.0], 0.001)
    scan = packed_scan(np.array([0.05, 1.234, np.nan, np.inf, 60.0]), LidarModel())
    assert np.frombuffer(base64.b64decode(scan["base64"]), "<i2").tolist() == [0, 1234, 0, 0, 0]


def test_in_words_a_picture_says_what_it_shows_and_an_unknown_one_is_refused():
    assert repr(show_lab("dot", "A dot", "A wall\n  at 1 m.")) == "[picture: A dot; A wall at 1 m.]"
    with pytest.raises(ValueError, match="no picture_none"):
        show_lab("none", "", "")
