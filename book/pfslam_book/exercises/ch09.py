"""Exercises of chapter 09."""

from __future__ import annotations

import numpy as np
from pfslam_book.show.exercise import Exercise

from pfslam.poses import compose

# ---- 1: the parabola


def sub_cell(left, middle, right):
    return 0.5 * (left - right) / (left - 2 * middle + right)


check_sub_cell = Exercise(
    right=sub_cell,
    cases=[(3.1, 4.7, 4.2), (1.0, 1.9, -0.6), (-7.3, -5.0, -5.9), (0.2, 0.9, 0.81)],
    mistakes={
        "That is the best of the three steps. The top lies between.": (
            lambda *values: float(np.argmax(values) - 1)
        ),
        "That is the centre of mass of the three values. Fit a parabola: its derivative is 0 at the top.": (
            lambda a, b, c: (c - a) / (a + b + c)
        ),
        "That is the height of the top. Its place is asked for.": (
            lambda a, b, c: b - 0.25 * (a - c) * sub_cell(a, b, c)
        ),
        "That is the slope in the middle. Divide it by the curvature.": lambda a, b, c: 0.5 * (c - a),
        "You lost the sign: the top may lie to the left.": lambda *values: abs(sub_cell(*values)),
    },
    praise="A lattice of 5 cm, and a pose between its nodes.",
)

# ---- 2: the error by first pose


def path_case(seed, start, n, back=0.0) -> tuple:
    """An estimate that begins elsewhere and drifts, part of it ``back`` again, and the truth."""
    rng, arc = np.random.default_rng(seed), np.linspace(0.0, 2.7, n)
    truth = np.column_stack([2.0 + 3.0 * np.sin(arc), 1.0 - 2.0 * np.cos(arc), arc + 0.4])
    drift = np.column_stack([0.02 * arc**2, -0.03 * arc, 0.04 * arc])
    drift = drift * (1.0 - back * arc[:, None]) + 0.004 * rng.standard_normal((n, 3))
    return compose(np.array(start), compose(truth, drift)), truth


PATHS = [path_case(0, (5.0, -3.0, 0.63), 40), path_case(1, (-2.2, 0.7, -1.9), 55, back=0.3)]


def away(poses, true_poses, sign=1.0):
    """Differences (K, 2) once the first position is the true one, and the path is turned about it."""
    turn = sign * (true_poses[0, 2] - poses[0, 2])
    c, s = np.cos(turn), np.sin(turn)
    turned = (poses[:, :2] - poses[0, :2]) @ np.array([[c, s], [-s, c]])
    return turned + true_poses[0, :2] - true_poses[:, :2]


def rms(errors):
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


def best_fit(poses, true_poses):
    """What is left when the path is turned and moved so that this is least; x + iy for a position."""
    found, truth = (
        path[:, :2] @ [1, 1j] - path[:, :2].mean(axis=0) @ [1, 1j] for path in (poses, true_poses)
    )
    turn = np.angle(np.vdot(found, truth))
    return float(np.sqrt(np.mean(np.abs(found * np.exp(1j * turn) - truth) ** 2)))


check_first_pose_error = Exercise(
    right=lambda p, q: rms(away(p, q)),
    cases=PATHS,
    mistakes={
        "You fitted the whole path to the truth. A fit absorbs the heading error: SLAM is given its first pose and "
        "nothing else.": best_fit,
        "The first positions agree now, the first headings do not: the whole path must be turned too.": (
            lambda p, q: rms(away(p, q, sign=0.0))
        ),
        "You turn the wrong way: by the true first heading less the estimated one, and about the first position.": (
            lambda p, q: rms(away(p, q, sign=-1.0))
        ),
        "You average over coordinates. Average the squared *distances*: x and y of a pose belong together.": (
            lambda p, q: float(np.sqrt(np.mean(away(p, q) ** 2)))
        ),
        "That is the mean distance. Root mean square: square, mean, root.": (
            lambda p, q: float(np.hypot(*away(p, q).T).mean())
        ),
    },
    praise=f"{100 * rms(away(*PATHS[0])):.1f} cm by the first pose; the best fit would have said "
    f"{100 * best_fit(*PATHS[0]):.1f} cm.",
)

# ---- 3: one step of the polish


def line_case(seed) -> tuple:
    """Lines in all directions, and points a few centimetres beside them."""
    rng = np.random.default_rng(seed)
    arms, position = rng.uniform(-4.0, 4.0, (23, 2)), rng.uniform(-2.0, 2.0, 2)
    angle = rng.uniform(0.0, np.pi, 23)
    normals = np.column_stack([np.cos(angle), np.sin(angle)])
    return arms, position, arms + position + 0.05 * rng.standard_normal((23, 2)), normals


def parts(arms, position, centres, normals):
    """The Jacobian and the residuals."""
    turning = normals[:, 1] * arms[:, 0] - normals[:, 0] * arms[:, 1]
    return np.column_stack([normals, turning]), np.sum(normals * (arms + position - centres), axis=1)


def line_step(*case, change=lambda jacobian, case: jacobian):
    """The step of least squares, with the Jacobian as it is or changed."""
    jacobian, residual = parts(*case)
    return -np.linalg.lstsq(change(jacobian, case), residual, rcond=None)[0]


def points_to_points(arms, position, centres, normals):
    """The step that brings each point to the centre of its line."""
    axes = np.repeat(np.eye(2), len(arms), axis=0)
    return line_step(np.tile(arms, (2, 1)), position, np.tile(centres, (2, 1)), axes)


def about_the_origin(arms, position, centres, normals):
    return line_step(arms + position, 0.0, centres, normals)


def gradient(*case):
    jacobian, residual = parts(*case)
    return -jacobian.T @ residual


check_line_step = Exercise(
    right=line_step,
    cases=[line_case(1), line_case(2)],
    mistakes={
        "That is point-to-point: it also pulls points *along* walls. Only the distance along the normal counts.": (
            points_to_points
        ),
        "The sign of the last column: a turn moves an arm (a_x, a_y) along (-a_y, a_x).": (
            lambda *case: line_step(*case, change=lambda jacobian, case: jacobian * [1, 1, -1])
        ),
        "You turn about the origin of the world. The robot turns about itself: use the arms without the position.": (
            about_the_origin
        ),
        "The heading never changes: the Jacobian has a third column.": (
            lambda *case: line_step(*case, change=lambda jacobian, case: jacobian * [1, 1, 0])
        ),
        "That is the gradient. Solve the normal equations with it: J^T J step = -J^T r.": gradient,
    },
    praise="Point-to-line ICP, one iteration. The next cell repeats it.",
)

# ---- 4: beams through walls


def beam_case(columns, end) -> tuple:
    """A map and a beam along row 4 to column ``end``; walls in that row in some columns, and two walls elsewhere."""
    occupied = np.zeros((30, 30), dtype=bool)
    occupied[4, list(columns)] = True
    occupied[11, 2:9] = occupied[9:15, 4] = True  # a beam with rows and columns exchanged would meet them
    return occupied, np.column_stack([np.arange(end + 1), np.full(end + 1, 4)])


def looking(last):
    """Whether there is a wall in the cells before the last few."""
    return lambda occupied, cells: bool(occupied[cells[:last, 1], cells[:last, 0]].any())


check_blocked = Exercise(
    right=looking(-3),
    cases=[
        *(
            beam_case(columns, 20)
            for columns in ((20,), (19, 20), (18, 19, 20), (17, 20), (16, 20), (15, 20), (10, 20), (9, 20))
        ),
        *(beam_case(columns, 20) for columns in ((2, 20), (1, 20), (0, 20))),
        *(beam_case(*case) for case in (((), 15), ((), 6), (range(8, 24), 18), (range(5), 4))),
    ],
    mistakes={
        "An index lies outside the map. Index it as occupied[iy, ix]; the cells are (ix, iy).": IndexError,
        "A beam that ends on the wall it hit is not blocked. Leave the end of the beam out.": looking(None),
        "Walls are thick and ranges noisy: leave out the *two* cells before the end as well.": looking(-1),
        "You leave out one cell before the end. Leave out two, and the end itself.": looking(-2),
        "Rows and columns have changed places. Index the map as occupied[iy, ix]; the cells are (ix, iy).": (
            lambda occupied, cells: bool(occupied[cells[:-3, 0], cells[:-3, 1]].any())
        ),
    },
    praise="A wall anywhere on the way, and the wall at its end left out.",
)
