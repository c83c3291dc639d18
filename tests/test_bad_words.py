"""A campaign of bad command lines, study files and settings: each ends in one line, or in a correct result.

``make weekly`` tries 2,000 cases of each kind.
"""

import dataclasses
import json
import os
import subprocess
import sys

import numpy as np
import pytest
from box_recording import box_recording
from settings import numbers, replaced

from pfslam.__main__ import main
from pfslam.config import SlamConfig
from pfslam.errors import DataError
from pfslam.io.course import save_course
from pfslam.runs import run_slam
from pfslam.study.definition import read_study
from pfslam.texture.config import TextureConfig
from pfslam.texture.mapping import map_texture

CASES = int(os.environ.get("PFSLAM_CASES", "60"))
WORDS = [
    *(
        "run",
        "simulate",
        "report",
        "study",
        "7",
        "8",
        "-7",
        "hall ",
        "",
        "--",
        "-",
        "..",
        ".",
        "/",
        "7.5",
        "٧",
    ),
    *(
        "--data",
        "--out",
        "--seed",
        "--particles",
        "--every",
        "--method",
        "--texture",
        "--no-texture",
        "--images",
    ),
    *(
        "nan",
        "1e9",
        "0",
        "-1",
        "99999999999999999999",
        "report",
        "refined",
        "matching",
        "/dev/null",
        "a b",
        "~",
    ),
    *("x" * 5000, "ä.log", "a\nb", "--help", "--verbose", "%s", "{0}", "$HOME", "--dataset=7", "\x00"),
]
GOOD = [
    ["run", "7", "--data", "DATA", "--out", "OUT", "--particles", "2", "--no-texture"],
    ["run", "7", "--data", "DATA", "--out", "OUT", "--method", "report", "--particles", "2", "--every", "9"],
    ["report", "7", "--data", "DATA", "--out", "OUT"],
    ["study", "STUDY", "--out", "OUT", "--jobs", "1"],
    ["simulate", "hall", "--out", "OUT", "--seed", "1"],
]
STUDY = """name = "small"
about = "A campaign."
[common]
dataset = "7"
data_dir = "DATA"
method = "dead-reckoning"
seed = [0, 1]
[[variant]]
label = "one"
every = 3
[[variant]]
label = "two"
every = [5, 9]
"""
LINES = [
    *('seed = "x"', "seed = []", "seed = { count = 1e99 }", "seed = { count = 10000000 }", "every = -1"),
    *("every = 0", '"map.free" = nan', '"map.nothing" = 1', '"search.field" = "magic"', "particles = true"),
    *('method = "magic"', 'dataset = ["7", "nowhere"]', "[[variant]]", 'label = "one"', "[common]", "= 3"),
    *("x = 1", '"disturb.blind" = [9]', '"disturb.magic" = 1', "name = 3", "\x00", "seed = [0, 0]", "[["),
]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a small good set and a study of it."""
    folder = tmp_path_factory.mktemp("place")
    save_course(box_recording(2.0, images=0), 7, folder / "data")
    (folder / "small.toml").write_text(STUDY.replace("DATA", str(folder / "data")), encoding="utf-8")
    return folder


def everything_in(folder):
    return {str(p.relative_to(folder)) for p in folder.rglob("*")}


def spoiled(words, rng):
    """A good command line with words changed, taken out, put in or moved."""
    words = list(words)
    for _ in range(rng.integers(1, 3)):
        at = int(rng.integers(len(words))) if words else 0
        kind = rng.integers(4)
        if kind == 0 and words:
            words[at] = str(rng.choice(WORDS))
        elif kind == 1 and words:
            del words[at]
        elif kind == 2:
            words.insert(at, str(rng.choice(WORDS)))
        else:
            rng.shuffle(words)
    return words


@pytest.mark.parametrize("seed", range(CASES // 5))
def test_bad_command_lines(place, tmp_path, monkeypatch, capsys, seed):
    rng = np.random.default_rng(seed)
    monkeypatch.chdir(tmp_path)
    names = {"DATA": str(place / "data"), "OUT": "mine", "STUDY": str(place / "small.toml")}
    line = spoiled([names.get(word, word) for word in GOOD[rng.integers(4)]], rng)
    before = everything_in(place)
    try:
        code = main(line)
    except SystemExit as stop:  # --help
        code = stop.code
    said = capsys.readouterr().err
    assert code in (0, 2), (line, said)
    assert "Traceback" not in said
    if code == 2:
        (complaint,) = [text for text in said.splitlines() if text.startswith("pfslam: ")]
        assert len(complaint) < 700, line
    assert everything_in(place) == before, line
    # Whatever was written lies in the folder asked for, or in the default one.
    allowed = {"mine", "out", *line}
    assert {name.split(os.sep)[0] for name in everything_in(tmp_path)} <= allowed, line


@pytest.mark.parametrize("seed", range(CASES // 5))
def test_bad_study_files(place, tmp_path, seed):
    rng = np.random.default_rng(seed)
    lines = (place / "small.toml").read_text(encoding="utf-8").splitlines()
    for _ in range(rng.integers(1, 3)):
        at = int(rng.integers(len(lines)))
        kind = rng.integers(3)
        if kind == 0:
            lines[at] = str(rng.choice(LINES))
        elif kind == 1:
            lines.insert(at, str(rng.choice(LINES)))
        else:
            del lines[at]
    path = tmp_path / "spoiled.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    complaint, cases = None, ()
    try:
        cases = read_study(path).cases
    except DataError as error:
        complaint = str(error)
    if complaint is None:
        assert 1 <= len(cases) <= 1_000_000
    else:
        assert "spoiled.toml" in complaint
        assert "\n" not in complaint
        assert len(complaint) < 600


def any_number(like, rng):
    """A number of the kind of ``like`` and of any size, or what is none; pairs for pairs."""
    if isinstance(like, tuple):
        return tuple(any_number(part, rng) for part in like)
    strange = rng.choice([0.0, -1.0, np.nan, np.inf, -np.inf, 1e300, 1e-300])
    size = 10.0 ** rng.uniform(-6, 6) if isinstance(like, float) else int(10.0 ** rng.uniform(0, 4))
    return float(strange) if rng.random() < 0.2 else size


def with_any_numbers(config, fields, rng):
    """The configuration with numbers in two of its fields replaced, or None where their ranges refuse them by name."""
    chosen = [fields[k] for k in rng.choice(len(fields), 2, replace=False)]
    changes = {name: any_number(value, rng) for name, value in chosen}
    refused = None
    try:
        for name, value in changes.items():
            config = replaced(config, name, value)
    except DataError as error:
        refused = error.field.split(", ")
    assert refused is None or any(name in str(changes) for name in refused)
    return config if refused is None else None


def result_or_complaint(work):
    """What ``work()`` gives, or None after one clear line about the recording or the grid."""
    complaint = None
    try:
        return work()
    except DataError as error:
        complaint = str(error)
    assert complaint.startswith(("box", "GridSpec"))
    return None


@pytest.mark.parametrize("seed", range(CASES // 5))
def test_any_numbers_are_refused_by_name_or_make_a_run(seed):
    """Whatever passes the ranges ends in a run that stays finite, or in one clear line."""
    rng = np.random.default_rng(seed)
    presets = SlamConfig.report(), SlamConfig.refined(), SlamConfig.per_particle(), SlamConfig.matching()
    particles = int(rng.integers(1, 6)) if seed % 4 < 3 else 1  # matching has one pose
    config = dataclasses.replace(presets[seed % 4], particles=particles, every=3)
    config = with_any_numbers(config, [f for f in numbers(config) if f[0] != "particles"], rng)
    if config is not None:
        result = result_or_complaint(lambda: run_slam(box_recording(2.0, images=0), config))
        assert result is None or np.isfinite(result.trajectory.poses).all()
        assert result is None or np.isfinite(result.grid.log_odds).all()


@pytest.mark.parametrize("seed", range(CASES // 10))
def test_any_numbers_are_refused_by_name_or_make_a_texture(seed):
    rng, steps = np.random.default_rng(seed), list(TextureConfig.steps().values())
    config = dataclasses.replace(steps[seed % len(steps)], resolution=0.05)
    config = with_any_numbers(config, list(numbers(config)), rng)
    box = box_recording(3.0, images=4)
    if config is not None:
        texture = result_or_complaint(lambda: map_texture(box, box.truth, config=config))
        assert texture is None or (texture.rgb[texture.seen][:, 1:] == [20, 30]).all()


FIELDS = [
    ("particles", [0, -3, 1.5, "x", None]),
    ("every", [0, -1, 2.5, "x"]),
    ("min_beams", [0, -1, 1.5, None]),
    ("resample_below", [-0.1, 1.5, np.nan, "x"]),
    ("resampler", ["magic", None, 3]),
    ("estimate", ["median", 1]),
    ("maps", ["none", 0]),
]


@pytest.mark.parametrize(("name", "value"), [(n, v) for n, values in FIELDS for v in values], ids=repr)
def test_bad_settings_are_refused_by_name(name, value):
    with pytest.raises(DataError, match=name):
        dataclasses.replace(SlamConfig.refined(), **{name: value})


def test_a_run_may_not_take_more_memory_than_allowed(tmp_path):
    """Absurd sizes end in one line within 2 GB of address space, not in a machine that swaps."""
    if sys.platform != "linux":
        pytest.skip("address space is limited through Linux's resource module")
    save_course(box_recording(2.0, images=0), 7, tmp_path)
    code = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_AS, (2 * 2**30, 2 * 2**30));"
        "from pfslam.__main__ import main; sys.exit(main(sys.argv[1:]))"
    )
    line = ["run", "7", "--data", str(tmp_path), "--out", str(tmp_path / "o"), "--particles", "99999999"]
    done = subprocess.run(
        [sys.executable, "-c", code, *line],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "whole number from 1 to" in done.stderr


def test_a_summary_is_valid_json_even_where_nothing_is_known(place, tmp_path):
    assert main(["run", "7", "--data", str(place / "data"), "--out", str(tmp_path), "--particles", "1"]) == 0
    text = (tmp_path / "summary.json").read_text(encoding="utf-8")
    json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))


def test_one_scan_is_a_recording(tmp_path):
    box = box_recording(2.0, images=0)
    one = dataclasses.replace(
        box, lidar=dataclasses.replace(box.lidar, t=box.lidar.t[:1], ranges=box.lidar.ranges[:1])
    )
    result = run_slam(one)
    assert len(result.infos) == 1
    assert result.grid.occupied.any()
