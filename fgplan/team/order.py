"""Whose turn it is: every robot derives the same order, nobody keeps it.

Turn 0 is round 0, in which everybody announces. Turn t >= 1 belongs to place (t - 1) mod R of
round (t - 1) div R. Where all answer at the same moment every turn belongs to everybody.
"""

import numpy as np

from fgplan.team.options import CoordinationOptions


def round_order(
    robots: tuple[str, ...], options: CoordinationOptions, number: int
) -> tuple[str, ...]:
    """Order of the robots in a round.

    Args:
        robots: In the order of the team.
        options: Order, seed and session.
        number: Number of the round, from 0.

    Returns:
        The order of the team, or a permutation of it drawn from (seed, session, number).
    """
    if options.order == "fixed":
        return robots
    generator = np.random.default_rng([options.seed, options.session, number])
    return tuple(robots[place] for place in generator.permutation(len(robots)))


def writers_of(robots: tuple[str, ...], options: CoordinationOptions, turn: int) -> tuple[str, ...]:
    """Robots that write in a turn.

    Args:
        robots: In the order of the team.
        options: Order, seed, session, and whether robots take turns.
        turn: Number of the turn, from 0.

    Returns:
        All of them in round 0 and where all answer at the same moment; else one.
    """
    if turn == 0 or not options.turns:
        return robots
    number, place = divmod(turn - 1, len(robots))
    return (round_order(robots, options, number)[place],)


def most_passed(robots: tuple[str, ...]) -> int:
    """Turns among which every robot has one at least, wherever they begin.

    Args:
        robots: In the order of the team.

    Returns:
        2 R - 1: a robot may be first in a round and last in the next.
    """
    return 2 * len(robots) - 1
