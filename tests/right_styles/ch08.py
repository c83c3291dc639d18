"""Right answers to the exercises of chapter 08, in the ways that people write them: each must pass its check."""

import numpy as np

POSES = np.column_stack([np.arange(5.0), 10.0 + np.arange(5.0), 0.1 * np.arange(5.0)])
WEIGHTS = np.array([0.4, 0.3, 0.2, 0.1, 0.0])


def by_loop(resample):
    rng, counts = np.random.default_rng(3), [0] * 5
    for _ in range(400):
        new, new_weights = resample(POSES, WEIGHTS, rng)
        for row in new:
            found = [k for k in range(5) if list(row) == list(POSES[k])]
            if not found:
                return True
            counts[found[0]] += 1
        if max(abs(w - 0.2) for w in new_weights) > 1e-9:
            return True
    return any(abs(c / 400 - 5 * w) > 0.2 for c, w in zip(counts, WEIGHTS, strict=True))


def grid_search(cells, step=0.01):
    shifts = np.arange(-0.3, 0.3 + 1e-4, step)
    return shifts[np.argmin([cells(s) for s in shifts])]


def in_two_passes(cells):
    best = 0.0
    for step in (0.05, 0.005):
        best = min((best + k * step for k in range(-7, 8)), key=cells)
    return best


def with_scipy(cells):
    from scipy.optimize import minimize_scalar

    return minimize_scalar(cells, bounds=(-0.3, 0.3), method="bounded").x


STYLES = {
    "check_looks_broken": [
        by_loop,
        lambda resample: int(by_loop(resample)),
        lambda resample: np.bool_(by_loop(resample)),
        lambda resample: np.array(by_loop(resample)),
        lambda resample: float(by_loop(resample)),
    ],
    "check_find_shift": [
        lambda cells: grid_search(cells, 0.005),
        lambda cells: min([k / 100 for k in range(-30, 31)], key=cells),
        lambda cells: np.float32(grid_search(cells)),
        lambda cells: np.array([grid_search(cells)]),
        in_two_passes,
        with_scipy,
        lambda cells: min((cells(s / 100), s / 100) for s in range(-30, 31))[1],
    ],
}
