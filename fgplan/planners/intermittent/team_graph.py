"""Robots split into overlapping teams, and the graph of teams G_T.

Nodes are teams; two teams are joined iff they share a robot. Information travels between teams
in the robots that they share, so G_T must be connected. Section II of Khodayi-mehr et al. 2019 has
every robot in exactly two teams; here each is in two or more (their footnote 1, reference [17]).

L is the largest number of nodes on a shortest path of G_T (Proposition III.2).
"""

from collections import deque
from dataclasses import dataclass, field

from fgplan.errors import InvalidInputError, UnknownNameError


@dataclass(frozen=True, slots=True)
class TeamGraph:
    """Teams of robots, checked connected.

    Attributes:
        robots: Unique names.
        teams: Members of each team by name, two or more, in the order of ``robots``.
        neighbours: Teams that share a robot with each team, ascending; made here.

    Raises:
        InvalidInputError: If a team has fewer than two robots, a robot fewer than two teams, or
            the graph of teams is not connected.
        UnknownNameError: If a team names a robot that is none of ``robots``.

    Example:
        >>> ring = TeamGraph(("a", "b", "c"), (("a", "b"), ("b", "c"), ("a", "c")))
        >>> ring.neighbours
        ((1, 2), (0, 2), (0, 1))
        >>> ring.longest_shortest_path
        2
    """

    robots: tuple[str, ...]
    teams: tuple[tuple[str, ...], ...]
    neighbours: tuple[tuple[int, ...], ...] = field(init=False)

    def __post_init__(self) -> None:
        """Check members and connection."""
        robots = tuple(self.robots)
        for name in robots:
            if robots.count(name) > 1:
                raise InvalidInputError(f"team graph: expected unique names, got {name!r} twice")
        teams = []
        for index, members in enumerate(self.teams):
            for name in members:
                if name not in robots:
                    raise UnknownNameError(
                        f"team {index}: robot {name!r} is not one of {', '.join(robots)}"
                    )
            if len(set(members)) != len(members) or len(members) < 2:
                raise InvalidInputError(
                    f"team {index}: expected two or more different robots, got {tuple(members)}"
                )
            teams.append(tuple(sorted(members, key=robots.index)))
        object.__setattr__(self, "robots", robots)
        object.__setattr__(self, "teams", tuple(teams))
        for name in robots:
            if len(self.teams_of(name)) < 2:
                raise InvalidInputError(
                    f"robot {name!r}: expected a member of two or more teams, got "
                    f"{self.teams_of(name)}; what it knows could not travel on"
                )
        sets = [set(team) for team in teams]
        neighbours = tuple(
            tuple(j for j in range(len(sets)) if j != i and sets[i] & sets[j])
            for i in range(len(sets))
        )
        object.__setattr__(self, "neighbours", neighbours)
        reached = self._distances(0)
        if len(reached) < len(teams):
            missing = sorted(set(range(len(teams))) - set(reached))
            raise InvalidInputError(
                f"team graph: expected a connected graph, but teams {missing} cannot be reached "
                "from team 0; let a robot be a member of a team on either side"
            )

    @property
    def longest_shortest_path(self) -> int:
        """L: nodes on the longest shortest path between two teams, both ends counted."""
        return 1 + max(max(self._distances(i).values()) for i in range(len(self.teams)))

    @property
    def greatest_degree(self) -> int:
        """Largest number of teams that one team shares robots with."""
        return max(len(near) for near in self.neighbours)

    def teams_of(self, robot: str) -> tuple[int, ...]:
        """Teams that a robot is a member of, ascending.

        Args:
            robot: Name.

        Returns:
            Indices of teams; none for a stranger.
        """
        return tuple(index for index, team in enumerate(self.teams) if robot in team)

    def _distances(self, start: int) -> dict[int, int]:
        """Edges to every team that can be reached from one."""
        found, queue = {start: 0}, deque([start])
        while queue:
            team = queue.popleft()
            for other in self.neighbours[team]:
                if other not in found:
                    found[other] = found[team] + 1
                    queue.append(other)
        return found


def propose_teams(robots: int | tuple[str, ...], teams_per_robot: int = 2) -> TeamGraph:
    """Teams for a number of robots: team i holds robots i, i + 1, ..., each robot in so many.

    With two teams a robot this is the ring of figure 1(a) of the paper. More teams a robot make
    larger teams and shorter ways between them.

    Args:
        robots: Their number, three or more (named ``r1``, ``r2``, ...), or their names.
        teams_per_robot: Teams that each robot is a member of, and robots that each team has.

    Returns:
        As many teams as robots.

    Raises:
        InvalidInputError: If there are fewer than three robots, or the teams would hold them all.

    Example:
        >>> propose_teams(4).teams
        (('r1', 'r2'), ('r2', 'r3'), ('r3', 'r4'), ('r1', 'r4'))
    """
    names = tuple(f"r{i + 1}" for i in range(robots)) if isinstance(robots, int) else tuple(robots)
    count = len(names)
    if count < 3:
        raise InvalidInputError(
            f"teams: expected three or more robots, got {count}; two robots are one team and need "
            "no schedule"
        )
    if not 2 <= teams_per_robot < count:
        raise InvalidInputError(
            f"teams_per_robot: expected 2 to {count - 1} for {count} robots, got {teams_per_robot}"
        )
    return TeamGraph(
        names,
        tuple(
            tuple(names[(i + step) % count] for step in range(teams_per_robot))
            for i in range(count)
        ),
    )
