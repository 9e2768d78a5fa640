"""Team graphs for tests: those of figure 1 of Khodayi-mehr et al. 2019, and random ones."""

import numpy as np

from fgplan.planners.intermittent.team_graph import TeamGraph

G1_TEAMS = (
    ("r12", "r18"),
    ("r12", "r23"),
    ("r23", "r34"),
    ("r34", "r45"),
    ("r45", "r56"),
    ("r56", "r67"),
    ("r67", "r78"),
    ("r18", "r78"),
)
G2_TEAMS = (
    ("r12", "r14", "r15"),
    ("r12", "r23", "r25"),
    ("r23", "r34", "r35"),
    ("r14", "r34", "r45"),
    ("r15", "r25", "r35", "r45"),
)
ROBOTS_1 = ("r12", "r23", "r34", "r45", "r56", "r67", "r78", "r18")
ROBOTS_2 = ("r12", "r14", "r15", "r23", "r25", "r34", "r35", "r45")


def random_team_graph(teams: int, generator: np.random.Generator) -> TeamGraph:
    """A connected graph of teams: a random tree of shared robots, and some robots more."""
    members: list[list[str]] = [[] for _ in range(teams)]
    count = 0

    def add(*joined: int) -> None:
        nonlocal count
        for team in joined:
            members[team].append(f"r{count}")
        count += 1

    for team in range(1, teams):
        add(team, int(generator.integers(team)))
    for _ in range(int(generator.integers(0, teams + 1))):
        size = int(generator.integers(2, min(teams, 4) + 1))
        add(*(int(t) for t in generator.choice(teams, size, replace=False)))
    for team in range(teams):
        while len(members[team]) < 2:
            add(team, int((team + 1 + generator.integers(teams - 1)) % teams))
    return TeamGraph(tuple(f"r{i}" for i in range(count)), tuple(tuple(m) for m in members))
