"""One calibration: how scans and odometry agree, with standard errors.

The LiDAR's moves between scans, as ``scenes`` measures them, must follow from the odometry's: from how much farther the
robot drove and turned than its odometry says, from the drift of its heading, from how late the scans are, and from
where the LiDAR sits and where it looks. All of these are fitted at once by robust least squares, as Censi, Franchi,
Marchionni and Oriolo do ("Simultaneous calibration of odometry and sensor parameters for mobile robots", 2013).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pfslam.evaluation.scenes import LATEST, LEAST_PAIRS, NO_TURN, ROUNDS, Matcher, pairs_of_scans
from pfslam.motion import dead_reckoning
from pfslam.poses import Trajectory, wrap_angle
from pfslam.recording import Recording

FLOOR = np.array([0.005, 0.005, 0.002])
"""What a match is good to at best (m, m, rad)."""
ITERATIONS = 10
STEPS = np.array([1e-4, 1e-4, 5e-3, 1e-4, 1e-4, 1e-4, 1e-4])
"""Steps of the numerical derivatives; that of the clock is half of a usual odometry's period."""


class Estimate(NamedTuple):
    """A number and its standard error."""

    value: float
    error: float

    def within(self, expected: float, tolerance: float) -> bool | None:
        """Tell whether the number is as expected: None where its error leaves that open.

        It counts as wrong only if it is off by more than the tolerance and by more than three standard errors.
        """
        if not self.error <= tolerance:
            return None
        return bool(abs(self.value - expected) <= max(tolerance, 3.0 * self.error))


@dataclass(frozen=True)
class Mounting:
    """What scans say of odometry and mounting, each with its standard error.

    ``turns`` and ``ways`` are the robot's true turns and ways over the odometry's, ``drift`` (rad/s) is by how much it
    turned to the left of what these explain, and scans are ``late`` (s). The LiDAR looks ``yaw`` (rad) to the left of
    what is stated, and sits ``ahead`` (m) and ``left`` (m) of it. Half of the time it turns, within a second, by more
    than ``sway`` (rad) that nothing of this explains.
    """

    turns: Estimate
    drift: Estimate
    late: Estimate
    ways: Estimate
    yaw: Estimate
    ahead: Estimate
    left: Estimate
    sway: float


def fit_mounting(recording: Recording) -> Mounting:
    """Fit how scans and odometry agree; all errors are infinite if there are too few scans that can be compared.

    Scans always agree with an odometry that was made of them, which tells nothing. Every pair is matched twice, the
    second time from where the first fit expects it.
    """
    one, zero = Estimate(1.0, np.inf), Estimate(0.0, np.inf)
    nothing = Mounting(one, zero, zero, one, zero, zero, zero, 0.0)
    if recording.lidar is None or recording.scan_matched or not recording.robot.lidar.increment:
        return nothing
    path, t = dead_reckoning(recording), recording.lidar.t
    x, y, _ = recording.robot.lidar.position_b
    values, errors = np.array([1.0, 0.0, 0.0, 1.0, 0.0, x, y]), np.zeros(0)
    for apart, reaches in ROUNDS:
        first, second = pairs_of_scans(recording, path, apart)
        if len(first) < LEAST_PAIRS:
            return nothing
        # Where scans are late, the motion during a sweep is the odometry's of as much earlier.
        then = Trajectory(path.t + np.clip(values[2], -LATEST, LATEST), path.poses)
        matcher = Matcher.of(recording, then, first, second)
        expected = Drive.of(path, t[first], t[second]).moves(values)
        moves, covariance, good = matcher.match(matcher.best(0.0 * expected, expected), reaches)
        if np.count_nonzero(good) < LEAST_PAIRS:
            return nothing
        drive = Drive.of(path, t[first[good]], t[second[good]])
        values = drive.start(moves[good]) if not len(errors) else values
        values, errors = drive.fit(values, moves[good], covariance[good])
    if drive.turns_at_one_rate(LEAST_PAIRS):
        return nothing
    if np.abs(drive.odometry(0.0)[1]).max() < NO_TURN:  # the factor is 0 where only the scans turn
        turned = np.count_nonzero(np.abs(moves[good, 2]) > 2.0 * NO_TURN) >= LEAST_PAIRS
        values[0], errors[[0, 2]] = 0.0, (0.0 if turned else np.inf, np.inf)
    sway = drive.sway(values, moves[good])
    turns, drift, late, ways, yaw, ahead, left = map(Estimate, values - [0, 0, 0, 0, 0, x, y], errors)
    return Mounting(turns, drift, late, ways, yaw, ahead, left, sway)


@dataclass(frozen=True, eq=False)
class Drive:
    """An odometry's poses by ``columns (3, K)`` at stamps ``t (K,)``, and pairs of scans at ``t0`` and ``t1 (P,)`` (s).

    Headings (rad) go on beyond a whole turn. ``values (7,)`` are those of a ``Mounting``, in its order, but the
    place of the LiDAR is that on the robot, not the difference from what is stated.
    """

    t: np.ndarray
    columns: np.ndarray
    t0: np.ndarray
    t1: np.ndarray

    @classmethod
    def of(cls, path: Trajectory, t0: np.ndarray, t1: np.ndarray) -> Drive:
        """Take the columns from a path."""
        return cls(path.t, np.array([*path.poses[:, :2].T, np.unwrap(path.poses[:, 2])]), t0, t1)

    def odometry(self, late: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the odometry's ways and turns (rad) between the scans ``(P,)``, if these are ``late`` (s).

        Ways are complex (m), ahead and to the left of the mean of the headings at both ends.
        """
        before, after = (
            np.array([np.interp(t - late, self.t, c) for c in self.columns]) for t in (self.t0, self.t1)
        )
        x, y, turn = after - before
        return (x + 1j * y) * np.exp(-1j * (before[2] + 0.5 * turn)), turn

    def turns_at_one_rate(self, least: int) -> bool:
        """Tell whether fewer than ``least`` pairs turn otherwise than the median: such a robot may as well drift."""
        turn = self.odometry(0.0)[1]
        otherwise = np.abs(turn - np.median(turn)) > NO_TURN
        return bool(np.abs(np.median(turn)) > NO_TURN and np.count_nonzero(otherwise) < least)

    def moves(self, values: np.ndarray) -> np.ndarray:
        """Return the LiDAR's moves between the scans of each pair ``(P, 3)`` (m, m, rad) that the values predict."""
        turns, drift, late, ways, yaw, x, y = values
        way, turn = self.odometry(late)
        turn = turns * turn + drift * (self.t1 - self.t0)
        by_arm = (np.exp(1j * turn) - 1.0) * (x + 1j * y)
        move = np.exp(-1j * yaw) * (ways * way * np.exp(0.5j * turn) + by_arm)
        return np.column_stack([move.real, move.imag, turn])

    def off(self, values: np.ndarray, moves: np.ndarray) -> np.ndarray:
        """Return by how much the prediction is off ``moves (P, 3)``."""
        off = self.moves(values) - moves
        return np.column_stack([off[:, :2], wrap_angle(off[:, 2])])

    def sway(self, values: np.ndarray, moves: np.ndarray) -> float:
        """Return by how much (rad in a second) half of the calmer pairs turn otherwise than they usually do."""
        calm = np.abs(moves[:, 2]) <= np.median(np.abs(moves[:, 2]))
        off = (self.off(values, moves)[:, 2] / np.maximum(self.t1 - self.t0, 1.0))[calm]
        return float(np.median(np.abs(off - np.median(off))))

    def start(self, moves: np.ndarray) -> np.ndarray:
        """Solve in closed form, clock by clock: any yaw and any scale are found, for both equations are linear.

        The clock that explains most turns counts. Then a move is a * way + b * (exp(i turn) - 1) with complex a and b.
        """
        lates = np.linspace(-0.9 * LATEST, 0.9 * LATEST, 19)
        rows = [np.column_stack([self.odometry(late)[1], self.t1 - self.t0]) for late in lates]
        fits = [robust_fit(A, moves[:, 2]) for A in rows]
        left = np.abs([A @ fit - moves[:, 2] for A, fit in zip(rows, fits, strict=True)])
        scale = np.median(left, axis=1).min() + FLOOR[2]
        best = int(np.argmin((left**2 / (left**2 + scale**2)).sum(axis=1)))
        half = np.exp(0.5j * moves[:, 2])
        A = np.column_stack([self.odometry(lates[best])[0] * half, half**2 - 1.0])
        a, b = robust_fit(A, moves[:, 0] + 1j * moves[:, 1])
        place = b * np.exp(-1j * np.angle(a))
        return np.array([*fits[best], lates[best], np.abs(a), -np.angle(a), place.real, place.imag])

    def fit(
        self, values: np.ndarray, moves: np.ndarray, covariance: np.ndarray, known: slice = slice(0)
    ) -> tuple[np.ndarray, np.ndarray]:
        """Improve the values by Gauss-Newton steps with Cauchy weights; also return their standard errors ``(7,)``.

        Values that are ``known`` stay as they are.

        The errors follow from each pair's own residual (Huber, "The behavior of maximum likelihood estimates under
        nonstandard conditions", 1967): so slip and poor matches count in full.
        """
        whiten = np.linalg.inv(np.linalg.cholesky(covariance + np.diag(FLOOR**2)))
        for _ in range(ITERATIONS):
            apart = [self.moves(values + e) - self.moves(values - e) for e in np.diag(STEPS)]
            J = whiten @ (np.stack(apart, axis=-1) / (2.0 * STEPS))
            J[..., known] = 0.0
            r = (whiten @ self.off(values, moves)[..., None])[..., 0]
            size = np.linalg.norm(r, axis=1)
            scale = max(float(np.median(size)), 0.5)
            weight = 1.0 / (1.0 + (size / (4.0 * scale)) ** 2)
            H = np.einsum("pik,p,pil->kl", J, weight, J)
            H += np.diag(1e-9 * np.diag(H) + 1e-6)
            gradient = np.einsum("pik,p,pi->pk", J, weight, r)
            step = -np.linalg.solve(H, gradient.sum(axis=0))
            step[2] = np.clip(step[2], -0.05, 0.05)
            values = values + step
        inverse, values[4] = np.linalg.inv(H), wrap_angle(values[4])
        variance = ((inverse @ gradient.T) ** 2).sum(axis=1) + 0.01 * scale**2 * np.abs(np.diag(inverse))
        return values, np.sqrt(variance)


def robust_fit(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Solve ``A (P, k)`` x = ``b (P,)``, real or complex, for the least sum of absolute residuals."""
    weight = np.ones(len(b))
    for _ in range(10):
        x = np.linalg.lstsq(weight[:, None] * A, weight * b, rcond=1e-9)[0]
        weight = np.maximum(np.abs(A @ x - b), 1e-3) ** -0.5
    return x
