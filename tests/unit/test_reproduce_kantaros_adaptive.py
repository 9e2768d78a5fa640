"""``fgplan reproduce kantaros-adaptive``: its table, requirements and picture."""

import numpy as np
import pytest

from fgplan.io.command import CommandOptions
from fgplan.reproduce.kantaros_adaptive.command import (
    BANK,
    OFFLINE,
    REPLANNED,
    SINGLE,
    requirements,
    run,
    summarised,
)


def row(name, plan, rms, *, lost=0, consistency=2.0, seed=0):
    return {
        "seed": seed,
        "filter": name,
        "plan": plan,
        "rms_last_m": rms,
        "worst_last_m": 2 * rms,
        "lost": lost,
        "consistency": consistency,
    }


def test_all_seeds_count_and_requirements_follow_the_bank():
    rows = [row(BANK, OFFLINE, 0.1), row(BANK, OFFLINE, 0.3, seed=1)]
    rows += [row(BANK, REPLANNED, 0.1), row(BANK, REPLANNED, 0.2, seed=1)]
    table = [summarised(rows, BANK, plan) for plan in (OFFLINE, REPLANNED)]
    assert table[1]["mean_rms_m"] == pytest.approx(0.15)
    assert table[1]["worst_target_m"] == pytest.approx(0.4)
    assert all(need.met for need in requirements(table))
    for change, name in (
        ({"lost": 1}, "lost"),
        ({"consistency": 20.0}, "squared"),
        ({"rms_last_m": 0.9}, "over offline"),
    ):
        worse = [*rows[:3], rows[3] | change]
        table = [summarised(worse, BANK, plan) for plan in (OFFLINE, REPLANNED)]
        assert [name in need.name for need in requirements(table) if not need.met] == [True]


@pytest.mark.full
def test_one_seed_is_run_and_drawn(tmp_path):
    options = CommandOptions(
        name="kantaros-adaptive", seeds=1, arguments={"every": 5}, out=tmp_path
    )
    outcome = run(options)
    assert [(r["filter"], r["plan"]) for r in outcome.results["rows"]] == [
        (BANK, OFFLINE),
        (BANK, REPLANNED),
        (SINGLE, OFFLINE),
        (SINGLE, REPLANNED),
    ]
    assert outcome.figures[0].stat().st_size > 10_000
    assert np.isfinite([r["rms_last_m"] for r in outcome.results["rows"]]).all()
