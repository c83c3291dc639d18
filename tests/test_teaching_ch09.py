"""Chapters 09 and 10: what their helpers compute, against values known beforehand."""

from dataclasses import replace

import numpy as np
import pytest
from pfslam_book import ch09, kinds
from pfslam_book.ch09 import judging
from pfslam_book.ch09 import walls as ch09_walls
from pfslam_book.ch09.tables import changed_fields, median_interval
from pfslam_book.kinds import kinds as ch09_kinds
from pfslam_book.show.tables import study_file

from pfslam.evaluation.trajectory import trajectory_error
from pfslam.poses import Trajectory, compose
from pfslam.slam import SlamConfig
from pfslam.study import read_study


def circle():
    s = np.linspace(0.0, 4.0, 50)
    return Trajectory(s, np.column_stack([3 * np.sin(s), 3 - 3 * np.cos(s), s]))


def test_best_fit_forgives_any_rigid_motion_and_nothing_else():
    truth = circle()
    moved = Trajectory(truth.t, compose(np.array([4.0, -2.0, 1.1]), truth.poses))
    assert judging.best_fit_rmse(moved, truth) == pytest.approx(0.0, abs=1e-9)
    stretched = Trajectory(truth.t, truth.poses * [1.1, 1.1, 1.0])
    centred = truth.poses[:, :2] - truth.poses[:, :2].mean(axis=0)
    expected = 0.1 * np.sqrt(np.mean(np.sum(centred**2, axis=1)))
    assert judging.best_fit_rmse(stretched, truth) == pytest.approx(expected)


def test_one_wrong_first_heading_shows_by_first_pose_and_nearly_vanishes_in_the_fit():
    truth = circle()
    wrong = judging.turned_start(truth, 1.0)
    distance = np.hypot(*(truth.poses[:, :2] - truth.poses[0, :2]).T)
    expected = np.sqrt(np.mean((2 * np.sin(np.deg2rad(0.5)) * distance) ** 2))
    assert trajectory_error(wrong, truth).ate_rmse_m == pytest.approx(expected)
    assert judging.best_fit_rmse(wrong, truth) < 1e-9


def test_lineages_follow_the_ancestors():
    clouds = np.arange(12.0).reshape(3, 4, 1) * np.ones(3)
    ancestors = np.array([[0, 0, 2, 3], [1, 1, 1, 2], [0, 1, 2, 3]])
    run = ch09_kinds.Histories(None, np.arange(3.0), clouds, ancestors, np.array([2]), ())
    assert run.lineages(2).tolist() == [[0, 0, 0, 2], [1, 1, 1, 2], [0, 1, 2, 3]]
    assert run.alive(2).tolist() == [2, 2, 4]
    assert run.paths(2)[0, :, 0].tolist() == [0.0, 0.0, 0.0, 2.0]


def test_two_places_that_only_their_beams_tell_apart():
    points = ch09_walls.scan_without_inner_wall()
    places = [ch09_walls.room(inner) for inner in (False, True)]
    assert [ch09_walls.field_score(place, points) for place in places] == [1.0, 1.0]
    shares = [ch09_walls.blocked_share(place, points) for place in places]
    assert shares[0] == 0.0
    assert shares[1] == pytest.approx(np.mean(points[:, 1] > 0), abs=0.02)


def test_every_rung_changes_one_setting_or_one_idea_and_the_last_is_the_refined_filter():
    changes = changed_fields("ch09_ladder")
    assert all(changes.values())
    assert [label for label, fields in changes.items() if "," in fields] == ["+ draw after motion"]
    last = read_study(study_file("ch09_ladder")).cases[-1].config()
    refined = replace(SlamConfig.refined(), particles=last.particles, every=last.every)
    assert last == refined


def test_what_taking_one_away_changes_is_what_its_rung_added():
    cases = {case.label: case for case in read_study(study_file("ch09_leave_one_out")).cases}
    whole = dict(cases["nothing"].settings)
    changes = changed_fields("ch09_ladder")
    for label, case in cases.items():
        if f"+ {label}" in changes:
            fields = {key.split(".")[-1] for key, value in case.settings if whole.get(key) != value}
            assert fields
            assert fields <= set(changes[f"+ {label}"].replace(",", " ").split())


def test_the_hard_ladder_is_the_ladder_in_buildings_with_hazards():
    plain, hard = (read_study(study_file(name)).cases for name in ("ch09_ladder", "ch09_hard_ladder"))
    assert list(dict.fromkeys(c.label for c in hard)) == list(dict.fromkeys(c.label for c in plain))
    clean = {(c.label, c.get("simulator.seed")): dict(c.settings) for c in plain}
    for case in hard:
        settings = {k: v for k, v in case.settings if not k.startswith("simulator.hazards.")}
        assert settings == clean[case.label, case.get("simulator.seed")]
    rungs = [row[0] for row in ch09.hard_ladder_table().rows]
    assert rungs == ch09.decided(ch09.steps(ch09.hard_ladder()))


HARD = [
    ("ch09_leave_one_out", "ch09_hard_leave_one_out", {"every"}),
    ("ch09_kinds", "ch09_hard_kinds", {"every"}),
]


@pytest.mark.parametrize(("plain", "hard", "other"), HARD)
def test_hard_studies_differ_by_their_hazards_and_how_many_scans_they_use(plain, hard, other):
    cases = {
        (c.label, c.get("simulator.seed")): dict(c.settings) for c in read_study(study_file(plain)).cases
    }
    for case in read_study(study_file(hard)).cases:
        settings = dict(case.settings)
        assert "simulator.hazards.slip" in settings
        wanted = cases[case.label, case.get("simulator.seed")]
        apart = {key for key in settings if settings[key] != wanted.get(key)}
        assert {key for key in apart if not key.startswith("simulator.hazards.")} == other


@pytest.mark.parametrize(("n", "ends"), [(6, (0, 5)), (10, (1, 8)), (20, (5, 14))])
def test_the_interval_of_a_median_misses_it_in_one_sample_of_twenty_at_most(n, ends):
    """The ends by tables of the sign test; and in samples of normal numbers the median is 0."""
    assert median_interval(np.arange(float(n))) == ends
    samples = np.random.default_rng(0).normal(size=(4000, n))
    held = [low <= 0 <= high for low, high in map(median_interval, samples)]
    assert 0.945 <= np.mean(held) <= 0.985


def test_a_proposal_that_knows_the_scan_wastes_no_particle():
    case = kinds.Proposals()
    assert case.n_eff(True) == pytest.approx(case.n)
    assert case.n_eff(False) < 0.3 * case.n
    exact = (case.seen / case.sigma_scan**2) / (1 / case.sigma_scan**2 + 1 / case.sigma_motion**2)
    assert case.drawn(True)[0].mean() == pytest.approx(exact, abs=0.003)
