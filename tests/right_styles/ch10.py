"""Right answers to the exercises of chapter 10, in the ways that people write them: each must pass its check."""

import math

import numpy as np

from pfslam.beyond.localization import kld_bound


def fox(k, epsilon, z):
    if k < 2:
        return 1
    a = 2 / (9 * (k - 1))
    return math.ceil((k - 1) / (2 * epsilon) * (1 - a + a**0.5 * z) ** 3)


def one_by_one(poses, epsilon, z, least):
    seen = []
    for n in range(len(poses)):
        x, y, theta = poses[n]
        cell = (x // 0.5, y // 0.5, math.degrees(theta) // 10)
        if cell not in seen:
            seen.append(cell)
        if n + 1 >= least and n + 1 >= fox(len(seen), epsilon, z):
            return n + 1
    return len(poses)


def in_arrays(poses, epsilon, z, least):
    cells = np.floor(poses / [0.5, 0.5, np.pi / 18]).astype(int)
    first = np.unique(cells, axis=0, return_index=True)[1]
    k = np.cumsum(np.isin(np.arange(len(poses)), first))
    n = np.arange(1, len(poses) + 1)
    good = n >= np.maximum([fox(bins, epsilon, z) for bins in k], least)
    return n[good][0] if good.any() else n[-1]


def count_up(poses, e, z, least):
    n = least
    while n < len(poses):
        k = len({tuple(np.floor(p / [0.5, 0.5, np.deg2rad(10)])) for p in poses[:n]})
        if n >= kld_bound(k, e, 0.5 * math.erfc(z / 2**0.5)):
            break
        n += 1
    return float(min(n, len(poses)))


def loop(fits, a, b):
    slow, fast, shares = 0.9, None, []
    for fit in fits:
        fast = fit if fast is None else (1 - b) * fast + b * fit
        slow = (1 - a) * slow + a * fit
        shares.append(0 if fast > slow else (slow - fast) / slow)
    return shares


def two_arrays(fits, a, b):
    slow, fast = [0.9], [fits[0]]
    for fit in fits:
        slow.append(slow[-1] + a * (fit - slow[-1]))
        fast.append(fast[-1] + b * (fit - fast[-1]))
    return np.clip(1 - np.array(fast[1:]) / slow[1:], 0, None)


STYLES = {
    "check_particles_needed": [one_by_one, in_arrays, count_up, lambda *given: [in_arrays(*given)]],
    "check_inject": [
        loop,
        two_arrays,
        lambda *given: tuple(loop(*given)),
        lambda *given: np.float32(two_arrays(*given)),
        lambda *given: np.round(loop(*given), 6),
    ],
}
