"""Monte Carlo runs that survive failing tasks, killed workers and interruptions."""

import json
import multiprocessing
import os
import signal
import sys
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from fgplan.errors import InvalidInputError
from fgplan.simulation.sweep import SweepTask, read_sweep, run_sweep


def draw(task):
    """A number drawn from the task's seed."""
    if task.arguments.get("calls"):
        with Path(task.arguments["calls"]).open("a") as stream:
            stream.write(f"{task.seed}\n")
    kind = task.arguments.get("kind", "draw")
    if kind == "raise":
        raise ValueError(f"seed {task.seed} is unlucky")
    if kind == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "exit":
        sys.exit(f"seed {task.seed} goes")
    if kind == "object":
        return object()
    if kind == "nan":
        return float("nan")
    return {"number": float(np.random.default_rng(task.seed).random()), "pid": os.getpid()}


def tasks_of(count, **arguments):
    return [SweepTask(seed=seed, arguments=arguments) for seed in range(count)]


def numbers(summary):
    return [result["number"] for result in summary.results]


def test_results_depend_on_the_seed_alone(tmp_path):
    with ThreadPoolExecutor(3) as executor:
        threads = run_sweep(tasks_of(12), draw, executor, out=tmp_path / "threads.jsonl")
    with ThreadPoolExecutor(1) as executor:
        one = run_sweep(tasks_of(12)[::-1], draw, executor, out=tmp_path / "one.jsonl")
    assert threads.count("done") == 12
    assert numbers(threads) == numbers(one)[::-1]
    assert numbers(threads)[3] == np.random.default_rng(3).random()


def test_failing_and_killed_tasks_cost_only_themselves(tmp_path):
    out = tmp_path / "deep" / "sweep.jsonl"
    tasks = tasks_of(5)
    tasks.insert(1, SweepTask(seed=50, arguments={"kind": "raise"}))
    tasks.insert(3, SweepTask(seed=60, arguments={"kind": "kill"}))
    heard = []
    summary = run_sweep(
        tasks, draw, out=out, workers=2, progress=lambda *told: heard.append(told[:2])
    )
    by_seed = {record.task.seed: record for record in summary.records}
    assert by_seed[50].status == "failed"
    assert "seed 50 is unlucky" in by_seed[50].error
    assert by_seed[60].status == "killed"
    assert summary.count("done") == 5
    assert numbers(summary) == [float(np.random.default_rng(seed).random()) for seed in range(5)]
    assert heard[-1] == (7, 7)
    assert os.getpid() not in {result["pid"] for result in summary.results}
    assert [record.task for record in summary.records] == tasks


def test_second_run_skips_what_is_done_and_tries_the_rest_again(tmp_path):
    out, calls = tmp_path / "sweep.jsonl", tmp_path / "calls.txt"
    good = tasks_of(4, calls=str(calls))
    bad = SweepTask(seed=9, arguments={"kind": "raise", "calls": str(calls)})
    with ThreadPoolExecutor(2) as executor:
        first = run_sweep([*good[:2], bad], draw, executor, out=out)
        assert (first.skipped, first.count("failed")) == (0, 1)
        second = run_sweep([*good, bad], draw, executor, out=out)
    assert second.skipped == 2
    assert second.count("done") == 4
    assert sorted(calls.read_text().split()) == ["0", "1", "2", "3", "9", "9"]
    lines = [json.loads(line) for line in out.read_text().splitlines()]
    assert [line["status"] for line in lines].count("failed") == 2
    assert len(lines) == 6


def test_line_that_was_cut_off_is_run_again(tmp_path):
    out = tmp_path / "sweep.jsonl"
    with ThreadPoolExecutor(1) as executor:
        run_sweep(tasks_of(3), draw, executor, out=out)
        text = out.read_text()
        out.write_text(text[:-20])
        assert len(read_sweep(out)) == 2
        again = run_sweep(tasks_of(3), draw, executor, out=out)
    assert again.skipped == 2
    assert again.count("done") == 3
    assert len(read_sweep(out)) == 3


def test_results_are_on_disk_as_they_finish(tmp_path):
    out = tmp_path / "sweep.jsonl"
    seen = []
    with ThreadPoolExecutor(1) as executor:
        run_sweep(
            tasks_of(3),
            draw,
            executor,
            out=out,
            progress=lambda *_: seen.append(len(read_sweep(out))),
        )
    assert seen == [1, 2, 3]


class OneWorkerCluster(Executor):
    """As dask with one worker that holds four tasks: a killer takes all of them with it."""

    def __init__(self):
        self.held = []
        self.lost = []

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        self.held.append((future, fn, args))
        # Alone, or when four are held: the worker works through them.
        if len(self.held) == 4 or self.lost:
            if any(given[1].arguments for _, _, given in self.held):
                for lost, _, given in self.held:
                    self.lost.append(given[1].seed)
                    lost.set_exception(KilledWorker("a worker died"))
            else:
                for done, call, given in self.held:
                    done.set_result(call(*given))
            self.held = []
        return future


KilledWorker = type("KilledWorker", (Exception,), {"__module__": "distributed.scheduler"})


def test_tasks_that_a_cluster_gives_up_are_run_again_alone(tmp_path):
    tasks = [*tasks_of(2), SweepTask(seed=60, arguments={"kind": "kill"}), SweepTask(seed=2)]
    cluster = OneWorkerCluster()
    summary = run_sweep(tasks, draw, cluster, out=tmp_path / "sweep.jsonl", workers=2)
    assert cluster.lost == [0, 1, 60, 2, 60]
    assert [record.status for record in summary.records] == ["done", "done", "killed", "done"]
    assert summary.records[2].error == "the worker ended: a worker died"


def test_task_that_exits_is_a_failure(tmp_path):
    tasks = [SweepTask(seed=4, arguments={"kind": "exit"}), SweepTask(seed=1)]
    with ThreadPoolExecutor(1) as executor:
        summary = run_sweep(tasks, draw, executor, out=tmp_path / "sweep.jsonl")
    assert [record.status for record in summary.records] == ["failed", "done"]
    assert "seed 4 goes" in summary.records[0].error


def test_executor_that_was_shut_down_is_said(tmp_path):
    executor = ThreadPoolExecutor(1)
    executor.shutdown()
    with pytest.raises(InvalidInputError, match="it was shut down"):
        run_sweep(tasks_of(2), draw, executor, out=tmp_path / "sweep.jsonl")


def test_results_must_be_plain_data(tmp_path):
    tasks = [SweepTask(seed=0, arguments={"kind": kind}) for kind in ("object", "nan")]
    with ThreadPoolExecutor(1) as executor:
        summary = run_sweep(tasks, draw, executor, out=tmp_path / "sweep.jsonl")
    assert summary.count("failed") == 2
    assert all("plain data" in record.error for record in summary.records)


def test_result_that_cannot_come_back_is_a_failure(tmp_path):
    tasks = [SweepTask(seed=0, arguments={"kind": "object"}), SweepTask(seed=1)]
    unpicklable = lambda task: task  # noqa: E731 - cannot be sent to a process
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as executor:
        summary = run_sweep(tasks, unpicklable, executor, out=tmp_path / "sweep.jsonl")
    assert summary.count("failed") == 2


def test_broken_executor_of_the_caller_keeps_what_is_done(tmp_path):
    out = tmp_path / "sweep.jsonl"
    tasks = [SweepTask(seed=1, arguments={"kind": "kill"})]
    context = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(1, mp_context=context) as executor,
        pytest.raises(InvalidInputError, match="the executor broke"),
    ):
        run_sweep(tasks, draw, executor, out=out)


def test_equal_tasks_are_refused_and_so_are_arguments_that_are_no_data(tmp_path):
    with pytest.raises(InvalidInputError, match="distinct tasks, got 1 equal"):
        run_sweep([SweepTask(seed=1), SweepTask(seed=1)], draw, out=tmp_path / "a")
    for wrong in (object(), float("nan")):
        with pytest.raises(InvalidInputError, match="seed 3: expected arguments of plain data"):
            run_sweep([SweepTask(seed=3, arguments={"x": wrong})], draw, out=tmp_path / "a")


@pytest.mark.parametrize("line", ["not json", '{"schema": "other.v1"}', "[1]"])
def test_file_that_is_no_sweep_is_refused(tmp_path, line):
    out = tmp_path / "sweep.jsonl"
    out.write_text(line + "\n")
    with pytest.raises(InvalidInputError, match=r"sweep\.jsonl, line 1: expected"):
        run_sweep([SweepTask(seed=1)], draw, out=out)


def test_nothing_to_do_starts_no_process(tmp_path):
    summary = run_sweep([], draw, out=tmp_path / "sweep.jsonl")
    assert summary.records == ()
