"""The stored tables that chapters draw from: they belong to their studies, and at night some rows are run again.

On the machine and with the libraries that made a table its numbers return. Elsewhere they agree within the study's own
tolerance. Where a study states none its runs are chaotic, a last bit grows into centimetres, and the errors must lie
within three times the spread of the table.
"""

import csv
import os
import re
import sys
from functools import cache

import numpy as np
import pytest
from conftest import REAL_DATA, ROOT
from pfslam_book.ch09.tables import PARTED
from pfslam_book.show.tables import read_provenance, stored_studies, study_file

from pfslam.settings import changed
from pfslam.slam import SlamConfig
from pfslam.study import run_case
from pfslam.study.provenance import machine, versions
from pfslam.study.run import COSTS, OFF
from pfslam.study.table import _cell

BUDGET = 40.0
"""Processor seconds for all runs together, as the tables state them."""
BAND = 3.0
SAME = 1e-9
"""Sums of many numbers may end in another bit where their library adds them in another order."""
ABSENT = re.compile("data set: found|data folder: found no such folder")
"""What the error says of a recording that is not part of the package, where it is not at hand."""
NAMES = stored_studies()
FIGURES = ("ate_max_m", "failed", "stopped", "doubted", "to_the_end")
sys.path.append(str(ROOT / "book" / "_tools"))
from measure.ch09 import parted  # noqa: E402
from measure.robots import BUILDINGS, GROUPS, HARD, PAIRS  # noqa: E402
from measure.trust import RIGHT, WITHOUT  # noqa: E402
from studies import definition  # noqa: E402


@pytest.fixture(autouse=True)
def data_folder(monkeypatch):
    """Recordings that are not part of the package, where they are at hand."""
    if "PFSLAM_DATA" not in os.environ and REAL_DATA.is_dir():
        monkeypatch.setenv("PFSLAM_DATA", str(REAL_DATA))


@cache
def stored(name):
    with open(study_file(name, ".csv"), newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_robots_with_one_fault_are_never_wrong_and_silent_nor_right_and_in_doubt_to_the_end():
    """What the page on trust says of its table of robots."""
    rows = [{k: float(r[k] or "nan") for k in FIGURES} | {"kind": r["kind"]} for r in stored("trust_robots")]
    single = [row for row in rows if row["kind"] in {BUILDINGS, *GROUPS}]
    pairs = [row for row in rows if row["kind"] == PAIRS]
    assert len(single) == sum(map(len, [HARD, *GROUPS.values()]))
    assert (len(pairs), len(rows)) == (60, len(single) + 92)
    off = [[not row["ate_max_m"] <= OFF for row in some] for some in (single, pairs)]
    told = [[row["failed"] + row["stopped"] + row["doubted"] > 0 for row in some] for some in (single, pairs)]
    silent = [sum(o and not t for o, t in zip(*both, strict=True)) for both in zip(off, told, strict=True)]
    assert sum(off[0]) > 20
    assert sum(off[1]) > 30
    assert silent == [0, 0]
    right = [row for row in rows if row["ate_max_m"] <= RIGHT]
    assert len(right) > 70
    assert not any(row["to_the_end"] and not row["stopped"] for row in right)


def spot_rows():
    """The rows that are run again, of every study the cheapest of each variant, as far as the budget goes."""
    for name in NAMES:
        cheapest, spent = {}, 0.0
        for number, row in enumerate(stored(name)):
            if not row["error"].startswith("WorkerDied"):
                found = (float(row["cpu_seconds"]), number)
                cheapest[row["label"]] = min(cheapest.get(row["label"], found), found)
        for seconds, number in sorted(cheapest.values()):
            if not spent or spent + seconds <= BUDGET / len(NAMES):
                yield name, number
            spent += seconds


@pytest.mark.parametrize("name", NAMES)
def test_every_study_has_its_table_with_a_row_for_each_case(name):
    (study, _), rows = definition(name), stored(name)
    assert study.name == name
    for case, row in zip(study.cases, rows, strict=True):
        assert row["label"] == case.label
        for key, value in case.settings:
            assert row[key] == _cell(value), f"{name}: {case.label}: {key}"
    provenance = read_provenance(name)
    assert provenance["runs"] == len(rows)
    assert provenance["failed"] == sum(bool(row["error"]) for row in rows)


def test_what_the_table_of_ingredients_leaves_out_are_settings_of_these_names():
    """The study runs for an hour, and rarely: a setting that has been renamed would stop it at its end."""
    for without in WITHOUT.values():
        config = changed(SlamConfig.refined(), without.config)
        assert changed(config.robust(0.02), without.careful).outliers


@pytest.mark.nightly
@pytest.mark.parametrize(("name", "number"), list(spot_rows()))
def test_a_row_comes_out_again(name, number):
    study, _ = definition(name)
    case, row = study.cases[number], stored(name)[number]
    found = run_case(case, study.run)
    if not row["error"] and ABSENT.search(found["error"]):
        pytest.skip(f"{case.label}: {found['error']}")
    found = {key: _cell(value) for key, value in found.items() if key not in COSTS}
    provenance = read_provenance(name)
    tolerance = SAME if same_machine(provenance) else provenance["tolerance"]
    if tolerance is not None:
        assert_close(found, {key: row[key] for key in found}, tolerance)
    else:
        assert_within_band(name, found)


@pytest.mark.nightly
def test_the_stored_drive_of_private_maps_comes_out_again():
    """Bit by bit only where the study's own table was made: elsewhere its runs are chaotic."""
    if not same_machine(read_provenance("ch09_private")):
        pytest.skip("made on another machine")
    with np.load(PARTED, allow_pickle=False) as file:
        kept = dict(file)
    found = parted()
    assert found.keys() == kept.keys()
    for name, values in kept.items():
        np.testing.assert_allclose(found[name], values, atol=1e-6, err_msg=name)


def assert_close(found, wanted, tolerance):
    """All numbers agree within a relative tolerance, and all words exactly."""
    for key, text in wanted.items():
        try:
            value = float(text)
        except ValueError:
            assert found[key] == text, key
        else:
            assert float(found[key]) == pytest.approx(value, rel=tolerance, abs=1e-9), key


def assert_within_band(name, found):
    """The errors lie within three times the spread of the rows of the same variant and data set."""
    family = [r for r in stored(name) if all(r.get(key) == found.get(key) for key in ("label", "dataset"))]
    assert found["error"] == ""
    for key in ("ate_rmse_m", "relation_xy_m"):
        values = [float(r[key]) for r in family if r.get(key)]
        if values:
            assert min(values) / BAND <= float(found[key]) <= max(values) * BAND, key


def same_machine(provenance):
    """Whether a table was made with these libraries on this kind of processor."""
    there = {"features": machine()["features"]} | provenance["machine"]
    libraries = ("numpy", "opencv", "python")
    return all(there[key] == value for key, value in machine().items()) and all(
        provenance["versions"][name] == versions()[name] for name in libraries
    )
