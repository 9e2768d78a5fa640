"""One participant's process as its parent sees it.

The child says how far it is in lines of JSON on standard output; what it writes on standard error
goes into a log beside its file. On its standard input it is told whose processes have ended; that
pipe ends when the parent does, however that ends.
"""

import contextlib
import os
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

import msgspec

LAST_LINES = 5
"""Lines of the log of a process that crashed that are shown."""

_STOP_S = 5.0


class ProgressLine(msgspec.Struct, frozen=True, kw_only=True):
    """How far a participant is.

    Attributes:
        done: Parts done.
        total: Parts in all; 0 where not known.
        doing: What is being done.
    """

    done: int
    total: int
    doing: str


def python_module(name: str) -> list[str]:
    """The words that run a module of this very package, whatever lies in the working folder.

    Args:
        name: The module.

    Returns:
        Program and first arguments; they need ``child_environment``.
    """
    return [sys.executable, "-P", "-m", name]


def child_environment() -> dict[str, str]:
    """The environment of this process, with this very package first on the path."""
    here = str(Path(__file__).parents[2])
    paths = [here, *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


class Child:
    """A process that runs one participant."""

    def __init__(self, robot: str, command: Sequence[str], log: Path) -> None:
        """Start it.

        Args:
            robot: Name of the participant.
            command: Program and arguments.
            log: Where its standard error goes; the folder is there.
        """
        self.robot = robot
        self.log = log
        self.progress: ProgressLine | None = None
        """The last that it said; None before it was ready to begin."""
        with log.open("wb") as errors:
            self._process = subprocess.Popen(
                list(command),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                env=child_environment(),
            )
        self._reader = threading.Thread(target=self._read, name=f"progress of {robot}", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def status(self) -> int | None:
        """Exit status; None while it runs, negative where a signal ended it."""
        return self._process.poll()

    def last_lines(self) -> str:
        """The last lines of its log, in one."""
        text = self.log.read_text(encoding="utf-8", errors="replace")
        lines = [line.strip() for line in text.splitlines() if line.strip()]
        return " | ".join(lines[-LAST_LINES:])

    def tell_ended(self, robot: str) -> None:
        """Tell it that another participant's process has ended.

        Args:
            robot: Name of that participant.
        """
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):  # it has ended itself
                self._process.stdin.write(f"{robot}\n".encode())
                self._process.stdin.flush()

    def hang_up(self) -> None:
        """Close its standard input: it ends by itself, if it still runs."""
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()

    def stop(self) -> None:
        """End it, gently at first, and give back what it held."""
        self.hang_up()
        for end in (None, self._process.terminate, self._process.kill):
            if end is not None:
                end()
            try:
                self._process.wait(_STOP_S)
                break
            except subprocess.TimeoutExpired:
                continue
        self._reader.join(_STOP_S)
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _read(self) -> None:
        """Take what it says until it ends."""
        if self._process.stdout is None:
            return
        for line in self._process.stdout:
            try:
                self.progress = msgspec.json.decode(line, type=ProgressLine)
            except msgspec.MsgspecError:
                continue  # a library's own words
