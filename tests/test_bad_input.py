"""A campaign of damaged files and bad command lines: each ends in one line, or in a result that is right.

``make nightly`` tries 2,000 cases of each kind.
"""

import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from bag_files import FORMATS, Messages, rows_of, write_bag
from box_recording import box_recording

from pfslam.__main__ import main
from pfslam.errors import DataError
from pfslam.io.course import save_course
from pfslam.io.datasets import load
from pfslam.io.recordings import save
from pfslam.motion import dead_reckoning

CASES = int(os.environ.get("PFSLAM_CASES", "60"))
NUMBERS = [np.nan, np.inf, -np.inf, 0, -1, 1e300, -1e300, 1e18, 5e-324, 2**31, 1e12]
UNSIGNED = ["nanosec", "height", "width", "offset", "count", "point_step", "row_step"]
WHOLE = dict.fromkeys(UNSIGNED, (0, 2**32 - 1)) | {"datatype": (0, 255), "is_bigendian": (0, 1)}
LOG_WORDS = ["nan", "inf", "-1", "x", "1e400", "999999", "1e300", "\n", "0", "FLASER", "é", "9" * 400]
TYPES = ["f2", ">f8", "i1", "u8", "c16", "U5", "O", "?", "f4", "S3", "M8[s]"]
LOG = "PARAM robot_frontlaser_offset 0.1 1 h 1\n" + "".join(
    f"FLASER 20 {' '.join(['2.5'] * 20)} {k / 10} 0 0 {k / 10} 0 0 {10 + k} robot {10 + k}\n"
    for k in range(12)
)


@pytest.fixture(scope="module", params=["a set", "a log", "a recording", *FORMATS])
def good(request, tmp_path_factory):
    """A good recording of each kind: where it lies, and its files as bytes."""
    folder, box = tmp_path_factory.mktemp("good"), box_recording(2.0, images=2)
    path = folder / {"a set": "set", "a log": "a.log", "a recording": "drive.npz"}.get(request.param, "drive")
    if request.param == "a set":
        save_course(box, 7, path, image_every=1)
    elif request.param == "a log":
        path.write_text(LOG)
    elif request.param == "a recording":
        save(box, path)
    else:
        path = write_bag(path, request.param, rows_of(box, request.param == "ros1"))
    files = [p for p in sorted(folder.rglob("*")) if p.is_file()]
    return path.relative_to(folder), {p.relative_to(folder): p.read_bytes() for p in files}


def damaged_bytes(data, rng):
    """Cut off, flipped, with a piece put in or taken out, or noise altogether."""
    i, j = sorted(rng.integers(len(data), size=2))
    noise = rng.integers(0, 256, size=rng.integers(1, 60), dtype=np.uint8).tobytes()
    return [
        data[:i],
        data[:i] + noise + data[i + len(noise) :],
        data[:i] + noise + data[i:],
        data[:i] + data[j:],
        noise,
    ][rng.integers(5)]


def damage_field(path, rng):
    """Spoil one field of an archive: its values, its shape, its type, or its being there."""
    with np.load(path) as data:
        fields = dict(data)
    name = rng.choice([name for name, values in fields.items() if values.size])
    values = fields.pop(name)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # making the damage may overflow; reading it must not
        spoiled = [
            lambda: None,
            lambda: with_one(values.astype(float), rng.choice(NUMBERS), rng),
            lambda: values.T,
            lambda: values[..., : rng.integers(3)] if values.ndim else values[None, None],
            lambda: values.astype(rng.choice(TYPES)),
            lambda: values[..., ::-1] if values.ndim else -values,
            lambda: np.full(values.shape, rng.choice(NUMBERS)),
            lambda: values.astype(float) * rng.choice([-1, 0, 1e-3, 1e3, 1e9]),
            lambda: values[None],
        ][rng.integers(9)]()
    np.savez(path, **fields, **({} if spoiled is None else {name: spoiled}))


def with_one(values, number, rng):
    values = values.copy()
    values.flat[rng.integers(values.size)] = number
    return values


def use(recording):
    """Drive a recording by dead reckoning and look at every image."""
    dead_reckoning(recording)
    if recording.camera is not None:
        for k in recording.camera.disparity_index:
            recording.camera.read_disparity(k)
        for k in recording.camera.rgb_index:
            recording.camera.read_rgb(k)


def works_or_says_why(path, names):
    """A recording can be used, or ``DataError`` has one line of sensible length that holds one of ``names``."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            use(load(path))
        except DataError as error:
            line = str(error)
            assert "\n" not in line
            assert len(line) < 600
            assert any(name in line for name in names), line


def damage(path, data, rng):
    """Write a file with its bytes damaged or, more often, a field of an archive or a few words of a log."""
    path.write_bytes(data)
    if path.suffix == ".npz" and rng.random() < 0.7:
        damage_field(path, rng)
    elif path.suffix == ".log" and rng.random() < 0.6:
        words = data.decode().split(" ")
        for at in rng.integers(len(words), size=rng.integers(1, 4)):
            words[at] = rng.choice(LOG_WORDS)
        path.write_text(" ".join(words), encoding="latin-1")
    else:
        path.write_bytes(damaged_bytes(data, rng))


@pytest.mark.parametrize("seed", range(CASES // 4))
def test_damaged_files(good, tmp_path, seed):
    rng, (path, files) = np.random.default_rng(seed), good
    for name, data in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(data)
    victim = Path(rng.choice([str(name) for name in files]))
    damage(tmp_path / victim, files[victim], rng)
    # Streams that no longer overlap are named by the recording, everything else by the file.
    works_or_says_why(tmp_path / path, [victim.name, path.name, ": imu time_stamps"])


@pytest.mark.parametrize("seed", range(CASES // 4))
def test_bags_of_damaged_messages(tmp_path, seed):
    """One number of one message, or of all of a kind, is spoiled; every third bag has clouds in the place of scans."""
    rng, rows = np.random.default_rng(seed), rows_of(box_recording(2.0, images=0))
    rows = [as_cloud(row) if row[0] == "/scan" else row for row in rows] if seed % 3 == 2 else rows
    scans = "/points" if seed % 3 == 2 else "/scan"
    topic = rng.choice([scans, "/odom", "/tf_static"], p=[0.5, 0.3, 0.2])
    messages = [message for name, _, message in rows if name == topic]
    place, number = rng.random(), float(rng.choice(NUMBERS))
    for message in messages if rng.random() < 0.5 else [messages[rng.integers(len(messages))]]:
        spoil(message, place, number)
    path = write_bag(tmp_path / "drive", "mcap", rows)
    works_or_says_why(path, ["drive"])


def as_cloud(row):
    """The row of a scan with a cloud of its end points."""
    _, arrived, scan = row
    angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
    points = scan.ranges[:, None] * np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
    stamp = scan.header.stamp
    return "/points", arrived, Messages().cloud(stamp.sec + stamp.nanosec * 1e-9, points)


def spoil(message, place, number):
    """Set one field of a message, chosen by ``place`` from 0 to 1, to a number, as far as the field can hold it."""
    holders, parts = [], [message]
    for part in parts:
        for name, value in vars(part).items():
            inner = value if isinstance(value, list) else [value]
            parts += [item for item in inner if hasattr(item, "__msgtype__")]
            holders += [(part, name)] if isinstance(value, (int, float)) else []
    part, name = holders[int(place * len(holders))]
    least, most = WHOLE.get(name, (-(2**31), 2**31 - 1))
    limited = int(np.clip(np.nan_to_num(number), least, most))
    is_whole = isinstance(getattr(part, name), int)
    setattr(part, name, limited if is_whole else float(np.clip(number, -3e38, 3e38)))


def test_a_long_value_is_cut():
    line = str(DataError("file", "field", "9" * 5000, "less"))
    assert len(line) < 250
    assert line.endswith("..., expected less")


MAP = "image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


@pytest.mark.skipif(os.name != "posix", reason="there are no such pipes")
@pytest.mark.parametrize(
    ("line", "name"),
    [
        (["info", "7", "--data", "."], "Encoders7.npz"),
        (["locate", "map.yaml", "hall"], "map.yaml"),
        (["locate", "map.yaml", "hall"], "map.pgm"),
        (["study", "pipe.toml"], "pipe.toml"),
        (["run", "hall", "--config", "pipe.toml"], "pipe.toml"),
        (["info", "bag"], "bag/metadata.yaml"),
    ],
)
def test_nobody_waits_for_a_pipe(tmp_path, line, name):
    (tmp_path / "map.yaml").write_text(MAP, encoding="utf-8")
    (tmp_path / name).unlink(missing_ok=True)
    (tmp_path / name).parent.mkdir(exist_ok=True)
    os.mkfifo(tmp_path / name)
    words = [sys.executable, "-m", "pfslam", *line]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    assert "found a pipe or a device, expected a file" in done.stderr


@pytest.mark.skipif(os.name != "posix", reason="streams are closed the Unix way")
@pytest.mark.parametrize("closed", [">&-", "2>&-"])
def test_a_closed_stream_is_no_fault(closed, tmp_path):
    line = f"{sys.executable} -m pfslam info nothing {closed}"
    done = subprocess.run(line, shell=True, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "fault" not in done.stdout + done.stderr


# Command lines

PLAIN = """run simulate report study 7 8 -7 -- - .. . / 7.5 nan 1e9 0 -1 99999999999999999999 matching /dev/null ~
--data --out --seed --particles --every --method --texture --no-texture --images --help %s {0} $HOME
--set search.prior=off noise.xy=1e400 lines=[] =1 --config --quiet --json"""
WORDS = [*PLAIN.split(), "hall ", "", "a b", "a\nb", "x" * 5000, "\u0667", "ä.log", "--dataset=7", "\x00"]
GOOD = """run 7 --data DATA --out OUT --particles 2 --no-texture
run 7 --data DATA --out OUT --method report --particles 2 --every 9
run 7 --data DATA --out OUT --particles 2 --set search.sharpness=30 --config RUN
report 7 --data DATA --out OUT
study STUDY --out OUT --jobs 1
simulate hall --out OUT --seed 1""".splitlines()
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


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a small good set and a study of it."""
    folder = tmp_path_factory.mktemp("place")
    save_course(box_recording(2.0, images=0), 7, folder / "data")
    (folder / "small.toml").write_text(STUDY.replace("DATA", str(folder / "data")), encoding="utf-8")
    (folder / "run.toml").write_text(
        'particles = 2\nestimate = "best"\n[map]\nfree = 0.3\n', encoding="utf-8"
    )
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
    names |= {"RUN": str(place / "run.toml")}
    line = spoiled([names.get(word, word) for word in GOOD[rng.integers(len(GOOD) - 1)].split()], rng)
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
    # Whatever was written lies in the folder asked for, which may be this one, or in the default one.
    allowed = {"mine", "out", *line}
    assert "." in line or {name.split(os.sep)[0] for name in everything_in(tmp_path)} <= allowed, line
