"""Executor of a sweep, and what its futures say when a worker or the whole of it ends.

There are two kinds. A pool of processes breaks as a whole when one of them ends: every future
raises BrokenExecutor, and nothing more is taken. A cluster (dask) outlives its workers: it gives
the tasks of one that ended to others, ``allowed-failures`` times, then raises KilledWorker for that
task alone. It counts all tasks that the worker held, so the task need not be at fault. Only when
the cluster's scheduler goes are all futures cancelled.

Dask's errors are known by their names: nothing here imports it.
"""

import multiprocessing
from collections.abc import Callable
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
)
from typing import ParamSpec, TypeVar

from fgplan.errors import InvalidInputError
from fgplan.simulation.dask_call import is_dask_executor, submit_to_dask

_Given = ParamSpec("_Given")
_Result = TypeVar("_Result")


class SweepPool:
    """The caller's executor, or one made here that is made again when it breaks."""

    def __init__(self, given: Executor | None, workers: int) -> None:
        self.given, self.workers = given, workers
        self.made: Executor | None = None

    def submit(
        self,
        function: Callable[_Given, _Result],
        *args: _Given.args,
        **kwargs: _Given.kwargs,
    ) -> "Future[_Result]":
        """Hand one call over.

        Args:
            function: What to call.
            *args: With what.
            **kwargs: With what, by name.

        Returns:
            The future; it holds the error already where the call cannot be sent.

        Raises:
            BrokenExecutor: If the executor takes nothing more.
        """
        if self.given is None:
            if self.made is None:
                context = multiprocessing.get_context("spawn")
                self.made = ProcessPoolExecutor(self.workers, mp_context=context)
            return self.made.submit(function, *args, **kwargs)
        try:
            if is_dask_executor(self.given):
                return submit_to_dask(self.given, function, *args, **kwargs)
            return self.given.submit(function, *args, **kwargs)
        except Exception as reason:  # sorted: the executor has ended, or this cannot be sent
            if isinstance(reason, RuntimeError) or _says_end(reason):
                raise BrokenExecutor(str(reason)) from reason
            unsent: Future[_Result] = Future()
            unsent.set_exception(reason)
            return unsent

    def renew(self) -> None:
        """Forget a broken pool.

        Raises:
            InvalidInputError: If it is the caller's.
        """
        if self.given is not None:
            raise InvalidInputError(
                "sweep: the executor broke (a worker was killed, it was shut down, or its cluster "
                "has gone); what is done is kept: make a new executor and run again, or leave it "
                "out, so that broken pools are replaced"
            )
        self.close()

    def close(self) -> None:
        """End the pool that was made here; what has not begun is not run."""
        if self.made is not None:
            self.made.shutdown(wait=True, cancel_futures=True)
            self.made = None


def went_with_executor(future: "Future[_Result]") -> bool:
    """Whether a future that is done ended because its executor did.

    Args:
        future: A future that nobody here cancelled.
    """
    if future.cancelled():
        return True
    reason = future.exception()
    return reason is not None and _says_end(reason)


def ended_worker(future: "Future[_Result]") -> bool:
    """Whether a future that is done says that a worker ended that held the task.

    Args:
        future: The future; a cancelled one does not say it.
    """
    reason = None if future.cancelled() else future.exception()
    return isinstance(reason, BrokenExecutor) or _is_of_dask(reason, "KilledWorker")


def _says_end(reason: BaseException) -> bool:
    """Whether an error says that the executor takes and finishes nothing any more."""
    ended = isinstance(reason, BrokenExecutor | CancelledError)
    return ended or _is_of_dask(reason, "ClosedClientError")


def _is_of_dask(reason: BaseException | None, name: str) -> bool:
    """Whether an error is dask's of that name."""
    kind = type(reason)
    return kind.__name__ == name and kind.__module__.partition(".")[0] == "distributed"
