"""When which team communicates: conflict-free, periodic schedules, and the worst delay.

Teams that share a robot never meet in the same epoch, and every team meets once a period T
(definition III.1): a colouring of the graph of teams, whose colours are epochs 1..T. Teams in the
order of their index take the smallest colour that no neighbour has, so at most (greatest degree
+ 1) are used. The paper prints T = max degree + 1 and its experiments use fewer: T is the number
of colours used unless ``degree+1`` is asked for, which pads with epochs in which nobody meets.

Proposition III.2: what a robot learns in one epoch has reached every team D = (T - 1) L epochs
later, L the number of nodes on the longest shortest path of the graph of teams.
"""

from dataclasses import dataclass
from typing import Literal

from fgplan.errors import InvalidInputError
from fgplan.planners.intermittent.team_graph import TeamGraph

PeriodChoice = Literal["used", "degree+1"]


@dataclass(frozen=True, slots=True)
class Schedule:
    """The epoch of every team.

    Attributes:
        graph: Teams.
        colors: Epoch within the period, 1 to ``period``, of each team.
        period: T.

    Raises:
        InvalidInputError: If two teams that share a robot meet in the same epoch, or an epoch is
            outside the period.
    """

    graph: TeamGraph
    colors: tuple[int, ...]
    period: int

    def __post_init__(self) -> None:
        """Check that it is free of conflicts."""
        if len(self.colors) != len(self.graph.teams):
            raise InvalidInputError(
                f"schedule: expected one epoch a team ({len(self.graph.teams)}), got "
                f"{len(self.colors)}"
            )
        for team, color in enumerate(self.colors):
            if not 1 <= color <= self.period:
                raise InvalidInputError(
                    f"schedule: team {team}: expected an epoch of 1 to {self.period}, got {color}"
                )
            for other in self.graph.neighbours[team]:
                if self.colors[other] == color:
                    raise InvalidInputError(
                        f"schedule: teams {team} and {other} share a robot and meet in the same "
                        f"epoch {color}; it cannot be in two places"
                    )

    @property
    def delay_bound(self) -> int:
        """D of Proposition III.2, epochs, from T as used and L by its definition."""
        return (self.period - 1) * self.graph.longest_shortest_path

    def sequence(self, robot: str) -> tuple[int | None, ...]:
        """s_ij of (4): the team that a robot meets in each epoch of a period, None for X.

        Args:
            robot: Name.

        Returns:
            ``period`` entries.
        """
        by_color = {self.colors[team]: team for team in self.graph.teams_of(robot)}
        return tuple(by_color.get(epoch) for epoch in range(1, self.period + 1))

    def team_at(self, robot: str, epoch: int) -> int | None:
        """Which team a robot meets in an epoch.

        Args:
            robot: Name.
            epoch: 1 or more.

        Returns:
            The team, or None where it meets nobody.
        """
        return self.sequence(robot)[(epoch - 1) % self.period]

    def next_meeting(self, robot: str, epoch: int) -> tuple[int, int]:
        """The first meeting of a robot after an epoch.

        Args:
            robot: Name.
            epoch: 0 or more.

        Returns:
            Its epoch, and the team.
        """
        sequence = self.sequence(robot)
        later = epoch
        while True:
            team = sequence[later % self.period]
            later += 1
            if team is not None:
                return later, team

    def teams_in(self, epoch: int) -> tuple[int, ...]:
        """Teams that meet in an epoch.

        Args:
            epoch: 1 or more.

        Returns:
            Indices, ascending; no two share a robot.
        """
        color = (epoch - 1) % self.period + 1
        return tuple(team for team, own in enumerate(self.colors) if own == color)


def make_schedule(graph: TeamGraph, period: PeriodChoice = "used") -> Schedule:
    """Colour the teams.

    Args:
        graph: Teams.
        period: ``used``: as many epochs as colours; ``degree+1``: the paper's formula.

    Returns:
        The schedule.

    Raises:
        InvalidInputError: If the choice is not known.

    Example:
        >>> from fgplan.planners.intermittent.team_graph import propose_teams
        >>> ring = make_schedule(propose_teams(8))
        >>> ring.period, ring.delay_bound, ring.sequence("r2")
        (2, 5, (0, 1))
    """
    if period not in ("used", "degree+1"):
        raise InvalidInputError(f"period: expected 'used' or 'degree+1', got {period!r}")
    colors: list[int] = []
    for team in range(len(graph.teams)):
        taken = {colors[other] for other in graph.neighbours[team] if other < team}
        colors.append(next(color for color in range(1, len(taken) + 2) if color not in taken))
    length = max(colors) if period == "used" else graph.greatest_degree + 1
    return Schedule(graph, tuple(colors), length)
