"""Plan, move, observe, estimate, plan again: section 7.2 of Regev and Indelman 2017.

    step 0: everybody senses, SLAM starts
    while a goal is left:
        a planning session                       new candidates for robots that arrived
        until a goal is reached, or an obstacle is seen for the first time:
            every robot steers from its estimate to the next pose of its path
            odometry and measurements are drawn; one iSAM2 update

A command is the relative pose from where the robot thinks it is to the next pose of its path: a
change of heading, a straight way, and the heading of the path. A robot that stands still does not
measure again.

Everything is handed on as it happens. What a run has handed on so far is enough to go on with it:
recorded steps are fed to SLAM as they were measured, recorded sessions are planned again by the
evaluator that is executed (its messages are needed later) and must end as recorded.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fgplan.closed_loop.candidates import Leg, kept_candidates, new_candidates
from fgplan.closed_loop.comparison import EXECUTED, OURS, Contestant
from fgplan.closed_loop.mission import LoopMission, LoopRobot
from fgplan.closed_loop.records import SessionRecord, SlamRecord, StepRecord, Trigger
from fgplan.closed_loop.roadmap import TeamRoadmap, build_team_roadmap
from fgplan.closed_loop.session import Session, hold_session, slam_record
from fgplan.errors import InvalidInputError, NoCandidatePathError
from fgplan.models.pose import between, position
from fgplan.paths.candidate_path import CandidatePath
from fgplan.simulation.noise import disturb_pose
from fgplan.simulation.simulate import advance, start
from fgplan.simulation.step import SimulationState, SimulationStep
from fgplan.slam.linearisation_point import linearisation_point
from fgplan.slam.team_slam import SlamStart, TeamSlam
from fgplan.typing import FloatArray

Record = StepRecord | SessionRecord | SlamRecord
"""What a loop hands on; the SLAM record is its last."""

_WORLD, _PRIORS, _ROADMAP, _CANDIDATES = 0, 1, 2, 3


def run_loop(
    mission: LoopMission,
    *,
    past: Sequence[Record] = (),
    contestants: Mapping[str, Contestant] = OURS,
    compare: bool = False,
) -> Iterator[Record]:
    """Run a mission until every goal is reached.

    Args:
        mission: What is given.
        past: Records that an earlier run of the same mission handed on, from its first; they are
            not handed on again.
        contestants: Ways of planning each session; ``incremental_choose`` is among them, and its
            choice is executed. Recorded sessions are not planned by the others again.
        compare: Whether all values of each session are compared with from scratch by QR.

    Yields:
        A record a step and a session, as they happen; the final SLAM result at the end.

    Raises:
        InvalidInputError: If the past is another mission's, or was written by other versions.
        NoCandidatePathError: If no robot can reach a goal at the first session.

    Example:
        >>> from fgplan.closed_loop.unknown_world import draw_mission
        >>> records = list(run_loop(draw_mission(0, candidates=3, goals=1, landmarks=20)))
        >>> type(records[0]).__name__, type(records[-1]).__name__
        ('StepRecord', 'SlamRecord')
    """
    if EXECUTED not in contestants:
        raise InvalidInputError(
            f"closed loop: expected {EXECUTED!r} among the contestants, got {list(contestants)}"
        )
    told = list(past)
    if told and isinstance(told[-1], SlamRecord):
        return
    loop, first = _begin(mission, told)
    if first is not None:
        yield first
    while loop.pending:
        recorded = _next(loop.past, SessionRecord)
        if recorded is None:
            yield loop.plan(contestants, compare)
        else:
            again = loop.plan({EXECUTED: OURS[EXECUTED]}, False)
            if again.chosen_index != recorded.chosen_index or again.step != recorded.step:
                raise InvalidInputError(
                    f"session {again.session}: expected the recorded choice "
                    f"{dict(recorded.chosen_index)}, got {dict(again.chosen_index)}: the records "
                    "are another mission's, or other versions wrote them"
                )
        while loop.trigger is None and loop.legs:
            if loop.state.step >= mission.max_steps:
                break
            recorded_step = _next(loop.past, StepRecord)
            step = loop.move(recorded_step)
            if recorded_step is None:
                yield step
        if loop.state.step >= mission.max_steps:
            break
    yield slam_record(loop.slam, loop.slam.belief(), loop.state.step)


@dataclass(slots=True, eq=False)
class _Loop:
    """Where a loop stands. GTSAM's smoother changes in place, so this is not a value."""

    mission: LoopMission
    slam: TeamSlam
    roadmap: TeamRoadmap
    state: SimulationState
    past: list[Record]
    next_goal: dict[str, int]
    legs: dict[str, Leg] = field(default_factory=dict)
    trigger: Trigger | None = "start"
    sessions: int = 0
    carried: Mapping[str, Any] = field(default_factory=dict)
    linearised: Any = None
    seen: set[int] = field(default_factory=set)

    @property
    def pending(self) -> bool:
        """Whether a robot has a goal left."""
        return any(self.next_goal[r.name] < len(r.goals) for r in self.mission.robots)

    def plan(self, contestants: Mapping[str, Contestant], compare: bool) -> SessionRecord:
        """Hold a planning session."""
        mission, slam = self.mission, self.slam
        assert self.trigger is not None
        self.sessions += 1
        kept, replaced, unreachable = {}, {}, {}
        renewed = []
        legs: dict[str, Leg] = {}
        for robot in mission.robots:
            while self.next_goal[robot.name] < len(robot.goals):
                try:
                    leg, old, fresh = self._leg(robot)
                except NoCandidatePathError as error:
                    unreachable[robot.name] = str(error)
                    self.next_goal[robot.name] += 1
                    self.legs.pop(robot.name, None)
                    continue
                legs[robot.name] = leg
                kept[robot.name], replaced[robot.name] = old, fresh
                if not old:
                    renewed.append(robot.name)
                break
        if not legs:
            raise NoCandidatePathError(
                "closed loop: no robot can reach a goal that is left: "
                + "; ".join(unreachable.values())
            )
        current = [slam.key(robot) for robot in slam.robots]
        self.linearised = linearisation_point(
            slam.values(), self.linearised, current, mission.relinearise_m
        )
        outcome = hold_session(
            mission,
            Session(
                number=self.sessions,
                step=self.state.step,
                time_s=self.state.step * mission.world.step_s,
                trigger=self.trigger,
                legs=legs,
                renewed=tuple(renewed),
                kept=kept,
                replaced=replaced,
                unreachable=unreachable,
            ),
            slam,
            slam.belief(self.linearised),
            self.roadmap.workspace,
            self.carried,
            contestants,
            compare=compare,
        )
        self.legs, self.carried = dict(outcome.legs), outcome.carried
        self.trigger = None
        return outcome.record

    def move(self, recorded: StepRecord | None) -> StepRecord:
        """Go on by one step: as recorded, or drawn anew."""
        slam = self.slam
        commands = {
            robot: between(slam.pose(robot), leg.target) for robot, leg in self.legs.items()
        }
        if recorded is None:
            self.state, step = advance(self.mission.world, self.state, commands)
        else:
            self.state = replace(self.state, step=recorded.step, poses=recorded.truth)
            step = SimulationStep(
                state=self.state,
                time_s=recorded.time_s,
                odometry=recorded.odometry,
                measurements=recorded.measurements,
                collided=recorded.collided,
            )
        self.legs = {r: replace(leg, taken=leg.taken + 1) for r, leg in self.legs.items()}
        arrived = tuple(robot for robot, leg in self.legs.items() if leg.arrived)
        record = _estimate(slam, step, self.sessions, tuple(commands), arrived)
        for robot in arrived:
            del self.legs[robot]
            self.next_goal[robot] += 1
            self.trigger = "goal"
        if self._see_obstacles():
            self.trigger = "obstacle"
        return record

    def _leg(self, robot: LoopRobot) -> tuple[Leg, int, int]:
        """Candidates of a robot: what is kept of the old, and new ones; and how many of each."""
        mission, goal = self.mission, self.next_goal[robot.name]
        estimate = self.slam.pose(robot.name)
        spacing_m, step_s = mission.spacing_m, mission.world.step_s
        wanted = mission.candidates.candidates
        old: tuple[CandidatePath, ...] = ()
        if robot.name in self.legs:
            old, wanted = kept_candidates(
                self.legs[robot.name],
                estimate,
                robot.motion,
                self.roadmap.workspace,
                spacing_m,
                step_s,
            )
        if old and not wanted:
            return Leg(robot=robot.name, goal=goal, candidates=old), len(old), 0
        place = [r.name for r in mission.robots].index(robot.name)
        again = 0 if robot.name not in self.legs else self.sessions
        rng = _stream(mission, _CANDIDATES, place, goal, again)
        ways = self.roadmap.paths(robot.name, position(estimate)[:2], goal, wanted, rng)
        fresh = new_candidates(robot, estimate, ways, spacing_m, step_s)
        known = {path.poses.tobytes() for path in old}
        fresh = tuple(path for path in fresh if path.poses.tobytes() not in known)
        return Leg(robot=robot.name, goal=goal, candidates=(*old, *fresh)), len(old), len(fresh)

    def _see_obstacles(self) -> bool:
        """Learn obstacles that a robot has come near for the first time."""
        mission = self.mission
        new = []
        places: FloatArray = np.array([position(pose)[:2] for pose in self.state.poses.values()])
        for index, ring in enumerate(mission.unknown_obstacles):
            if index in self.seen or not mission.obstacle_range_m:
                continue
            around = replace(
                mission.workspace, obstacles=(ring,), robot_radius_m=mission.obstacle_range_m
            )
            if not around.are_positions_valid(places).all():
                self.seen.add(index)
                new.append(ring)
        if new:
            self.roadmap = self.roadmap.with_obstacles(new)
        return bool(new)


def _begin(mission: LoopMission, past: list[Record]) -> tuple[_Loop, StepRecord | None]:
    """Put everybody in place, sense once, and start SLAM."""
    zero = start(mission.world, _stream(mission, _WORLD))
    starts = {}
    for place, robot in enumerate(mission.robots):
        rng = _stream(mission, _PRIORS, place)
        truth = mission.world.robot(robot.name).pose
        mean = disturb_pose(truth, robot.start_covariance, rng)
        starts[robot.name] = SlamStart(pose=mean, covariance=robot.start_covariance)
    sensors = dict(mission.world.sensors)
    sensors |= {name: model.sensor for name, model in mission.world.multi_robot.items()}
    slam = TeamSlam(starts, sensors, mission.slam)
    recorded = _next(past, StepRecord)
    if recorded is not None:
        same = all(
            np.array_equal(recorded.truth.get(robot), pose) for robot, pose in zero.poses.items()
        )
        if recorded.step != 0 or not same:
            raise InvalidInputError(
                "closed loop: expected records of this mission from step 0 on, got others"
            )
    everybody = tuple(robot.name for robot in mission.robots)
    record = _estimate(slam, zero, 0, everybody, ())
    roadmap = build_team_roadmap(
        mission.workspace, dict(mission.goals), mission.candidates, _stream(mission, _ROADMAP)
    )
    loop = _Loop(
        mission=mission,
        slam=slam,
        roadmap=roadmap,
        state=zero.state,
        past=past,
        next_goal=dict.fromkeys(everybody, 0),
    )
    return loop, record if recorded is None else None


def _estimate(
    slam: TeamSlam,
    step: SimulationStep,
    session: int,
    moved: tuple[str, ...],
    arrived: tuple[str, ...],
) -> StepRecord:
    """Hand a step to SLAM and record what it makes of it."""
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


def _next(past: list[Record], kind: type) -> Any:  # noqa: ANN401 - of the kind asked for
    """Take the next recorded event, which must be of a kind; None where the records end."""
    if not past:
        return None
    if not isinstance(past[0], kind):
        raise InvalidInputError(
            f"closed loop: expected a {kind.__name__} next, got a {type(past[0]).__name__}: the "
            "records are another mission's, or not in order"
        )
    return past.pop(0)


def _stream(mission: LoopMission, *purpose: int) -> np.random.Generator:
    """Random numbers for one purpose, whatever else was drawn."""
    return np.random.default_rng(np.random.SeedSequence(mission.seed, spawn_key=purpose))
