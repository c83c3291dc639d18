"""Chapter 09: its studies are what the page says they are, and its interval keeps its promise."""

from dataclasses import replace

import numpy as np
import pytest
from pfslam_book import ch09
from pfslam_book.ch09.tables import HARD_LADDER, LADDER, changed_fields, median_interval, paired
from pfslam_book.show.tables import select, study_file

from pfslam.evaluation.trajectory import trajectory_error
from pfslam.poses import Trajectory, transform_points
from pfslam.slam import SlamConfig
from pfslam.study import read_study


def cases_of(name):
    return read_study(study_file(name)).cases


def test_the_reports_drift_is_cured_by_gentle_clearing_and_by_no_other_change():
    errors = ch09.errors_by_label(ch09.read_table("ch09_report"))
    assert errors["gentle clearing"].max() < errors["report"].min()
    for other in ("likelihood weights, resampling at N/2", "mean as estimate", "known start"):
        assert np.median(errors[other]) > 3.0 * errors["gentle clearing"].max()
    scoring = ch09.lattice_medians()
    assert scoring["exact"] < scoring["lattice"]
    assert scoring["low"] < scoring["exact"] - scoring["lattice"] < scoring["high"] < 0


def test_every_rung_changes_one_setting_or_one_idea_and_the_last_is_the_refined_filter():
    changes = changed_fields(LADDER)
    assert all(changes.values())
    assert [label for label, fields in changes.items() if "," in fields] == ["+ draw after motion"]
    last = cases_of(LADDER)[-1].config()
    # The ladder's scanner has four beams to the degree: there is nothing to fill in, and never are beams few.
    same = {name: getattr(last, name) for name in ("particles", "every", "beam_spacing", "min_beams")}
    assert last == replace(SlamConfig.refined(), **same)


def test_hard_drives_differ_from_the_ladders_by_their_hazards():
    clean = {(c.label, c.get("simulator.seed")): dict(c.settings) for c in cases_of(LADDER)}
    for case in cases_of(HARD_LADDER):
        settings = dict(case.settings)
        assert "simulator.hazards.slip" in settings
        wanted = clean[case.label, case.get("simulator.seed")]
        apart = {key for key in settings if settings[key] != wanted.get(key)}
        assert all(key.startswith("simulator.hazards.") for key in apart)


def test_the_table_of_hard_drives_holds_what_is_decided_and_every_comparison_of_particles():
    found = ch09.hard_comparisons()
    shown = {tuple(row[:2]) for row in ch09.hard_table().rows}
    assert {key for key, pair in found.items() if ch09.is_decided(*pair)} <= shown
    assert {key for key in found if not key[1].startswith("+")} <= shown
    assert all(len(before) == len(after) == 10 for before, after in found.values())


@pytest.mark.parametrize(("n", "ends"), [(6, (0, 5)), (10, (1, 8)), (20, (5, 14))])
def test_the_interval_of_a_median_misses_it_in_one_sample_of_twenty_at_most(n, ends):
    """The ends by tables of the sign test; and in samples of normal numbers the median is 0."""
    assert median_interval(np.arange(float(n))) == ends
    samples = np.random.default_rng(0).normal(size=(4000, n))
    held = [low <= 0 <= high for low, high in map(median_interval, samples)]
    assert 0.945 <= np.mean(held) <= 0.985


def test_pairs_that_do_not_differ_are_called_the_same_runs():
    errors = np.linspace(0.1, 0.2, 8)
    assert paired(errors, errors)[1] == "the same runs"
    assert paired(errors, errors - 0.05) == ("-5.0", "-5.0 to -5.0", "8")


def test_the_graph_is_decided_in_rings_and_private_maps_are_where_the_page_says_so():
    for percent in (3, 6):
        for column in ("ate_rmse_m", "return_m"):
            assert ch09.nearer("scan matching, loops closed", "ring", percent, column) == 6
    found = {}
    for method, percent in (("own maps, 10", 3), ("own maps, 30", 3), ("own maps, 10", 6)):
        for place in ("corridor", "ring"):
            for column in ("ate_rmse_m", "return_m"):
                found[method, percent, place, column] = ch09.nearer(method, place, percent, column)
    assert len(found) == 12
    decided = {key for key, wins in found.items() if wins in (0, 6)}
    assert decided == {
        ("own maps, 10", 6, "corridor", "ate_rmse_m"),
        ("own maps, 30", 3, "corridor", "return_m"),
    }


def test_the_stored_drive_has_the_errors_of_its_row_in_the_study_and_its_lines_are_unbroken():
    drive, table = ch09.parted(), ch09.read_table("ch09_private")
    rows = select(table, place="corridor", percent=6.0, building=2.0)
    truth, cloud = Trajectory(drive.t, drive.truth), drive.hypotheses
    last, heaviest = len(cloud) - 1, [int(np.argmax(drive.log_weights[-1]))]
    for k in range(last - 1, -1, -1):
        heaviest.insert(0, drive.parents[k, heaviest[0]])
    found = {
        ("own maps, 10", "ate_rmse_m"): drive.told,
        ("own maps, 10", "path_rmse_m"): cloud[np.arange(last + 1), heaviest],
        ("shared map, 30", "ate_rmse_m"): drive.shared,
    }
    for (label, column), poses in found.items():
        error = trajectory_error(Trajectory(drive.t, poses), truth).ate_rmse_m
        assert error == pytest.approx(select(rows, label=label)[column].item(), abs=1e-4)
    for column in ("ate_rmse_m", "return_m"):
        own = select(table, place="corridor", percent=6.0, label="own maps, 10")
        assert np.argsort(own[column])[2] == 1, "the caption: third best of six"
        assert ch09.nearer("own maps, 10", "corridor", 6, column) == (6 if column == "ate_rmse_m" else 5)
    begin = np.take_along_axis(cloud[:-1], drive.parents[:-1, :, None].astype(int), axis=1)
    moved = np.linalg.norm(np.diff(drive.truth[:, :2], axis=0), axis=1)[:, None]
    assert (np.abs(np.linalg.norm((cloud[1:] - begin)[..., :2], axis=2) - moved) < 0.5).all()
    assert (drive.parents[~drive.resampled] == np.arange(10)).all()


def ends_of_the_corridor(drive, poses):
    """Where along the corridor its near end stands (m), by the last two scans from these poses."""
    walls = [
        transform_points(pose, points) for pose, points in zip(poses[-2:], drive.points[-2:], strict=True)
    ]
    x, y = np.concatenate(walls).T
    return x[np.abs(y - 0.2) < 0.8]


def test_the_shared_map_tears_and_the_private_one_closes():
    """The corridor begins 2 m behind the start, and its walls stand 1 m to the left and the right of its middle."""
    drive = ch09.parted()
    for points, pose in zip(drive.points, drive.truth, strict=True):
        if len(points):
            x, y = transform_points(pose, points).T
            on_a_side, at_the_end = np.abs(np.abs(y - 0.2) - 1.0) < 0.25, np.abs(x + 2.0) < 0.15
            assert (on_a_side | at_the_end).all()
            assert x.max() < 9.1
    heaviest = np.argmax(drive.log_weights[-1])
    own = [drive.hypotheses[-2, drive.parents[-2, heaviest]], drive.hypotheses[-1, heaviest]]
    np.testing.assert_allclose(ends_of_the_corridor(drive, drive.truth), -2.0, atol=0.1)
    np.testing.assert_allclose(ends_of_the_corridor(drive, own), -2.0, atol=0.5)
    assert (ends_of_the_corridor(drive, drive.shared) > -1.0).all()


def test_all_that_live_at_the_return_share_one_history_to_the_far_end():
    """The answer to question 3: their maps of it are the same."""
    drive = ch09.parted()
    far, heirs = int(np.argmax(drive.truth[:, 0])), set(range(10))
    for parents in drive.parents[far:-1][::-1]:
        heirs = set(parents[list(heirs)].tolist())
    assert len(heirs) == 1
