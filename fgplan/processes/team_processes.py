"""One process a participant on this machine: started, watched, and brought to an end together.

Each listens on a port of the loopback and connects to all others: none is a master, and one that
was cut off finds the team again whoever of it is still there. A participant that is refused before
it was ready (its scenario, its options, no path) stops the team. One that dies later does not: the
others notice it by themselves and go on; those that still wait for it to come are told.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fgplan.errors import InvalidInputError, NoCandidatePathError
from fgplan.planners.planner import Progress
from fgplan.processes.child import Child
from fgplan.processes.robot_file import ROBOTS, robot_path
from fgplan.team.network_options import free_endpoint

PATIENCE_S = 90.0
"""Seconds that others may run on after the first has ended."""

NO_PLAN, REFUSED = 1, 2
"""Exit statuses of ``fgplan robot``: no feasible plan, bad input."""

_POLL_S = 0.02


@dataclass(frozen=True, slots=True)
class Endpoints:
    """Where one participant listens and whom it connects to.

    Attributes:
        listen: Its own endpoint.
        connect: Those of all others.
    """

    listen: str
    connect: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Ended:
    """How a process ended.

    Attributes:
        status: Exit status; negative where a signal ended it.
        why: Where it did not end well: signal or status, and the last lines of its log.
    """

    status: int
    why: str = ""


def loopback_endpoints(robots: Sequence[str], scheme: str = "tcp") -> dict[str, Endpoints]:
    """Endpoints on this machine: free ports, and everybody connects to everybody.

    Args:
        robots: Participants.
        scheme: ``tcp``, or ``tls`` with certificates.

    Returns:
        Endpoints by participant.
    """
    ends: list[str] = []
    while len(ends) < len(robots):
        end = free_endpoint(scheme)
        if end not in ends:
            ends.append(end)
    return {
        name: Endpoints(own, tuple(end for end in ends if end != own))
        for name, own in zip(robots, ends, strict=True)
    }


def run_team_processes(
    commands: Mapping[str, Sequence[str]],
    folder: Path,
    *,
    progress: Progress | None = None,
    patience_s: float = PATIENCE_S,
) -> dict[str, Ended]:
    """Run all participants, each in its own process, until all have ended.

    Args:
        commands: Program and arguments of each participant; it writes its file into ``folder``.
        folder: The run folder; what an earlier run's robots left there goes.
        progress: Told how far all are, in one line.
        patience_s: Seconds after which who still runs is stopped, once the first has ended well.

    Returns:
        How each ended.

    Raises:
        NoCandidatePathError: If a participant found, before it was ready, that there is no plan.
        InvalidInputError: If one was refused before it was ready.
    """
    (folder / ROBOTS).mkdir(parents=True, exist_ok=True)
    for name in commands:
        robot_path(folder, name).unlink(missing_ok=True)
    children: list[Child] = []
    try:
        for name, command in commands.items():
            children.append(Child(name, command, folder / ROBOTS / f"{name}.log"))
        _watch(children, folder, progress, patience_s)
    finally:
        for child in children:
            child.hang_up()
        for child in children:
            child.stop()
    return {child.robot: _ended(child, folder) for child in children}


def _watch(
    children: Sequence[Child], folder: Path, progress: Progress | None, patience_s: float
) -> None:
    """Until all have ended, or patience has."""
    first_s: float | None = None
    known: set[str] = set()
    while True:
        statuses = {child.robot: child.status for child in children}
        for name in [name for name, status in statuses.items() if status is not None]:
            if name not in known:
                known.add(name)
                for child in children:
                    child.tell_ended(name)
        for child in children:
            _check_refusal(child, folder)
        if progress is not None:
            over = sum(status is not None for status in statuses.values())
            progress(over, len(children), _line(children))
        if all(status is not None for status in statuses.values()):
            return
        now_s = time.monotonic()
        if first_s is None and 0 in statuses.values():
            first_s = now_s
        if first_s is not None and now_s > first_s + patience_s:
            return
        time.sleep(_POLL_S)


def _check_refusal(child: Child, folder: Path) -> None:
    """Stop the team where one was refused before it was ready."""
    ready = child.progress is not None or robot_path(folder, child.robot).exists()
    if ready or child.status not in (NO_PLAN, REFUSED):
        return
    said = child.last_lines().rpartition(" | ")[2]
    for words in ("fgplan: no feasible plan: ", "fgplan: error: "):
        said = said.removeprefix(words)
    error = NoCandidatePathError if child.status == NO_PLAN else InvalidInputError
    raise error(f"process of {child.robot!r}: {said}")


def _line(children: Sequence[Child]) -> str:
    """How far all are."""
    parts = []
    for child in children:
        told = child.progress
        if told is None:
            parts.append(f"{child.robot} starts")
        elif told.done == 0 and told.doing:
            parts.append(f"{child.robot} {told.doing}")
        else:
            parts.append(f"{child.robot} {told.done}" + (f"/{told.total}" if told.total else ""))
    return ", ".join(parts) + "; processes ended"


def _ended(child: Child, folder: Path) -> Ended:
    """How a process ended."""
    status = child.status
    if status == 0 or (status == NO_PLAN and robot_path(folder, child.robot).exists()):
        return Ended(status)
    if status is None:
        return Ended(-1, "could not be stopped")
    how = f"ended by signal {-status}" if status < 0 else f"ended with status {status}"
    said = child.last_lines()
    return Ended(status, f"{how}: {said}" if said else how)
