"""Lost or not: made-up scores with a known answer, whole runs without an alarm, robots that are carried off."""

from dataclasses import replace

import numpy as np
import pytest

import pfslam
from pfslam.config import SlamConfig
from pfslam.evaluation.faults import first_seconds, kidnap
from pfslam.evaluation.trajectory import relations_error
from pfslam.io.formats import read_relations
from pfslam.runs import run_slam
from pfslam.slam import StepInfo
from pfslam.trust import LEAST_PAST, LOST_BELOW, alarms, lost, score_deviation

CONFIG = replace(SlamConfig.refined(), particles=10)


def infos(scores, matched=True, drawn=True):
    """A run with these scores, ten a second."""
    flags = np.broadcast_to(matched, len(scores)), np.broadcast_to(drawn, len(scores))
    return [
        StepInfo(0.1 * k, np.zeros(3), None, 1.0, 500, 0, matched=bool(m), drawn=bool(d), score=float(score))
        for k, (score, m, d) in enumerate(zip(scores, *flags, strict=True))
    ]


def ordinary(count, seed=0):
    """Scores about 0.95 with a normal lower side: 0.02 is one spread."""
    return 0.95 - 0.02 * np.abs(np.random.default_rng(seed).standard_normal(count))


def test_score_deviation_is_a_count_of_standard_deviations_of_a_normal_past():
    """The past ends 5 standard deviations above the last score; 400 scores give the spread to 8 %, 30 runs to 1.5 %."""
    found = []
    for seed in range(30):
        scores = 0.9 + 0.01 * np.random.default_rng(seed).standard_normal(500)
        scores[-1] = 0.85
        found.append(score_deviation(infos(scores))[-1])
    assert np.mean(found) == pytest.approx(-5.0, abs=0.3)


def test_scores_that_stay_as_they_were_raise_no_alarm():
    assert not lost(infos(ordinary(5000))).any()


@pytest.mark.parametrize("scale", [1.0, 0.3])
def test_a_fall_is_found_whatever_the_ordinary_score(scale):
    """The same threshold serves a LiDAR whose scans score 0.95 and one whose scans score 0.3."""
    scores = ordinary(300)
    scores[200:203] = 0.4
    found = lost(infos(scale * scores))
    np.testing.assert_array_equal(np.flatnonzero(found), [200, 201, 202])
    np.testing.assert_allclose(alarms(infos(scale * scores)), [20.0])


def test_falls_close_together_are_one_alarm_and_later_ones_another():
    scores = ordinary(400)
    scores[[100, 110, 130, 300]] = 0.3
    np.testing.assert_allclose(alarms(infos(scores)), [10.0, 30.0])


def test_blind_scans_and_the_first_ones_are_not_judged():
    scores = np.concatenate([ordinary(LEAST_PAST), [0.1] * 5, ordinary(20)])
    matched = np.ones(len(scores), dtype=bool)
    matched[LEAST_PAST : LEAST_PAST + 5] = False
    found = score_deviation(infos(scores, matched))
    assert np.isnan(found[: LEAST_PAST + 5]).all()
    assert np.isfinite(found[LEAST_PAST + 5 :]).all()
    assert len(alarms(infos(scores, matched))) == 0
    assert len(alarms(infos(np.full(LEAST_PAST, 0.9)))) == 0


def test_standing_still_does_not_narrow_what_is_ordinary():
    """Only scans that were drawn count as past: a thousand equal scores before the drive change nothing."""
    waiting = np.full(1000, 0.999)
    drive = ordinary(200)
    scores = np.concatenate([waiting, drive])
    drawn = np.concatenate([np.zeros(1000, bool), np.ones(200, bool)])
    np.testing.assert_array_equal(
        score_deviation(infos(scores, drawn=drawn))[1000:], score_deviation(infos(drive))
    )


def test_lost_scans_do_not_become_ordinary():
    scores = np.concatenate([ordinary(100), np.full(500, 0.3)])
    assert lost(infos(scores))[100:].all()


# Whole runs
# ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def hall():
    return first_seconds(pfslam.load("hall"), 75.0)


@pytest.fixture(scope="module")
def carried(hall):
    """The recording of a robot that is carried 6 m off after 50 s, and the run over it."""
    taken = kidnap(hall, 50.0, 6.0)
    return taken, run_slam(taken, CONFIG)


@pytest.mark.slow
def test_a_robot_that_is_carried_off_is_found_lost_within_a_second(carried):
    """Carried 6 m. The score falls from above 0.9 to less than half, and the run did nothing like it before."""
    taken, result = carried
    begin = taken.encoders.t[0] + 50.0
    jump = np.diff(taken.truth.at(np.array([begin - 0.1, begin + 0.1]))[:, :2], axis=0)
    assert np.hypot(*jump[0]) > 5.0
    when = alarms(result.infos) - begin
    assert len(when) == 1
    assert 0.0 <= when[0] <= 1.0
    score = np.array([info.score for info in result.infos])
    t = result.trajectory.t - begin
    assert score[(t > 0.0) & (t < 1.0)].min() < 0.5 * np.median(score[(t > -20.0) & (t < 0.0)])


@pytest.mark.slow
def test_after_it_the_scores_look_fine_again_though_the_robot_is_metres_off(carried):
    """Why an alarm is needed: the filter has drawn the new place over its map, and knows nothing of its error."""
    taken, result = carried
    late = result.trajectory.t > taken.encoders.t[0] + 55.0
    known = late & taken.truth.covers(result.trajectory.t)
    off = result.trajectory.poses[known] - taken.truth.at(result.trajectory.t[known])
    assert np.hypot(off[:, 0], off[:, 1]).min() > 2.0
    assert np.nanmin(score_deviation(result.infos)[late]) > LOST_BELOW


@pytest.mark.slow
def test_sparse_real_scans_raise_no_alarm(real_data):
    log = pfslam.load(real_data / "intel" / "intel.log")
    result = run_slam(log, CONFIG)
    known = read_relations(real_data / "intel" / "intel.relations").at_stamps(log.lidar.t)
    assert relations_error(result.trajectory, known.t1, known.t2, known.poses)[0].mean() < 0.03
    assert len(alarms(result.infos)) == 0
