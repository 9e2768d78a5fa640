"""Sweeps on a dask cluster on loopback: a worker that is killed costs its own task only."""

import asyncio
import logging
import os
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from fgplan.errors import InvalidInputError
from fgplan.simulation.sweep import SweepTask, read_sweep, run_sweep

dask = pytest.importorskip("dask")
distributed = pytest.importorskip("distributed")

WORKERS = 2


def draw(task):
    """A number drawn from the task's seed; some tasks end their worker first."""
    kind = task.arguments.get("kind", "draw")
    if kind == "lost":
        mark = Path(task.arguments["mark"])
        if mark.exists():
            kind = "always"
        else:  # done, but its worker soon ends with the result
            mark.write_text(str(os.getpid()))
            threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGKILL)).start()
    if kind == "once":
        mark = Path(task.arguments["mark"])
        if not mark.exists():
            mark.touch()
            kind = "always"
    if kind == "always":
        time.sleep(task.arguments.get("seconds", 0.0))
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "slow":
        time.sleep(task.arguments["seconds"])
    return {"number": float(np.random.default_rng(task.seed).random()), "pid": os.getpid()}


def tasks_of(count, **arguments):
    return [SweepTask(seed=seed, arguments=arguments) for seed in range(count)]


def number_of(seed):
    return float(np.random.default_rng(seed).random())


def cluster(workers, *, allowed_failures=1, saturation=1.1, processes=True):
    """Workers of one thread on loopback.

    A task is given up once more than ``allowed_failures`` workers ended that held it. A worker
    holds ``saturation`` tasks a thread, rounded up.
    """
    chosen = {
        "distributed.scheduler.allowed-failures": allowed_failures,
        "distributed.scheduler.worker-saturation": saturation,
    }
    with dask.config.set(chosen):
        return distributed.LocalCluster(
            host="127.0.0.1",
            protocol="tcp://",
            n_workers=workers,
            processes=processes,
            threads_per_worker=1,
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        )


@pytest.fixture(scope="module")
def client():
    # Read when a worker is lost: one that is not back in time is closed for good, and none may be
    # left. By default 15 s, in which a slow machine may not have imported all.
    patient = dask.config.set({"distributed.deploy.lost-worker-timeout": "10 minutes"})
    with patient, cluster(WORKERS) as made, distributed.Client(made) as client:
        yield client


def test_dask_gives_the_same_results_in_any_order_and_resumes(client, tmp_path):
    executor = client.get_executor(pure=False)
    out = tmp_path / "dask.jsonl"
    with ThreadPoolExecutor(1) as one:
        here = run_sweep(tasks_of(10), draw, one, out=tmp_path / "here.jsonl")
    half = run_sweep(tasks_of(10)[::-2], draw, executor, out=out, workers=WORKERS)
    assert half.count("done") == 5
    there = run_sweep(tasks_of(10), draw, executor, out=out, workers=WORKERS)
    assert there.skipped == 5
    assert [r["number"] for r in there.results] == [r["number"] for r in here.results]
    assert os.getpid() not in {result["pid"] for result in there.results}


def test_worker_killed_once_costs_nothing_and_always_costs_its_own_task(client, tmp_path):
    tasks = tasks_of(10, kind="slow", seconds=0.02)
    once = SweepTask(seed=50, arguments={"kind": "once", "mark": str(tmp_path / "mark")})
    always = SweepTask(seed=60, arguments={"kind": "always"})
    tasks[2:2] = [once, always]
    out = tmp_path / "sweep.jsonl"
    executor = client.get_executor(pure=False)
    summary = run_sweep(tasks, draw, executor, out=out, workers=WORKERS)
    killed = [record for record in summary.records if record.status != "done"]
    assert [record.task for record in killed] == [always]
    assert killed[0].status == "killed"
    assert "the worker ended: Attempted to run task" in killed[0].error
    expected = [number_of(task.seed) for task in tasks if task is not always]
    assert [result["number"] for result in summary.results] == expected
    assert (tmp_path / "mark").exists()
    assert len(read_sweep(out)) == 12


def is_running(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_result_lost_before_it_is_fetched_and_never_made_again_ends_too(
    client, tmp_path, monkeypatch
):
    """Dask's own executor tells nobody of it: whoever waits for its future waits for ever."""
    gather, mark = client._gather, tmp_path / "mark"

    async def late(futures, *args, **kwargs):
        await asyncio.sleep(1.0)
        until_s = time.monotonic() + 60.0
        while is_running(int(mark.read_text())) and time.monotonic() < until_s:
            await asyncio.sleep(0.02)
        return await gather(futures, *args, **kwargs)

    monkeypatch.setattr(client, "_gather", late)
    lost = SweepTask(seed=70, arguments={"kind": "lost", "mark": str(mark)})
    executor = client.get_executor(pure=False)
    summary = run_sweep([lost], draw, executor, out=tmp_path / "sweep.jsonl", workers=WORKERS)
    assert [record.status for record in summary.records] == ["killed"]
    assert "the worker ended: Attempted to run task" in summary.records[0].error


class GivenUp(distributed.diagnostics.plugin.SchedulerPlugin):
    """Notes which tasks the scheduler gave up."""

    def __init__(self):
        self.keys = []

    def transition(self, key, start, finish, *args, **kwargs):
        if finish == "erred":
            self.keys.append(key)


@pytest.mark.full
def test_innocent_tasks_that_dask_gives_up_with_a_killer_are_done(tmp_path):
    """One worker holds all, and no failure is allowed: dask gives up whatever it held."""
    # A second, in which the worker is given the others.
    tasks = [SweepTask(seed=60, arguments={"kind": "always", "seconds": 1.0}), *tasks_of(4)]
    noted = GivenUp()
    with (
        cluster(1, allowed_failures=0, saturation=float("inf")) as made,
        distributed.Client(made) as client,
    ):
        made.scheduler.add_plugin(noted)
        executor = client.get_executor(pure=False)
        summary = run_sweep(tasks, draw, executor, out=tmp_path / "sweep.jsonl", workers=4)
    assert len(noted.keys) == 6, "all five, then the killer again; else this shows nothing"
    assert [record.status for record in summary.records] == ["killed", *4 * ["done"]]


def test_cluster_that_goes_is_said_and_what_is_done_is_kept(tmp_path):
    out = tmp_path / "sweep.jsonl"
    tasks = tasks_of(8, kind="slow", seconds=0.1)
    with cluster(1, processes=False) as made, distributed.Client(made) as client:
        executor = client.get_executor(pure=False)

        def end(done, total, doing):
            if done == 2:
                made.close()

        with pytest.raises(InvalidInputError, match="its cluster has gone"):
            run_sweep(tasks, draw, executor, out=out, workers=2, progress=end)
        kept = read_sweep(out)
        assert 2 <= len(kept) < 8
        assert {record.status for record in kept.values()} == {"done"}
        with pytest.raises(InvalidInputError, match="its cluster has gone"):
            run_sweep(tasks, draw, executor, out=out, workers=2)
    with ThreadPoolExecutor(1) as executor:
        again = run_sweep(tasks, draw, executor, out=out)
    assert again.skipped == len(kept)
    assert [result["number"] for result in again.results] == [number_of(seed) for seed in range(8)]


def test_function_that_cannot_be_sent_is_a_failure(client, tmp_path):
    lock = threading.Lock()
    executor = client.get_executor(pure=False)
    summary = run_sweep(tasks_of(2), lambda _: lock, executor, out=tmp_path / "sweep.jsonl")
    assert summary.count("failed") == 2
    assert all("Could not serialize" in record.error for record in summary.records)
