"""The parent as its child sees it: the other end of ``fgplan.processes.child``.

On standard input the parent names the participants whose processes have ended, a line each. When
standard input ends, the parent has: a child without parent ends too.
"""

import os
import threading


class Parent:
    """Listens to the parent in a thread of its own."""

    def __init__(self) -> None:
        """Start to listen."""
        self._gone = threading.Event()
        self._ended: frozenset[str] = frozenset()
        threading.Thread(target=self._listen, name="parent", daemon=True).start()

    def has_gone(self) -> bool:
        """Whether the parent has ended."""
        return self._gone.is_set()

    def ended(self) -> frozenset[str]:
        """Participants whose processes have ended."""
        return self._ended

    def _listen(self) -> None:
        """Take what it says until it ends."""
        # Not sys.stdin: its lock, held by a thread that waits, is fatal at the end of the process.
        rest = b""
        while data := os.read(0, 1024):
            *lines, rest = (rest + data).split(b"\n")
            self._ended |= {line.decode() for line in lines}
        self._gone.set()
