"""Where a Ctrl-C must wait."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def ctrl_c_held_back() -> Iterator[None]:
    """A Ctrl-C that comes within the block counts when the block has ended, where the system can do that (POSIX).

    Imports need it: what runs in destructors and in compiled modules loses the exception, and the program goes on.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def starting_workers() -> Iterator[None]:
    """Processes that are started within the block never take a Ctrl-C, which a terminal sends to them too.

    So it is answered once, by the process that they work for, and none of them prints where it was.
    """
    if hasattr(signal, "pthread_sigmask"):
        from multiprocessing import resource_tracker

        resource_tracker.ensure_running()  # its start lets every Ctrl-C through again: not in the block
    with ctrl_c_held_back():
        yield
