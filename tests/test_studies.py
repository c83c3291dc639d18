"""The stored tables that chapters draw from: they belong to their studies, and some rows are run again.

On the machine and with the libraries that made a table its numbers return to the last digit. Elsewhere they agree
within the study's own tolerance. Where a study states none its runs are chaotic, a last bit grows into centimetres,
and the errors must lie within three times the spread of the table.
"""

import csv
import json
import os
from functools import cache

import pytest
from conftest import REAL_DATA
from pfslam_book.show.tables import read_provenance, stored_studies, study_file

from pfslam.study import read_study, run_case
from pfslam.study.provenance import machine, versions
from pfslam.study.run import COSTS
from pfslam.study.table import _cell

BUDGET, WEEKLY = 8.0, 40.0
"""Processor seconds for all runs together, as the tables state them: of every test run, and once a week."""
BAND = 3.0
NAMES = stored_studies()


@pytest.fixture(autouse=True)
def data_folder(monkeypatch):
    """Recordings that are not part of the package, where they are at hand."""
    if "PFSLAM_DATA" not in os.environ and REAL_DATA.is_dir():
        monkeypatch.setenv("PFSLAM_DATA", str(REAL_DATA))


@cache
def stored(name):
    with open(study_file(name, ".csv"), newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def spot_rows(name, budget):
    """Numbers of the rows that are run again: the cheapest of each variant, as far as the budget goes."""
    rows, cheapest = stored(name), {}
    for number, row in enumerate(rows):
        if not row["error"].startswith("WorkerDied"):
            best = cheapest.setdefault(row["label"], number)
            cheapest[row["label"]] = min(best, number, key=lambda n: float(rows[n]["cpu_seconds"]))
    chosen, spent = [], 0.0
    for number in sorted(cheapest.values(), key=lambda n: float(rows[n]["cpu_seconds"])):
        spent += float(rows[number]["cpu_seconds"])
        if not chosen or spent <= budget / len(NAMES):
            chosen.append(number)
    return chosen


def test_there_are_stored_studies():
    assert "example" in NAMES


@pytest.mark.parametrize("name", stored_studies())
def test_every_study_has_its_table_with_a_row_for_each_case(name):
    study, rows = read_study(study_file(name)), stored(name)
    assert study.name == name
    assert study.about
    assert len(rows) == len(study.cases)
    for case, row in zip(study.cases, rows, strict=True):
        assert row["label"] == case.label
        for key, value in case.settings:
            assert row[key] == _cell(value), f"{name}: {case.label}: {key}"
    provenance = read_provenance(name)
    assert provenance["runs"] == len(rows)
    assert provenance["failed"] == sum(bool(row["error"]) for row in rows)


def rows_to_run():
    """Some rows of every study; those that are run once a week are marked."""
    for name in NAMES:
        often = spot_rows(name, BUDGET)
        for number in spot_rows(name, WEEKLY):
            yield pytest.param(name, number, marks=[] if number in often else pytest.mark.weekly)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "number"), list(rows_to_run()))
def test_a_row_comes_out_again(name, number):
    case, row = read_study(study_file(name)).cases[number], stored(name)[number]
    found = run_case(case)
    if found["error"] and "data set" in found["error"] and not row["error"]:
        pytest.skip(f"{case.get('dataset')} is not here")
    found = {key: _cell(value) for key, value in found.items() if key not in COSTS}
    wanted = {key: row[key] for key in found}
    provenance = read_provenance(name)
    if same_machine(provenance):
        assert found == wanted
    elif provenance["tolerance"] is not None:
        assert close(found, wanted, provenance["tolerance"])
    else:
        assert_within_band(name, found)


def close(found, wanted, tolerance):
    """Whether all numbers agree within a relative tolerance, and all words exactly."""
    for key, text in wanted.items():
        value = number_of(text)
        if value is None:
            assert found[key] == text, key
        else:
            assert number_of(found[key]) == pytest.approx(value, rel=tolerance, abs=1e-9), key
    return True


def number_of(text):
    try:
        return float(text)
    except ValueError:
        return None


def assert_within_band(name, found):
    """The errors lie within three times the spread of the rows of the same variant and data set."""
    family = [r for r in stored(name) if (r["label"], r["dataset"]) == (found["label"], found["dataset"])]
    assert found["error"] == ""
    for key in ("ate_rmse_m", "relation_xy_m"):
        values = [float(r[key]) for r in family if r.get(key)]
        if values:
            assert min(values) / BAND <= float(found[key]) <= max(values) * BAND, key


def test_the_comparison_sees_a_changed_digit():
    row = {"label": "a", "ate_rmse_m": "0.0123456789012345", "error": ""}
    assert close(row, row, 1e-6)
    with pytest.raises(AssertionError):
        close(row | {"ate_rmse_m": "0.0123457789012345"}, row, 1e-6)
    with pytest.raises(AssertionError):
        close(row | {"label": "b"}, row, 1e-6)


def same_machine(provenance):
    """Whether a table was made with these libraries on this kind of processor: then numbers agree to the last bit."""
    there = {"features": machine()["features"]} | provenance["machine"]
    libraries = ("numpy", "opencv", "python")
    return all(there[key] == value for key, value in machine().items()) and all(
        provenance["versions"][name] == versions()[name] for name in libraries
    )


def test_provenance_knows_another_machine():
    provenance = read_provenance("example")
    other = json.loads(json.dumps(provenance))
    other["versions"]["numpy"] = "0.1"
    assert not same_machine(other)
    other = json.loads(json.dumps(provenance))
    other["machine"]["processor"] = "abacus"
    assert not same_machine(other)
