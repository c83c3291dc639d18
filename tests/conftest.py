"""What all tests share: where the real recordings lie, and a browser only where one is asked for."""

import os
import signal
from pathlib import Path

import pytest
from headless import running_chromium
from hypothesis import settings

# The same examples on every run, and no clock: a busy machine is no reason to fail.
settings.register_profile("pfslam", deadline=None, derandomize=True)
settings.load_profile("pfslam")

# A bar shows up after two seconds, so what a command says would depend on how busy the machine is.
os.environ["TQDM_DISABLE"] = "1"
# Started with "&", a shell's programs ignore Ctrl-C, and so would those that the tests start and interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parents[1]
REAL_DATA = ROOT.parent / "shared" / "data"


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real recordings, which are not part of this repository."""
    if not REAL_DATA.is_dir():
        pytest.skip("no real recordings beside the checkout (../shared/data)")
    return REAL_DATA


@pytest.fixture(scope="session")
def chromium():
    """A headless Chromium that reaches nothing but this machine."""
    yield from running_chromium()
