"""The demo over the real Victoria Park log: its parts, the quick run, and (``full``) the whole."""

import json
import time
from pathlib import Path

import gtsam
import numpy as np
import pytest

from fgplan.cli import main
from fgplan.demos.announced_views import joined_states
from fgplan.demos.victoria_log import GAUGE_SIGMAS, read_log, team_past
from fgplan.demos.victoria_team import (
    LASER_RANGE_M,
    TeamOptions,
    motion_of,
    prepare_team,
    steps_with_a_view,
)
from fgplan.errors import IllPosedBeliefError, NoCandidatePathError

TEAM = ("r1", "r2", "r3", "r4")
FIGURES = ("park_and_candidate_paths", "chosen_paths", "impacted_paths", "evaluator_times")
EVALUATORS = ("incremental", "incremental, all candidates", "from_scratch", "isam2", "as_published")


@pytest.fixture(scope="module")
def log():
    return read_log(1500)


@pytest.fixture(scope="module")
def past(log):
    return team_past(log, TEAM)


@pytest.fixture(scope="module")
def team(log, past):
    return prepare_team(log, past, TeamOptions(candidates=4), np.random.default_rng(0))


def test_log_is_cut_into_consecutive_parts_without_odometry_between_them(log, past):
    assert [key for keys in past.parts.values() for key in keys] == list(log.poses)
    owner = {key: robot for robot, keys in past.parts.items() for key in keys}
    graph = past.belief.graph
    factors = [graph.at(index) for index in range(graph.size())]
    odometry = [f for f in factors if isinstance(f, gtsam.BetweenFactorPose2)]
    assert len(odometry) == len(log.poses) - 1 - 3
    assert all(owner[f.keys()[0]] == owner[f.keys()[1]] for f in odometry)
    priors = [f for f in factors if isinstance(f, gtsam.PriorFactorPose2)]
    assert [f.keys() for f in priors] == [[log.poses[0]]]


def test_estimate_is_a_stationary_point_and_beats_the_files_initial_values(past):
    linear = past.belief.linear()
    step = np.abs(linear.optimizeGradientSearch().vector()).max()
    assert step < 1e-3
    graph = past.belief.graph
    values = gtsam.load2D(gtsam.findExampleDataFile("victoria_park.txt"))[1]
    initial = gtsam.Values()
    for key in past.belief.keys:
        if past.belief.kinds[key] == "Pose2":
            initial.insert(key, values.atPose2(key))
        else:
            initial.insert(key, values.atPoint2(key))
    assert past.cost < 0.01 * graph.error(initial)
    # Half of chi squared, with as many degrees of freedom as rows beyond unknowns.
    rows = sum(graph.at(index).dim() for index in range(graph.size()))
    unknowns = sum(past.belief.dim(key) for key in past.belief.keys)
    assert past.cost < 0.5 * (rows - unknowns)


def test_gauge_is_the_first_pose_of_the_first_robot(log, past):
    sigmas = np.sqrt(np.diag(past.belief.covariance(log.poses[0])))
    # The graph has no other absolute factor, so the first pose keeps exactly its prior.
    np.testing.assert_allclose(sigmas, GAUGE_SIGMAS, rtol=1e-6)


def test_too_short_a_piece_is_ill_posed_and_says_what_is_loose():
    with pytest.raises(IllPosedBeliefError, match="could move together"):
        team_past(read_log(400), TEAM[:2])


def test_motion_noise_gives_the_log_the_variance_of_its_file(log):
    motion = motion_of(log)
    metres = np.linalg.norm(log.steps[:, :2], axis=1).sum()
    radians = np.abs(log.steps[:, 2]).sum()
    total = metres * motion.per_metre**2 + radians * motion.per_radian**2
    np.testing.assert_allclose(total, len(log.steps) * log.odometry_sigmas**2, rtol=1e-12)


def test_goals_are_driven_places_apart_and_the_same_every_time(log, past, team):
    driven = np.vstack([past.trajectory(robot)[:, :2] for robot in TEAM])
    goals = np.array([team.goals[robot] for robot in TEAM])
    for robot, goal in zip(TEAM, goals, strict=True):
        assert np.linalg.norm(driven - goal, axis=1).min() == 0.0
        start = past.belief.pose(past.parts[robot][-1])[:2]
        assert np.linalg.norm(goal - start) >= TeamOptions().way_m
    between = np.linalg.norm(goals[:, None] - goals[None], axis=2)[np.triu_indices(4, 1)]
    assert between.min() >= TeamOptions().goal_distance_m
    again = prepare_team(log, past, TeamOptions(candidates=4), np.random.default_rng(0))
    for robot in TEAM:
        np.testing.assert_array_equal(again.goals[robot], team.goals[robot])
        for one, other in zip(again.candidates[robot], team.candidates[robot], strict=True):
            np.testing.assert_array_equal(one.poses, other.poses)


def test_goals_too_far_apart_name_the_robot(log, past):
    options = TeamOptions(candidates=4, goal_distance_m=1000.0)
    with pytest.raises(NoCandidatePathError, match="robot 'r2': expected a driven place"):
        prepare_team(log, past, options, np.random.default_rng(0))


def test_candidates_keep_clear_of_trees_and_see_those_before_them(past, team):
    trees = past.belief.landmarks()
    seeing = blind = 0
    for robot in TEAM:
        counts = steps_with_a_view(team.candidates[robot])
        seeing, blind = seeing + counts[0], blind + counts[1]
        for path in team.candidates[robot]:
            assert team.workspace.are_motions_valid(path.poses[:-1, :2], path.poses[1:, :2]).all()
            for seen in path.observations:
                offset = trees[seen.landmark] - path.poses[seen.step, :2]
                heading = path.poses[seen.step, 2]
                assert np.linalg.norm(offset) <= LASER_RANGE_M
                assert offset @ (np.cos(heading), np.sin(heading)) >= -1e-9
    assert seeing > 0
    assert blind > 0


def test_joined_states_are_those_of_the_joint_belief(team):
    from fgplan.beliefs.candidate_belief import candidate_belief

    paths = {robot: paths[0] for robot, paths in team.candidates.items()}
    factors = candidate_belief(team.problem, paths).factors
    count = sum(factor.identity.kind == "multi_robot" for factor in factors)
    assert len(joined_states(team.problem, paths)) == count > 0


def check_demo(folder: Path, out: str, robots_candidates: int) -> dict:
    """What every run of the demo must leave behind."""
    result = json.loads((folder / "result.json").read_text("utf-8"))
    assert result["complete"]
    assert all(item["met"] for item in result["requirements"])
    found = result["results"]
    assert found["agreed"]
    assert len(found["robots"]) == 4
    for robot in found["robots"].values():
        assert robot["candidates"] == robots_candidates
        assert 0.0 < robot["sigma_on_arrival_m"] < robot["sigma_without_team_m"]
        assert f"{robot['sigma_on_arrival_m']:.3f} m" in out
    for account in found["rounds"]:
        assert account["impacted"] + account["untouched"] == account["candidates"]
        assert account["solved"] + account["skipped"] >= account["impacted"]
    assert set(found["evaluators"]) == set(EVALUATORS)
    assert found["evaluators"]["isam2"]["max_rel_diff"]["first evaluation"] < 1e-6
    for name in FIGURES:
        assert (folder / f"{name}.png").stat().st_size > 10_000
        assert f"{name}.png" in out
    return found


def test_quick_demo(tmp_path, capsys):
    began = time.perf_counter()
    assert main(["demo", "victoria-park", "--quick", "--check", "--out", str(tmp_path)]) == 0
    passed = time.perf_counter() - began
    out = capsys.readouterr().out
    found = check_demo(tmp_path, out, robots_candidates=6)
    assert found["past"]["poses"] == 1500
    assert found["seconds"]["plan"] < passed
    assert main(["plot", str(tmp_path)]) == 0


@pytest.mark.full
def test_whole_demo_twice_on_two_roadmaps(tmp_path, capsys):
    command = ["demo", "victoria-park", "--check", "--seeds", "2", "--out", str(tmp_path)]
    assert main(command) == 0
    found = check_demo(tmp_path, capsys.readouterr().out, robots_candidates=20)
    assert found["past"]["poses"] == 6969
    assert found["past"]["trees"] == 151
    assert [item["seed"] for item in found["further_seeds"]] == [1]
    assert all(
        robot["steps_with_a_view"] and robot["steps_without"] for robot in found["robots"].values()
    )
