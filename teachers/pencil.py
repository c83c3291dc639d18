"""The numbers of the solutions to the pencil questions, one short function for each chapter.

Every function returns what its solution prints, in SI units unless a name says otherwise. `tests/test_teachers.py`
holds each against a simulation or another way to the same number.
"""

from math import atan, ceil, comb, degrees, exp, hypot, log, pi, radians, sin, sqrt, tan

import numpy as np

CELL = 0.05  # side of a cell (m)
BEAM = radians(0.25)  # between two beams
SPEED, TURNING = 0.97, 1.5  # cruise speed (m/s), fastest turn (rad/s)
COUNT = 0.0022  # metres of one encoder count
FOCAL, CAMERA_HEIGHT, PITCH = 585.051, 0.38001, radians(18)  # px, m, rad


def p00() -> dict[str, float]:
    """Whole counts: what one reading says about the speed, and about the way."""
    counts = SPEED * 0.025 / COUNT
    return {"counts": counts, "percent": 100 / counts, "way_mm": 1000 * COUNT, "window": 100 * COUNT / SPEED}


def p01() -> dict[str, float]:
    """A square of 10 m driven with a gyro that shows 1/1.03 of a turn: where dead reckoning ends."""
    corner = pi / 2 / 1.03
    gap = 10 * sin(2 * corner) / sin(corner / 2)
    missing, lap = 4 * (pi / 2 - corner), 40 / SPEED
    return {
        "corner_deg": degrees(corner),
        "gap": gap,
        "heading_deg": degrees(missing),
        "bias": missing / lap,
        "lap": lap,
    }


def p02(share: float = 0.6, least: float = 0.99) -> dict[str, float]:
    """A wall cell that a scan hits with probability ``share`` and crosses otherwise, with a clamp of n steps."""
    ratio = share / (1 - share)

    def occupied(n: int) -> float:
        weights = ratio ** np.arange(-n, n + 1)
        return float(weights[n + 1 :].sum() / weights.sum())

    clamp = next(n for n in range(1, 100) if occupied(n) >= least)
    return {
        "two": occupied(2),
        "clamp": clamp,
        "at_clamp": occupied(clamp),
        "scans": clamp + 1,
        "break_even_gentle": 0.1 / 1.1,
    }


def p03(sigma: float = sqrt(0.02), tau: float = 0.01, time: float = 10.0) -> dict[str, float]:
    """A straight drive with noise on the yaw rate: how far particles end to the side."""
    q = sigma**2 * tau
    side = SPEED * sqrt(q * time**3 / 3)
    return {
        "heading_deg": degrees(sqrt(q * time)),
        "side": side,
        "correlation": sqrt(3) / 2,
        "given": side / 2,
        "doubling": 2**1.5,
    }


def p04(half: float = 1.0, sharpness: float = 54.0) -> dict[str, float]:
    """Beams on one cell of a corridor's wall, ``half`` metres to the side."""
    beside = CELL / (half * BEAM)
    far = sqrt(half * CELL / BEAM - half**2)
    return {
        "beside": beside,
        "far": far,
        "beyond_percent": 100 * (1 - atan(far / half) / (pi / 2)),
        "changed": 2 * beside,
        "ratio": exp(sharpness * 2 * beside / 1081),
    }


def p05(n: int = 100, rate: float = 4.0) -> dict[str, float]:
    """Resampling by independent draws from equal weights: what becomes of the first ancestors."""
    return {
        "survive_percent": 100 * (1 - (1 - 1 / n) ** n),
        "one_left": 2 * n * (1 - 1 / n),
        "seconds": 2 * n * (1 - 1 / n) / rate,
    }


def p06() -> dict[str, float]:
    """How a cell of the floor shrinks in the image, and how far it moves meanwhile."""

    def rows(x: float) -> float:
        """Rows of the image that a cell ``x`` metres ahead of the camera fills."""
        edges = [FOCAL * tan(atan(CAMERA_HEIGHT / (x + d)) - PITCH) for d in (-CELL / 2, CELL / 2)]
        return edges[0] - edges[1]

    low, high = 1.0, 10.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if rows(middle) > 1 else (low, middle)
    late = 0.03
    return {
        "rows_1": rows(1.0),
        "one_row": low,
        "rough": sqrt(FOCAL * CAMERA_HEIGHT * CELL),
        "moved": TURNING * late * 3,
        "range_turning": CELL / (TURNING * late),
    }


def p07(p: float = 0.7, power: float = 0.8) -> dict[str, float]:
    """The sign test: when it decides, and how often it finds a change that helps in a share ``p`` of buildings."""

    def tail(n: int, k: int, q: float) -> float:
        return sum(comb(n, i) * q**i * (1 - q) ** (n - i) for i in range(k, n + 1))

    def needed(n: int) -> int:
        return next(k for k in range(n + 2) if 2 * tail(n, k, 0.5) <= 0.05)

    enough = [n for n in range(6, 200) if tail(n, needed(n), p) >= power]
    first = enough[0]
    return {
        "needed": needed(20),
        "level": 2 * tail(20, needed(20), 0.5),
        "found_percent": 100 * tail(20, needed(20), p),
        "buildings": first,
        "all_win": next(n for n in range(1, 20) if 2 * 0.5**n <= 0.05),
    }


def p08(sigma: float = 0.002) -> dict[str, float]:
    """Rest, steady turn and start of a turn: how well bias, scale and delay follow from them."""
    rest, steady, start = (0.0, 0.0, 5.0), (6.0, 0.0, 4.0), (0.75, 1.5, 1.0)
    rows = np.array([(turn, -faster, -time) for turn, faster, time in (rest, steady, start)])
    scale, delay, bias = (sigma * np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))).tolist()
    return {"bias": bias, "scale": scale, "delay_ms": 1000 * delay}


def p09(sigma: float = 0.01, distance: float = 20.0, beams: int = 1000) -> dict[str, float]:
    """A corridor two metres wide with an end wall ``distance`` ahead: how sure across, and how sure along."""
    ahead = 2 * atan(1 / distance) / BEAM
    thin = sqrt(beams / 54)  # as if one beam in so many had an error of its own
    return {
        "ahead": ahead,
        "across_mm": 1000 * sigma / sqrt(beams),
        "along_mm": 1000 * sigma / sqrt(ahead),
        "along_honest_mm": 1000 * sigma / sqrt(ahead) * thin,
        "one_beam": 1 / tan(BEAM / 2),
        "range": 30.0,
    }


def p10(area: float = 300.0, near: float = 0.25, turn: float = 5.0, missed: float = 0.01) -> dict[str, float]:
    """How many particles, spread over ``area``, leave none near the robot with probability ``missed``."""
    share = pi * near**2 / area * 2 * turn / 360
    n = ceil(log(missed) / log(1 - share))
    return {
        "share": share,
        "n": n,
        "expected": n * share,
        "half": ceil(log(missed) / log(1 - share / 8)),
    }


def p11(q: float = 0.01**2, r: float = 0.05**2) -> dict[str, float]:
    """A rail on which every step adds the variance ``q`` and every look has the variance ``r``."""
    after = (-q + sqrt(q * q + 4 * q * r)) / 2
    gain = after / r
    return {
        "sigma_cm": 100 * sqrt(after),
        "gain": gain,
        "looks": ceil(log(0.01) / log(1 - gain)),
        "rough_cm": 100 * (q * r) ** 0.25,
    }


def p12(n: int = 95, step: float = 0.02) -> dict[str, float]:
    """A chain of ``n`` edges, each off by ``step`` (standard deviation), whose end is tied to its beginning."""
    return {
        "before_cm": 100 * step * sqrt(n),
        "middle_cm": 100 * step * sqrt(n) / 2,
        "share_percent": 100 / n,
        "scale_m": 0.02 * n,
        "both_cm": 100 * step * sqrt(n / 2) / 2,
    }


def p13(far: float = 10.0) -> dict[str, float]:
    """What moves a wall ``far`` metres away by one cell while the robot turns, and by half a cell."""
    quarter = pi / 2
    found = {
        "clock_ms": 1000 * CELL / (TURNING * far),
        "yaw_deg": degrees(CELL / far),
        "scale_percent": 100 * CELL / (far * quarter),
        "lever_cm": 100 * CELL / hypot(1, 1),
    }
    return found | {f"{name}_half": value / 2 for name, value in found.items()}


NUMBERS = {
    make.__name__: make() for make in (p00, p01, p02, p03, p04, p05, p06, p07, p08, p09, p10, p11, p12, p13)
}
"""All of them, by chapter."""
