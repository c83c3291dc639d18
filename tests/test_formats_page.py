"""The page on file formats: every command and every line of Python on it runs, in its order, and means what it says."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from bag_files import rows_of, write_bag
from box_recording import box_recording

from pfslam.simulator.cache import cache_folder

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "book" / "formats.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(bash|python)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)

pytestmark = [
    pytest.mark.nightly,
    # On Windows the first bash is often the one that asks for Linux to be installed.
    pytest.mark.skipif(
        os.name == "nt" or not shutil.which("bash"), reason="the page's commands are for Unix"
    ),
]


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """What each block of the page printed, run in one folder from the first to the last, and that folder."""
    folder, home = tmp_path_factory.mktemp("page"), tmp_path_factory.mktemp("home")
    write_bag(folder / "drive_bag", "mcap", rows_of(box_recording(images=0)))
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = os.environ | {"PATH": path, "HOME": str(home), "PFSLAM_CACHE": str(cache_folder())}
    environment |= {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    outputs = []
    for language, text in BLOCKS:
        command = ["bash", "-ec", text] if language == "bash" else [sys.executable, "-c", text]
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=300
        )
        assert done.returncode == 0, f"{text}\n{done.stdout}{done.stderr}"
        outputs.append((text, done.stdout))
    return folder, outputs


def printed(outputs, words: str) -> str:
    """What the block printed that holds the words."""
    (found,) = [said for text, said in outputs if words in text]
    return found


def rmse(text: str) -> list[float]:
    return [float(value) for value in re.findall(r"^\s*rmse\s+(\S+)", text, re.MULTILINE)]


def test_evo_and_the_summary_agree(said):
    folder, outputs = said
    summary = json.loads((folder / "out" / "hall" / "summary.json").read_text(encoding="utf-8"))
    position, heading, relative = rmse(printed(outputs, "evo_rpe"))
    assert position == pytest.approx(summary["slam"]["ate_rmse_m"], abs=1e-3)
    assert heading == pytest.approx(summary["slam"]["heading_rmse_deg"], abs=0.02)
    assert 0 < relative < 0.02


def test_the_logs_come_back(said):
    folder, outputs = said
    for name in ("new", "old"):
        summary = json.loads((folder / "out" / name / "summary.json").read_text(encoding="utf-8"))
        assert summary["scans_recorded"] > 70
        assert summary["dropped"] == {} or "messages of other kinds" not in summary["dropped"]
    (error,) = rmse(printed(outputs, "run new.log"))
    assert error < 0.05


def test_the_bag_becomes_a_map_and_a_file(said):
    folder, outputs = said
    look = printed(outputs, "info drive_bag")
    assert "/scan" in look
    assert "verdict" in look
    summary = json.loads((folder / "out" / "bag" / "summary.json").read_text(encoding="utf-8"))
    assert summary["scans"] == len(box_recording(images=0).lidar.t)
    assert printed(outputs, "np.load").splitlines()[1] == "lidar.ranges (55, 1081) float32"
