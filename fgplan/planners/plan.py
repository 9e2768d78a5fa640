"""What a planner hands back: states and covariances of every robot, and what they cost.

One product for all planners, and its form as plain data (numbers, strings, lists, dicts), which is
what goes into a result file. What only one planner has to say goes into ``details``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fgplan.checks import check_covariance, check_finite
from fgplan.errors import InvalidInputError
from fgplan.paths.candidate_path import CandidatePath, Observation
from fgplan.typing import FloatArray, Pose

PLAN_SCHEMA = "plan.v1"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotPlan:
    """What one robot is to do.

    Attributes:
        robot: Name.
        start: Its current pose, shape (3,) or (4, 4), world frame.
        path: Its path, or None where it stays.
        covariances: Covariance of its pose at each step with the team's plan followed to the end,
            shape (L + 1, d, d), tangent of that pose; a robot that stays has one. Empty where the
            planner does not compute them.
        goals: Shape (G, 2) or (G, 3), metres, world frame.
        candidate: Index of the path among its candidates, or -1.
        candidates: Number of its candidates.
    """

    robot: str
    start: Pose
    path: CandidatePath | None
    covariances: FloatArray
    goals: FloatArray
    candidate: int = -1
    candidates: int = 0

    def __post_init__(self) -> None:
        """Check that there is one covariance a pose."""
        name = f"plan of robot {self.robot!r}: covariances"
        covariances = check_finite(self.covariances, name, (None, None, None))
        rows = 1 if self.path is None else self.path.steps + 1
        if len(covariances) not in (0, rows):
            raise InvalidInputError(f"{name}: expected {rows} or none, got {len(covariances)}")
        object.__setattr__(self, "covariances", covariances)
        object.__setattr__(
            self,
            "goals",
            check_finite(self.goals, f"plan of robot {self.robot!r}: goals", (None, None)),
        )

    @property
    def poses(self) -> FloatArray:
        """Poses at all steps, shape (L + 1, ...); the start alone where it stays."""
        return np.asarray(self.start)[None] if self.path is None else self.path.poses


@dataclass(frozen=True, slots=True)
class ObjectiveValue:
    """Common objective after an accepted announcement.

    Attributes:
        sequence: Place among the accepted announcements; 0 is before the first.
        robot: Who announced; empty for the first.
        value: The objective.
    """

    sequence: int
    robot: str
    value: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """What a team is to do.

    Attributes:
        planner: Name of the planner.
        mission: Name of the mission.
        scenario_digest: Digest of the scenario.
        seed: Seed of the run.
        robots: In the order of the team.
        agreed: Whether the planner came to its own end (agreement, optimum), not to a limit.
        objective: Common objective by accepted announcement; planners without announcements give
            one value.
        report: Counts of the work.
        traffic: By kind of message: sent, sent_bytes, delivered, delivered_bytes, lost.
        seconds: Real seconds by stage.
        warnings: Plain sentences.
        options: Options of the planner as used.
        details: What only this planner has to say; plain data.
    """

    planner: str
    mission: str
    scenario_digest: str
    seed: int
    robots: tuple[RobotPlan, ...]
    agreed: bool = True
    objective: tuple[ObjectiveValue, ...] = ()
    report: Mapping[str, int] = field(default_factory=dict)
    traffic: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)

    @property
    def paths(self) -> dict[str, CandidatePath]:
        """Path of each robot that has one, in the order of the team."""
        return {item.robot: item.path for item in self.robots if item.path is not None}

    @property
    def value(self) -> float:
        """Common objective of the plan; NaN where the planner has none."""
        return self.objective[-1].value if self.objective else float("nan")

    def to_data(self) -> dict[str, Any]:
        """The plan as plain data: ``plan_of`` reads it back without loss."""
        return {
            "schema": PLAN_SCHEMA,
            "planner": self.planner,
            "mission": self.mission,
            "scenario_digest": self.scenario_digest,
            "seed": int(self.seed),
            "robots": [_robot_data(item) for item in self.robots],
            "agreed": bool(self.agreed),
            "objective": [
                {"sequence": item.sequence, "robot": item.robot, "value": _number(item.value)}
                for item in self.objective
            ],
            "report": {key: int(value) for key, value in self.report.items()},
            "traffic": {
                kind: {key: int(value) for key, value in counts.items()}
                for kind, counts in self.traffic.items()
            },
            "seconds": {key: float(value) for key, value in self.seconds.items()},
            "warnings": list(self.warnings),
            "options": dict(self.options),
            "details": dict(self.details),
        }


def plan_of(data: Mapping[str, Any]) -> Plan:
    """Plan of plain data.

    Args:
        data: As ``Plan.to_data`` gives it.

    Returns:
        The plan.

    Raises:
        InvalidInputError: If the schema or a field is wrong.
    """
    if data.get("schema") != PLAN_SCHEMA:
        raise InvalidInputError(
            f"plan: schema: expected {PLAN_SCHEMA!r}, got {data.get('schema')!r}"
        )
    try:
        return Plan(
            planner=data["planner"],
            mission=data["mission"],
            scenario_digest=data["scenario_digest"],
            seed=data["seed"],
            robots=tuple(_robot_of(item) for item in data["robots"]),
            agreed=data["agreed"],
            objective=tuple(
                ObjectiveValue(
                    item["sequence"],
                    item["robot"],
                    float("nan") if item["value"] is None else item["value"],
                )
                for item in data["objective"]
            ),
            report=dict(data["report"]),
            traffic={kind: dict(counts) for kind, counts in data["traffic"].items()},
            seconds=dict(data["seconds"]),
            warnings=tuple(data["warnings"]),
            options=dict(data["options"]),
            details=dict(data["details"]),
        )
    except (KeyError, TypeError) as error:
        raise InvalidInputError(f"plan: missing or malformed field: {error}") from error


def _number(value: float) -> float | None:
    """A number that JSON can hold: NaN is null."""
    return float(value) if np.isfinite(value) else None


def _robot_data(item: RobotPlan) -> dict[str, Any]:
    """One robot as plain data."""
    path = item.path
    return {
        "robot": item.robot,
        "start": np.asarray(item.start).tolist(),
        "path": None if path is None else _path_data(path),
        "covariances": item.covariances.tolist(),
        "goals": item.goals.tolist(),
        "candidate": int(item.candidate),
        "candidates": int(item.candidates),
    }


def _path_data(path: CandidatePath) -> dict[str, Any]:
    """One path as plain data."""
    return {
        "poses": path.poses.tolist(),
        "times_s": path.times_s.tolist(),
        "motion_covariances": path.motion_covariances.tolist(),
        "vertices": list(path.vertices),
        "length_m": path.length_m,
        "observations": [
            {
                "step": seen.step,
                "landmark": int(seen.landmark),
                "sensor": seen.sensor,
                "covariance": np.asarray(seen.covariance).tolist(),
            }
            for seen in path.observations
        ],
    }


def _robot_of(data: Mapping[str, Any]) -> RobotPlan:
    """One robot of plain data."""
    path = data["path"]
    covariances = np.array(data["covariances"], dtype=np.float64)
    return RobotPlan(
        robot=data["robot"],
        start=np.array(data["start"], dtype=np.float64),
        path=None if path is None else _path_of(data["robot"], path),
        covariances=covariances if covariances.size else np.zeros((0, 0, 0)),
        goals=np.array(data["goals"], dtype=np.float64),
        candidate=data["candidate"],
        candidates=data["candidates"],
    )


def _path_of(robot: str, data: Mapping[str, Any]) -> CandidatePath:
    """One path of plain data."""
    return CandidatePath(
        robot=robot,
        poses=np.array(data["poses"], dtype=np.float64),
        times_s=np.array(data["times_s"], dtype=np.float64),
        motion_covariances=np.array(data["motion_covariances"], dtype=np.float64),
        vertices=tuple(data["vertices"]),
        length_m=data["length_m"],
        observations=tuple(
            Observation(
                step=seen["step"],
                landmark=seen["landmark"],
                sensor=seen["sensor"],
                covariance=check_covariance(seen["covariance"], f"plan of robot {robot!r}: noise"),
            )
            for seen in data["observations"]
        ),
    )
