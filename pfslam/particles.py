"""The belief as a cloud of weighted poses: predict, reweight, resample.

Weights are kept as logarithms: a product of a thousand small numbers is a sum, and nothing underflows. Poses and
weights live in one immutable object, so that no function can move one without the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Annotated, Literal

import numpy as np

from pfslam.errors import DataError
from pfslam.motion import motion_model
from pfslam.settings import Range, Settings

MAX_PARTICLES = 100_000
Scheme = Literal["systematic", "stratified", "multinomial", "residual"]


@dataclass(frozen=True, eq=False)
class Particles:
    """``poses (N, 3)`` and normalised ``log_weights (N,)``: mu[k] and log alpha[k] of the report. Implements Eq. 10.

    Weights given unnormalised are normalised here, so that they always sum to one.
    """

    poses: np.ndarray
    log_weights: np.ndarray

    def __post_init__(self):
        poses, log_weights = np.asarray(self.poses, dtype=float), np.asarray(self.log_weights, dtype=float)
        if (
            poses.ndim != 2
            or poses.shape[1:] != (3,)
            or log_weights.shape != (len(poses),)
            or len(poses) == 0
        ):
            raise DataError(
                "Particles", "shapes", f"{poses.shape}, {log_weights.shape}", "(N, 3), (N,) with N >= 1"
            )
        total = log_sum_exp(log_weights)
        if not (np.isfinite(total) and np.isfinite(poses).all()):
            raise DataError(
                "Particles", "poses, log_weights", "NaN, or no weight above zero", "finite poses, some weight"
            )
        object.__setattr__(self, "poses", poses)
        object.__setattr__(self, "log_weights", log_weights - total)

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def weights(self) -> np.ndarray:
        """Weights ``(N,)`` that sum to one: alpha[k] of the report."""
        return np.exp(self.log_weights)

    @classmethod
    def at(cls, pose, n: int) -> Particles:
        """Put ``n`` particles at one pose ``(3,)`` with equal weights 1 / n: the report's start."""
        return cls(np.tile(np.asarray(pose, dtype=float), (n, 1)), np.zeros(n))


@dataclass(frozen=True)
class ControlNoise(Settings):
    """White noise on the control at every sample: standard deviations in m/s and rad/s.

    The spread that it causes depends on the sample rate. ``per_root_second`` reads the same two numbers as densities
    (m / s^0.5 and rad / s^0.5), dividing by the root of dt, which makes the spread independent of the rate.
    The defaults are the report's.
    """

    sigma_v: Annotated[float, Range(0.0, 100.0)] = sqrt(0.1)
    sigma_omega: Annotated[float, Range(0.0, 100.0)] = sqrt(0.02)
    per_root_second: bool = False


def log_sum_exp(values: np.ndarray) -> float:
    """Compute log(sum(exp(values))) without overflow; -inf if every value is -inf."""
    top = np.max(values)
    return float(top + np.log(np.sum(np.exp(values - top)))) if np.isfinite(top) else float(top)


def predict(
    particles: Particles, v, omega, dt: float, noise: ControlNoise, rng: np.random.Generator
) -> Particles:
    """Drive every particle for ``dt`` s by its own noisy control, weights unchanged. Implements Eq. 11.

    >>> cloud = Particles.at(np.zeros(3), 100)
    >>> noise = ControlNoise(sigma_v=0.1, sigma_omega=0.1)
    >>> moved = predict(cloud, 1.0, 0.0, 0.5, noise, np.random.default_rng(0))
    >>> moved.poses.shape, bool(abs(moved.poses[:, 0].mean() - 0.5) < 0.02)
    ((100, 3), True)
    """
    n = len(particles)
    scale = 1.0 / np.sqrt(dt) if noise.per_root_second else 1.0
    noisy_v = v + scale * noise.sigma_v * rng.standard_normal(n)
    noisy_omega = omega + scale * noise.sigma_omega * rng.standard_normal(n)
    return Particles(motion_model(particles.poses, noisy_v, noisy_omega, dt), particles.log_weights)


def reweight(particles: Particles, log_likelihood: np.ndarray) -> tuple[Particles, float]:
    """Multiply weights by likelihoods and normalise; also return the log evidence log p(z). Implements Eq. 12.

    ``log_likelihood (N,)``. If no particle has any likelihood the scan says nothing: the particles come back as they
    were, with evidence -inf for the caller to count.

    >>> cloud, evidence = reweight(Particles.at(np.zeros(3), 2), np.log([803.0, 811.0]))
    >>> cloud.weights.round(4).tolist()
    [0.4975, 0.5025]
    """
    joint = particles.log_weights + log_likelihood
    log_evidence = log_sum_exp(joint)
    if log_evidence == -np.inf:
        return particles, log_evidence
    return Particles(particles.poses, joint), log_evidence


def effective_sample_size(weights: np.ndarray) -> float:
    """N_eff = 1 / sum(w^2) of normalised weights ``(N,)``: 1 if one has all, N if all are equal. Implements Eq. 13.

    >>> float(effective_sample_size([0.5, 0.5, 0.0, 0.0]))
    2.0
    """
    weights = np.asarray(weights, dtype=float)
    if not abs(weights.sum() - 1.0) <= 1e-5:
        raise DataError(
            "effective_sample_size", "weights", f"sum {weights.sum():.6g}", "weights that sum to 1"
        )
    return float(1.0 / np.sum(weights**2))


def _checked(weights) -> np.ndarray:
    weights = np.asarray(weights, dtype=float)
    if weights.ndim != 1 or not (weights >= 0).all() or not 0 < weights.sum() < np.inf:
        raise DataError("resampling", "weights", weights, "(N,) finite weights, none negative, not all zero")
    return weights


def _pick(weights: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Return the particle in whose share of [0, 1) each position falls; never one of zero weight."""
    edges = np.cumsum(weights)
    last = int(np.flatnonzero(weights)[-1])  # round-off may leave the last edge short of 1
    return np.minimum(np.searchsorted(edges / edges[-1], positions, side="right"), last)


def systematic_resample(weights: np.ndarray, rng: np.random.Generator, n: int | None = None) -> np.ndarray:
    """Draw ancestors ``(n,)``: one random offset, then n equal strides through the cumulative weights.

    ``n=None`` draws as many as there are weights.

    >>> systematic_resample([0.6, 0.25, 0.15], np.random.default_rng(0)).tolist()
    [0, 0, 2]
    >>> systematic_resample([0.6, 0.25, 0.15], np.random.default_rng(0), 5).tolist()
    [0, 0, 0, 1, 2]
    """
    weights, n = _checked(weights), len(weights) if n is None else n
    return _pick(weights, (np.arange(n) + rng.random()) / n)


def stratified_resample(weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw ancestors ``(N,)``: one random position in each of N equal strata."""
    weights, n = _checked(weights), len(weights)
    return _pick(weights, (np.arange(n) + rng.random(n)) / n)


def multinomial_resample(weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw ancestors ``(N,)``: N independent draws."""
    return _pick(_checked(weights), np.sort(rng.random(len(weights))))


def residual_resample(weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw ancestors ``(N,)``: floor(N w) copies for certain, the rest from what remains of each weight."""
    weights, n = _checked(weights), len(weights)
    expected = n * weights / np.sum(weights)
    certain = np.floor(expected + 1e-9).astype(int)  # 3 * (1/3) must count as one whole copy
    ancestors = np.repeat(np.arange(n), certain)[:n]
    missing = n - len(ancestors)
    if missing == 0:
        return ancestors
    remainder = np.maximum(expected - certain, 0.0)
    return np.sort(
        np.concatenate([ancestors, _pick(remainder / remainder.sum(), np.sort(rng.random(missing)))])
    )


RESAMPLERS = {
    "systematic": systematic_resample,
    "stratified": stratified_resample,
    "multinomial": multinomial_resample,
    "residual": residual_resample,
}


def resample(particles: Particles, rng: np.random.Generator, scheme: str = "systematic") -> Particles:
    """Draw N particles by weight, all with weight 1 / N afterwards."""
    ancestors = RESAMPLERS[scheme](particles.weights, rng)
    return Particles(particles.poses[ancestors], np.zeros(len(particles)))
