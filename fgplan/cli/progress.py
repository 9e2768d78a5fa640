"""One line of progress on a terminal; nothing in a pipe or a file."""

import shutil
import sys
import time
from typing import TextIO

_LEAST_PAUSE_S = 0.1


class TerminalProgress:
    """Shows ``doing done/total`` on one line of a terminal, ten times a second at most.

    Attributes:
        stream: Where to write; standard error by default, so that output can be piped.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self.stream = sys.stderr if stream is None else stream
        self._shows = self.stream.isatty()
        self._next = 0.0
        self._width = 0

    def __call__(self, done: int, total: int, doing: str) -> None:
        """Show how much is done.

        Args:
            done: Parts done.
            total: Parts in all; 0 where not known.
            doing: What is being done.
        """
        now = time.monotonic()
        if not self._shows or (now < self._next and done != total):
            return
        self._next = now + _LEAST_PAUSE_S
        line = f"{doing} {done}/{total}" if total else f"{doing} {done}"
        line = line[: shutil.get_terminal_size().columns - 1]  # a second line would stay
        self.stream.write("\r" + line.ljust(self._width))
        self.stream.flush()
        self._width = len(line)

    def close(self) -> None:
        """Clear the line."""
        if self._shows and self._width:
            self.stream.write("\r" + " " * self._width + "\r")
            self.stream.flush()
            self._width = 0
