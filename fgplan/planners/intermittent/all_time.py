"""The baseline of section IV-B that is connected at all times: a formation that moves as one.

The robots keep a fixed configuration. RRT* plans for its centre until the uncertainty of the most
uncertain target is below delta, with the same tree, samples and fallbacks as a team's; when the end
is reached it plans again. Everybody knows everything at once.
"""

import numpy as np

from fgplan.planners.intermittent.estimate import Estimate, Filtered, Record
from fgplan.planners.intermittent.options import SegmentOptions
from fgplan.planners.intermittent.segment import Segment, plan_segment
from fgplan.planners.intermittent.segment_model import StateModel
from fgplan.planners.intermittent.segment_problem import SegmentProblem
from fgplan.planners.intermittent.truth import Truth
from fgplan.typing import FloatArray
from roadmaps import Workspace


def formation(robots: int, spacing_m: float) -> FloatArray:
    """Offsets of robots in two rows about their centre.

    Args:
        robots: Their number.
        spacing_m: Between neighbours, metres; at most the communication range.

    Returns:
        Shape (N, 2), metres.
    """
    rows = np.array([(index // 2, index % 2) for index in range(robots)], dtype=np.float64)
    return spacing_m * (rows - rows.mean(axis=0))


def run_formation(
    workspace: Workspace,
    model: StateModel,
    options: SegmentOptions,
    start: FloatArray,
    estimate: Estimate,
    truth: Truth,
    generator: np.random.Generator,
    spacing_m: float | None = None,
) -> tuple[FloatArray, Filtered, tuple[Segment, ...]]:
    """Run a formation for as long as the truth is known.

    Args:
        workspace: Where robots may be.
        model: Of the state; all its robots are in the formation.
        options: Of planning.
        start: Place of the centre, shape (2,), metres.
        estimate: The first estimate, at time 0.
        truth: States and noise.
        generator: Source of all samples.
        spacing_m: Between neighbours; 0.75 R if left out.

    Returns:
        Places of the robots, shape (steps + 1, N, 2), the estimate of every step, and the plans.
    """
    robots = truth.normals.shape[1]
    spacing = 0.75 * options.range_m if spacing_m is None else spacing_m
    offsets = formation(robots, spacing)
    places = [start + offsets]
    means, uncertainty, plans = [], [], []
    now, center = estimate, np.asarray(start, dtype=np.float64)
    while now.time < truth.steps:
        problem = SegmentProblem(
            workspace=workspace,
            model=model,
            estimate=now,
            starts=center[None],
            times=np.array([now.time]),
            carriers=np.arange(robots),
            bodies=np.zeros(robots, dtype=np.int64),
            offsets=offsets,
            meets=False,
        )
        segment = plan_segment(problem, options, generator)
        plans.append(segment)
        way = segment.places[0][1:] if segment.end > now.time else center[None]
        records: list[tuple[int, Record]] = []
        until = min(now.time + len(way), truth.steps)
        for time in range(now.time + 1, until + 1):
            here = way[time - now.time - 1] + offsets
            places.append(here)
            if time % model.every:
                continue
            for robot, place in enumerate(here):
                readings = model.measure(
                    robot, truth.states[time], place, truth.normals[time, robot]
                )
                records.append((robot, Record(time, (place[0], place[1]), readings)))
        filtered = model.run(now, until, records)
        means.append(filtered.means)
        uncertainty.append(filtered.uncertainty)
        center = way[until - now.time - 1]
        now = filtered.estimate
    whole = Filtered(now, np.concatenate(means), np.concatenate(uncertainty))
    return np.array(places), whole, tuple(plans)
