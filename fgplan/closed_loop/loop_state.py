"""Where a closed loop stands, and its two events: a planning session, a step.

Who arrived gets new candidates; who is on its way keeps those it has, and gets new ones for those
that an obstacle blocks. A goal without any candidate is given up and the next one is tried. An
obstacle is seen from where a robot truly is and known to all from then on.
"""

import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fgplan.closed_loop.candidates import Leg, kept_candidates, new_candidates
from fgplan.closed_loop.comparison import Contestant
from fgplan.closed_loop.mission import LoopMission, LoopRobot
from fgplan.closed_loop.records import GivenUpRecord, SessionRecord, StepRecord, Trigger
from fgplan.closed_loop.roadmap import TeamRoadmap, build_team_roadmap
from fgplan.closed_loop.session import CandidateSet, Session, hold_session
from fgplan.errors import NoCandidatePathError
from fgplan.models.hidden_state import square_root
from fgplan.models.pose import between, position
from fgplan.paths.candidate_path import CandidatePath
from fgplan.simulation.noise import disturb_pose
from fgplan.simulation.simulate import advance, start
from fgplan.simulation.step import SimulationState, SimulationStep
from fgplan.slam.linearisation_point import linearisation_point
from fgplan.slam.slam_options import SlamStart
from fgplan.slam.team_slam import Located, TeamSlam
from fgplan.typing import FloatArray, Key
from roadmaps.polygons import build_polygon_set

_WORLD, _PRIORS, _ROADMAP, _CANDIDATES, _LANDMARKS = 0, 1, 2, 3, 4
"""What random numbers are for."""


@dataclass(slots=True, eq=False)
class LoopState:
    """Where a loop stands. GTSAM's smoother changes in place, so this is not a value.

    Attributes:
        mission: What is given.
        slam: What the team knows.
        roadmap: What it knows of the workspace.
        simulation: The truth.
        unknown: Obstacles of the world that nobody has seen, shape (corners, 2).
        next_goal: By robot, place of the goal it heads for, from 0.
        legs: Robots that have a goal left, between sessions.
        trigger: Why a session is due; None while the robots move.
        sessions: Number of sessions held.
        carried: By robot, what its evaluator takes to the next session.
        linearised: Where planning linearised in the last session.
        obstacles: Polygons seen since the last session.
        edges_removed: Edges of the roadmap that they cross.
    """

    mission: LoopMission
    slam: TeamSlam
    roadmap: TeamRoadmap
    simulation: SimulationState
    unknown: tuple[FloatArray, ...]
    next_goal: dict[str, int]
    legs: dict[str, Leg] = field(default_factory=dict)
    trigger: Trigger | None = "start"
    sessions: int = 0
    carried: Mapping[str, Any] = field(default_factory=dict)
    linearised: Any = None
    obstacles: tuple[FloatArray, ...] = ()
    edges_removed: int = 0

    @property
    def pending(self) -> bool:
        """Whether a robot has a goal left."""
        return any(self.next_goal[r.name] < len(r.goals) for r in self.mission.robots)

    def plan(
        self, contestants: Mapping[str, Contestant], compare: bool | Collection[int]
    ) -> SessionRecord | GivenUpRecord:
        """Hold a planning session.

        Args:
            contestants: As in ``run_loop``.
            compare: As in ``run_loop``.

        Returns:
            Its record; or that no goal that is left can be reached, and none is left then.

        Raises:
            NoCandidatePathError: If no robot can reach a goal at the first session.
        """
        mission, slam = self.mission, self.slam
        sets: dict[str, CandidateSet] = {}
        unreachable: dict[str, str] = {}
        for robot in mission.robots:
            found, reasons = self._candidate_set(robot)
            if found is not None:
                sets[robot.name] = found
            if reasons:
                unreachable[robot.name] = "; ".join(reasons)
        step = self.simulation.step
        if not sets:
            if not self.sessions:
                raise NoCandidatePathError(
                    f"closed loop: no robot can reach a goal: {'; '.join(unreachable.values())}"
                )
            return GivenUpRecord(
                step=step, time_s=step * mission.world.step_s, unreachable=unreachable
            )
        self.sessions += 1
        current = [slam.key(robot) for robot in slam.robots]
        self.linearised = linearisation_point(
            slam.values(), self.linearised, current, mission.relinearise_m
        )
        outcome = hold_session(
            mission,
            Session(
                number=self.sessions,
                step=step,
                trigger=self.trigger or "start",
                sets=sets,
                unreachable=unreachable,
                obstacles=self.obstacles,
                edges_removed=self.edges_removed,
            ),
            slam,
            slam.belief(self.linearised),
            self.roadmap.workspace,
            self.carried,
            contestants,
            compare=compare if isinstance(compare, bool) else self.sessions in compare,
        )
        self.legs, self.carried = dict(outcome.legs), outcome.carried
        self.trigger, self.obstacles, self.edges_removed = None, (), 0
        return outcome.record

    def move(self, recorded: StepRecord | None) -> StepRecord:
        """Go on by one step.

        Args:
            recorded: The step as an earlier run recorded it; None draws it.

        Returns:
            Its record.
        """
        if recorded is None:
            commands = {
                robot: between(self.slam.pose(robot), leg.target)
                for robot, leg in self.legs.items()
            }
            self.simulation, step = advance(self.mission.world, self.simulation, commands)
        else:
            self.simulation = replace(
                self.simulation, step=recorded.step, poses=dict(recorded.truth)
            )
            step = SimulationStep(
                state=self.simulation,
                time_s=recorded.time_s,
                odometry=recorded.odometry,
                measurements=recorded.measurements,
                collided=recorded.collided,
            )
        moved = tuple(self.legs)
        self.legs = {r: replace(leg, taken=leg.taken + 1) for r, leg in self.legs.items()}
        arrived = tuple(robot for robot, leg in self.legs.items() if leg.arrived)
        record = estimate_step(self.slam, step, self.sessions, moved, arrived)
        for robot in arrived:
            del self.legs[robot]
            self.next_goal[robot] += 1
            self.trigger = "goal"
        self.look_for_obstacles()
        return record

    def look_for_obstacles(self) -> None:
        """Learn obstacles that a robot is near to for the first time; a session is due then."""
        places: FloatArray = np.array([position(p)[:2] for p in self.simulation.poses.values()])
        reach = self.mission.obstacle_range_m
        near = [
            bool(build_polygon_set((ring,)).touch_points(places, reach).any())
            for ring in self.unknown
        ]
        new = tuple(ring for ring, seen in zip(self.unknown, near, strict=True) if seen)
        if not new:
            return
        self.unknown = tuple(
            ring for ring, seen in zip(self.unknown, near, strict=True) if not seen
        )
        before = self.roadmap.graph.number_of_edges()
        self.roadmap = self.roadmap.with_obstacles(new)
        self.edges_removed += before - self.roadmap.graph.number_of_edges()
        self.obstacles += new
        self.trigger = "obstacle" if self.sessions else "start"

    def _candidate_set(self, robot: LoopRobot) -> tuple[CandidateSet | None, list[str]]:
        """Where a robot goes next, or None; and why goals were given up."""
        reasons: list[str] = []
        while self.next_goal[robot.name] < len(robot.goals):
            try:
                return self._candidates(robot), reasons
            except NoCandidatePathError as error:
                reasons.append(str(error))
                self.next_goal[robot.name] += 1
                self.legs.pop(robot.name, None)
        return None, reasons

    def _candidates(self, robot: LoopRobot) -> CandidateSet:
        """Candidates of a robot: what is kept of the old, and new ones."""
        mission, goal, leg = self.mission, self.next_goal[robot.name], self.legs.get(robot.name)
        estimate = self.slam.pose(robot.name)
        spacing_m, step_s = mission.spacing_m, mission.world.step_s
        old: tuple[CandidatePath, ...] = ()
        blocked = 0
        if leg is not None:
            old, blocked = kept_candidates(
                leg, estimate, robot.motion, self.roadmap.workspace, spacing_m, step_s
            )
        wanted = blocked if old else mission.candidates.candidates
        if not wanted:
            return CandidateSet(goal=goal, candidates=old, kept=len(old))
        place = self.slam.robots.index(robot.name)
        rng = random_stream(mission, _CANDIDATES, place, goal, 0 if leg is None else self.sessions)
        try:
            ways = self.roadmap.paths(robot.name, position(estimate)[:2], goal, wanted, rng)
        except NoCandidatePathError:
            if not old:
                raise
            ways = ()
        fresh = new_candidates(robot, estimate, ways, spacing_m, step_s)
        known = {path.poses.tobytes() for path in old}
        fresh = tuple(path for path in fresh if path.poses.tobytes() not in known)
        return CandidateSet(goal=goal, candidates=(*old, *fresh), kept=len(old))


def begin_loop(mission: LoopMission) -> tuple[LoopState, SimulationStep]:
    """Put everybody in place and start SLAM; nothing has been measured yet.

    Args:
        mission: What is given.

    Returns:
        The state, and step 0 with what would be measured there.

    Raises:
        NoCandidatePathError: If the workspace has too little free space for a roadmap.
    """
    zero = start(mission.world, random_stream(mission, _WORLD))
    starts = {}
    for place, robot in enumerate(mission.robots):
        rng = random_stream(mission, _PRIORS, place)
        truth = mission.world.robot(robot.name).pose
        mean = disturb_pose(truth, robot.start_covariance, rng)
        starts[robot.name] = SlamStart(pose=mean, covariance=robot.start_covariance)
    sensors = dict(mission.world.sensors)
    multi_robot = {name: model.sensor for name, model in mission.world.multi_robot.items()}
    slam = TeamSlam(starts, {**sensors, **multi_robot}, mission.slam, _known_landmarks(mission))
    roadmap = build_team_roadmap(
        mission.workspace, mission.goals, mission.candidates, random_stream(mission, _ROADMAP)
    )
    state = LoopState(
        mission=mission,
        slam=slam,
        roadmap=roadmap,
        simulation=zero.state,
        unknown=mission.unknown_obstacles,
        next_goal={robot.name: 0 for robot in mission.robots},
    )
    return state, zero


def estimate_step(
    slam: TeamSlam,
    step: SimulationStep,
    session: int,
    moved: tuple[str, ...],
    arrived: tuple[str, ...],
) -> StepRecord:
    """Hand a step to SLAM and record what it makes of it.

    Args:
        slam: Changes in place.
        step: What happened.
        session: Planning session under which it was executed; 0 before the first.
        moved: Robots whose measurements count; who stands still does not measure again.
        arrived: Robots that reached their goal with this step.

    Returns:
        The record.
    """
    measurements = tuple(one for one in step.measurements if one.robot in moved)
    began = time.perf_counter()
    slam.update(step.state.step, step.odometry, measurements)
    seconds = time.perf_counter() - began
    return StepRecord(
        step=step.state.step,
        time_s=step.time_s,
        session=session,
        truth=step.poses,
        odometry=step.odometry,
        measurements=measurements,
        estimates={robot: slam.pose(robot) for robot in slam.robots},
        covariances={robot: slam.covariance(robot) for robot in slam.robots},
        arrived=arrived,
        collided=step.collided,
        seconds=seconds,
    )


def random_stream(mission: LoopMission, *purpose: int) -> np.random.Generator:
    """Random numbers for one purpose, whatever else was drawn.

    Args:
        mission: Gives the seed.
        *purpose: Whole numbers that tell purposes apart.

    Returns:
        A generator.
    """
    return np.random.default_rng(np.random.SeedSequence(mission.seed, spawn_key=purpose))


def _known_landmarks(mission: LoopMission) -> dict[Key, Located]:
    """Priors of the landmarks that are known beforehand, means drawn about the truth."""
    found = {}
    for place, (key, covariance) in enumerate(mission.landmark_covariances.items()):
        noise = random_stream(mission, _LANDMARKS, place).standard_normal(len(covariance))
        mean = mission.world.landmark_position(key) + square_root(covariance) @ noise
        found[key] = (mean, covariance)
    return found
