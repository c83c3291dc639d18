"""Every number that a run depends on, in one frozen object, with the two presets of the book.

``SlamConfig.report()`` is the filter as the report describes it. ``SlamConfig.refined()`` changes one ingredient after
another; each can be switched by itself with ``dataclasses.replace``, which is how the book shows what each one buys.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import inf, sqrt
from typing import Annotated, Literal

from pfslam.errors import DataError
from pfslam.grid import LOG_4, MapConfig
from pfslam.particles import ControlNoise, Scheme
from pfslam.refined.search.boxes import MAX_SCORES
from pfslam.refined.tilt import TiltConfig
from pfslam.settings import Range, Settings, plain

MAX_PARTICLES = 100_000
MAX_EVERY = 10**6
NOISY = 0.04
"""Ranges that scatter by more than this (m) smear a wall over several cells; common scanners are good to 1 or 2 cm."""
NoiseSize = Annotated[float, Range(0.0, 100.0)]
HalfWidth = Annotated[int, Range(0, 10_000)]
HalfWidths = tuple[HalfWidth, HalfWidth]
Stride = Annotated[int, Range(1, 10_000)]
Share = Annotated[float, Range(0.0, 1.0)]


@dataclass(frozen=True)
class MotionNoise(Settings):
    """Describe how the uncertainty of a motion between two scans grows with the metres moved and radians turned."""

    xy: NoiseSize = 0.02
    xy_per_metre: NoiseSize = 0.08
    yaw: NoiseSize = 0.005
    yaw_per_radian: NoiseSize = 0.05
    yaw_per_metre: NoiseSize = 0.06
    sampled: bool = True
    """Whether particles are moved by noise of this size. If not, it only sets the search window and the prior."""

    def sigmas(self, metres: float, radians: float) -> tuple[float, float]:
        """Return the standard deviations (m, rad) of position (each axis) and heading."""
        return (
            self.xy + self.xy_per_metre * metres,
            self.yaw + self.yaw_per_radian * radians + self.yaw_per_metre * metres,
        )


@dataclass(frozen=True)
class SearchConfig(Settings):
    """Choose how a particle searches for a better pose around itself, and how that pose changes its weight."""

    yaw_step: Annotated[float, Range(1e-5, 1.0)] = 0.005
    """Heading step of the lattice (rad); the step in x and y is one cell."""
    cells: HalfWidths = (4, 4)
    """Least and greatest half width of the window in cells; between them it spans three sigmas of the motion."""
    yaws: HalfWidths = (4, 4)
    """Least and greatest half width in heading steps."""
    beam_stride: Stride = 1
    """Every how-many-th beam is scored."""
    field: Literal["occupied", "distance"] = "occupied"
    """"occupied": count of end points on occupied cells. "distance": credit for near misses too."""
    prior: bool = False
    """Whether leaving the predicted pose costs something (the motion model's own density)."""
    sub_cell: bool = False
    """Whether a parabola through the best score and its neighbours refines the pose within a step."""
    keep_offset: bool = True
    """Whether a particle keeps its offset from the lattice node it was scored at (the report), or moves onto it."""
    sharpness: Annotated[float, Range(0.0, 1e6)] = 54.0
    """Log-likelihood of a perfect scan: one score for the whole scan, because its beams are not independent."""
    weight: Literal["count", "likelihood"] = "count"
    """"count": weights multiply by the score (Eq. 12). "likelihood": by exp(sharpness * mean score - prior cost)."""

    def __post_init__(self):
        super().__post_init__()
        for name in ("cells", "yaws"):
            least, greatest = getattr(self, name)
            if least > greatest:
                raise DataError("SearchConfig", name, (least, greatest), "a least and a greatest half width")
        poses = (2 * self.cells[1] + 1) ** 2 * (2 * self.yaws[1] + 1)
        if poses > MAX_SCORES:
            raise DataError(
                "SearchConfig", "cells, yaws", f"{poses} poses in a window", f"at most {MAX_SCORES}"
            )


@dataclass(frozen=True)
class PolishConfig(Settings):
    """Set the alignment of the estimate to the lines that the map's hits form."""

    iterations: Annotated[int, Range(1, 1000)] = 6
    min_hits: Annotated[int, Range(1, 10_000)] = 3
    reach: Annotated[int, Range(0, 10)] = 1
    """A beam sees the hits up to so many cells away: 1 gives 3 x 3 cells, 2 gives 5 x 5."""
    elongation: Annotated[float, Range(0.0, 1e6)] = 2.0
    """A cell's neighbourhood counts as a line if its long variance exceeds so many short ones (plus a floor)."""
    floor: Annotated[float, Range(1e-6, 1e6)] = 0.02
    """Floor under the short variance, in cells squared."""
    rho: Annotated[float, Range(1e-6, 1e6)] = 0.05
    """Distance (m) at which a beam's weight has fallen to exp(-1/2)."""
    beam_stride: Stride = 2
    degenerate_below: Share = 0.01
    """Least share of normals along a direction for the map to have a say in it; below, odometry decides."""
    independent_beams: Annotated[float, Range(0.0, 1e6)] = 0.0
    """As so many independent beams, each good to 2 cm, do the lines count against odometry; 0: it has no say else."""


@dataclass(frozen=True)
class CareConfig(Settings):
    """Set how a run takes care among what moves, and among glass."""

    gate: Annotated[float, Range(0.0, inf)] = 3.0
    """A match so many sigmas of the motion from odometry is not believed if beams stay unexplained."""
    unexplained: Share = 0.1
    """Greatest share of unexplained beams that a match beyond the gate may leave."""
    free_scans: Annotated[int, Range(1, 1000)] = 4
    """Beams that end in cells seen free so often, far from any wall, are left out of the match."""
    wait: Annotated[int, Range(1, 1000)] = 5
    """Hits near something that has gone wait for so many drawn scans before they are drawn."""
    gone: Annotated[int, Range(1, 1000)] = 2
    """Scans that must see through a hit, more than met it again, for it to have gone."""
    radius: Annotated[float, Range(0.0, 100.0)] = 0.5
    """How far from something that has gone hits wait (m): a person's width."""
    margin: Annotated[int, Range(0, 100)] = 2
    """Beams that end so few cells away, or fewer, did not see through a hit: they may have met the same wall."""


@dataclass(frozen=True)
class SlamConfig(Settings):
    """Collect all settings of one run of the filter, in SI units; sigmas are standard deviations.

    >>> from dataclasses import replace
    >>> few = replace(SlamConfig.refined(), particles=20)
    >>> few.particles, few.estimate
    (20, 'mean')
    """

    maps: Literal["shared", "per-particle"] = "shared"
    """"shared": one map, drawn from the estimate. "per-particle": a map for each particle (Rao-Blackwellised)."""
    particles: Annotated[int, Range(1, MAX_PARTICLES)] = 200
    every: Annotated[int, Range(1, MAX_EVERY)] | None = None
    """Every how-many-th scan is used; None takes the recording's own default."""
    noise: ControlNoise | MotionNoise = field(default_factory=MotionNoise)
    """White noise on every control sample (Eq. 11), or noise on the motion between two scans."""
    predict_before_first_scan: bool = False
    search: SearchConfig = field(default_factory=SearchConfig)
    map: MapConfig = field(default_factory=MapConfig)
    polish: PolishConfig | None = None
    """Alignment of the estimate to the map's lines; ``None`` leaves it out."""
    care: CareConfig | None = None
    """How to live with people and glass; ``None`` takes everything that a beam meets for a wall."""
    tilt: TiltConfig | None = None
    """How the body's lean is taken into account; ``None`` takes every floor to be flat."""
    estimate: Literal["best", "mean"] = "best"
    """"best": the particle of greatest weight. "mean": the weighted mean of all."""
    resample_below: Share = 0.1
    """Resample when N_eff is at most this share of N."""
    resampler: Scheme = "systematic"
    draw_metres: Annotated[float, Range(0.0, inf)] = 0.0
    draw_radians: Annotated[float, Range(0.0, inf)] = 0.0
    """The scan is drawn into the map after moving or turning by at least so much since the last one; inf: never."""
    min_beams: Annotated[int, Range(1, 10**6)] = 10
    """Scans with fewer valid beams are predicted through, not matched, and counted."""

    def __post_init__(self):
        super().__post_init__()
        noise = self.noise
        if self.particles > 1 and isinstance(noise, MotionNoise) and not noise.sampled:
            expected = "1 with matching, whose noise is not sampled: it has one pose"
            raise DataError("SlamConfig", "particles", self.particles, expected)

    @classmethod
    def report(cls, sigma_v: float = sqrt(0.1), sigma_omega: float = sqrt(0.02)) -> SlamConfig:
        """Return the report's filter: 729 perturbations, +-log 4 clamped at twice that, N_eff <= N / 10, best particle.

        The report calls 0.02 a variance and sets it for its first data set; for its second it takes
        ``sigma_omega = sqrt(0.05)``. Both arguments are standard deviations in m/s and rad/s.
        """
        return cls(noise=ControlNoise(sigma_v, sigma_omega), predict_before_first_scan=True)

    @classmethod
    def refined(cls) -> SlamConfig:
        """Return the accurate filter: gentle clearing, likelihood field, motion prior, sub-cell step, weighted mean."""
        return cls(
            search=SearchConfig(
                yaw_step=0.01,
                cells=(4, 10),
                yaws=(4, 30),
                beam_stride=2,
                field="distance",
                prior=True,
                sub_cell=True,
                keep_offset=False,
                weight="likelihood",
            ),
            map=MapConfig(free=0.1 * LOG_4, clamp=5.0 * LOG_4),
            polish=PolishConfig(),
            tilt=TiltConfig(),
            estimate="mean",
            resample_below=0.5,
            draw_metres=0.05,
            draw_radians=0.025,
        )

    @classmethod
    def per_particle(cls) -> SlamConfig:
        """Return the refined filter with a map for each of thirty particles, drawn from that particle's own path."""
        return replace(cls.refined(), maps="per-particle", particles=30, draw_metres=0.2, draw_radians=0.1)

    @classmethod
    def matching(cls) -> SlamConfig:
        """Return scan matching without particles: one pose, predicted by odometry, then matched and polished."""
        return replace(cls.refined(), particles=1, noise=MotionNoise(sampled=False))

    def careful(self, scatter: float = 0.0) -> SlamConfig:
        """Return the settings for a second look, where scans mislead: slower, made for people, glass and noisy ranges.

        With ``scatter`` (m), the standard deviation of the ranges, a beam must end farther behind a hit to have seen
        through it: four of them, which is three of the difference between two ranges. Above ``NOISY`` a line needs more
        hits: a few that scatter look like a line that is none. Methods without a polish, or with a map for each
        particle, come back as they are.
        """
        if self.polish is None or self.maps == "per-particle":
            return self
        min_hits = 8 if scatter > NOISY else self.polish.min_hits
        polish = replace(self.polish, min_hits=min_hits, elongation=1.3, independent_beams=150.0)
        margin = max(CareConfig.margin, round(4.0 * scatter / self.map.resolution))
        return replace(self, polish=polish, care=self.care or CareConfig(margin=margin))

    def as_dict(self) -> dict:
        """Return all settings as plain nested dictionaries, for ``summary.json`` and tables."""
        return {name: value for name, value in plain(self).items() if name != "kind"}


PRESETS: dict[str, Callable[[], SlamConfig]] = {
    "report": SlamConfig.report,
    "refined": SlamConfig.refined,
    "per-particle": SlamConfig.per_particle,
    "matching": SlamConfig.matching,
}
"""The methods by name, as the command line and studies know them."""
