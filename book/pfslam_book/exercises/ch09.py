"""Checks of the exercises of chapter 09: each takes the reader's function and says what is wrong in words."""

from __future__ import annotations

import numpy as np
from pfslam_book.ch09.judging import best_fit_rmse
from pfslam_book.ch09.runs import PolishCase
from pfslam_book.show.checks import Check, compare

from pfslam.evaluation.trajectory import trajectory_error
from pfslam.poses import Trajectory, compose

# ---- 1: the parabola


def sub_cell(left, middle, right):
    """Return where the parabola through three equidistant values has its top, in steps from the middle one."""
    return 0.5 * (left - right) / (left - 2 * middle + right)


SUB_CELL_CASES = [(3.1, 4.7, 4.2), (1.0, 1.9, -0.6), (-7.3, -5.0, -5.9), (0.2, 0.9, 0.81)]
SUB_CELL_MISTAKES = [
    (lambda a, b, c: 2 * sub_cell(a, b, c), "Twice the right step: the first derivative is half of (right - left)."),
    (lambda a, b, c: float(np.argmax([a, b, c]) - 1), "That is the best of the three steps. The top lies between."),
    (lambda a, b, c: (c - a) / (a + b + c), "That is the centre of mass of the three values. Fit a parabola: its "
     "derivative is 0 at the top."),
    (lambda a, b, c: 0.5 * (c - a) / (a - b + c), "The second derivative is left - 2 middle + right."),
    (lambda a, b, c: b - 0.25 * (a - c) * sub_cell(a, b, c), "That is the height of the top. Its place is asked for."),
    (lambda a, b, c: 0.5 * (c - a), "That is the slope in the middle. Divide it by the curvature."),
    (lambda a, b, c: abs(sub_cell(a, b, c)), "You lost the sign: the top may lie to the left."),
    (lambda a, b, c: 1 / sub_cell(a, b, c), "Upside down: the slope is divided by the curvature."),
    (lambda a, b, c: 0.5 * (c - a) / b, "You divide by the middle value. Divide by the curvature, left - 2 middle + "
     "right."),
    (lambda a, b, c: np.clip(sub_cell(a, b, c), -0.25, 0.25), "You cut the step at a quarter. The top may lie up to "
     "half a step away."),
    (lambda a, b, c: (np.exp(c) - np.exp(a)) / (np.exp(a) + np.exp(b) + np.exp(c)), "That is the centre of mass of the "
     "exponentials. Fit a parabola to the three values."),
    (lambda a, b, c: 1 + sub_cell(a, b, c), "Counted from the left value. Count from the middle one."),
]  # fmt: skip


def check_sub_cell(theirs) -> Check:
    """Tell whether ``sub_cell(left, middle, right)`` is the top of the parabola, in steps from the middle."""
    praise = "A lattice of 5 cm, and a pose between its nodes."
    return compare(theirs, sub_cell, SUB_CELL_CASES, mistakes=SUB_CELL_MISTAKES, praise=praise)


# ---- 2: the error by first pose


def _paths(seed: int, start: tuple, length: int, back: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return an estimate that begins elsewhere and drifts, part of it ``back`` again, and the truth."""
    rng, arc = np.random.default_rng(seed), np.linspace(0.0, 2.7, length)
    truth = np.column_stack([2.0 + 3.0 * np.sin(arc), 1.0 - 2.0 * np.cos(arc), arc + 0.4])
    drift = np.column_stack([0.02 * arc**2, -0.03 * arc, 0.04 * arc])
    drift = drift * (1.0 - back * arc[:, None]) + 0.004 * rng.standard_normal((length, 3))
    return compose(np.array(start), compose(truth, drift)), truth


PATHS = [_paths(0, (5.0, -3.0, 0.63), 40), _paths(1, (-2.2, 0.7, -1.9), 55, back=0.3)]


def _errors(poses, true_poses) -> np.ndarray:
    """Return differences ``(K, 2)`` once the first pose, heading included, is the true one."""
    turn = true_poses[0, 2] - poses[0, 2]
    c, s = np.cos(turn), np.sin(turn)
    turned = (poses[:, :2] - poses[0, :2]) @ np.array([[c, s], [-s, c]])
    return turned + true_poses[0, :2] - true_poses[:, :2]


def _trajectories(poses, true_poses) -> tuple[Trajectory, Trajectory]:
    t = np.arange(len(poses), dtype=float)
    return Trajectory(t, np.array(poses)), Trajectory(t, np.array(true_poses))


def first_pose_error(poses, true_poses):
    """Return the root mean square of the distances, aligned at the first pose."""
    return trajectory_error(*_trajectories(poses, true_poses)).ate_rmse_m


def _rms(errors) -> float:
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


def _unturned(p, q):
    return p[:, :2] - p[0, :2] + q[0, :2] - q[:, :2]


def _turned_back(p, q):
    turn = q[0, 2] - p[0, 2]
    c, s = np.cos(turn), np.sin(turn)
    return (p[:, :2] - p[0, :2]) @ np.array([[c, -s], [s, c]]) + q[0, :2] - q[:, :2]


def _about_the_origin(p, q):
    turn = q[0, 2] - p[0, 2]
    c, s = np.cos(turn), np.sin(turn)
    return p[:, :2] @ np.array([[c, s], [-s, c]]) - p[0, :2] + q[0, :2] - q[:, :2]


FIRST_POSE_MISTAKES = [
    (lambda p, q: best_fit_rmse(*_trajectories(p, q)), "You fitted the whole path to the truth. A fit absorbs the "
     "heading error: SLAM is given its first pose and nothing else."),
    (lambda p, q: _rms(_unturned(p, q)), "The first positions agree now, the first headings do not: the whole path "
     "must be turned too."),
    (lambda p, q: _rms(_turned_back(p, q)), "You turn the wrong way: by the true first heading less the estimated "
     "one, and about the first position."),
    (lambda p, q: _rms(_unturned(p, q) - _unturned(p, q).mean(axis=0)), "Subtracting means is half of a best fit. "
     "Move the first pose, not the mean."),
    (lambda p, q: _rms((p - q)[:, :2]), "The estimate lives in a frame of its own. Bring its first pose onto the true "
     "one, then compare."),
    (lambda p, q: float(np.hypot(*_errors(p, q).T).mean()), "That is the mean distance. Root mean square: square, "
     "mean, root."),
    (lambda p, q: float(np.mean(np.sum(_errors(p, q) ** 2, axis=1))), "The mean of the squares is in square metres. "
     "Take the root."),
    (lambda p, q: float(np.sqrt(np.mean(_errors(p, q) ** 2))), "You average over coordinates. Average the squared "
     "*distances*: x and y of a pose belong together."),
    (lambda p, q: float(np.hypot(*_errors(p, q)[-1])), "That is the error at the end. All poses count."),
    (lambda p, q: float(np.median(np.hypot(*_errors(p, q).T))), "That is the median distance. Root mean square: "
     "square, mean, root."),
    (lambda p, q: float(np.sqrt(np.mean(_errors(p, q)[:, 0] ** 2))), "You count x alone. A distance has two "
     "coordinates."),
    (lambda p, q: float(np.sqrt(np.sum(_errors(p, q) ** 2))), "You add the squares up. Take their mean over the "
     "poses."),
    (lambda p, q: _rms(_errors(p, q)[1:]), "You leave the first pose out. Its error is 0 by definition, and it "
     "counts."),
    (lambda p, q: float(np.sqrt(np.sum(_errors(p, q).var(axis=0)))), "That is a standard deviation: it subtracts the "
     "mean error, which is half of a best fit."),
    (lambda p, q: _rms(_errors(p[::-1], q[::-1])), "You aligned at the last pose. SLAM is given the first one."),
    (lambda p, q: _rms(_about_the_origin(p, q)), "You turned about the origin. The path has to be turned about its own "
     "first position: subtract that before, and add the true one after."),
    (lambda p, q: _rms(_errors(p + (0, 0, np.rad2deg(p[0, 2] - q[0, 2]) + q[0, 2] - p[0, 2]), q)), "You turned the "
     "angle into degrees. cos and sin take radians."),
    (lambda p, q: float(np.hypot(*_errors(p, q).T).max()), "That is the largest error; the root mean square is asked "
     "for."),
]  # fmt: skip


def check_first_pose_error(theirs) -> Check:
    """Tell whether ``first_pose_error(poses, true_poses)`` aligns at the first pose and fits nothing."""
    fitted, aligned = best_fit_rmse(*_trajectories(*PATHS[0])), first_pose_error(*PATHS[0])
    praise = f"{100 * aligned:.1f} cm by the first pose; the best fit would have said {100 * fitted:.1f} cm."
    return compare(theirs, first_pose_error, PATHS, mistakes=FIRST_POSE_MISTAKES, praise=praise)


# ---- 3: one step of the polish


def line_step(arms, position, centres, normals):
    """Return the step (dx, dy, dtheta) that brings the end points onto their lines in least squares."""
    residual = np.sum(normals * (arms + position - centres), axis=1)
    turning = normals[:, 1] * arms[:, 0] - normals[:, 0] * arms[:, 1]
    return -np.linalg.lstsq(np.column_stack([normals, turning]), residual, rcond=None)[0]


def _line_cases() -> list[tuple]:
    """Return the corner of the chapter, and random lines."""
    case = PolishCase.make()
    arms, centres, normals = case.lines(case.pose)
    cases = [(arms[::7], case.pose[:2], centres[::7], normals[::7])]
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        arms, position = rng.uniform(-4.0, 4.0, (23, 2)), rng.uniform(-2.0, 2.0, 2)
        angle = rng.uniform(0.0, np.pi, 23)
        normals = np.column_stack([np.cos(angle), np.sin(angle)])
        cases.append((arms, position, arms + position + 0.05 * rng.standard_normal((23, 2)), normals))
    return cases


def _solved(arms, position, centres, normals, *, turning=None, difference=None):
    """Return the step with another Jacobian of the heading, or other differences."""
    difference = arms + position - centres if difference is None else difference
    residual = np.sum(normals * difference, axis=1)
    own = normals[:, 1] * arms[:, 0] - normals[:, 0] * arms[:, 1]
    columns = np.column_stack([normals, own if turning is None else turning])
    return -np.linalg.lstsq(columns, residual, rcond=None)[0]


def _gradient(arms, position, centres, normals):
    turning = normals[:, 1] * arms[:, 0] - normals[:, 0] * arms[:, 1]
    return -np.column_stack([normals, turning]).T @ np.sum(normals * (arms + position - centres), axis=1)


def _points_to_points(arms, position, centres, normals):
    ones, zeros = np.ones(len(arms)), np.zeros(len(arms))
    rows = np.concatenate(
        [np.column_stack([ones, zeros, -arms[:, 1]]), np.column_stack([zeros, ones, arms[:, 0]])]
    )
    return -np.linalg.lstsq(rows, (arms + position - centres).T.ravel(), rcond=None)[0]


def _without_turning(arms, position, centres, normals):
    residual = np.sum(normals * (arms + position - centres), axis=1)
    return np.append(-np.linalg.lstsq(normals, residual, rcond=None)[0], 0.0)


LINE_MISTAKES = [
    (np.linalg.LinAlgError, "The normal equations cannot be solved: is one column of your Jacobian all zeros?"),
    (_points_to_points, "That is point-to-point: it also pulls points *along* their walls. Only the distance along the "
     "normal counts."),
    (lambda a, p, c, n: _solved(a, p, c, n, turning=n[:, 0] * a[:, 1] - n[:, 1] * a[:, 0]), "The sign of the last "
     "column: a turn moves an arm (a_x, a_y) along (-a_y, a_x)."),
    (lambda a, p, c, n: _solved(a, p, c, n, turning=np.sum(n * a, axis=1)), "The last column is not n . a: a turn "
     "moves an arm at a right angle to itself, along (-a_y, a_x)."),
    (lambda a, p, c, n: _solved(a, p, c, n, turning=n[:, 1] * (a + p)[:, 0] - n[:, 0] * (a + p)[:, 1]), "You turn "
     "about the origin of the world. The robot turns about itself: use the arms without the position."),
    (lambda a, p, c, n: _solved(a, p, c, n, difference=a - c), "Your answer contains the position. The residual is "
     "taken at position + arm, and the step alone is returned."),
    (lambda a, p, c, n: line_step(a, p, c, n) * (1, 1, 180 / np.pi), "The turn is in degrees; radians are asked for."),
    (lambda a, p, c, n: line_step(a, p, c, n)[[2, 0, 1]], "The turn comes last: dx, dy, dtheta."),
    (lambda a, p, c, n: line_step(a, p, c, np.column_stack([n[:, 1], -n[:, 0]])), "You measure along the walls. Take "
     "the distance along the normals."),
    (lambda a, p, c, n: _solved(a, p, c, n, difference=n * np.linalg.norm(a + p - c, axis=1)[:, None]), "You take the "
     "distance to the centre of each line. Only its part along the normal counts: n . (p + a - c)."),
    (lambda a, p, c, n: _solved(a, p, c, n, difference=n * np.abs(np.sum(n * (a + p - c), axis=1))[:, None]), "You "
     "lost the signs of the residuals: a point may lie on either side of its line."),
    (lambda a, p, c, n: _solved(a, p, c, n, difference=a), "Your residuals leave out the position and the lines."),
    (lambda a, p, c, n: _solved(a, p, c, n, turning=n[:, 1] * c[:, 0] - n[:, 0] * c[:, 1]), "You turn the lines about "
     "the origin of the world. The robot turns about itself: use the arms."),
    (lambda a, p, c, n: _solved(a, p, c, n, turning=n[:, 1] - n[:, 0]), "The last column lacks the arms: a turn moves "
     "far points further."),
    (lambda a, p, c, n: _solved(a, p, c, n, turning=n[:, 1] * a[:, 0] + n[:, 0] * a[:, 1]), "One sign in the last "
     "column: a turn moves an arm (a_x, a_y) along (-a_y, a_x)."),
    (lambda a, p, c, n: _gradient(a, p, c, n), "That is the gradient. Solve the normal equations with it: J^T J step = "
     "-J^T r."),
    (lambda a, p, c, n: _gradient(a, p, c, n) / len(a), "That is the gradient. Solve the normal equations with it: "
     "J^T J step = -J^T r."),
    (lambda a, p, c, n: np.append((c - a - p).mean(axis=0), 0.0), "That is the mean shift from points to points. Only "
     "the distance along the normal counts, and the heading may turn."),
    (_without_turning, "The heading never changes: the Jacobian has a third column."),
]  # fmt: skip


def check_line_step(theirs) -> Check:
    """Tell whether ``line_step(arms, position, centres, normals)`` is one step of point-to-line least squares."""
    praise = "Point-to-line ICP, one iteration. The next cell repeats it."
    return compare(theirs, line_step, _line_cases(), mistakes=LINE_MISTAKES, praise=praise)


# ---- 4: beams through walls


def blocked(occupied, cells):
    """Tell whether a beam meets a wall before its last three cells."""
    on_the_way = cells[:-3]
    return bool(occupied[on_the_way[:, 1], on_the_way[:, 0]].any())


def _beam_cases() -> list[tuple[np.ndarray, np.ndarray]]:
    """Return maps and beams along row 4: free, at a wall, past an obstacle at each distance, deep in a wall."""

    def place(*columns: int) -> np.ndarray:
        occupied = np.zeros((30, 30), dtype=bool)
        occupied[4, list(columns)] = True
        occupied[11, 2:9] = True  # a wall elsewhere, which rows and columns in the wrong order would meet
        occupied[9:15, 4] = True
        return occupied

    def beam(end: int) -> np.ndarray:
        return np.column_stack([np.arange(end + 1), np.full(end + 1, 4)])

    ends = [
        ((), 15),
        ((20,), 20),
        ((19, 20), 20),
        ((18, 19, 20), 20),
        ((17, 20), 20),
        ((16, 20), 20),
        ((10, 20), 20),
        ((9, 20), 20),
        ((2, 20), 20),
        ((), 6),
    ]
    return [
        (place(*columns), beam(end))
        for columns, end in (*ends, (range(8, 24), 18), ((0, 20), 20), (range(5), 4))
    ]


def _looking(first: int | None, last: int | None):
    def rule(occupied, cells):
        some = cells[first:last]
        return bool(occupied[some[:, 1], some[:, 0]].any())

    return rule


BLOCKED_MISTAKES = [
    (IndexError, "An index lies outside the map. Index it as occupied[iy, ix]; the cells are (ix, iy)."),
    (_looking(None, None), "A beam that ends on the wall it hit is not blocked. Leave the end of the beam out."),
    (_looking(None, -1), "Walls are thick and ranges noisy: leave out the *two* cells before the end as well."),
    (_looking(None, -2), "You leave out one cell before the end. Leave out two, and the end itself."),
    (_looking(None, -4), "You leave out one cell too many: the end and the two before it do not count, the next does."),
    (_looking(1, -3), "You leave out the first cell, where the robot stands. It counts as well."),
    (_looking(-6, -3), "You look only near the end. A wall anywhere on the way blocks the beam."),
    (lambda o, c: bool(o[c[:-3, 0], c[:-3, 1]].any()), "Rows and columns have changed places. Index the map as "
     "occupied[iy, ix]; the cells are (ix, iy)."),
    (lambda o, c: bool(o[c[:-3, 1], c[:-3, 0]].all()), "You ask whether *all* cells on the way are occupied. One is "
     "enough."),
    (_looking(None, -5), "You leave out too many cells: the end and the two before it do not count, the next does."),
    (_looking(3, -3), "You leave out the first cells as well. A wall anywhere on the way blocks the beam."),
    (_looking(0, 1), "You look only where the robot stands. A wall anywhere on the way blocks the beam."),
    (lambda o, c: bool(o[c[:-3:2, 1], c[:-3:2, 0]].any()), "You look at every second cell only."),
    (lambda o, c: bool(o[c[: len(c) // 2, 1], c[: len(c) // 2, 0]].any()), "You look at the first half of the beam "
     "only."),
    (lambda o, c: blocked(o, c[::-1]), "You leave out the cells near the robot. The robot comes first, the end last."),
    (lambda o, c: bool(o[c[:-3, 1], c[:-3, 0]].sum() > 1), "One wall is enough; you ask for two cells."),
    (lambda o, c: int(o[c[:-3, 1], c[:-3, 0]].sum()), "You count the cells. Return whether there is any."),
    (lambda o, c: o[c[:-3, 1], c[:-3, 0]], "That says it of every cell. Return one truth value: is there any?"),
    (lambda o, c: bool((~o[c[:-3, 1], c[:-3, 0]]).any()), "You ask whether any cell on the way is free. Ask whether "
     "any is occupied."),
    (lambda o, c: True, "For you every beam is blocked, also one that meets no wall. Index the map as occupied[iy, "
     "ix]: occupied[cells] takes whole rows of it."),
    (lambda o, c: not blocked(o, c), "The other way round: True where the beam had to pass through a wall."),
    (lambda o, c: False, "No beam is ever blocked."),
]  # fmt: skip


def check_blocked(theirs) -> Check:
    """Tell whether ``blocked(occupied, cells)`` finds the beams that pass through a wall, and only those."""
    praise = "A wall anywhere on the way, and the wall at its end left out."
    return compare(_as_bool(theirs), blocked, _beam_cases(), mistakes=BLOCKED_MISTAKES, praise=praise)


def _as_bool(theirs):
    """Return the same function with NumPy's truth values and counts 0 and 1 as Python's."""

    def plain(occupied, cells):
        answer = theirs(occupied, cells)
        single = (
            np.ndim(answer) == 0 and not isinstance(answer, str) and answer is not None and answer is not ...
        )
        return bool(answer) if single and answer in (0, 1) else answer

    return plain
