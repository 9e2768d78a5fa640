"""One call on a dask cluster as a future that always ends.

Dask's own executor (``client.get_executor()``) reads a result once, when the scheduler first says
that it is there. If the worker that holds it ends before it is fetched, dask runs the call again;
where that ends in an error (``KilledWorker``), nobody tells the executor's future, and whoever
waits for it waits for ever (distributed 2026.8; 2 of 16 runs of tests/unit/test_sweep_on_dask.py).
Here the cluster's future is asked by dask's public ``add_done_callback``, which runs in a thread
where fetching may wait and fail.

Nothing here imports dask: its classes are known by their names.
"""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any, TypeVar

_Result = TypeVar("_Result")


def is_dask_executor(executor: Executor | None) -> bool:
    """Whether an executor is the one that a dask client gives.

    Args:
        executor: Any executor.
    """
    kind = type(executor)
    return kind.__name__ == "ClientExecutor" and kind.__module__.partition(".")[0] == "distributed"


def submit_to_dask(
    executor: Any,  # noqa: ANN401 - dask's, which is not imported
    function: Callable[..., _Result],
    *args: object,
    **kwargs: object,
) -> "Future[_Result]":
    """Hand one call to the cluster behind dask's executor.

    Args:
        executor: Dask's executor; its options (``pure``, ``workers``, ``retries``, ...) are kept.
        function: What to call.
        *args: With what.
        **kwargs: With what, by name.

    Returns:
        A future that ends when the call's result was fetched or cannot be.

    Raises:
        RuntimeError: If the executor was shut down.
    """
    # Three private attributes, as dask offers no other way from its executor to its client.
    if executor._shutdown:
        raise RuntimeError("cannot schedule new futures after shutdown")
    of_cluster = executor._client.submit(function, *args, **{**executor._kwargs, **kwargs})
    future: Future[_Result] = Future()
    future.set_running_or_notify_cancel()
    # The closure keeps dask's future alive, without which dask would forget the call.
    of_cluster.add_done_callback(lambda done: _fetch(done, future))
    return future


def _fetch(done: Any, future: "Future[_Result]") -> None:  # noqa: ANN401 - dask's
    """Put the outcome of dask's future into ours; waits while a lost result is made again."""
    try:
        result = done.result()
    except BaseException as reason:  # noqa: BLE001 - whatever it is, who waits must be told
        future.set_exception(reason)
    else:
        future.set_result(result)
