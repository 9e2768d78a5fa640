"""The order of the horizons in Table I: centralised, all-to-all, connected, none."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from fgplan.io.result_file import Requirement, require_at_most, require_true

COLUMNS = ("centralised", "all_to_all", "connected", "none")
MOST_INVERSION = 0.1
DENSE_RATIO = 0.1


def inversions(rows: Sequence[Mapping[str, Any]], first: str, second: str) -> list[float]:
    """By how much the horizons of one column exceed those of the next, where they do.

    Args:
        rows: As ``plan_row`` gives them.
        first: The column that is to be the smaller one.
        second: The other.

    Returns:
        Relative excess of each row that is the wrong way round; equal is one for ``none``.
    """
    found = []
    for row in rows:
        if f"horizon_{second}" not in row:
            continue
        excess = row[f"horizon_{first}"] / row[f"horizon_{second}"] - 1.0
        if not excess < 0.0 if second == "none" else not excess <= 0.0:
            found.append(float(excess))
    return found


def blocks_of_ten(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The order of the horizons in the mean over every ten trials.

    Args:
        rows: As ``run`` collects them.

    Returns:
        Of each block, in the order of the trials: number of inversions and the largest one, by pair
        of columns.
    """
    blocks = []
    for first_trial in range(0, min(row["trials"] for row in rows) - 9, 10):
        part = slice(first_trial, first_trial + 10)
        means = [
            {
                f"horizon_{name}": float(np.mean(row[f"horizons_{name}"][part]))
                for name in COLUMNS
                if f"horizons_{name}" in row
            }
            for row in rows
        ]
        block: dict[str, Any] = {"first_trial": first_trial}
        for first, second in pairwise(COLUMNS):
            excess = inversions(means, first, second)
            block[f"inversions_{first}_{second}"] = len(excess)
            block[f"largest_inversion_{first}_{second}"] = max(excess, default=0.0)
        blocks.append(block)
    return blocks


def block_summary(blocks: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """A line on the blocks of ten trials.

    Args:
        blocks: As ``blocks_of_ten`` gives them.

    Returns:
        How many have at most one inversion in every column, none above a tenth; nothing for none.
    """
    good = sum(
        all(block[f"inversions_{a}_{b}"] <= 1 for a, b in pairwise(COLUMNS))
        and all(block[f"largest_inversion_{a}_{b}"] <= MOST_INVERSION for a, b in pairwise(COLUMNS))
        for block in blocks
    )
    if not blocks:
        return ()
    return (f"order as required in the mean over ten trials: {good} of {len(blocks)} blocks",)


def requirements(rows: Sequence[Mapping[str, Any]]) -> tuple[Requirement, ...]:
    """What the rows must show.

    Args:
        rows: As ``run`` collects them.

    Returns:
        Every row solved; the order of the horizons; the time of an iteration in dense form.
    """
    needs = [
        require_true(
            "every_row_solved",
            all(row[key] == row["trials"] for row in rows for key in row if "solved_" in key),
        )
    ]
    for first, second in pairwise(COLUMNS):
        excess = inversions(rows, first, second)
        needs.append(require_at_most(f"inversions_{first}_{second}", len(excess), 1))
        largest = max(excess, default=0.0)
        needs.append(
            require_at_most(f"largest_inversion_{first}_{second}", largest, MOST_INVERSION)
        )
    worst = [row["ratio_published"] for row in rows if (row["robots"], row["targets"]) != (10, 10)]
    if worst:
        needs.append(require_at_most("dense_iteration_ratio", max(worst), DENSE_RATIO))
    return tuple(needs)
