"""Lost or not: made-up scores with a known answer, whole runs without an alarm, robots that are carried off."""

from dataclasses import replace

import numpy as np
import pytest

import pfslam
from pfslam.evaluation.trajectory import relations_error, trajectory_error
from pfslam.io.course import load_course
from pfslam.io.formats import read_relations
from pfslam.refined.health import (
    ALONG_METRES,
    DRAGGED_METRES,
    LEAST_PAST,
    LOST_BELOW,
    alarms,
    distrust,
    in_doubt,
    lost,
    score_deviation,
    was_dragged,
)
from pfslam.run import run_slam
from pfslam.slam import SlamConfig, Step
from pfslam.study.disturbances import first_seconds, kidnap

CONFIG = replace(SlamConfig.refined(), particles=10)


def infos(scores, matched=True, drawn=True):
    """A run with these scores, ten a second."""
    flags = np.broadcast_to(matched, len(scores)), np.broadcast_to(drawn, len(scores))
    return [
        Step(0.1 * k, np.zeros(3), None, 1.0, 500, 0, matched=bool(m), drawn=bool(d), score=float(score))
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


# What is not to be trusted
# ------------------------------------------------------------------------------------------------


def steady(count=400, **what):
    """A run of eight scans a second that drives 0.1 m between two of them; ``what[name][k]`` changes scan k."""
    changes = [{name: values[k] for name, values in what.items()} for k in range(count)]
    ordinary_step = {"matched": True, "drawn": True, "score": 0.95}
    return [
        Step(k / 8, np.array([0.1 * k, 0.0, 0.0]), None, 1.0, 500, 0, **(ordinary_step | change))
        for k, change in enumerate(changes)
    ]


def pulled(step, unexplained, during=slice(200, 216), count=400):
    """Departures of ``step`` metres a scan to one side and back to none, and the share of beams unexplained."""
    departure, share = np.zeros((count, 2)), np.zeros(count)
    departure[during, 1], share[during] = step, unexplained
    return {"departure": departure, "unexplained": share}


def test_a_steady_run_is_trusted():
    assert distrust(steady()) == []
    assert distrust([]) == []
    assert distrust(steady(1)) == []


def test_scans_that_drag_the_estimate_past_unexplained_beams_are_named_from_then_on():
    (found,) = distrust(steady(**pulled(0.03, 0.1)))
    # The seventh scan of 0.03 m passes 0.2 m; from then on nothing takes the error out of the map.
    assert found["from"] == 206 / 8
    assert found["to"] is None
    assert found["reason"].startswith("scans moved the estimate 0.21 m from its odometry within 2 s")


@pytest.mark.parametrize(
    ("step", "unexplained", "during"),
    [
        pytest.param(0.03, 0.0, slice(200, 216), id="wheels slip, and walls explain every beam"),
        pytest.param(0.01, 0.3, slice(200, 216), id="people about, and the estimate stays"),
        pytest.param(0.03, 0.1, slice(0, 400, 8), id="a small pull once a second"),
    ],
)
def test_a_pull_or_strange_beams_alone_are_trusted(step, unexplained, during):
    assert distrust(steady(**pulled(step, unexplained, during))) == []


def test_pulls_to_and_fro_cancel():
    changes = pulled(0.05, 0.1, slice(100, 300))
    changes["departure"][::2] *= -1.0
    assert distrust(steady(**changes)) == []


def test_scans_far_apart_are_not_judged_by_what_odometry_says_between_them():
    """A log with a scan every three seconds: its odometry may drift 0.3 m between two."""
    sparse = [replace(info, t=3.0 * info.t * 8) for info in steady(**pulled(0.3, 0.1))]
    assert distrust(sparse) == []
    assert DRAGGED_METRES < 0.3


@pytest.mark.parametrize(("blind", "flagged"), [(15, False), (16, True), (80, True)])
def test_a_blind_stretch_lasts_from_the_last_scan_to_the_next(blind, flagged):
    seen = np.ones(400, dtype=bool)
    seen[100 : 100 + blind] = False
    found = distrust(steady(matched=seen, drawn=seen))
    assert [(d["from"], d["to"]) for d in found] == ([(99 / 8, (100 + blind) / 8)] if flagged else [])


def test_a_run_that_ends_blind_stays_in_doubt():
    seen = np.arange(400) < 300
    (found,) = distrust(steady(matched=seen, drawn=seen))
    assert (found["from"], found["to"]) == (299 / 8, None)


def test_ten_metres_of_bare_corridor_are_in_doubt_and_nine_are_not():
    for metres, flagged in ((0.9 * ALONG_METRES, False), (1.1 * ALONG_METRES, True)):
        free = [np.array([1.0, 0.0]) if 100 <= k < 100 + 10 * metres else None for k in range(400)]
        found = distrust(steady(free_direction=free))
        assert bool(found) == flagged
        assert all(d["to"] is None and "no wall shows the way along" in d["reason"] for d in found)


def test_reasons_come_in_order_of_time():
    scores = np.append(ordinary(300), np.full(100, 0.3))
    seen = np.ones(400, dtype=bool)
    seen[200:240] = False
    found = distrust(steady(score=scores, matched=seen, drawn=seen, **pulled(0.04, 0.1, slice(100, 120))))
    assert [d["from"] for d in found] == sorted(d["from"] for d in found)
    assert [d["reason"].split()[0] for d in found] == ["scans", "no", "scans"]


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


@pytest.mark.nightly
def test_sparse_real_scans_raise_no_alarm(real_data):
    log = pfslam.load(real_data / "intel" / "intel.log")
    result = run_slam(log, CONFIG)
    known = read_relations(real_data / "intel" / "intel.relations").at_stamps(log.lidar.t)
    assert relations_error(result.trajectory, known.t1, known.t2, known.poses)[0].mean() < 0.03
    assert len(alarms(result.infos)) == 0
    assert result.distrust == []
    assert result.config.outliers is None, "a second look is in doubt for longer, so the first one stands"


@pytest.mark.slow
def test_a_robot_that_was_carried_off_is_in_doubt_from_then_on(carried):
    taken, result = carried
    first = result.distrust[0]
    assert 0.0 <= first["from"] - (taken.encoders.t[0] + 50.0) <= 1.0
    assert first["to"] is None


@pytest.mark.nightly
def test_in_noise_a_second_look_still_sees_that_the_robot_was_carried_off(carried):
    """Careful runs believe odometry, which knows nothing of the way in between; the walls contradict it."""
    taken, _ = carried
    scans = taken.lidar
    noise = np.random.default_rng(0).normal(0.0, 0.06, scans.ranges.shape).astype(scans.ranges.dtype)
    noise[~taken.robot.lidar.valid(scans.ranges)] = 0.0
    noisy = replace(taken, lidar=replace(scans, ranges=np.maximum(scans.ranges + noise, 0.0)))
    result = run_slam(noisy, CONFIG, keep_particles=False)
    first = result.distrust[0]
    assert result.config.outliers is not None
    assert 0.0 <= first["from"] - (taken.encoders.t[0] + 50.0) <= 3.0
    assert first["to"] is None


@pytest.mark.nightly
def test_a_robot_among_people_says_that_it_was_dragged_along(real_data):
    """Seven people about, one walking ahead: one look is off by more than 0.3 m from 81 s on, and said so before."""
    recording = load_course("20", real_data / "hard" / "people20")
    result = run_slam(recording, replace(CONFIG, particles=200), second_look=False)
    found = trajectory_error(result.trajectory, recording.truth)
    assert found.ate_max_m > 0.3, "then this drive is no test any more"
    assert result.distrust[0]["from"] - recording.lidar.t[0] < 82.0
    assert result.distrust[0]["to"] is None


def test_matches_that_were_not_believed_leave_odometry_alone():
    rejected = np.zeros(400, bool)
    rejected[100:130] = True
    (doubt,) = distrust(steady(matched=~rejected, drawn=~rejected, rejected=rejected))
    assert doubt["from"] == pytest.approx(99 / 8)
    assert doubt["to"] == pytest.approx(130 / 8)
    assert "could be believed" in doubt["reason"]


def test_times_in_doubt_are_told_from_the_others():
    t = np.arange(6.0)
    stretches = [{"from": 1.0, "to": 2.0, "reason": ""}, {"from": 4.5, "to": None, "reason": ""}]
    assert in_doubt(stretches, t).tolist() == [False, True, True, False, False, True]
    assert not in_doubt([], t).any()


def test_a_robot_that_was_carried_off_before_is_not_misled():
    """Scans that contradict odometry after an alarm are right."""
    pulling = pulled(0.02, 0.05)
    scores = np.full(400, 0.9) + 0.01 * np.sin(np.arange(400))
    assert was_dragged(steady(**pulling, score=scores))
    first = int(np.argmax(pulling["unexplained"] > 0.0))
    scores[first - 5] = 0.1
    infos = steady(**pulling, score=scores)
    assert len(alarms(infos)) == 1
    assert not was_dragged(infos)


def test_only_scans_that_drag_mislead_a_run():
    assert was_dragged(steady(**pulled(0.02, 0.05)))
    assert not was_dragged(steady(**pulled(0.02, 0.0)))
    assert not was_dragged(steady())
    assert not was_dragged([])
