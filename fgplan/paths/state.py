"""A state on a path: where a robot would be, at which look-ahead step and time.

The state, not the vertex, identifies a variable: heading depends on the edge by which a vertex was
reached, and two passes over one vertex are two variables. Steps count from 1 along a path; step 0
is the robot's current pose, and past poses known to the prior have negative steps.
"""

from dataclasses import dataclass

from fgplan.typing import Pose


@dataclass(frozen=True, slots=True)
class State:
    """One state of one robot.

    Attributes:
        robot: Name of the robot.
        step: Look-ahead step; 0 is the current pose, negative is past.
        time_s: Seconds from planning time; negative is past.
        pose: Shape (3,) or (4, 4), world frame.
        vertex: Roadmap vertex, or -1 where there is none.
    """

    robot: str
    step: int
    time_s: float
    pose: Pose
    vertex: int = -1
