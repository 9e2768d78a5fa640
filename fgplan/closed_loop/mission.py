"""What a closed loop is given: the world as it truly is, and what the team plans with.

The two are kept apart. Nothing here lets planning read the truth: it gets the bounds and the known
obstacles (``workspace``), each robot's prior, its models of noise, and what SLAM makes of what was
measured. Obstacles of the world that the workspace lacks are learned by coming near them.

Time: a path is cut into poses at most ``spacing_m`` apart and a robot goes from one to the next in
one step of ``world.step_s`` seconds, so that planned times are those of the execution.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fgplan.checks import check_covariance, check_finite, check_not_negative
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.evaluation.objective import Objective, length_and_uncertainty
from fgplan.models.motion import MotionModel
from fgplan.models.pose import tangent_dim
from fgplan.paths.multi_robot import MultiRobotModel
from fgplan.planners.impacted_paths.options import CandidateOptions
from fgplan.simulation.world import World
from fgplan.slam.slam_options import SlamOptions
from fgplan.typing import Covariance, FloatArray, Key
from roadmaps import Workspace


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopRobot:
    """One robot as planning knows it.

    Attributes:
        name: As in the world.
        goals: Shape (G, 2), or (G, 3) for a robot in space, which keeps its height on the way;
            metres, world frame, visited in this order.
        motion: Noise of a planned motion step.
        start_covariance: Prior of its first pose, shape (d, d), tangent of the pose. The mean of
            the prior is drawn from it about the true pose.
        sensors: Names of the world's sensors with which it is planned to see landmarks.
    """

    name: str
    goals: FloatArray
    motion: MotionModel
    start_covariance: Covariance
    sensors: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check shapes."""
        goals = check_finite(self.goals, f"goals of robot {self.name!r}", (None, None))
        if goals.shape[1] not in ((2,) if self.motion.sigmas.size == 3 else (2, 3)):
            raise InvalidInputError(
                f"goals of robot {self.name!r}: expected 2 coordinates, or 3 for a robot in space, "
                f"got {goals.shape[1]}"
            )
        what = f"start covariance of robot {self.name!r}"
        covariance = check_covariance(self.start_covariance, what, self.motion.sigmas.size)
        object.__setattr__(self, "goals", goals)
        object.__setattr__(self, "start_covariance", covariance)
        object.__setattr__(self, "sensors", tuple(self.sensors))


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopMission:
    """A closed loop before it begins.

    Attributes:
        name: Title.
        world: The truth; its sensors are those of SLAM and of planning.
        workspace: Bounds and the obstacles that the team knows beforehand.
        robots: In the order of the team, one for each of the world's.
        multi_robot: Models of factors between robots inside planning; empty plans without them.
            What robots truly measure of each other is the world's.
        candidates: How candidate paths are made; ``spacing_m`` is the longest step.
        path_weight: kappa_goal of (41), a metre.
        uncertainty_weight: kappa_Sigma of (41), a square metre.
        others_landmarks: Whether planning uses landmarks that only other robots have mapped.
        landmark_covariances: Prior of each landmark that the world says is known beforehand, shape
            (2, 2) or (3, 3), square metres. The mean is drawn from it about the true position.
        relinearise_m: A landmark or past pose whose estimate moved by more than this since the
            last session is linearised anew, metres; nearer ones keep their linearisation point,
            and messages over them stay valid. Zero always takes the estimate.
        slam: Options of SLAM.
        obstacle_range_m: Distance from which a robot sees an obstacle of the world that the
            workspace lacks, metres; more than a step, or it would be seen too late.
        max_steps: Steps after which the loop is given up.
        seed: Seed of everything that is drawn.
    """

    name: str
    world: World
    workspace: Workspace
    robots: tuple[LoopRobot, ...]
    multi_robot: tuple[MultiRobotModel, ...] = ()
    candidates: CandidateOptions = field(
        default_factory=lambda: CandidateOptions(candidates=25, spacing_m=100.0)
    )
    path_weight: float = 0.1
    uncertainty_weight: float = 1.0
    others_landmarks: bool = True
    landmark_covariances: Mapping[Key, Covariance] = field(default_factory=dict)
    relinearise_m: float = 0.1
    slam: SlamOptions = field(default_factory=SlamOptions)
    obstacle_range_m: float = 0.0
    max_steps: int = 10_000
    seed: int = 0

    def __post_init__(self) -> None:
        """Check that robots are those of the world, and their goals are free."""
        for key in ("robots", "multi_robot"):
            object.__setattr__(self, key, tuple(getattr(self, key)))
        names = [robot.name for robot in self.robots]
        if names != [robot.name for robot in self.world.robots]:
            raise InvalidInputError(
                f"closed loop: expected the robots of the world in its order, "
                f"{[robot.name for robot in self.world.robots]}, got {names}"
            )
        if self.candidates.spacing_m is None or self.candidates.roadmap != "prm":
            raise InvalidInputError(
                "closed loop: expected candidates with spacing_m (the longest step, metres) on a "
                f"prm, got {self.candidates}"
            )
        check_not_negative(self.relinearise_m, "closed loop relinearise_m")
        check_not_negative(self.obstacle_range_m, "closed loop obstacle_range_m")
        for name, least in (("max_steps", 1), ("seed", 0)):
            number = getattr(self, name)
            if isinstance(number, bool) or not isinstance(number, int) or number < least:
                raise InvalidInputError(
                    f"closed loop {name}: expected a whole number of at least {least}, got "
                    f"{number!r}"
                )
        self._check_world()
        self._check_landmarks()
        for robot in self.robots:
            self._check_robot(robot)

    @property
    def spacing_m(self) -> float:
        """Longest step of a robot, metres."""
        return float(self.candidates.spacing_m or 0.0)

    @property
    def unknown_obstacles(self) -> tuple[FloatArray, ...]:
        """Polygons of the world that the team does not know beforehand, shape (corners, 2)."""
        if self.world.workspace is None:
            return ()
        known = {np.asarray(ring).tobytes() for ring in self.workspace.obstacles}
        rings = [np.asarray(ring) for ring in self.world.workspace.obstacles]
        return tuple(ring for ring in rings if ring.tobytes() not in known)

    @property
    def goals(self) -> Mapping[str, FloatArray]:
        """Goals of each robot, shape (G, 2) or (G, 3), metres."""
        return {robot.name: robot.goals for robot in self.robots}

    def robot(self, name: str) -> LoopRobot:
        """Look a robot up by name.

        Raises:
            UnknownNameError: If there is none.
        """
        for robot in self.robots:
            if robot.name == name:
                return robot
        known = ", ".join(robot.name for robot in self.robots)
        raise UnknownNameError(f"closed loop: robot {name!r} is not one of: {known}")

    def objective(self, robots: tuple[str, ...]) -> Objective:
        """Objective (41) of Regev and Indelman 2017 over the robots that still have a goal."""
        return length_and_uncertainty(robots, self.path_weight, self.uncertainty_weight)

    def _check_world(self) -> None:
        """Refuse worlds of which the loop would leave something out."""
        world = self.world
        if world.hidden is not None:
            raise InvalidInputError(
                "closed loop: expected a world without hidden targets, got "
                f"{', '.join(world.hidden.targets)}; this loop maps landmarks"
            )
        twice = sorted(world.sensors.keys() & world.multi_robot.keys())
        if twice:
            raise InvalidInputError(
                f"closed loop: expected other names for the world's multi-robot models than for "
                f"its sensors, got {twice[0]!r} for both; rename one"
            )
        if world.workspace is None:
            return
        grid, known = world.workspace.grid, self.workspace.grid
        same = grid is known or (
            grid is not None
            and known is not None
            and np.array_equal(grid.occupancy, known.occupancy)
        )
        if grid is not None and not same:
            raise InvalidInputError(
                "closed loop: expected the world's occupancy grid in the workspace too; only "
                "polygons may be unknown beforehand"
            )
        if self.unknown_obstacles and self.obstacle_range_m <= self.spacing_m:
            raise InvalidInputError(
                f"closed loop obstacle_range_m: expected more than a step ({self.spacing_m:g} m), "
                f"because {len(self.unknown_obstacles)} obstacles are not known beforehand, got "
                f"{self.obstacle_range_m:g}"
            )

    def _check_landmarks(self) -> None:
        """Check the priors of known landmarks."""
        world = self.world
        if set(self.landmark_covariances) != world.known_landmarks:
            one = min(set(self.landmark_covariances) ^ world.known_landmarks)
            raise InvalidInputError(
                f"closed loop landmark_covariances: expected one for each of the world's "
                f"{len(world.known_landmarks)} known landmarks, got "
                f"{len(self.landmark_covariances)}; they differ in landmark {one}"
            )
        size = world.landmark_positions.shape[1]
        checked = {
            key: check_covariance(self.landmark_covariances[key], f"landmark {key}", size)
            for key in sorted(self.landmark_covariances)
        }
        object.__setattr__(self, "landmark_covariances", checked)

    def _check_robot(self, robot: LoopRobot) -> None:
        """Check one robot against the world and the workspace."""
        pose = self.world.robot(robot.name).pose
        if robot.motion.sigmas.size != tangent_dim(pose):
            raise InvalidInputError(
                f"robot {robot.name!r}: expected a motion model of {tangent_dim(pose)} sigmas, "
                f"got {robot.motion.sigmas.size}"
            )
        for sensor in robot.sensors:
            if sensor not in self.world.sensors:
                known = ", ".join(self.world.sensors) or "none"
                raise UnknownNameError(
                    f"robot {robot.name!r}: sensor {sensor!r} is not one of: {known}"
                )
        valid = self.workspace.are_positions_valid(robot.goals[:, :2])
        if not valid.all():
            goal = robot.goals[int(np.argmin(valid))].tolist()
            raise InvalidInputError(
                f"robot {robot.name!r}: expected goals in free space, got {goal}, which is out of "
                "bounds or touches an obstacle"
            )
