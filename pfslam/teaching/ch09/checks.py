"""Checks of the exercises of chapter 09. Each takes the student's function and says what is wrong in words."""

from __future__ import annotations

import numpy as np

from pfslam.evaluation.trajectory import trajectory_error
from pfslam.poses import Trajectory, compose
from pfslam.teaching.ch09.beyond import best_fit_rmse
from pfslam.teaching.show.checks import Check, attempt, hint, is_unanswered, not_a_number, passed, unanswered

ARC = np.linspace(0.0, 3.0, 40)
TRUE = np.column_stack([2.0 + 3.0 * np.sin(ARC), 1.0 - 3.0 * np.cos(ARC), ARC])
DRIFT = np.column_stack([0.02 * ARC**2, -0.03 * ARC, 0.04 * ARC])
POSES = compose(np.array([5.0, -3.0, 0.6]), compose(TRUE, DRIFT))
"""An estimate that begins elsewhere, turned by 0.6 rad, and drifts."""


def check_first_pose_error(first_pose_error) -> Check:
    """Whether ``first_pose_error(poses, true_poses)`` aligns at the first pose, heading included, and fits nothing."""
    answer = attempt(first_pose_error, POSES.copy(), TRUE.copy())
    problem = not_a_number(answer, "metres")
    if problem is not None:
        return problem
    estimate, truth = Trajectory(ARC, POSES), Trajectory(ARC, TRUE)
    right = trajectory_error(estimate, truth).ate_rmse_m
    moved = POSES[:, :2] - POSES[0, :2] + TRUE[0, :2] - TRUE[:, :2]
    raw = POSES[:, :2] - TRUE[:, :2]
    aligned = np.hypot(*_aligned().T)
    wrong = [
        (
            best_fit_rmse(estimate, truth),
            "You fitted the whole path to the truth. A fit absorbs the heading error: SLAM "
            "is given its first pose and nothing else.",
        ),
        (
            _rms(moved),
            "The first positions agree now, the first headings do not: the whole path must be turned too.",
        ),
        (
            _rms(moved - moved.mean(axis=0)),
            "Subtracting means is half of a best fit. Move the first pose, not the mean.",
        ),
        (
            _rms(raw),
            "The estimate lives in a frame of its own. Bring its first pose onto the true one, then compare.",
        ),
        (float(aligned.mean()), "That is the mean distance. Root mean square: square, mean, root."),
        (float(np.mean(aligned**2)), "The mean of the squares is in square metres. Take the root."),
        (float(aligned.max()), "That is the largest error; the root mean square is asked for."),
    ]
    if np.isclose(answer, right, rtol=1e-6):
        return passed(f"{right:.3f} m by the first pose; the best fit would have said {wrong[0][0]:.3f} m.")
    for value, words in wrong:
        if np.isclose(answer, value, rtol=1e-4):
            return hint(words)
    return hint(f"For the path of the check it should be {right:.3f} m; yours gives {float(answer):.3f} m.")


def _aligned() -> np.ndarray:
    """Errors (K, 2) of the check's path after alignment at the first pose."""
    turn = TRUE[0, 2] - POSES[0, 2]
    c, s = np.cos(turn), np.sin(turn)
    return (POSES[:, :2] - POSES[0, :2]) @ np.array([[c, s], [-s, c]]) + TRUE[0, :2] - TRUE[:, :2]


def _rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


ANCESTORS = np.array([0, 0, 2, 2])
HITS: list[int | None] = [1, 3, None, None]


def check_draw_all(draw_all) -> Check:
    """Whether ``draw_all(maps, ancestors, hits)`` gives each particle its own map, and copies no more than needed."""
    maps = [np.full(5, 10.0 * k) for k in range(4)]
    before = [m.copy() for m in maps]
    answer = attempt(draw_all, maps, ANCESTORS.copy(), list(HITS))
    if is_unanswered(answer):
        return unanswered()
    if isinstance(answer, Check):
        return answer
    if not isinstance(answer, (list, tuple)) or len(answer) != 4 or any(np.shape(m) != (5,) for m in answer):
        return hint("Return a list with one map for each of the four particles.")
    changed = any(not np.array_equal(m, b) for m, b in zip(maps, before, strict=True))
    if np.array_equal(answer[0], answer[1]):
        return hint(
            "Particles 0 and 1 drew into one and the same array: each now sees the other's wall. Copies of a "
            "particle may share a map only until one of them draws."
        )
    expected = [before[a].copy() for a in ANCESTORS]
    for m, h in zip(expected, HITS, strict=True):
        if h is not None:
            m[h] += 1.0
    if not all(np.array_equal(m, e) for m, e in zip(answer, expected, strict=True)):
        if np.array_equal(answer[1], before[1] + np.eye(5)[3]):
            return hint(
                "Particle 1 drew into its own old map, but it descends from particle 0: use the ancestors."
            )
        return hint(
            "Particle k starts from the map of ancestors[k] and adds 1 at hits[k]; some map is not that."
        )
    if changed:
        return hint(
            "Your new maps are right, but a map of the step before has changed. It may be somebody else's."
        )
    kept = sum(any(m is old for old in maps) for m in answer)
    if kept < 2:
        return hint(
            "Right numbers, and more memory than needed: particles 2 and 3 drew nothing. They can go on "
            "sharing the array of their ancestor."
        )
    return passed("Four particles, three arrays: two drew and have their own, two share one.")


def _beam_cases() -> list[tuple[str, np.ndarray, np.ndarray, bool]]:
    """Name, map, cells of the beam, and whether it is blocked. The beam runs along row 4 from column 0."""

    def wall(*columns: int) -> np.ndarray:
        occupied = np.zeros((9, 30), dtype=bool)
        occupied[:, list(columns)] = True
        return occupied

    def beam(end: int) -> np.ndarray:
        return np.column_stack([np.arange(end + 1), np.full(end + 1, 4)])

    return [
        ("at the wall", wall(20), beam(20), False),
        ("in a wall two cells thick", wall(19, 20), beam(20), False),
        ("in free space", wall(25), beam(15), False),
        ("behind a wall", wall(10, 20), beam(20), True),
        ("deep in a filled wall", wall(*range(8, 24)), beam(18), True),
    ]


def check_blocked(blocked) -> Check:
    """Whether ``blocked(occupied, cells)`` finds the beams that pass through a wall, and only those."""
    answers = []
    for _, occupied, cells, _ in _beam_cases():
        answer = attempt(blocked, occupied.copy(), cells.copy())
        if is_unanswered(answer):
            return unanswered()
        if isinstance(answer, Check):
            return answer
        if np.ndim(answer) != 0:
            return hint("One answer per beam is asked for: True or False.")
        answers.append(bool(answer))
    expected = [case[3] for case in _beam_cases()]
    if answers == expected:
        return passed("Five beams: two pass through walls, as the map would not allow.")
    if answers[0]:
        return hint("A beam that ends on the wall it hit is not blocked. Leave the end of the beam out.")
    if answers[1]:
        return hint(
            "Walls are two cells thick and ranges noisy: leave out the last two cells before the end as well."
        )
    if not answers[3] and answers[4]:
        return hint("You look only near the end. A wall anywhere on the way blocks the beam.")
    if not any(answers):
        return hint(
            "No beam is ever blocked. Index the map as occupied[iy, ix]; cells are (ix, iy), the robot's first."
        )
    if not answers[4]:
        return hint(
            "The field gives full marks to a point deep inside a filled wall. Your check must not: it has "
            "occupied cells all the way."
        )
    name = next(case[0] for case, a in zip(_beam_cases(), answers, strict=True) if a != case[3])
    return hint(f"The beam that ends {name} is judged wrongly.")
