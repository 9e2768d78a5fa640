"""What has arrived for a robot, sender by sender, while the robot may be planning.

A planning robot can hold Python's interpreter lock for seconds. So the network puts messages into
rings of its own, outside Python, one for each sender, and never waits. One thread a sender takes
them from there whenever the lock is free, and stops taking when enough of that sender's wait here.
So memory is bounded, a flood of one sender pushes out its own messages only, and senders are
served in turn.
"""

import threading
from collections import deque
from collections.abc import Callable, Sequence


class Mailbox:
    """Messages as bytes, in order of arrival from each sender."""

    def __init__(self, senders: Sequence[str], kept: int, kept_bytes: int) -> None:
        """Make an empty mailbox.

        Args:
            senders: Teammates, in the order of the team.
            kept: Messages of one sender that wait here at most.
            kept_bytes: Bytes of one sender that wait here; the message that passes it still fits.
        """
        self._kept = kept
        self._kept_bytes = kept_bytes
        self._waiting: dict[str, deque[bytes]] = {sender: deque() for sender in senders}
        self._bytes = dict.fromkeys(senders, 0)
        self._next = 0
        self._closed = False
        self._changed = threading.Condition()
        self._threads: list[threading.Thread] = []

    def fill(self, sender: str, take: Callable[[], bytes | None]) -> None:
        """Start the thread that takes a sender's messages from the network.

        Args:
            sender: Teammate.
            take: Waits for the next message; None is the end.
        """

        def run() -> None:
            """Take until the network is closed."""
            while (data := take()) is not None and self.put(sender, data):
                pass

        thread = threading.Thread(target=run, name=f"mail of {sender}", daemon=True)
        self._threads.append(thread)
        thread.start()

    def put(self, sender: str, data: bytes) -> bool:
        """Keep a message; wait while too many of this sender are here.

        Args:
            sender: Teammate.
            data: Message.

        Returns:
            Whether it was kept; not after closing.
        """
        with self._changed:
            waiting = self._waiting[sender]
            self._changed.wait_for(
                lambda: (
                    self._closed
                    or (len(waiting) < self._kept and self._bytes[sender] < self._kept_bytes)
                )
            )
            if self._closed:
                return False
            waiting.append(data)
            self._bytes[sender] += len(data)
            self._changed.notify_all()
            return True

    def take(self, most: int) -> list[tuple[str, bytes]]:
        """Take out messages, one of each sender in turn; never waits.

        Args:
            most: How many at most.

        Returns:
            Senders and messages.
        """
        taken: list[tuple[str, bytes]] = []
        senders = tuple(self._waiting)
        with self._changed:
            empty = 0
            while senders and empty < len(senders) and len(taken) < most:
                sender = senders[self._next % len(senders)]
                self._next += 1
                if not self._waiting[sender]:
                    empty += 1
                    continue
                empty = 0
                data = self._waiting[sender].popleft()
                self._bytes[sender] -= len(data)
                taken.append((sender, data))
            if taken:
                self._changed.notify_all()
        return taken

    def wait(self, timeout_s: float) -> bool:
        """Wait until something is here.

        Args:
            timeout_s: Seconds to wait at most.

        Returns:
            Whether something is.
        """
        with self._changed:
            return self._changed.wait_for(lambda: any(self._waiting.values()), timeout_s)

    def close(self) -> None:
        """Let the threads end; the network must have been closed before."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        for thread in self._threads:
            thread.join(timeout=5.0)
