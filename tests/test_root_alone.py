"""The root of the package stands alone: without the wings the report's filter still runs, to the same numbers."""

import os
import shutil
import subprocess
import sys

import numpy as np
from test_architecture import MODULES, PACKAGE, WINGS, imported, label

ROOT_FOLDERS = ("search", "io", "simulator")
OF_THE_ROOT = [
    path
    for path in MODULES
    if path.relative_to(PACKAGE).parts[0] in ROOT_FOLDERS
    or (path.parent == PACKAGE and path.name not in ("__init__.py", "__main__.py"))
]

RUN = """
from dataclasses import replace
import numpy as np
import pfslam
from pfslam.io.selection import select

recording = select(pfslam.load("hall"), until=25.0)
config = replace(pfslam.SlamConfig.report(), particles=12, every=20)
odometry, result = pfslam.dead_reckoning(recording), pfslam.run_slam(recording, config)
found = {
    "odometry": odometry.poses,
    "t": result.trajectory.t,
    "poses": result.trajectory.poses,
    "n_eff": np.array([info.effective_sample_size for info in result.infos]),
    "log_odds": result.grid.log_odds,
    "origin": np.array(result.grid.spec.origin),
}
"""
OF_A_COPY = (
    RUN + "import sys\nnp.savez(sys.argv[1], home=pfslam.__file__, loaded=sorted(sys.modules), **found)\n"
)


def test_without_the_wings_the_report_runs_to_the_same_numbers(tmp_path):
    copy, written = tmp_path / "pfslam", tmp_path / "found.npz"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__", *WINGS))
    assert not [wing for wing in WINGS if (copy / wing).exists()]
    code, environment = [sys.executable, "-c", OF_A_COPY, written], os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(code, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    whole: dict = {}
    exec(RUN, whole)
    with np.load(written) as alone:
        assert str(alone["home"]) == str(copy / "__init__.py")
        assert not [name for name in alone["loaded"] if name.startswith(tuple(f"pfslam.{w}" for w in WINGS))]
        for name, value in whole["found"].items():
            np.testing.assert_array_equal(alone[name], value, err_msg=name)
    assert len(whole["found"]["t"]) > 40
    assert (whole["found"]["log_odds"] > 0).sum() > 1000


def test_no_module_of_the_root_imports_a_wing():
    """In a function neither, nor for types alone."""
    names = {path.relative_to(PACKAGE).with_suffix("").as_posix() for path in OF_THE_ROOT}
    assert {"slam", "run", "methods", "texture", "search/volume", "io/datasets", "simulator/drive"} <= names
    wings = tuple(f"pfslam.{wing}" for wing in WINGS)
    assert not [
        f"{label(path)}:{line} imports {name}"
        for path in OF_THE_ROOT
        for name, line in imported(path)
        if name.startswith(wings)
    ]
