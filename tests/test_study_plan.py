"""The plan for many runs, against sums done by hand."""

import numpy as np
import pytest
from study_plan import OVERHEAD, cost_lines, plan, plan_lines, read_overhead

ROUND = {
    "start of a worker": 2.0,
    "handing out a run, Dask": 5.0,
    "check whether a run is kept": 0.1,
    "a kept run": 700.0,
    "a row of the table": 300.0,
    "a case waiting": 1000.0,
}


def test_a_million_runs_by_hand():
    big = plan(1_000_000, 1000, 10.0, 250.0, ROUND)
    assert big.core_hours == pytest.approx(10_000_000 / 3600)
    assert big.hours == pytest.approx((10_000 + 2) / 3600)
    assert big.start_hours == pytest.approx(2000 / 3600)
    assert big.memory_gb == pytest.approx(250)
    assert big.runs_per_second == pytest.approx(1e6 / 10_002)
    assert big.dispatch_share == pytest.approx(5000 / 10_002)  # 5 ms a run on one process
    assert (big.cases_gb, big.table_gb) == pytest.approx((1.0, 0.3))
    assert big.disk_gb == pytest.approx(4.096)  # a block for each file of 700 bytes
    assert big.check_minutes == pytest.approx(100 / 60)


def test_tables_have_a_line_for_each_row_and_a_column_for_each_plan():
    plans = [plan(1000, 2, 10.0, 250.0, ROUND), plan(1_000_000, 1000, 10.0, 250.0, ROUND)]
    lines = plan_lines(plans).splitlines()
    assert lines[0] == "| runs | 1,000 | 1,000,000 |"
    assert {line.count("|") for line in lines} == {4}
    table = {
        "label": np.array(["a", "b"]),
        "particles": np.array([50, np.nan]),
        "cpu_seconds": np.array([10.0, 0.5]),
        "scans": np.array([1000.0, 1000.0]),
        "peak_mb": np.array([250.0, 240.0]),
        "ate_rmse_m": np.array([0.0123, 0.5]),
    }
    assert cost_lines(table).splitlines()[2:] == [
        "| a | 50 | 10 | 10 | 250 | 0.012 |",
        "| b | - | 0.5 | 0.5 | 240 | 0.500 |",
    ]


def test_the_stored_measurement_has_every_figure():
    assert OVERHEAD.is_file()
    assert set(ROUND) <= set(read_overhead())
