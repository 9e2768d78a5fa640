"""Monte Carlo over any ``concurrent.futures.Executor``: streamed to disk, resumable.

A task is plain data with its seed. The seed is in the arguments for two reasons: the result must
not depend on which worker takes the task, and dask's executor takes equal calls for one (8 calls
of f(1) gave 1 result). Equal tasks are therefore refused.

Each task ends as one line of JSON, appended and flushed as it finishes; a second run skips tasks
whose digest is done. A task that raises is recorded as failed, and one that takes its worker down
with it (killed, out of memory) as killed; both cost only themselves and are tried again by the
next run. A broken pool does not say who broke it, nor does a cluster that gives up a task after its
workers ended: such tasks are run again at the end, one by one, and the one whose worker ends while
nothing else runs is it.
"""

import hashlib
import json
import os
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    wait,
)
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TextIO

from fgplan.errors import InvalidInputError
from fgplan.simulation.sweep_pool import SweepPool, ended_worker, went_with_executor

SWEEP_SCHEMA = "sweep.v1"

Status = Literal["done", "failed", "killed"]

_Outcome = tuple[Any, str, float]
"""Result, traceback if it raised, seconds."""

_LAST_RESULTS_S = 10.0
"""How long results are waited for that may still come from an executor that broke."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepTask:
    """One run of a sweep.

    Attributes:
        seed: Seed of every random number of the run.
        arguments: Whatever else the function needs; plain data (JSON).
    """

    seed: int
    arguments: Mapping[str, Any] = field(default_factory=dict)

    @property
    def digest(self) -> str:
        """Sha256 of the task, hexadecimal: the same task has it in every process.

        Raises:
            InvalidInputError: If an argument is not plain data.
        """
        try:
            text = json.dumps(
                {"seed": self.seed, "arguments": dict(self.arguments)},
                sort_keys=True,
                allow_nan=False,
            )
        except (TypeError, ValueError) as error:
            raise InvalidInputError(
                f"sweep task with seed {self.seed}: expected arguments of plain data (finite "
                f"numbers, strings, lists, dicts): {error}"
            ) from error
        return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class SweepRecord:
    """One line of the file.

    Attributes:
        digest: Digest of the task.
        task: The task.
        status: ``done``, ``failed`` (it raised) or ``killed`` (its worker ended).
        result: What the function returned, plain data; None unless done.
        error: Traceback, or what the pool said; empty if done.
        seconds: Time of the function; 0 where it did not return.
    """

    digest: str
    task: SweepTask
    status: Status
    result: Any = None
    error: str = ""
    seconds: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepSummary:
    """What a call of ``run_sweep`` did.

    Attributes:
        records: Last record of every task, in the order of the tasks.
        skipped: Tasks that were done before.
    """

    records: tuple[SweepRecord, ...]
    skipped: int

    def count(self, status: Status) -> int:
        """Number of tasks with a status."""
        return sum(record.status == status for record in self.records)

    @property
    def results(self) -> tuple[Any, ...]:
        """Results of the tasks that are done, in the order of the tasks."""
        return tuple(record.result for record in self.records if record.status == "done")


def run_sweep(
    tasks: Iterable[SweepTask],
    function: Callable[[SweepTask], Any],
    executor: Executor | None = None,
    *,
    out: str | Path,
    workers: int | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> SweepSummary:
    """Run a function on every task that is not done yet.

    Args:
        tasks: Distinct tasks, each with its seed.
        function: Takes a task, returns plain data (JSON). It is sent to workers, so it must be
            importable; it must draw random numbers from the task's seed alone.
        executor: Any executor, left open; None makes a pool of spawned processes. Dask's is
            ``client.get_executor(pure=False)``.
        out: File of JSON lines; its folder is made, and what it holds is not run again.
        workers: Processes of the pool made here, and half of how many tasks are handed to an
            executor at a time; None takes the number of cores.
        progress: Called as ``progress(done, total, doing)`` after each task.

    Returns:
        The last record of every task.

    Raises:
        InvalidInputError: If two tasks are equal, an argument is not plain data, the file is not a
            sweep's, or the caller's own executor broke, was shut down or lost its cluster (run
            again: what is done is kept).
    """
    listed = list(tasks)
    by_digest = {task.digest: task for task in listed}
    if len(by_digest) != len(listed):
        raise InvalidInputError(
            f"sweep: expected distinct tasks, got {len(listed) - len(by_digest)} equal to another; "
            "give each its own seed (some executors take equal calls for one)"
        )
    path = Path(out)
    path.parent.mkdir(parents=True, exist_ok=True)
    records = {d: r for d, r in read_sweep(path).items() if d in by_digest}
    waiting = deque(d for d in by_digest if d not in records or records[d].status != "done")
    skipped = len(by_digest) - len(waiting)
    _end_last_line(path)
    with path.open("a", encoding="utf-8") as stream:
        pool = SweepPool(executor, workers or os.cpu_count() or 1)
        try:
            for record in _finished(waiting, by_digest, function, pool):
                records[record.digest] = record
                _write(stream, record)
                if progress is not None:
                    progress(len(records), len(by_digest), "tasks")
        finally:
            pool.close()
    return SweepSummary(records=tuple(records[digest] for digest in by_digest), skipped=skipped)


def read_sweep(path: str | Path) -> dict[str, SweepRecord]:
    """Read the records of a sweep.

    Args:
        path: File of JSON lines; none at all counts as empty.

    Returns:
        Last record of each task by digest. A last line that was cut off is left out.

    Raises:
        InvalidInputError: If another line is not a record of a sweep; names file and line.
    """
    file = Path(path)
    if not file.exists():
        return {}
    lines = file.read_text(encoding="utf-8").split("\n")
    records = {}
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            data = json.loads(line)
            if data["schema"] != SWEEP_SCHEMA:
                raise KeyError(f"schema {data['schema']!r}")
            task = SweepTask(seed=data["seed"], arguments=data["arguments"])
            record = SweepRecord(
                data["digest"], task, data["status"], data["result"], data["error"], data["seconds"]
            )
        except json.JSONDecodeError as error:
            # Whoever was killed while writing leaves half a line; a later run goes on after it.
            if line.startswith('{"schema": "sweep.v1"') and not line.endswith("}"):
                continue
            raise InvalidInputError(f"{file}, line {number}: expected JSON: {error}") from error
        except (KeyError, TypeError) as error:
            raise InvalidInputError(
                f"{file}, line {number}: expected a record of {SWEEP_SCHEMA}: {error}"
            ) from error
        records[record.digest] = record
    return records


def _finished(
    waiting: deque[str],
    tasks: Mapping[str, SweepTask],
    function: Callable[[SweepTask], Any],
    pool: SweepPool,
) -> Iterable[SweepRecord]:
    """Records as tasks finish."""
    under_way: dict[Future[_Outcome], str] = {}
    suspects: deque[str] = deque()
    while waiting or suspects or under_way:
        # Suspects run last and alone, so that the next worker that ends says who it was.
        alone = not waiting and not under_way
        source = suspects if alone else waiting
        room = 1 if alone else 2 * pool.workers - len(under_way)
        for _ in range(min(room, len(source))):
            digest = source.popleft()
            try:
                under_way[pool.submit(_run_one, function, tasks[digest])] = digest
            except BrokenExecutor:  # broke between two tasks: this one has not begun
                source.appendleft(digest)
                break
        ready, _ = wait(under_way, return_when=FIRST_COMPLETED)
        gone = not ready
        if any(went_with_executor(future) for future in ready):
            gone = True
            # Those of a broken pool end with it; what a cluster was given while it went may not.
            ready, _ = wait(under_way, timeout=_LAST_RESULTS_S)
        for future in ready:
            digest = under_way.pop(future)
            ended = ended_worker(future)
            if ended and alone:
                text = f"the worker ended: {future.exception()}"
                yield SweepRecord(digest, tasks[digest], "killed", error=text)
            elif ended or went_with_executor(future):
                suspects.append(digest)
            else:
                yield _record(digest, tasks[digest], future)
        if gone:
            suspects.extend(under_way.values())
            under_way.clear()
            pool.renew()


def _record(digest: str, task: SweepTask, future: "Future[_Outcome]") -> SweepRecord:
    """Record of a task that came back or could not."""
    try:
        result, error, seconds = future.result()
    except Exception:  # noqa: BLE001 - whatever the way there and back raised is recorded
        return SweepRecord(digest, task, "failed", error=traceback.format_exc())
    if error:
        return SweepRecord(digest, task, "failed", error=error, seconds=seconds)
    try:
        json.dumps(result, allow_nan=False)
    except (TypeError, ValueError) as reason:
        text = f"expected a result of plain data (finite numbers, strings, lists, dicts): {reason}"
        return SweepRecord(digest, task, "failed", error=text, seconds=seconds)
    return SweepRecord(digest, task, "done", result=result, seconds=seconds)


def _run_one(function: Callable[[SweepTask], Any], task: SweepTask) -> _Outcome:
    """In the worker: result, traceback if it raised, seconds."""
    began = time.perf_counter()
    try:
        return function(task), "", time.perf_counter() - began
    except (Exception, SystemExit):  # noqa: BLE001 - a failing task costs only itself
        return None, traceback.format_exc(), time.perf_counter() - began


def _write(stream: TextIO, record: SweepRecord) -> None:
    """Append one line and make sure that it is on disk."""
    data = {
        "schema": SWEEP_SCHEMA,
        "digest": record.digest,
        "seed": record.task.seed,
        "arguments": dict(record.task.arguments),
        "status": record.status,
        "result": record.result,
        "error": record.error,
        "seconds": record.seconds,
    }
    stream.write(json.dumps(data) + "\n")
    stream.flush()
    os.fsync(stream.fileno())


def _end_last_line(path: Path) -> None:
    """Start a new line after one that was cut off."""
    if path.exists() and path.stat().st_size:
        with path.open("rb+") as stream:
            stream.seek(-1, os.SEEK_END)
            if stream.read(1) != b"\n":
                stream.write(b"\n")
