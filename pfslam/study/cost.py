"""What a run costs: processor time and the peak of memory."""

from __future__ import annotations

import sys
import time
from contextlib import suppress
from pathlib import Path

STATUS = Path("/proc/self/status")
CLEAR = Path("/proc/self/clear_refs")


class Meter:
    """Processor time of this process and its peak of memory, from the making of the meter to ``read``.

    Only Linux can begin its peak anew; elsewhere it is that of the process so far. Empty where no system tells.
    """

    def __init__(self) -> None:
        with suppress(OSError):
            CLEAR.write_text("5")
        self.begin = time.process_time()

    def read(self) -> dict[str, float | None]:
        """The two columns of cost."""
        return {"cpu_seconds": round(time.process_time() - self.begin, 3), "peak_mb": peak_megabytes()}


def peak_megabytes() -> float | None:
    """Largest resident set (MB) since it was last begun anew."""
    with suppress(OSError, StopIteration):
        lines = STATUS.read_text().splitlines()
        return round(next(int(s.split()[1]) for s in lines if s.startswith("VmHWM")) * 1024 / 1e6, 1)
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return round(peak * (1 if sys.platform == "darwin" else 1024) / 1e6, 1)
