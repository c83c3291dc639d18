"""What the accurate filter tells of each scan."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pfslam.particles import Particles, effective_sample_size
from pfslam.refined.events import RefinedEvent
from pfslam.refined.map import Fix, Prior, RefinedMap
from pfslam.refined.matching import Match
from pfslam.slam import Step


@dataclass(frozen=True, eq=False)
class RefinedStep(Step):
    """What happened in one step of the accurate filter: as in ``Step``, and more.

    ``matched`` is False for the first scan, for scans with too few beams, and for those whose match lay beyond the
    gate, which are ``rejected``; ``struck_floor`` beams were left out because they met the floor.
    """

    struck_floor: int = 0
    rejected: bool = False
    aligned_score: float = 0.0
    """The score at the estimate: where odometry is far off, lines lead it to where no particle has searched."""
    aligned: bool = False
    """Whether lines of the map have moved the estimate."""
    silent_direction: np.ndarray | None = None
    """The direction ``(2,)`` along which no line constrained the pose, None where there was none."""
    departure: np.ndarray = field(default_factory=lambda: np.zeros(2))
    """How far ``(2,)`` the scan moved the estimate from where odometry had put it (m, world axes)."""
    unexplained: float = 0.0
    """Share of the beams that end in ground seen before, but more than two cells from any wall of the map."""
    old_walls: float = 0.0
    """By how much the share of beams on walls drawn long before is larger at the estimate than where odometry led.

    "Where odometry led": the estimate without what scans have corrected over about the last metre.
    """
    covariance: np.ndarray | None = None
    """Covariance ``(3, 3)`` of the estimate (m^2, m rad, rad^2; world axes), relative to the first scan drawn.

    It comes from the map's lines, not from the cloud (see ``pfslam.refined.covariance``); None without lines.
    """

    @classmethod
    def coasted(
        cls,
        event: RefinedEvent,
        pose: np.ndarray,
        particles: Particles,
        covariance: np.ndarray | None,
        rejected: bool = False,
        drawn: bool = False,
    ) -> RefinedStep:
        """Describe a step whose scan was not matched."""
        n_eff, beams = effective_sample_size(particles.weights), len(event.beams)
        return cls(
            event.t,
            pose,
            particles,
            n_eff,
            beams,
            struck_floor=event.struck_floor,
            covariance=covariance,
            rejected=rejected,
            drawn=drawn,
        )

    @classmethod
    def matched_scan(
        cls,
        event: RefinedEvent,
        prior: Prior,
        match: Match,
        particles: Particles,
        n_eff: float,
        log_evidence: float,
        fix: Fix,
        map: RefinedMap,
    ) -> RefinedStep:
        """Describe a step whose scan was matched, with the map as it was then."""
        uncorrected = fix.pose - np.append(prior.corrected_by(fix.pose), 0.0)
        return cls(
            event.t,
            fix.pose,
            particles,
            n_eff,
            len(event.beams),
            matched=True,
            scored=log_evidence > -np.inf,
            score=float(particles.weights @ match.score),
            log_evidence=log_evidence,
            struck_floor=event.struck_floor,
            aligned_score=fix.score,
            aligned=fix.aligned,
            silent_direction=fix.silent_direction,
            departure=fix.pose[:2] - prior.pose[:2],
            unexplained=map.unexplained(event, fix.pose),
            old_walls=map.on_old_walls(event, fix.pose) - map.on_old_walls(event, uncorrected),
            covariance=fix.covariance,
        )
