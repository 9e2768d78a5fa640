"""Kernels are compiled by one process at a time.

Two processes that compile different variants of the same kernel at once can each write the file
that the other's entry of numba's index means: the wrong machine code is loaded then, without a
word. So the planner is rehearsed in one process, under a lock of this user on this machine, before
its programs start.
"""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from fgplan.planners.mission import Mission
from fgplan.planners.program import DistributedPlanner


def rehearse(planner: DistributedPlanner, mission: Mission) -> None:
    """Compile every kernel that the planner's programs need for a mission.

    Args:
        planner: The planner.
        mission: The mission.

    Raises:
        OptionError: If an option is not known or not usable.
    """
    with _one_at_a_time():
        planner.rehearse(mission, np.random.default_rng(mission.seed))


@contextmanager
def _one_at_a_time() -> Iterator[None]:
    """Hold the lock; without locks of files (not POSIX) nothing is held."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    path = Path(tempfile.gettempdir()) / f"fgplan-kernels-{os.getuid()}.lock"
    number = os.open(path, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW, 0o600)
    try:
        fcntl.flock(number, fcntl.LOCK_EX)
        yield
    finally:
        os.close(number)
