"""A filter in the middle of its drive, in one ``.npz`` file of plain numbers: read back, it goes on to the last bit.

The layers of the map and the columns of the steps are arrays; all that is small is JSON, kept as its UTF-8 bytes in the
array ``told``. The array ``seal`` is a check sum over them, so that a file is the one that was written, or refused.
"""

from __future__ import annotations

import json
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numpy as np

from pfslam.errors import DataError
from pfslam.grid import Canvas, GridSpec
from pfslam.io.files import read_npz, write_npz
from pfslam.particles import Particles
from pfslam.refined.health import COLUMNS, Steps
from pfslam.refined.map import RefinedMap
from pfslam.refined.odometer import Odometer
from pfslam.refined.outliers import WaitingScan
from pfslam.refined.step import RefinedBelief, RefinedConfig
from pfslam.sensors import LidarModel, RobotModel
from pfslam.settings import changed, plain, written

FORMAT = b"pfslam belief 6"
"""Changes with the layout, and the seal with it."""
LAYERS = ("log_odds", "scores", "slots", "sums", "first", "drawn")
STEPS = {f"step_{name}": name for name in COLUMNS}


def write_belief(
    path: str | Path,
    config: RefinedConfig,
    rng: np.random.Generator,
    odometer: Odometer,
    belief: RefinedBelief,
    steps: Steps,
) -> None:
    """Write all that the next scan needs, whole or not at all."""
    state, map = rng.bit_generator.state, belief.map
    if state["bit_generator"] != "PCG64":
        raise DataError(path, "rng", state["bit_generator"], "NumPy's default generator, PCG64")
    told = {
        "config": plain(config),
        "lidar": plain(odometer.robot.lidar),
        "rng": state,
        "odometer": {name: value for name, value in vars(odometer).items() if name != "robot"},
        "particles": vars(belief.particles),
        "belief": [belief.estimate, belief.variance, belief.covariance, belief.corrected],
        "map": [map.spec.origin, map.drawn_at, [vars(scan) for scan in map.waiting]],
    }
    text = json.dumps(told, default=_as_list)
    moments, drawn = map.moments, np.reshape(map.drawn, (-1, 3, 3))
    layers = map.grid.log_odds, map.field, moments.slots.values, moments.sums, moments.first, drawn
    arrays = {"told": np.frombuffer(text.encode(), dtype=np.uint8)} | dict(zip(LAYERS, layers, strict=True))
    arrays |= {key: steps.columns[name] for key, name in STEPS.items()}
    write_npz(path, **arrays, seal=_seal(arrays))


def read_belief(
    path: str | Path,
) -> tuple[RefinedConfig, np.random.Generator, Odometer, RefinedBelief, Steps]:
    """Read what ``write_belief`` wrote; ``DataError`` for any other file."""
    data = read_npz(path, ("told", *LAYERS, *STEPS, "seal"))
    if not np.array_equal(data.pop("seal"), _seal(data)):
        expected = "what Mapper.save of this version wrote"
        raise DataError(path, "seal", "one of other numbers than the file's", expected)
    told = json.loads(data["told"].tobytes(), object_hook=_as_array)
    config, rng = changed(RefinedConfig(), written(RefinedConfig, told["config"])), np.random.default_rng(0)
    rng.bit_generator.state = told["rng"]
    odometer = Odometer(RobotModel(lidar=changed(LidarModel(), written(LidarModel, told["lidar"]))))
    vars(odometer).update(told["odometer"])
    particles = Particles(**told["particles"])
    vars(particles).update(told["particles"])  # normalised a second time, weights may differ in the last bit
    origin, drawn_at, waiting = told["map"]
    spec = GridSpec(origin, config.map.resolution, data["log_odds"].shape)
    map = RefinedMap(config.map, spec, config.lines, config.outliers)
    map._log_odds, map._scores, slots = (Canvas(spec, data[n].dtype, data[n]) for n in LAYERS[:3])
    map.moments.slots, map.moments.used = slots, len(data["first"])
    map.moments._sums, map.moments._first = data["sums"], data["first"]
    map.drawn, map.drawn_at = list(data["drawn"]), drawn_at
    map.is_empty = drawn_at is None
    map.waiting = tuple(WaitingScan(**scan) for scan in waiting)
    estimate, variance, covariance, corrected = told["belief"]
    belief = RefinedBelief(particles, estimate, map, variance, covariance, corrected)
    return config, rng, odometer, belief, Steps.of_columns({name: data[key] for key, name in STEPS.items()})


def _as_list(value: Any) -> Any:
    return {"array": value.tolist()} if isinstance(value, np.ndarray) else value.item()


def _as_array(told: dict[str, Any]) -> Any:
    return np.array(told["array"]) if "array" in told else told


def _seal(arrays: dict[str, np.ndarray]) -> np.ndarray:
    """Compute a check sum over names, types, shapes and numbers."""
    seal = blake2b(FORMAT)
    for name, values in arrays.items():
        seal.update(f"{name} {values.dtype} {values.shape}".encode() + values.tobytes())
    return np.frombuffer(seal.digest(), dtype=np.uint8)
