"""Candidate paths from session to session: new ones for who arrived, the rest kept.

A robot that has executed t steps of its chosen path keeps the candidates that share those t steps
from step t + 1 on. From the others it has departed: such a candidate is kept from the pose after
the one nearest to the robot, and the way there is straight. Whatever lies behind where a kept
candidate is joined keeps its poses, bit by bit; only the motions up to there are new. A candidate
whose way or tail is blocked by an obstacle that was not known is given up.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fgplan.closed_loop.free_place import nearest_free_place
from fgplan.closed_loop.mission import LoopRobot
from fgplan.models.motion import MotionModel
from fgplan.models.pose import position
from fgplan.paths.candidate_path import CandidatePath
from fgplan.paths.path_making import make_candidate_paths
from fgplan.typing import FloatArray, Pose
from roadmaps import VertexPath, Workspace, headings, space_positions


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """One robot on its way to one goal, between two planning sessions.

    Attributes:
        robot: Name.
        goal: Place of the goal among the robot's goals, from 0.
        candidates: Candidate paths of the last session; pose 0 is where the robot was then.
        chosen: Index of the path that is executed.
        taken: Steps of it executed since.
    """

    robot: str
    goal: int
    candidates: tuple[CandidatePath, ...]
    chosen: int
    taken: int = 0

    @property
    def path(self) -> CandidatePath:
        """The path that is executed."""
        return self.candidates[self.chosen]

    @property
    def target(self) -> Pose:
        """Pose to which the next step leads; there is one until the robot has arrived."""
        return self.path.poses[self.taken + 1]

    @property
    def arrived(self) -> bool:
        """Whether the path has been executed to its end."""
        return self.taken == self.path.steps


def new_candidates(
    robot: LoopRobot,
    estimate: Pose,
    ways: Sequence[VertexPath],
    spacing_m: float,
    step_s: float,
) -> tuple[CandidatePath, ...]:
    """Candidate paths along ways over the roadmap, one pose a step of the execution.

    Args:
        robot: Who is to go.
        estimate: Its estimated pose, where the ways start.
        ways: Paths over vertices.
        spacing_m: Longest step, metres.
        step_s: Duration of a step, seconds.

    Returns:
        One path a way, without observations.
    """
    made = make_candidate_paths(robot.name, estimate, ways, robot.motion, spacing_m=spacing_m)
    return tuple(
        CandidatePath(
            robot=path.robot,
            poses=path.poses,
            times_s=np.arange(path.steps + 1, dtype=np.float64) * step_s,
            motion_covariances=path.motion_covariances,
            vertices=path.vertices,
            length_m=path.length_m,
        )
        for path in made
    )


def kept_candidates(
    leg: Leg,
    estimate: Pose,
    motion: MotionModel,
    workspace: Workspace,
    spacing_m: float,
    step_s: float,
) -> tuple[tuple[CandidatePath, ...], int]:
    """What is left of a leg's candidates from where the robot stands now; see the module header.

    Args:
        leg: Robot, candidates, and how far it has gone along the chosen one; it has not arrived.
        estimate: Its estimated pose.
        motion: Noise of its planned motion steps.
        workspace: Bounds and the obstacles known now.
        spacing_m: Longest step, metres.
        step_s: Duration of a step, seconds.

    Returns:
        Distinct paths without observations, the rest of the chosen path first if it is free; and
        how many were given up because an obstacle blocks them.
    """
    here = position(estimate)[:2]
    free = nearest_free_place(workspace, here)
    if free is None:
        return (), len(leg.candidates)
    way_in = np.array([here]) if (free == here).all() else np.array([here, free])
    order = [leg.chosen, *(i for i in range(len(leg.candidates)) if i != leg.chosen)]
    walked = leg.path.poses[1 : leg.taken + 1].tobytes()
    found: dict[bytes, CandidatePath] = {}
    blocked = 0
    for index in order:
        path = leg.candidates[index]
        follows = path.poses[1 : leg.taken + 1].tobytes() == walked and path.steps > leg.taken
        entry = leg.taken + 1 if follows else _entry(path, here)
        tail = np.array([position(pose)[:2] for pose in path.poses[entry:]])
        places = np.concatenate([way_in[-1:], tail])
        if workspace.are_motions_valid(places[:-1], places[1:]).all():
            joined = _joined(path, entry, estimate, way_in, motion, spacing_m, step_s)
            found.setdefault(joined.poses.tobytes(), joined)
        else:
            blocked += 1
    return tuple(found.values()), blocked


def _entry(path: CandidatePath, here: FloatArray) -> int:
    """Step after the nearest one of a path that the robot has departed from."""
    places = np.array([position(pose)[:2] for pose in path.poses[1:]])
    nearest = 1 + int(np.argmin(np.linalg.norm(places - here, axis=1)))
    return min(nearest + 1, path.steps)


def _joined(
    path: CandidatePath,
    entry: int,
    estimate: Pose,
    way_in: FloatArray,
    motion: MotionModel,
    spacing_m: float,
    step_s: float,
) -> CandidatePath:
    """Along a way that begins at the estimate to one of a path's steps, then along the path."""
    ends = np.concatenate([way_in, position(path.poses[entry])[None, :2]])
    places = space_positions(ends, spacing_m)
    head = np.repeat(path.poses[entry][None], len(places) - 2, axis=0)
    angles = headings(places)[1:-1]
    if head.ndim == 2:
        head[:, :2], head[:, 2] = places[1:-1], angles
    else:
        head[:, :2, 3] = places[1:-1]
        head[:, :3, :3] = _turned(angles)
    poses = np.concatenate([np.asarray(estimate)[None], head, path.poses[entry:]])
    first = motion.covariances(poses[: len(head) + 2])
    return CandidatePath(
        robot=path.robot,
        poses=poses,
        times_s=np.arange(len(poses), dtype=np.float64) * step_s,
        motion_covariances=np.concatenate([first, path.motion_covariances[entry:]]),
        vertices=(-1,) * (len(head) + 1) + path.vertices[entry:],
    )


def _turned(angles: FloatArray) -> FloatArray:
    """Rotations about the vertical, shape (n, 3, 3)."""
    turned = np.tile(np.eye(3), (len(angles), 1, 1))
    turned[:, 0, 0] = turned[:, 1, 1] = np.cos(angles)
    turned[:, 1, 0] = np.sin(angles)
    turned[:, 0, 1] = -turned[:, 1, 0]
    return turned
