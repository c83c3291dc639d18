"""``make bench``: a whole run is timed, and its scans are counted. Nothing here depends on speed."""

import re

import bench
from box_recording import box_recording


def test_a_drive_in_a_map_of_some_width_is_timed(monkeypatch):
    monkeypatch.setattr(bench, "WIDTHS", (60.0,))
    (line,) = bench.map_sizes(box_recording(images=0))
    found = re.fullmatch(r"about  60 m wide +([\d.]+) ms a scan +(nan|\d+) MB", line)
    assert found
    assert float(found[1]) > 0
    assert bench.used_scans(box_recording(images=0), 5) == 11
