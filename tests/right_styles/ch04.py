"""Right answers to the exercises of chapter 04, in the ways that people write them: each must pass its check."""

import math

import numpy as np

from pfslam.correlation import map_correlation
from pfslam.grid import GridSpec


def count_in_a_loop(points, occupied, origin, resolution):
    count = 0
    for x, y in points.tolist():
        ix, iy = int((x - origin[0]) // resolution), int((y - origin[1]) // resolution)
        if 0 <= iy < len(occupied) and 0 <= ix < len(occupied[0]):
            count += bool(occupied[iy][ix])
    return count


def count_float32(points, occupied, origin, resolution):
    return np.float32(count_in_a_loop(np.asarray(points, np.float32), occupied, origin, resolution))


def count_complex(points, occupied, origin, resolution):
    z = (points[:, 0] + 1j * points[:, 1] - complex(*origin)) / resolution
    walls = {(int(ix), int(iy)) for iy, ix in zip(*np.nonzero(occupied), strict=True)}
    return [sum((int(np.floor(p.real)), int(np.floor(p.imag))) in walls for p in z)]


def choose_in_a_loop(scores, steps):
    best = 0
    for k, (score, step) in enumerate(zip(scores.tolist(), steps.tolist(), strict=True)):
        if (score, -sum(s * s for s in step)) > (scores[best], -sum(s * s for s in steps[best])):
            best = k
    return best


def choose_by_lexsort(scores, steps):
    return np.lexsort([(steps**2).sum(axis=1), -scores])[0]


def works_by_complex_numbers(transform):
    pose, points = np.array([3.0, -1.0, 2.1]), np.random.default_rng(1).normal(size=(5, 2))
    moved = complex(*pose[:2]) + np.exp(1j * pose[2]) * (points @ [1, 1j])
    return np.allclose(np.asarray(transform(pose, points)) @ [1, 1j], moved)


def works_by_matrices(transform):
    c, s = np.cos(-2.2), np.sin(-2.2)
    T_wb = np.array([[c, -s, 0.4], [s, c, 5.0], [0, 0, 1]])
    points = np.array([[1.0, 2.0], [-3.0, 0.5]])
    expected = (T_wb @ np.vstack([points.T, [1, 1]]))[:2].T
    return np.max(np.abs(transform(np.array([0.4, 5.0, -2.2]), points) - expected)) < 1e-9


def works_there_and_back(transform):
    pose, points = np.array([-2.0, 4.0, 1.1]), np.array([[2.0, 1.0], [0.0, -1.0]])
    dx, dy = (np.asarray(transform(pose, points)) - pose[:2]).T
    c, s = np.cos(pose[2]), np.sin(pose[2])
    for (x, y), back in zip(points.tolist(), zip(c * dx + s * dy, c * dy - s * dx, strict=True), strict=True):
        if math.dist((x, y), back) > 1e-6:
            return False
    return True


def works_in_float32(transform):
    found = np.float32(transform(np.float32([3, 1, 0.7]), np.float32([[2, 1]]))).tolist()[0]
    return all(math.isclose(a, b, rel_tol=1e-4) for a, b in zip(found, [3.8855, 3.0533], strict=True))


def works_in_a_table(transform):
    for pose, point, expected in [
        ((3.0, 1.0, 0.7), (2.0, 0.0), [4.5297, 2.2884]),
        ((3.0, 1.0, 0.7), (0.0, 1.0), [2.3558, 1.7648]),
    ]:
        (found,) = transform(np.array(pose), np.array([point]))
        if [round(float(v), 4) for v in found] != expected:
            return False
    return True


STYLES = {
    "check_count_on_walls": [
        count_in_a_loop,
        count_float32,
        count_complex,
        lambda p, m, o, r: map_correlation(m, GridSpec(o, r, m.shape), p),
    ],
    "check_choose": [
        choose_in_a_loop,
        choose_by_lexsort,
        lambda s, d: np.float32(choose_in_a_loop(s, d)),
        lambda s, d: np.array([choose_in_a_loop(s, d)]),
    ],
    "check_transform_test": [
        works_by_complex_numbers,
        works_by_matrices,
        works_there_and_back,
        works_in_float32,
        works_in_a_table,
    ],
}
