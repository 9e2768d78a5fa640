"""fgplan bench history: pasts differ in length only, and the short version runs and is exact."""

import gtsam
import numpy as np
import pytest

from fgplan.beliefs.belief import Belief
from fgplan.bench.blas_threads import blas_threads, blas_warning
from fgplan.bench.history import QUICK, SIGHT, run
from fgplan.bench.landmark_tours import draw_tours
from fgplan.bench.long_past import LANDMARKS, synthetic_past, victoria_park_past
from fgplan.errors import InvalidInputError
from fgplan.io.command import CommandOptions
from fgplan.models.motion import MotionModel

MOTION = MotionModel(sigmas=np.array([1.0, 1.0, 0.01]), speed_m_per_s=10.0)


def tours(past, count=5, prior=None):
    prior = Belief(past.graph, past.values) if prior is None else prior
    return draw_tours(prior, past.start_keys, count, SIGHT, MOTION, np.random.default_rng(3))


@pytest.fixture(scope="module")
def outcome():
    recorded = []
    options = CommandOptions(quick=True, progress=lambda *line: recorded.append(line))
    return run(options), recorded


def test_results_hold_what_the_issue_names(outcome):
    results = outcome[0].results
    assert results["poses"] == list(QUICK.synthetic)
    for name in ("from_scratch_ms", "isam2_ms", "incremental_ms", "prepare_ms"):
        assert len(results[name]) == len(QUICK.synthetic)
        assert all(value > 0.0 for value in results[name])
    assert [case["past"] for case in results["cases"]] == ["synthetic"] * 2 + ["victoria_park"] * 2
    growth = max(results["incremental_ms"]) / min(results["incremental_ms"])
    assert results["incremental_growth"] == growth
    park = [c["incremental_ms"] for c in results["cases"] if c["past"] == "victoria_park"]
    assert results["incremental_growth_victoria_park"] == max(park) / min(park)
    last = results["cases"][len(QUICK.synthetic) - 1]
    assert results["prepare_evaluations"] == last["prepare_ms"] / last["from_scratch_ms"]


def test_incremental_is_exact_on_every_past(outcome):
    results = outcome[0].results
    assert max(case["max_rel_diff"] for case in results["cases"]) < 1e-9
    assert results["max_rel_diff"] == max(case["max_rel_diff"] for case in results["cases"])


def test_worlds_are_what_they_claim(outcome):
    results = outcome[0].results
    assert results["landmarks_observed_by_a_candidate"] >= 5
    assert all(case["start_correlation"] > 0.1 for case in results["cases"])
    assert len({case["landmarks_touched"] for case in results["cases"]}) == 1
    assert [c["landmarks"] for c in results["cases"][:2]] == [LANDMARKS, LANDMARKS]


def test_every_requirement_of_the_issue_is_judged(outcome):
    names = [item.name for item in outcome[0].requirements]
    assert names == [
        "incremental_growth",
        "incremental_growth_victoria_park",
        "prepare_evaluations",
        "max_rel_diff",
    ]
    bounds = {item.name: item.required for item in outcome[0].requirements}
    assert bounds["incremental_growth"] == "at most 1.5"
    assert bounds["prepare_evaluations"] == "at most 10"


def test_summary_has_a_line_a_past_and_progress_is_told(outcome):
    found, recorded = outcome
    assert sum("synthetic" in line or "victoria_park" in line for line in found.summary) == 4
    assert {doing for _, _, doing in recorded} >= {"preparation", "turns"}


def test_longer_synthetic_past_offers_the_same_candidates():
    short, long = tours(synthetic_past(100)), tours(synthetic_past(300))
    assert list(short) == list(long)
    for robot in short:
        for one, other in zip(short[robot], long[robot], strict=True):
            np.testing.assert_allclose(one.poses, other.poses, rtol=0.0, atol=1e-9)
            assert [(o.step, o.landmark) for o in one.observations] == [
                (o.step, o.landmark) for o in other.observations
            ]


def test_longer_synthetic_past_knows_more():
    traces = []
    for poses in (100, 400):
        past = synthetic_past(poses)
        belief = Belief(past.graph, past.values)
        keys = list(past.start_keys.values())[1:]
        traces.append(np.trace(belief.covariance(keys)))
    assert traces[1] < traces[0]


def test_victoria_park_parts_are_tied_by_landmarks_only():
    past = victoria_park_past(1_000)
    dims = past.values.dims()
    log = [key for key in sorted(dims) if dims[key] == 3]
    part = {key: place * 4 // len(log) for place, key in enumerate(log)}
    assert len(log) == past.poses == 1_000
    assert [part[key] for key in past.start_keys.values()] == [0, 1, 2, 3]
    assert all(part.get(key + 1) != part[key] for key in past.start_keys.values())
    pairs = set()
    for index in range(past.graph.size()):
        poses = [key for key in past.graph.at(index).keys() if dims[key] == 3]  # noqa: SIM118
        pairs |= {(part[a], part[b]) for a in poses for b in poses if part[a] != part[b]}
    assert not pairs


def test_victoria_park_values_fit_better_than_dead_reckoning():
    past = victoria_park_past(800)
    _, initial = gtsam.load2D(gtsam.findExampleDataFile("victoria_park.txt"))
    dims = past.values.dims()
    reckoned = gtsam.Values()
    for key in dims:
        at = initial.atPose2(key) if dims[key] == 3 else initial.atPoint2(key)
        reckoned.insert(key, at)
    assert past.graph.error(past.values) < 0.1 * past.graph.error(reckoned)


@pytest.mark.parametrize("poses", [0, 50, 150])
def test_synthetic_past_has_whole_rounds(poses):
    with pytest.raises(InvalidInputError, match="multiples of 100"):
        synthetic_past(poses)


@pytest.mark.parametrize("poses", [4, 7_000])
def test_victoria_park_prefix_is_within_the_log(poses):
    with pytest.raises(InvalidInputError, match="prefix of 8 to 6969"):
        victoria_park_past(poses)


def test_tours_need_landmarks():
    past = victoria_park_past(200)
    with pytest.raises(InvalidInputError, match="at least 32 mapped landmarks"):
        tours(past)


def test_blas_threads_are_read_and_judged(monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    assert blas_warning(blas_threads()) is None
    monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    assert blas_warning(blas_threads()) is None
    monkeypatch.setenv("OMP_NUM_THREADS", "4")
    assert "got 4" in blas_warning(blas_threads())
    monkeypatch.delenv("OMP_NUM_THREADS")
    assert "nothing set" in blas_warning(blas_threads())
