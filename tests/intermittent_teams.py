"""Random team graphs for tests; those of the paper are in ``fgplan.bench.intermittent_scene``."""

import numpy as np

from fgplan.planners.intermittent.team_graph import TeamGraph


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
