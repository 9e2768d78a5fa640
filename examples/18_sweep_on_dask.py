"""A Monte Carlo study on a Dask cluster: one scenario planned on a new roadmap for every seed.

Needs `pip install 'fgplan[cluster]'`. Here the cluster is two processes of this machine; on real
clusters only LocalCluster is replaced (docs/cluster.md). Stop it when you like: the same folder
goes on. Run it from anywhere: `python examples/18_sweep_on_dask.py [FOLDER]`.
"""

import logging
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from distributed import Client, LocalCluster

import fgplan

SCENARIO = Path(__file__).parent / "scenarios" / "two_robots.toml"


def plan(task: fgplan.SweepTask) -> dict[str, Any]:
    """What the team agrees on; every random number is drawn from the task's seed."""
    mission = fgplan.load_mission(task.arguments["scenario"])
    found = fgplan.find_planner("impacted_paths").plan(mission, np.random.default_rng(task.seed))
    return {"objective": found.value}


def main(folder: Path) -> None:
    """Eight seeds on two workers."""
    tasks = [fgplan.SweepTask(seed=s, arguments={"scenario": str(SCENARIO)}) for s in range(8)]
    with (
        LocalCluster(
            n_workers=2,
            threads_per_worker=1,  # GTSAM holds the interpreter's lock
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster) as client,
    ):
        executor = client.get_executor(pure=False)
        swept = fgplan.run_sweep(tasks, plan, executor, out=folder / "sweep.jsonl", workers=2)
    for record in swept.records:
        said = f"objective {record.result['objective']:.3f}" if record.result else record.error
        print(f"seed {record.task.seed} {record.status}: {said}")
    values = [result["objective"] for result in swept.results]
    print(f"objective {np.mean(values):.2f} on average, {np.ptp(values):.2f} between extremes")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as made:
            main(Path(made))
