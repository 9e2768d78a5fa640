"""The scenario file, schema 1: its tables and fields.

Every table refuses unknown fields by name. Numbers are in metres, radians and seconds; a planar
pose is [x, y, heading], a spatial one [x, y, z, qx, qy, qz, qw] (as in TUM files). What only the
planner or a user's own object understands stays a plain table: ``[planner.NAME]``, ``[sensors.*]``
of a user's own kind, ``[simulation]`` options.
"""

from typing import Annotated, Any, Literal

from msgspec import Meta, field

from fgplan.io.simulation_table import SimulationTable
from fgplan.io.table import (
    KeyName,
    Matrix,
    Name,
    NotNegative,
    Numbers,
    PlanePoint,
    Point,
    PoseNumbers,
    Positive,
    Probability,
    Sigmas,
    Table,
)


class WorldTable(Table, frozen=True):
    """``[world]``: bounds or a map file, polygons on top of either.

    Attributes:
        bounds: Least and greatest corner of the robot's centre, metres.
        map: ROS map_server yaml or MovingAI .map, relative to the scenario file.
        map_cell_m: Side of a cell of a MovingAI map, which does not say; 1 m if left out.
        obstacles: Simple polygons, corners in metres.
        robot_radius_m: Radius of every robot's disc, metres.
        unknown: What unknown cells count as.
    """

    bounds: tuple[PlanePoint, PlanePoint] | None = None
    map: str | None = None
    map_cell_m: Positive | None = None
    obstacles: tuple[Annotated[tuple[PlanePoint, ...], Meta(min_length=3)], ...] = ()
    robot_radius_m: NotNegative = 0.0
    unknown: Literal["free", "occupied"] = "occupied"


class MotionTable(Table, frozen=True):
    """``robots.motion``: noise of a motion step and speed.

    Attributes:
        sigmas: 3 (planar x, y, heading) or 6 (spatial, rotation first) standard deviations a step.
        per_metre: Same length; standard deviation after one metre.
        per_radian: Same length; standard deviation after turning one radian.
        speed_m_per_s: Speed along a path, metres a second.
    """

    sigmas: Annotated[tuple[NotNegative, ...], Meta(min_length=3, max_length=6)]
    per_metre: tuple[NotNegative, ...] = ()
    per_radian: tuple[NotNegative, ...] = ()
    speed_m_per_s: Positive = 1.0


class RobotTable(Table, frozen=True):
    """``[[robots]]``: one robot.

    Attributes:
        name: Unique name.
        start: Pose at planning time, metres and radians; left out where the prior says it.
        start_sigmas: Standard deviations of the start, 3 or 6.
        start_covariance: Or its whole covariance, 3 x 3 or 6 x 6.
        goal: Position to reach, metres; or ``goals``, several in the order of visiting.
        goals: Positions in the order of visiting.
        motion: Motion noise and speed.
        sensors: Names of sensors under ``[sensors]`` that the robot carries.
    """

    name: Name
    motion: MotionTable
    start: PoseNumbers | None = None
    start_sigmas: Sigmas | None = None
    start_covariance: Matrix | None = None
    goal: Point | None = None
    goals: tuple[Point, ...] = ()
    sensors: tuple[Name, ...] = ()


class TargetTable(Table, frozen=True):
    """``[[targets]]``: hidden state x(t + 1) = A x(t) + w(t), w ~ N(d, Q).

    Attributes:
        name: Unique name.
        mean: Estimate at planning time, metres.
        sigmas: Standard deviations; or ``covariance``.
        covariance: Whole covariance.
        transition: A; the identity if left out.
        drift: d; zero if left out.
        process: Q; zero (a static target) if left out.
    """

    name: Name
    mean: Annotated[Numbers, Meta(min_length=1)]
    sigmas: Sigmas | None = None
    covariance: Matrix | None = None
    transition: Matrix | None = None
    drift: Numbers | None = None
    process: Matrix | None = None


class LandmarkTable(Table, frozen=True):
    """``[[landmarks]]``: a mapped landmark, a variable of the prior.

    Attributes:
        position: Two coordinates for planar robots, three for spatial ones.
        sigma_m: Standard deviation in every direction, metres.
        name: Name in objective terms; ``l0``, ``l1``, ... if left out.
    """

    position: Point
    sigma_m: Positive
    name: str = ""


class MultiRobotTable(Table, frozen=True):
    """``[[team.multi_robot]]``: when two robots measure each other, and how.

    Attributes:
        sensor: ``{kind = "relative_pose", sigmas = [...]}``, or a table as under ``[sensors]``,
            or the name of one.
        distance_m: Criterion: states nearer than this, metres.
        criterion: Or a user's own as "module:object", called with two states.
        time_tolerance_s: Largest difference of the two times, seconds; for all but relative poses.
        include_past: Whether past poses take part; the team's setting if left out.
    """

    sensor: dict[str, Any] | Name
    distance_m: Positive | None = None
    criterion: Name | None = None
    time_tolerance_s: Positive | None = None
    include_past: bool | None = None


class PartitionTable(Table, frozen=True):
    """``[[team.communication.partitions]]``: a time in which groups do not hear each other.

    Attributes:
        start_s: When it begins, seconds.
        end_s: When it heals, seconds.
        groups: Names of robots by group; a robot in no group hears nobody.
    """

    start_s: NotNegative
    end_s: Positive
    groups: tuple[tuple[Name, ...], ...]


class CommunicationTable(Table, frozen=True):
    """``[team.communication]``: faults of the simulated network, drawn by the run's seed.

    Attributes:
        loss: Probability that a message is lost.
        duplication: Probability that it arrives twice.
        reordering: Probability that it is held back by up to ``reordering_s``.
        reordering_s: Longest time held back, seconds.
        delay_s: Shortest and longest delay of every message, seconds.
        partitions: Times in which groups do not hear each other.
    """

    loss: Probability = 0.0
    duplication: Probability = 0.0
    reordering: Probability = 0.0
    reordering_s: NotNegative = 0.5
    delay_s: tuple[NotNegative, NotNegative] = (0.0, 0.0)
    partitions: tuple[PartitionTable, ...] = ()


class TeamTable(Table, frozen=True):
    """``[team]``: how the robots agree and what they learn from each other.

    Order, tolerance, without_path, the three ``_after_s`` and communication go to the planner as
    options of these names; what is left out is the planner's default.

    Attributes:
        multi_robot: Models of multi-robot factors; several may hold at once.
        order: Order of turns; ``random`` is drawn by the run's seed.
        tolerance: Relative improvement below which a robot keeps its path.
        include_past: Whether past poses take part in multi-robot factors.
        without_path: A robot whose goal cannot be reached is an error, or it stays at its start.
        lost_after_s: Seconds without a sign of a robot after which the others go on without it.
        hung_after_s: Seconds of silence after which a robot whom the network sees counts as lost
            too; longer than any evaluation. The network is believed if left out.
        drop_after_s: Seconds after which the path of a lost robot is withdrawn; kept if left out.
        communication: Faults of the simulated network; a perfect one if left out.
        network: How robots that are processes reach each other.
    """

    multi_robot: tuple[MultiRobotTable, ...] = ()
    order: Literal["fixed", "random"] | None = None
    tolerance: Positive | None = None
    include_past: bool = True
    without_path: Literal["refuse", "stay"] | None = None
    lost_after_s: Positive | None = None
    hung_after_s: Positive | None = None
    drop_after_s: Positive | None = None
    communication: CommunicationTable | None = None
    network: dict[str, Any] = field(default_factory=dict)


class IndependentPrior(Table, frozen=True, tag_field="kind", tag="independent"):
    """``[prior] kind = "independent"``: robots' starts and landmarks, uncorrelated."""


class GaugeTable(Table, frozen=True):
    """``[prior.gauge]``: which pose of the past's graph is held, and how firmly.

    Attributes:
        key: The pose, as ``a0`` or a number; the files' FIX lines if left out.
        sigmas: Standard deviations, 3 or 6; 1 mm and 1 mrad if left out.
    """

    key: KeyName | None = None
    sigmas: Sigmas | None = None


class G2oPrior(Table, frozen=True, tag_field="kind", tag="g2o"):
    """``[prior] kind = "g2o"``: the team's past as pose graphs.

    Attributes:
        files: g2o files or one folder of them, relative to the scenario file; edges may join
            vertices of two files.
        start_keys: Key of each robot's current pose, as ``a41`` or a number; if left out, robots
            are named as the files tell them apart and start from their last poses.
        gauge: Which pose is held, and how firmly.
        estimate: Whether to estimate jointly first; the files' vertices are the estimate otherwise.
            If true and nothing says what is held, the first pose of the first robot is.
        repeat_tolerance: Edges of two files with the same ends that differ by no more are one.
        landmark_character: Letter of landmarks' keys, where landmarks and poses share ids.
        past_step_s: Seconds between consecutive past poses. If given, the poses that share the
            letter of a robot's start key, with lower index, are its past and may take part in
            multi-robot factors.
    """

    files: Annotated[tuple[Name, ...], Meta(min_length=1)]
    start_keys: dict[str, KeyName] = field(default_factory=dict)
    gauge: GaugeTable = field(default_factory=GaugeTable)
    estimate: bool = False
    repeat_tolerance: NotNegative = 0.0
    landmark_character: Annotated[str, Meta(pattern="^[A-Za-z]$")] | None = None
    past_step_s: Positive | None = None


class PyfgPrior(Table, frozen=True, tag_field="kind", tag="pyfg"):
    """``[prior] kind = "pyfg"``: the team's past as PyFactorGraph text.

    Attributes:
        file: The file, relative to the scenario file.
        start_keys: As for g2o.
        gauge: Which pose is held, and how firmly.
        estimate: As for g2o.
        past: Whether past poses, at their times, may take part in multi-robot factors.
    """

    file: Name
    start_keys: dict[str, KeyName] = field(default_factory=dict)
    gauge: GaugeTable = field(default_factory=GaugeTable)
    estimate: bool = False
    past: bool = False


class MrclamPrior(Table, frozen=True, tag_field="kind", tag="mrclam"):
    """``[prior] kind = "mrclam"``: the team's past as a UTIAS MR.CLAM folder, run through SLAM.

    Attributes:
        folder: The folder, relative to the scenario file.
        past: Whether past poses, at their times, may take part in multi-robot factors.
    """

    folder: Name
    past: bool = False


class TumPrior(Table, frozen=True, tag_field="kind", tag="tum"):
    """``[prior] kind = "tum"``: the team's past as TUM trajectories, with an assumed noise.

    Attributes:
        folder: Folder of files ROBOT.tum, or one such file, relative to the scenario file.
        past: Whether past poses, at their times, may take part in multi-robot factors.
    """

    folder: Name
    past: bool = False


LogPrior = G2oPrior | PyfgPrior | MrclamPrior | TumPrior


class PythonPrior(Table, frozen=True, tag_field="kind", tag="python"):
    """``[prior] kind = "python"``: a user's own graph.

    Attributes:
        function: "module:function", called with nothing; returns (graph, values, start_keys) or
            (graph, values, start_keys, past_states).
    """

    function: Name


class TermTable(Table, frozen=True):
    """``[[objective.terms]]``: one term, or one a robot where no robot is named.

    Attributes:
        kind: What is measured.
        weight: Factor in the objective.
        robot: The robot whose path or pose is meant; every robot in turn if left out.
        robots: Uncertainty: poses of several robots, jointly.
        trajectory_of: Uncertainty: all future poses of this robot, jointly.
        landmarks: Uncertainty: "all" or names of landmarks, jointly.
        keys: Uncertainty: keys of the prior, jointly.
        function: Uncertainty: a registered name, "trace" if left out. Path: "module:object".
        block: Uncertainty: part of every pose, "position" if left out.
        read: Uncertainty: "arrival", look-ahead steps or "end"; "end" if left out.
        arrival_of: Uncertainty: whose arrival.
        name: Path: name in reports; that of the function if left out.
    """

    kind: Literal["uncertainty", "path_length", "travel_time", "path"]
    weight: float = 1.0
    robot: Name | None = None
    robots: tuple[Name, ...] | None = None
    trajectory_of: Name | None = None
    landmarks: Literal["all"] | tuple[Name, ...] | None = None
    keys: tuple[KeyName, ...] | None = None
    function: Name | None = None
    block: Literal["position", "pose", "heading"] | None = None
    read: Literal["end", "arrival"] | tuple[Annotated[int, Meta(ge=0)], ...] | None = None
    arrival_of: Name | None = None
    name: Name | None = None


class ObjectiveTable(Table, frozen=True):
    """``[objective]``: a preset with its weights, or a list of terms.

    Attributes:
        preset: Objective (41) of Regev and Indelman 2017; taken where there are no terms.
        path_weight: Weight of path length in the preset, kappa_path; 0.1 if left out.
        uncertainty_weight: Weight of the trace at the goal there, kappa_uncert; 1 if left out.
        terms: Terms instead of the preset.
    """

    preset: Literal["length_and_uncertainty"] | None = None
    path_weight: float | None = None
    uncertainty_weight: float | None = None
    terms: tuple[TermTable, ...] = ()


class Scenario(Table, frozen=True):
    """A scenario file.

    Attributes:
        schema: Version of this format: 1.
        name: Title for figures and results; the file's name if left out.
        seed: Seed of every random number of the run.
        world: Bounds and obstacles.
        robots: In the order of the team.
        planner: ``name`` and one table of options a planner, ``[planner.NAME]``.
        sensors: Sensors by name: ``kind`` (built-in or "module:object") and its parameters.
        targets: Hidden targets.
        landmarks: Mapped landmarks.
        team: Multi-robot factors and agreement.
        prior: Where the belief at planning time comes from.
        objective: What the team minimises.
        simulation: The world in which the team plans, moves and plans again; it only plans where
            this is left out.
    """

    schema: Literal[1]
    world: WorldTable
    robots: Annotated[tuple[RobotTable, ...], Meta(min_length=1)]
    planner: dict[str, Any]
    name: str = ""
    seed: Annotated[int, Meta(ge=0)] = 0
    sensors: dict[str, dict[str, Any]] = field(default_factory=dict)
    targets: tuple[TargetTable, ...] = ()
    landmarks: tuple[LandmarkTable, ...] = ()
    team: TeamTable = field(default_factory=TeamTable)
    prior: IndependentPrior | LogPrior | PythonPrior = field(default_factory=IndependentPrior)
    objective: ObjectiveTable = field(default_factory=ObjectiveTable)
    simulation: SimulationTable | None = None

    @property
    def planner_name(self) -> str:
        """Name of the planner, built-in or ``module:object``."""
        return str(self.planner["name"])

    @property
    def planner_options(self) -> dict[str, Any]:
        """Options under ``[planner.NAME]`` of the planner that is named."""
        return dict(self.planner.get(self.planner_name, {}))
