"""Lost or not: made-up scores with a known answer, whole runs without an alarm, robots that are carried off."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pfslam
from pfslam.__main__ import main
from pfslam.evaluation.trajectory import relations_error
from pfslam.io.formats import read_relations
from pfslam.refined.health import (
    ALONG_METRES,
    COLUMNS,
    LEAST_PAST,
    SIGNS,
    UNSURE_METRES,
    Steps,
    alarms,
    departures,
    distrust,
    in_doubt,
    was_dragged,
)
from pfslam.refined.record import RefinedStep
from pfslam.run import run_slam
from pfslam.slam import SlamConfig
from pfslam.study.disturbances import first_seconds, kidnap

README = Path(__file__).resolve().parents[1] / "README.md"
CONFIG = replace(SlamConfig.refined(), particles=10)


def steady(count=400, **what):
    """A run of eight scans a second that drives 0.1 m between two of them; ``what[name][k]`` changes scan k."""
    changes = [{name: values[k] for name, values in what.items()} for k in range(count)]
    ordinary_step = {"matched": True, "drawn": True, "score": 0.95}
    return [
        RefinedStep(k / 8, np.array([0.1 * k, 0.0, 0.0]), None, 1.0, 500, **(ordinary_step | change))
        for k, change in enumerate(changes)
    ]


def infos(scores, **what):
    return steady(len(scores), score=scores, aligned_score=scores, **what)


def ordinary(count, seed=0):
    """Scores about 0.95 with a normal lower side: 0.02 is one spread."""
    return 0.95 - 0.02 * np.abs(np.random.default_rng(seed).standard_normal(count))


def score_deviation(run):
    """How far each score lies from those before it, in their spreads."""
    return Steps(run).judged()["deviation"][:, 0]


def test_score_deviation_is_a_count_of_standard_deviations_of_a_normal_past():
    """The past ends 5 standard deviations above the last score; 400 scores give the spread to 8 %, 30 runs to 1.5 %."""
    found = []
    for seed in range(30):
        scores = 0.9 + 0.01 * np.random.default_rng(seed).standard_normal(500)
        scores[-1] = 0.85
        found.append(score_deviation(infos(scores))[-1])
    assert np.mean(found) == pytest.approx(-5.0, abs=0.3)


@pytest.mark.parametrize(
    ("fell", "when"),
    [([], []), ([200, 201, 202], [25.0]), ([80, 88, 120, 300], [10.0, 37.5]), (range(80, 400), [10.0])],
)
@pytest.mark.parametrize("scale", [1.0, 0.3])
def test_a_fall_is_found_whatever_the_ordinary_score_and_falls_close_together_are_one_alarm(
    scale, fell, when
):
    """The same threshold serves a LiDAR whose scans score 0.95 and one whose scans score 0.3."""
    scores = ordinary(400)
    scores[list(fell)] = 0.3
    np.testing.assert_array_equal(np.flatnonzero(Steps(infos(scale * scores)).judged()["lost"]), list(fell))
    np.testing.assert_allclose(alarms(infos(scale * scores)), when)


@pytest.mark.parametrize("well", ["score", "aligned_score"])
def test_a_robot_whose_particles_or_whose_estimate_fit_is_not_lost(well):
    """Odometry that stands still leaves the particles behind, and the lines lead the estimate to its place."""
    scores = ordinary(400)
    scores[200:230] = 0.3
    assert len(alarms(infos(scores))) == 1
    assert (
        len(alarms(steady(**{"score": scores, "aligned_score": scores} | {well: ordinary(400, seed=1)}))) == 0
    )


def test_blind_scans_and_the_first_ones_are_not_judged():
    scores = np.concatenate([ordinary(LEAST_PAST), [0.1] * 5, ordinary(20)])
    matched = np.ones(len(scores), dtype=bool)
    matched[LEAST_PAST : LEAST_PAST + 5] = False
    found = score_deviation(infos(scores, matched=matched))
    assert np.isnan(found[: LEAST_PAST + 5]).all()
    assert np.isfinite(found[LEAST_PAST + 5 :]).all()
    assert len(alarms(infos(scores, matched=matched))) == 0
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


# What is not to be trusted
# ------------------------------------------------------------------------------------------------


def pulled(step, unexplained, during=slice(200, 216), count=400):
    """Departures of ``step`` metres a scan to one side and back to none, and the share of beams unexplained."""
    departure, share = np.zeros((count, 2)), np.zeros(count)
    departure[during, 1], share[during] = step, unexplained
    return {"departure": departure, "unexplained": share}


def test_a_steady_run_is_trusted():
    assert distrust(steady()) == distrust([]) == distrust(steady(1)) == []
    assert not was_dragged(steady())
    assert not was_dragged([])


def test_scans_that_drag_the_estimate_past_unexplained_beams_are_named_from_then_on():
    (found,) = distrust(steady(**pulled(0.03, 0.1)))
    # The fourth scan of 0.03 m passes 0.1 m; from then on nothing takes the error out of the map.
    assert found["from"] == 203 / 8
    assert found["to"] is None
    assert found["reason"].startswith("scans moved the estimate 0.12 m from its odometry within 2 s")


@pytest.mark.parametrize(
    ("more", "doubted"), [(-0.3, True), (0.0, True), (0.09, True), (0.11, False), (0.5, False)]
)
def test_a_correction_that_puts_the_beams_back_on_old_walls_is_no_drag(more, doubted):
    """Wheels slip with somebody in view. A second look would believe the wheels more, so none is asked for."""
    infos = steady(**pulled(0.03, 0.1), old_walls=np.full(400, more))
    assert (bool(distrust(infos)), was_dragged(infos)) == (doubted, doubted)


def to_and_fro(changes):
    changes["departure"][::2] *= -1.0
    return changes


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param(pulled(0.03, 0.0), id="wheels slip, and walls explain every beam"),
        pytest.param(pulled(0.005, 0.3), id="people about, and the estimate stays"),
        pytest.param(pulled(0.03, 0.1, slice(0, 400, 8)), id="a small pull once a second"),
        pytest.param(to_and_fro(pulled(0.05, 0.1, slice(100, 300))), id="pulls to and fro"),
    ],
)
def test_a_pull_or_strange_beams_alone_are_trusted(changes):
    assert distrust(steady(**changes)) == []


@pytest.mark.parametrize("noise", [0.05, 0.5])
def test_departures_are_as_long_as_chance_says_however_good_the_odometry(noise):
    """Squared lengths of normal departures are chi-square, whose geometric mean is exp(ln 2 - gamma) variances.

    Two standard deviations then hold all but exp(-4 exp(-gamma)) = 10.6 %, here of more than 1000 separate sums.
    """
    drift = np.random.default_rng(3).normal(0.0, noise, (20_000, 2))
    run = Steps(steady(len(drift), departure=drift, unexplained=np.full(len(drift), 0.1)))
    metres, sigma = departures(run)
    assert np.mean(metres > 2.0 * sigma) == pytest.approx(np.exp(-4.0 * np.exp(-np.euler_gamma)), abs=0.02)
    np.testing.assert_allclose(
        metres[16:20], [np.hypot(*drift[k - 16 : k + 1].sum(axis=0)) for k in range(16, 20)]
    )
    assert distrust(run) == []


def test_a_good_odometry_is_not_taken_to_be_better_than_the_motion_model():
    metres, sigma = departures(steady(departure=np.tile([[0.001, 0.0], [-0.001, 0.0]], (200, 1))))
    assert metres.max() < 0.0011
    np.testing.assert_allclose(sigma, 0.02, rtol=0.01)


def test_an_odometry_of_another_scale_is_no_drag():
    """A fifth too long: of every step of 0.1 m, 0.02 m are taken back."""
    assert distrust(steady(departure=np.tile([-0.02, 0.0], (400, 1)), unexplained=np.full(400, 0.1))) == []


@pytest.mark.parametrize(("share", "doubted"), [(0.0, True), (0.2, True), (0.6, False), (1.0, False)])
def test_an_odometry_that_scans_often_correct_as_far_says_nothing_against_them(share, doubted):
    """In a share of the first 25 s, walls explain scans that move the estimate as far as later ones do among people."""
    usual, later = np.zeros((400, 2)), pulled(0.03, 0.1)
    usual[: round(200 * share), 1] = 0.04
    later["departure"] += usual
    assert bool(distrust(steady(**later))) == doubted


def test_what_scans_correct_later_does_not_excuse_what_they_did_before():
    later = pulled(0.03, 0.1, slice(100, 116))
    later["departure"][200:, 1] = 0.04
    assert [found["from"] for found in distrust(steady(**later))] == [103 / 8]


def test_scans_far_apart_are_judged_by_what_the_odometry_says_between_others():
    """A log with a scan every three seconds: one of 0.3 m is no drag if the odometry often drifts so far."""
    often = pulled(0.3, 0.1)
    often["departure"][:200:2, 1] = 0.3
    for changes, doubted in ((pulled(0.3, 0.1), True), (often, False)):
        sparse = [replace(info, t=3.0 * info.t * 8) for info in steady(**changes)]
        assert bool(distrust(sparse)) == doubted


@pytest.mark.parametrize("rejected", [False, True])
@pytest.mark.parametrize(
    ("blind", "stretches"),
    [
        (slice(100, 115), []),
        (slice(100, 116), [(99 / 8, 116 / 8)]),
        (slice(100, 180), [(99 / 8, 180 / 8)]),
        (slice(300, 400), [(299 / 8, None)]),
    ],
)
def test_a_blind_stretch_lasts_from_the_last_scan_to_the_next(blind, stretches, rejected):
    seen = np.ones(400, dtype=bool)
    seen[blind] = False
    found = distrust(steady(matched=seen, drawn=seen, rejected=~seen & rejected))
    assert [(d["from"], d["to"]) for d in found] == stretches
    assert all(("could be believed" in d["reason"]) == rejected for d in found)


@pytest.mark.parametrize(("fallen", "ends"), [(0, [270 / 8]), (3, [270 / 8]), (5, [270 / 8, None])])
def test_after_a_silence_the_first_scans_may_fit_badly_and_take_back_what_odometry_drifted(fallen, ends):
    """Ten seconds and 2 m without scans: three that fit badly are no sign, five tell that it was carried off."""
    scores, changes = ordinary(400), pulled(0.0, 0.0)
    scores[190 : 190 + fallen] = 0.3
    changes["departure"][190], changes["unexplained"][190:192] = 0.5, 0.3
    found = distrust(paused(infos(scores, **changes), 10.0, 2.0))
    assert [d["to"] for d in found] == ends
    assert found[0]["from"] == 189 / 8
    assert found[0]["reason"] == "no scan was recorded for 10.1 s: odometry alone"


def paused(steps, seconds, metres):
    """Let so many seconds and metres more pass before the 190th step."""
    there = [k >= 190 for k in range(len(steps))]
    return [
        replace(step, t=step.t + seconds * late, estimate=step.estimate + [metres * late, 0.0, 0.0])
        for step, late in zip(steps, there, strict=True)
    ]


@pytest.mark.parametrize(
    ("seconds", "metres", "doubted"),
    [(10.0, -0.1, False), (10.0, 0.0, False), (10.0, 0.09, False), (10.0, 0.11, True), (3600.0, 0.0, True)],
)
def test_a_silence_in_which_the_robot_went_no_farther_than_usual_is_no_reason_for_doubt(
    seconds, metres, doubted
):
    """It goes 0.1 m from scan to scan: a recorder that pauses while it stands, or for as long, loses nothing."""
    assert [d["to"] for d in distrust(paused(steady(), seconds, metres))] == [190 / 8 + seconds] * doubted


def test_a_recorder_that_pauses_while_a_robot_stands_loses_nothing_however_long_it_has_stood():
    """The usual step is the mean one: the median of a robot that mostly stands is what its estimate trembles by."""
    standing = [
        replace(step, estimate=np.array([min(0.1 * k, 4.0), 0.001 * (k % 2), 0.0]))
        for k, step in enumerate(steady())
    ]
    assert distrust(paused(standing, 10.0, 0.01)) == []
    assert len(distrust(paused(standing, 10.0, 0.1))) == 1


def test_ten_metres_of_bare_corridor_are_in_doubt_and_nine_are_not():
    for metres, flagged in ((0.9 * ALONG_METRES, False), (1.1 * ALONG_METRES, True)):
        free = [np.array([1.0, 0.0]) if 100 <= k < 100 + 10 * metres else None for k in range(400)]
        found = distrust(steady(silent_direction=free))
        assert bool(found) == flagged
        assert all(d["to"] is None and "no wall shows the way along" in d["reason"] for d in found)


@pytest.mark.parametrize(("least", "doubted"), [(0.9, False), (1.1, True)])
def test_a_large_covariance_is_in_doubt_from_then_on(least, doubted):
    """The long axis of the ellipse lies across x and y; what was drawn stays in the map when it is small again."""
    axis, covariances = np.array([0.6, 0.8]), [np.diag([0.01, 0.01, 100.0]) for _ in range(400)]
    for covariance in covariances[100:200]:  # a heading that is open is no matter here
        covariance[:2, :2] = 1e-6 * np.eye(2) + (least * UNSURE_METRES) ** 2 * np.outer(axis, axis)
    found = distrust(steady(covariance=covariances))
    assert [(d["from"], d["to"]) for d in found] == [(100 / 8, None)] * doubted
    assert all("no better than to 1.1 m (standard deviation)" in d["reason"] for d in found)


def test_reasons_come_in_order_of_time():
    scores = np.append(ordinary(300), np.full(100, 0.3))
    seen = np.ones(400, dtype=bool)
    seen[200:240] = False
    found = distrust(infos(scores, matched=seen, drawn=seen, **pulled(0.04, 0.1, slice(100, 120))))
    assert [d["from"] for d in found] == sorted(d["from"] for d in found)
    assert [d["reason"].split()[0] for d in found] == ["scans", "no", "scans"]


def eventful():
    """A run with all there is to doubt: lost, dragged, blind, unsure, along a bare corridor, and a pause."""
    scores, seen = ordinary(400), np.ones(400, dtype=bool)
    seen[150:180], scores[300:320] = False, 0.3
    covariances = [None if k < 20 else np.diag([0.01 * k, 0.01, 0.1]) for k in range(400)]
    free = [np.array([1.0, 0.0]) if 180 <= k < 300 else None for k in range(400)]
    changes = pulled(0.04, 0.1, slice(100, 120)) | {"covariance": covariances, "silent_direction": free}
    return paused(infos(scores, matched=seen, drawn=seen, rejected=~seen, **changes), 10.0, 2.0)


def test_asked_after_each_scan_or_seldom_steps_say_what_a_list_of_them_says():
    run = eventful()
    often, seldom = Steps(), Steps(run[:1])
    for k, step in enumerate(run):
        often.append(step)
        assert distrust(often) == distrust(run[: k + 1])
    for step in run[1:]:
        seldom.append(step)
    assert distrust(seldom) == distrust(Steps.of_columns(seldom.columns)) == distrust(run)
    assert len({stretch["reason"][:12] for stretch in distrust(run)}) == 6
    assert was_dragged(often) == was_dragged(run)
    assert often.judged().keys() == COLUMNS.keys() | SIGNS.keys()
    for name, column in Steps(run).judged().items():
        np.testing.assert_array_equal(often.judged()[name], column, err_msg=name)


def test_the_next_scan_is_judged_without_those_of_long_ago():
    """What they were may be gone: so the next one costs no more after hours."""
    run = eventful()
    kept = Steps(run[:399])
    distrust(kept)
    for name in COLUMNS.keys() - {"t", "rejected"}:  # reasons tell the seconds, and what was rejected
        kept.columns[name][:380] = 0
    kept.append(run[399])
    assert distrust(kept) == distrust(run)


def test_steps_that_are_kept_are_read_back_as_they_were():
    run, kept = eventful(), Steps()
    for step in run:
        kept.append(step)
    kept.append(run[0])
    kept.cut(400)
    assert len(kept) == 400
    for found, expected in zip([*kept[:390], *[kept[k] for k in range(-10, 0)]], run, strict=True):
        for name, value in vars(expected).items():
            np.testing.assert_array_equal(getattr(found, name), value, err_msg=name)
            assert (getattr(found, name) is None) == (value is None)
    with pytest.raises(IndexError):
        kept[400]


def test_steps_of_a_long_drive_are_copied_seldom():
    """Each time there is room for twice as many: nine times for 10,000 scans."""
    kept, step, rooms = Steps(), steady(1)[0], set[int]()
    for _ in range(10_000):
        kept.append(step)
        rooms.add(len(kept.columns["t"].base))
    assert sorted(rooms) == [64 * 2**k for k in range(9)]


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
    assert (result.distrust[0]["from"], result.distrust[0]["to"]) == (begin + when[0], None)
    score = np.array([info.score for info in result.infos])
    t = result.trajectory.t - begin
    assert score[(t > 0.0) & (t < 1.0)].min() < 0.5 * np.median(score[(t > -20.0) & (t < 0.0)])


@pytest.mark.nightly
def test_sparse_real_scans_raise_no_alarm(real_data):
    log = pfslam.load(real_data / "intel" / "intel.log")
    result = run_slam(log, CONFIG)
    known = read_relations(real_data / "intel" / "intel.relations").at_stamps(log.lidar.t)
    assert len(known.poses) == 97
    metres, radians = relations_error(result.trajectory, known.t1, known.t2, known.poses)
    assert metres.mean() <= 0.03
    assert np.rad2deg(radians.mean()) <= 0.5
    assert len(alarms(result.infos)) == 0
    assert result.distrust == []
    assert result.config.outliers is None, "a second look is in doubt for longer, so the first one stands"


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


def test_times_in_doubt_are_told_from_the_others():
    t = np.arange(6.0)
    stretches = [{"from": 1.0, "to": 2.0, "reason": ""}, {"from": 4.5, "to": None, "reason": ""}]
    assert in_doubt(stretches, t).tolist() == [False, True, True, False, False, True]
    assert not in_doubt([], t).any()


def test_only_scans_that_drag_before_any_alarm_ask_for_a_second_look():
    """Scans that contradict odometry after the robot was carried off are right."""
    pulling, scores = pulled(0.02, 0.05), np.full(400, 0.9) + 0.01 * np.sin(np.arange(400))
    assert was_dragged(infos(scores, **pulling))
    assert not was_dragged(steady(**pulled(0.02, 0.0)))
    scores[195] = 0.1
    carried_off = infos(scores, **pulling)
    assert len(alarms(carried_off)) == 1
    assert not was_dragged(carried_off)


@pytest.mark.nightly
def test_the_building_of_the_readme_with_all_hazards_is_right_and_not_doubted(tmp_path):
    """Wheels slip there with people in view. The run said from 42 s on that it was not to be trusted."""
    line = next(line for line in README.read_text(encoding="utf-8").splitlines() if "--people" in line)
    hazards = line[line.index("--people") : line.rindex("`")].split()
    assert {"--people", "--doors", "--glass", "--bumps", "--slip"} <= set(hazards)
    assert main(["simulate", "hall", "--seed", "7", "--out", str(tmp_path / "mine"), *hazards]) == 0
    assert main(["run", str(tmp_path / "mine"), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    told = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert told["slam"]["ate_rmse_m"] < 0.02
    assert told["distrust"] == told["checks_failed"] == []
