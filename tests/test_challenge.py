"""Twenty buildings: what is written, ranked by hand, and checked against the code that made it."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from pfslam_book import challenge as twenty
from pfslam_book.challenge import challenge, digest, made_by, rank
from pfslam_book.your_filter import BOOK, Filter, my_filter, step

from pfslam.errors import DataError


def entry(name, errors, code="def step(): ...\n"):
    """A file as a student hands it in."""
    seeds = list(range(len(errors)))
    content = {"name": name, "version": "0", "seconds": 60.0, "seeds": seeds, "errors": {"yours": errors}}
    return json.dumps(content | {"digest": digest(code), "code": code})


def test_a_class_is_ranked_by_buildings_and_then_by_the_median(tmp_path):
    for name, errors in {
        "lost one": [0.02, 0.02, 0.9],  # two below 0.1 m, median 0.02
        "steady": [0.09, 0.08, 0.07],  # three
        "stopped": [0.02, None, 0.01],  # two, median 0.02
        "nearly": [0.03, 0.05, 0.2],  # two, median 0.05
    }.items():
        (tmp_path / f"{name}.json").write_text(entry(name, errors))
    rows = rank(tmp_path).rows
    assert [row[1] for row in rows] == ["steady", "lost one", "stopped", "nearly"]
    assert rows[0] == ["1", "steady", "3 of 3", "0.080", "0.090", "its own"]
    assert rows[2][2:] == ["2 of 3", "0.020", "stopped", "its own"]


def test_a_source_that_was_changed_afterwards_is_named_and_junk_is_an_error(tmp_path):
    forged = json.loads(entry("forged", [0.01])) | {"code": "def step(): pass\n"}
    (tmp_path / "forged.json").write_text(json.dumps(forged))
    assert rank(tmp_path).rows[0][-1] == "ANOTHER"
    for junk in ("[]", "{}", "no JSON", json.dumps(forged | {"errors": {"yours": ["x"]}})):
        (tmp_path / "junk.json").write_text(junk)
        with pytest.raises(DataError, match="junk"):
            rank(tmp_path)


def stays(f, s, poses, weights, log_odds, points_b, inputs, rng):
    """A filter that never moves: its error is the distance from the start."""
    return poses, weights, log_odds, np.zeros(3)


def stops(*arguments):
    raise IndexError("off the map")


@pytest.mark.slow
def test_a_filter_is_driven_written_and_found_again(tmp_path, monkeypatch, capsys):
    reckoned = lambda recording, config: SimpleNamespace(trajectory=twenty.dead_reckoning(recording))  # noqa: E731
    monkeypatch.setattr(twenty, "run_slam", reckoned)  # the report's filter takes its time
    file, parts = tmp_path / "challenge.json", my_filter("none", move=lambda poses, *rest: poses)
    table = challenge(stays, parts, "A", seeds=[901], file=file, seconds=12.0)
    recording = twenty.building(901, 12.0)
    path = recording.true_path()
    far = np.hypot(*(path.poses - path.poses[0])[:, :2].T)
    written = json.loads(file.read_text())
    (off,) = written["errors"]["yours"]
    assert 0.2 * far.max() < off < far.max()
    assert written["errors"]["the book's"][0] < 0.1
    assert written["errors"]["the report's"] == written["errors"]["dead reckoning"]
    assert "def stays" in written["code"]
    assert "move=lambda" in written["code"]
    assert f"building 901: yours {off:.3f} m" in capsys.readouterr().out
    assert table.rows[1][:2] == ["the book's", "1 of 1"]
    assert made_by(file, stays, parts)
    assert "another source" in made_by(file, stays, Filter(**BOOK)).message
    assert "another source" in made_by(file, step, parts).message
    file.write_text(json.dumps(written | {"errors": {"yours": [0.01]}}))
    assert "the file says 0.01 m" in made_by(file, stays, parts).message
    assert twenty.off(twenty.filters(stops, parts)["yours"], recording) is None
