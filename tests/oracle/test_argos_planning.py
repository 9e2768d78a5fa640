"""ARGoS, ten robots in space: joint estimate, then a session whose values are those of QR.

From the vendored log (examples/data/argos_10_robots), as ``fgplan run`` plans it: 1070 poses of ten
robots estimated together, candidates from the last poses, announcements until nobody changes. Under
the announcements at the end every objective term of the candidates is compared with from scratch by
QR.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fgplan.evaluation.from_scratch import FromScratch
from fgplan.evaluation.incremental.evaluator import Incremental
from fgplan.io.mission_file import make_mission
from fgplan.io.past_estimate import estimate_past
from fgplan.io.past_formats import read_team_past
from fgplan.io.past_scenario import derive_scenario
from fgplan.io.place import Place
from fgplan.io.prior_table import make_prior
from fgplan.io.scenario import Scenario
from fgplan.io.scenario_file import convert_table
from fgplan.models.pose import check_pose
from fgplan.planners.impacted_paths.candidates import candidate_sets
from fgplan.planners.impacted_paths.options import CandidateOptions
from fgplan.team.coordination import coordinate

ARGOS = Path(__file__).parents[2] / "examples" / "data" / "argos_10_robots"
COMPARED = ("a", "e", "h")
"""Robots whose candidates are compared: far from the others, in the middle, near many."""


@pytest.fixture(scope="module")
def session():
    estimate = estimate_past(read_team_past(ARGOS))
    tables = derive_scenario(estimate, "argos").tables
    scenario = convert_table(tables, Scenario, Place(ARGOS))
    mission = make_mission(scenario, ARGOS, make_prior(scenario, Place(ARGOS), estimate))
    sets = candidate_sets(mission, CandidateOptions(candidates=3))
    agreement = coordinate(sets.problem, sets.candidates, Incremental())
    return estimate, sets, agreement


def test_the_team_estimates_and_agrees(session):
    estimate, sets, agreement = session
    assert estimate.converged
    assert estimate.error_after == pytest.approx(10482.2626, rel=1e-6)
    assert agreement.agreed
    assert list(sets.problem.start_keys) == list("abcdefghij")
    assert {key & 0xFFFF for key in sets.problem.start_keys.values()} == {106}
    values = np.array(agreement.values)
    assert (np.diff(values) < 0.0).all()


def test_robots_stay_level_at_their_height(session):
    _, sets, _ = session
    for robot, paths in sets.candidates.items():
        start = sets.problem.prior.pose(sets.problem.start_keys[robot])
        for path in paths:
            np.testing.assert_array_equal(path.poses[0], start)
            np.testing.assert_array_equal(path.poses[1:, 2, 3], start[2, 3])
            np.testing.assert_array_equal(path.poses[1:, 2, :3], [[0.0, 0.0, 1.0]] * path.steps)
            for pose in path.poses:
                check_pose(pose, robot)


def test_values_equal_from_scratch_by_qr(session):
    _, sets, agreement = session
    oracle, engine = FromScratch(elimination="qr"), Incremental()
    chosen = {robot: sets.candidates[robot][place] for robot, place in agreement.chosen.items()}
    for robot in COMPARED:
        others = {name: path for name, path in chosen.items() if name != robot}
        candidates = sets.candidates[robot]
        _, ours = engine.evaluate(engine.start(sets.problem, robot, candidates), others)
        _, exact = oracle.evaluate(oracle.start(sets.problem, robot, candidates), others)
        assert not ours.report.skipped
        np.testing.assert_allclose(ours.terms, exact.terms, rtol=1e-9)
        np.testing.assert_allclose(ours.values, exact.values, rtol=1e-9)
        assert int(np.argmin(exact.values)) == agreement.chosen[robot]


def test_the_estimate_is_worth_having(session):
    # Without the edges between robots a robot far from the held pose knows less of where it is.
    estimate, _, _ = session
    own = replace(estimate.past, graph=type(estimate.past.graph)())
    for index in range(estimate.past.graph.size()):
        factor = estimate.past.graph.at(index)
        first, second = factor.keys()
        if first >> 56 == second >> 56:
            own.graph.add(factor)
    alone = estimate_past(own)
    assert len(alone.held) == 10
    for robot, key in estimate.current_keys.items():
        start = estimate.past.robots[robot][0]
        together = _relative_trace(estimate.belief, start, key)
        apart = _relative_trace(alone.belief, start, key)
        assert together < apart


def _relative_trace(belief, first, second):
    """Variance of the second position given that the first pose is exactly known."""
    rows = belief.square_root_information([first, second])
    given = np.linalg.inv(rows[6:, 6:])
    return float(np.trace((given @ given.T)[3:, 3:]))
