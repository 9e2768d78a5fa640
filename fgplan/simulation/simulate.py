"""One closed loop for SLAM, targets and meetings: move, sense, hand on, go on.

Every step the targets move, then the commanded robots, then all robots sense. ``advance`` takes a
state and commands and returns the next state and what was seen: whoever plans again between two
steps calls it. ``simulate`` runs given plans to their end.

The random numbers of step t come from streams derived from (entropy, t, what for, robot), not from
one sequence. So the truth of the targets and the noise of one robot's motion do not depend on what
others did or saw: methods are compared under the same targets and noise, and a run resumes from
its state alone.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from fgplan.checks import check_generator
from fgplan.errors import InvalidInputError
from fgplan.models.measurement import Odometry
from fgplan.models.pose import between, compose, position
from fgplan.paths.candidate_path import CandidatePath
from fgplan.simulation.command import Commands, commands_of
from fgplan.simulation.noise import disturb_pose
from fgplan.simulation.sensing import sense
from fgplan.simulation.step import SimulationState, SimulationStep
from fgplan.simulation.world import World, WorldRobot
from fgplan.typing import FloatArray, Pose

_TARGETS, _MOTION, _SENSING = 0, 1, 2


def start(world: World, generator: np.random.Generator) -> SimulationStep:
    """Put everybody in place and sense once, before anybody moves.

    Args:
        world: The world.
        generator: Gives the entropy of the whole run: one draw.

    Returns:
        Step 0, without odometry.
    """
    check_generator(generator, "simulation")
    words = generator.integers(0, 2**32, size=4, dtype=np.uint64)
    state = SimulationState(
        step=0,
        poses={robot.name: robot.pose for robot in world.robots},
        hidden_state=world.hidden_state,
        entropy=sum(int(word) << (32 * place) for place, word in enumerate(words)),
    )
    return _sensed(world, state, (), ())


def advance(
    world: World, state: SimulationState, commands: Mapping[str, Pose]
) -> tuple[SimulationState, SimulationStep]:
    """Go on by one step.

    Args:
        world: The world.
        state: Where the run stands.
        commands: Relative pose for each robot that is to move, shape (3,) or (4, 4), in the frame
            of its pose; the others stay, sense, and read no odometry.

    Returns:
        The next state, and the step that holds it.

    Raises:
        UnknownNameError: If a command is for a robot that the world does not have.
        InvalidInputError: If a command does not fit its robot's pose, or would carry no noise.
    """
    for name, command in commands.items():
        if np.shape(command) != world.robot(name).pose.shape or not np.isfinite(command).all():
            raise InvalidInputError(
                f"command of robot {name!r}: expected a finite relative pose of shape "
                f"{world.robot(name).pose.shape}, got {command!r}"
            )
    now = state.step + 1
    hidden = state.hidden_state
    if world.hidden is not None:
        hidden = world.hidden.sample(hidden, state.step, _stream(state, now, _TARGETS, 0))
    poses, odometry = dict(state.poses), []
    for index, robot in enumerate(world.robots):
        if robot.name in commands:
            command = np.asarray(commands[robot.name], dtype=np.float64)
            stream = _stream(state, now, _MOTION, index)
            before = state.poses[robot.name]
            poses[robot.name], reading = _move(robot, before, command, stream)
            odometry.append(reading)
    after = SimulationState(step=now, poses=poses, hidden_state=hidden, entropy=state.entropy)
    collided = _collided(world, state.poses, poses)
    step = _sensed(world, after, tuple(odometry), collided)
    return after, step


def resume(
    world: World,
    state: SimulationState,
    plans: Mapping[str, CandidatePath | Commands],
    begun_at: int = 0,
) -> Iterator[SimulationStep]:
    """Go on with plans until all have ended.

    Args:
        world: The world.
        state: Where the run stands.
        plans: A path or commands for each robot that moves. Commands are executed as they are,
            open loop; whoever steers by estimates calls ``advance``.
        begun_at: Step at which the plans began; earlier commands have been executed.

    Returns:
        The steps to come; nothing is computed before it is asked for.

    Raises:
        UnknownNameError: If a plan is for a robot that the world does not have.
        InvalidInputError: If a command does not fit its robot's pose, or the plans begin later
            than the state.
    """
    if begun_at > state.step:
        raise InvalidInputError(
            f"simulation: expected plans begun at step {state.step} or before, got {begun_at}"
        )
    commands = {name: commands_of(plan) for name, plan in plans.items()}
    for name in commands:
        world.robot(name)
    return _steps(world, state, commands, begun_at)


def simulate(
    world: World,
    plans: Mapping[str, CandidatePath | Commands],
    generator: np.random.Generator,
) -> Iterator[SimulationStep]:
    """Run plans from the start to their end.

    Args:
        world: The world.
        plans: A path or commands for each robot that moves; the others stay and sense.
        generator: Gives the entropy of the whole run: one draw.

    Returns:
        Step 0, then one step a command of the longest plan.

    Raises:
        UnknownNameError: If a plan is for a robot that the world does not have.
        InvalidInputError: If a command does not fit its robot's pose.

    Example:
        >>> import numpy as np
        >>> from fgplan.simulation.command import heading_changes
        >>> from fgplan.simulation.world import World, WorldRobot
        >>> world = World(robots=(WorldRobot(name="r1", pose=np.zeros(3)),))
        >>> plans = {"r1": heading_changes([0.0, np.pi / 2], [10.0, 5.0])}
        >>> steps = list(simulate(world, plans, np.random.default_rng(0)))
        >>> steps[-1].poses["r1"].round(3).tolist()
        [10.0, 5.0, 1.571]
    """
    first = start(world, generator)
    rest = resume(world, first.state, plans)

    def steps() -> Iterator[SimulationStep]:
        yield first
        yield from rest

    return steps()


def _steps(
    world: World, state: SimulationState, commands: Mapping[str, Commands], begun_at: int
) -> Iterator[SimulationStep]:
    """The steps until all commands are executed."""
    longest = max((len(one) for one in commands.values()), default=0)
    for place in range(state.step - begun_at, longest):
        now = {name: one.relative[place] for name, one in commands.items() if place < len(one)}
        state, step = advance(world, state, now)
        yield step


def _stream(state: SimulationState, step: int, purpose: int, index: int) -> np.random.Generator:
    """Random numbers of one step for one purpose."""
    return np.random.default_rng(
        np.random.SeedSequence(state.entropy, spawn_key=(step, purpose, index))
    )


def _move(
    robot: WorldRobot, pose: Pose, command: Pose, stream: np.random.Generator
) -> tuple[Pose, Odometry]:
    """Move one robot and read its odometry; the equations of ``world``."""
    after, covariance = compose(pose, command), None
    if robot.actuation is not None:
        covariance = robot.actuation.covariance(command)
        after = disturb_pose(after, covariance, stream)
    reading = command
    if robot.odometry is not None:
        covariance = robot.odometry.covariance(command)
        reading = disturb_pose(between(pose, after), covariance, stream)
    return after, Odometry(robot=robot.name, relative=reading, covariance=covariance)


def _sensed(
    world: World,
    state: SimulationState,
    odometry: tuple[Odometry, ...],
    collided: tuple[str, ...],
) -> SimulationStep:
    """Let every robot sense, and close the step."""
    measurements = [
        one
        for index, robot in enumerate(world.robots)
        for one in sense(
            world,
            robot,
            state.poses,
            state.hidden_state,
            state.step,
            _stream(state, state.step, _SENSING, index),
        )
    ]
    return SimulationStep(
        state=state,
        time_s=state.step * world.step_s,
        odometry=odometry,
        measurements=tuple(measurements),
        collided=collided,
    )


def _collided(
    world: World, before: Mapping[str, Pose], after: Mapping[str, Pose]
) -> tuple[str, ...]:
    """Robots whose straight way from one pose to the next is not free."""
    if world.workspace is None:
        return ()
    starts: FloatArray = np.array([position(pose)[:2] for pose in before.values()])
    ends: FloatArray = np.array([position(pose)[:2] for pose in after.values()])
    free = world.workspace.are_motions_valid(starts, ends)
    return tuple(name for name, fine in zip(before, free, strict=True) if not fine)
