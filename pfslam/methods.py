"""The methods by name: the one choice that stands above the report's filter and the accurate ones.

The table says where each method's settings are made. They are imported when a method is asked for and not before, so
that whoever runs the report's filter needs none of the others.
"""

from __future__ import annotations

from pkgutil import resolve_name
from typing import Any

METHODS = {
    "report": "pfslam.slam:SlamConfig.report",
    "refined": "pfslam.refined.step:RefinedConfig",
    "per-particle": "pfslam.beyond.per_particle:PerParticleConfig",
    "matching": "pfslam.refined.step:RefinedConfig.matching",
}
"""By the name of a method: the module and the function that makes its settings."""


def preset(method: str) -> Any:
    """Return the settings of a method: a ``SlamConfig``, or one of the classes that extend it.

    >>> preset("report").particles
    200
    """
    return resolve_name(METHODS[method])()
