"""``[prior]`` to a belief at planning time: from starts and landmarks, a log, or a function.

Keys of an independent prior: robot i of the file is ``x<i>``, landmark j is ``l<j>``. Landmarks of
the file are added to every kind of prior, each with a prior factor of its own; a landmark whose
key the graph already has is refused.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gtsam
import numpy as np

from fgplan.beliefs.belief import Belief
from fgplan.errors import ScenarioError
from fgplan.evaluation.problem import PastState
from fgplan.factors.keys import describe_key
from fgplan.io.key_name import read_key
from fgplan.io.mrclam_past import read_mrclam_past
from fgplan.io.past_estimate import PastEstimate, estimate_past
from fgplan.io.place import Place
from fgplan.io.pose_numbers import gtsam_pose
from fgplan.io.scenario import (
    G2oPrior,
    LogPrior,
    MrclamPrior,
    PyfgPrior,
    PythonPrior,
    Scenario,
    TumPrior,
)
from fgplan.io.scenario_file import landmark_name
from fgplan.io.sensor_table import make_covariance
from fgplan.io.team_past import TeamPast, is_pose, read_g2o_past, read_pyfg_past
from fgplan.io.tum_past import read_tum_past
from fgplan.io.user_object import load_object
from fgplan.paths.state import State
from fgplan.typing import Key


@dataclass(frozen=True, slots=True, kw_only=True)
class Prior:
    """The belief at planning time and what its keys mean.

    Attributes:
        belief: The belief.
        start_keys: Key of each robot's current pose, in the order of the team.
        landmark_keys: Key of each landmark of the scenario, by name.
        past_states: Past poses that may take part in multi-robot factors.
        estimate: The team's past and its estimate, where the prior comes from a log.
    """

    belief: Belief
    start_keys: Mapping[str, Key]
    landmark_keys: Mapping[str, Key]
    past_states: tuple[PastState, ...] = ()
    estimate: PastEstimate | None = None


def make_prior(scenario: Scenario, place: Place, estimate: PastEstimate | None = None) -> Prior:
    """Make the prior of a scenario.

    Args:
        scenario: The scenario.
        place: The whole file, for messages and for the folder of logs and modules.
        estimate: What reading and estimating the scenario's log gives, where that is done already.

    Returns:
        The prior.

    Raises:
        ScenarioError: If a start is missing or given twice, a file or function is wrong, or the
            belief is ill-posed.
    """
    where = place.at("prior")
    table = scenario.prior
    past: tuple[PastState, ...] = ()
    if isinstance(table, LogPrior):
        if estimate is None:
            estimate = _from_log(table, where)
        graph, values = estimate.belief.graph, estimate.belief.values
        start_keys = estimate.current_keys
    elif isinstance(table, PythonPrior):
        graph, values, start_keys, past = _from_function(table, where)
    else:
        graph, values, start_keys = _from_starts(scenario, place)
    if isinstance(table, LogPrior | PythonPrior):
        _check_starts(scenario, start_keys, place)
    landmark_keys = _add_landmarks(scenario, graph, values, place)
    with where.checking():
        belief = Belief(graph, values)
        ordered = {robot.name: start_keys[robot.name] for robot in scenario.robots}
        if isinstance(table, G2oPrior) and table.past_step_s is not None:
            past = _past_states(belief, ordered, table.past_step_s)
        elif (
            isinstance(table, PyfgPrior | MrclamPrior | TumPrior)
            and table.past
            and estimate is not None
        ):
            past = _timed_past_states(belief, estimate.past)
    return Prior(
        belief=belief,
        start_keys=ordered,
        landmark_keys=landmark_keys,
        past_states=past,
        estimate=estimate,
    )


def _from_starts(
    scenario: Scenario, place: Place
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values, dict[str, Key]]:
    """Robots' starts, uncorrelated."""
    graph, values, keys = gtsam.NonlinearFactorGraph(), gtsam.Values(), {}
    for index, robot in enumerate(scenario.robots):
        where = place.at(f"robots[{index}]", f"robot {robot.name!r}")
        if robot.start is None:
            raise where.at("start").error("expected a pose [x, y, heading], got nothing")
        pose = gtsam_pose(robot.start, where.at("start"))
        size = 3 if len(robot.start) == 3 else 6
        covariance = make_covariance(
            (robot.start_sigmas, robot.start_covariance),
            ("start_sigmas", "start_covariance"),
            (size,),
            where,
        )
        key = int(gtsam.symbol("x", index))
        _add_prior(graph, key, pose, gtsam.noiseModel.Gaussian.Covariance(covariance))
        values.insert(key, pose)
        keys[robot.name] = key
    return graph, values, keys


def _from_log(table: LogPrior, place: Place) -> PastEstimate:
    """The team's past, estimated or as the files have it, held where they or the scenario say."""
    if isinstance(table, MrclamPrior | TumPrior):
        where = place.at("folder")
        read = read_mrclam_past if isinstance(table, MrclamPrior) else read_tum_past
        with where.checking():
            return estimate_past(read(_path_of(where, table.folder)))
    current = {
        robot: read_key(name, place.at(f"start_keys.{robot}"))
        for robot, name in table.start_keys.items()
    }
    past = _read_log(table, place, current or None)
    held: tuple[Key, ...] = ()
    if table.gauge.key is not None:
        held = (read_key(table.gauge.key, place.at("gauge.key")),)
    unary = any(past.graph.at(i).size() == 1 for i in range(past.graph.size()))
    if not (held or past.held or unary or table.estimate):
        raise place.at("gauge").error(
            "expected a pose to hold, got neither a FIX line in the files nor gauge; add gauge = "
            "{ key = ... } with the key of the first pose"
        )
    sigmas = table.gauge.sigmas or ()
    hold = held if table.estimate else held or past.held
    for key in held or past.held:
        size = _pose_in(past.values, key, place.at("gauge.key"))
        if sigmas and len(sigmas) != size:
            raise place.at("gauge.sigmas").error(f"expected {size} numbers, got {len(sigmas)}")
    for robot, key in current.items():
        _pose_in(past.values, key, place.at(f"start_keys.{robot}"))
    with place.checking():
        return estimate_past(past, hold, sigmas, optimise=table.estimate)


def _read_log(
    table: G2oPrior | PyfgPrior, place: Place, current: Mapping[str, Key] | None
) -> TeamPast:
    """Read the files of a log."""
    names = table.files if isinstance(table, G2oPrior) else (table.file,)
    where = place.at("files" if isinstance(table, G2oPrior) else "file")
    paths = [_path_of(where, name) for name in names]
    try:
        if isinstance(table, PyfgPrior):
            return read_pyfg_past(paths[0], current)
        one = paths[0] if len(paths) == 1 else paths
        return read_g2o_past(one, table.landmark_character, table.repeat_tolerance, current)
    except ScenarioError as error:  # names the log's file and line, but not who asked for it
        raise where.error(str(error)) from error


def _path_of(where: Place, name: str) -> Path:
    """A file or folder that the scenario names."""
    path = where.file.parent / name
    return path if path.is_dir() else where.path_of(name)


def _pose_in(values: gtsam.Values, key: Key, place: Place) -> int:
    """Dimension of the pose at a key, or the scenario's error."""
    if not (values.exists(key) and is_pose(values, key)):
        raise place.error(f"expected the key of a pose in the files, got {describe_key(key)}")
    return int(values.dims()[key])


def _from_function(
    table: PythonPrior, place: Place
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values, dict[str, Key], tuple[PastState, ...]]:
    """A user's own graph, values and keys of the current poses."""
    where = place.at("function")
    made: Any = load_object(table.function, where)()
    if not isinstance(made, tuple) or len(made) not in (3, 4):
        raise where.error(
            "expected (graph, values, start_keys) or (graph, values, start_keys, past_states), got "
            f"{type(made).__name__}"
        )
    graph, values, start_keys = made[:3]
    for name, value, kind in (
        ("graph", graph, gtsam.NonlinearFactorGraph),
        ("values", values, gtsam.Values),
        ("start_keys", start_keys, Mapping),
    ):
        if not isinstance(value, kind):
            raise where.error(f"expected {name} as a {kind.__name__}, got {type(value).__name__}")
    past = tuple(made[3]) if len(made) == 4 else ()
    keys = {str(robot): int(key) for robot, key in start_keys.items()}
    return gtsam.NonlinearFactorGraph(graph), gtsam.Values(values), keys, past


def _check_starts(scenario: Scenario, start_keys: Mapping[str, Key], place: Place) -> None:
    """The graph says where robots are: each once, and the robots' tables not again."""
    names = [robot.name for robot in scenario.robots]
    for index, robot in enumerate(scenario.robots):
        where = place.at(f"robots[{index}]", f"robot {robot.name!r}")
        if robot.name not in start_keys:
            known = ", ".join(start_keys) or "none"
            raise where.error(f"expected a start key of this robot from the prior, got {known}")
        for name in ("start", "start_sigmas", "start_covariance"):
            if getattr(robot, name) is not None:
                raise where.at(name).error(
                    f"expected no {name} with prior kind {_kind_of(scenario)!r}, which says where "
                    "the robots are, got one"
                )
    for name in start_keys:
        if name not in names:
            raise place.at("prior.start_keys").error(
                f"expected names of robots ({', '.join(names)}), got {name!r}"
            )


def _kind_of(scenario: Scenario) -> str:
    """Kind of the prior as the file writes it."""
    return str(type(scenario.prior).__struct_config__.tag)


def _add_landmarks(
    scenario: Scenario, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, place: Place
) -> dict[str, Key]:
    """Add the file's landmarks to the graph."""
    keys = {}
    for index, landmark in enumerate(scenario.landmarks):
        where = place.at(f"landmarks[{index}]")
        key = int(gtsam.symbol("l", index))
        if values.exists(key):
            raise where.error(
                f"expected key {describe_key(key)} to be free, but the prior's graph has it; give "
                "landmarks in one of the two places"
            )
        position = np.array(landmark.position)
        noise = gtsam.noiseModel.Isotropic.Sigma(position.size, landmark.sigma_m)
        _add_prior(graph, key, position, noise)
        values.insert(key, position)
        keys[landmark_name(scenario, index)] = key
    return keys


def _add_prior(
    graph: gtsam.NonlinearFactorGraph,
    key: Key,
    value: Any,  # noqa: ANN401 - one of four GTSAM types
    noise: gtsam.noiseModel.Base,
) -> None:
    """Add a prior factor of the value's type."""
    if isinstance(value, gtsam.Pose2):
        graph.add(gtsam.PriorFactorPose2(key, value, noise))
    elif isinstance(value, gtsam.Pose3):
        graph.add(gtsam.PriorFactorPose3(key, value, noise))
    elif value.size == 2:
        graph.add(gtsam.PriorFactorPoint2(key, value, noise))
    else:
        graph.add(gtsam.PriorFactorPoint3(key, value, noise))


def _past_states(
    belief: Belief, start_keys: Mapping[str, Key], step_s: float
) -> tuple[PastState, ...]:
    """Poses that share the letter of a start key and have a lower index, oldest first."""
    past = []
    for robot, start in start_keys.items():
        for key in belief.keys:
            steps = int(start) - int(key)
            same_letter = key >> 48 == start >> 48
            if same_letter and steps > 0 and belief.kinds[key] in ("Pose2", "Pose3"):
                state = State(robot, -steps, -steps * step_s, belief.pose(key))
                past.append(PastState(key, state))
    return tuple(past)


def _timed_past_states(belief: Belief, past: TeamPast) -> tuple[PastState, ...]:
    """All poses before each robot's current one, at their times before it, oldest first."""
    states = []
    for robot, keys in past.robots.items():
        now = past.times_s[keys[-1]]
        for place, key in enumerate(keys[:-1]):
            time_s = past.times_s[key] - now
            state = State(robot, place + 1 - len(keys), time_s, belief.pose(key))
            states.append(PastState(key, state))
    return tuple(states)
