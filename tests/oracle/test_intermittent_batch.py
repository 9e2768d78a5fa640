"""Algorithm 4 against the batch solution of the same linearised problem, solved by GTSAM."""

import gtsam
import numpy as np
import pytest
from intermittent_scenes import (
    block_model,
    dense_estimate,
    dense_model,
    drawn_records,
    estimate_of,
    segment_problem,
)

from fgplan.planners.intermittent.ekf import measurement_rows, predict_state
from fgplan.planners.intermittent.options import SegmentOptions
from fgplan.planners.intermittent.segment import grow_tree


def batch(dense, start, steps, rows_of, linearised):
    """Last state's mean and covariance by GTSAM.

    ``linearised[t]`` is where the process of step t is linearised; ``rows_of(t, prediction)`` gives
    whitened rows and innovations at the prediction of time t.
    """
    size = dense.size
    unit = gtsam.noiseModel.Unit.Create(size)
    graph = gtsam.GaussianFactorGraph()

    def root(covariance):
        return np.linalg.inv(np.linalg.cholesky(covariance))

    weight = root(start.covariance[0])
    graph.add(gtsam.JacobianFactor(0, weight, weight @ start.mean, unit))
    for time in range(1, steps + 1):
        before = linearised[time - 1]
        by_state, by_noise = dense.process.jacobians(before, time - 1)
        prediction = dense.process.advance(before, time - 1)
        weight = root(by_noise @ dense.process.noise(time - 1) @ by_noise.T)
        offset = prediction - by_state @ before
        graph.add(
            gtsam.JacobianFactor(time - 1, -weight @ by_state, time, weight, weight @ offset, unit)
        )
        for rows, innovation in rows_of(time, prediction):
            noise = gtsam.noiseModel.Unit.Create(len(rows))
            right = innovation + rows @ prediction
            graph.add(gtsam.JacobianFactor(time, rows, right, noise))
    solution = graph.optimize()
    ordering = gtsam.Ordering()
    for time in range(steps + 1):
        ordering.push_back(time)
    information = graph.hessian(ordering)[0]
    covariance = np.linalg.inv(information)[-size:, -size:]
    return solution.at(steps), covariance


@pytest.mark.parametrize("size", [2, 3])
def test_filter_equals_the_batch_solution(size):
    blocks = block_model(2, size)
    dense = dense_model(blocks)
    start = dense_estimate(estimate_of(size))
    records = drawn_records(blocks, 15, np.random.default_rng(8))
    filtered = blocks.run(estimate_of(size), 15, records)

    def rows_of(time, prediction):
        return [
            measurement_rows(
                dense.observations[robot][index],
                prediction,
                np.array(record.position),
                np.array(value),
            )
            for robot, record in records
            if record.time == time
            for index, value in record.readings
        ]

    linearised = [start.mean, *filtered.means]
    mean, covariance = batch(dense, start, 15, rows_of, linearised)
    # Batch solves 16 n unknowns at once: digits are lost to its condition, some 1e5.
    np.testing.assert_allclose(filtered.estimate.mean, mean, rtol=1e-8, atol=1e-9)
    ours = dense_model(blocks).run(start, 15, records).estimate.covariance[0]
    np.testing.assert_allclose(ours, covariance, rtol=1e-7, atol=1e-12)
    for i, block in enumerate(filtered.estimate.covariance):
        part = slice(size * i, size * (i + 1))
        np.testing.assert_allclose(block, covariance[part, part], rtol=1e-7, atol=1e-12)


# The later body starts within the first edge of the other, or only after several.
@pytest.mark.parametrize("late", [9, 31])
def test_cost_and_covariance_of_tree_nodes_equal_the_batch_solution(late):
    blocks = block_model(2)
    dense = dense_model(blocks)
    problem = segment_problem(
        blocks,
        [(1.0, 1.0), (6.0, 2.0)],
        [2, late],
        tracks=np.linspace((0.5, 0.5, 7.5, 2.0), (1.0, 1.0, 6.0, 2.0), late + 1).reshape(-1, 2, 2),
    )
    options = SegmentOptions(samples=120, explore=80)
    grown = grow_tree(problem, options, np.random.default_rng(2))
    start = dense_estimate(problem.estimate)
    leaves = [node for node in range(1, grown.count) if np.ptp(grown.tree.time[node]) == 0]
    for node in leaves[:: max(1, len(leaves) // 2)]:
        end = int(grown.tree.time[node, 0])
        way = grown.path(node)

        def place(body, time, way=way):
            begin = int(problem.times[body])
            if time <= begin:
                return problem.tracks[time, body]
            times = grown.tree.time[way, body]
            return np.array(
                [np.interp(time, times, grown.tree.position[way, body, c]) for c in range(2)]
            )

        def rows_of(time, prediction, place=place):
            found = []
            for body in range(2):
                for one in dense.observations[body]:
                    if one.visible(prediction, place(body, time), dense.workspace):
                        value = one.predict(prediction, place(body, time))
                        found.append(measurement_rows(one, prediction, place(body, time), value))
            return found

        linearised = list(dense.predicted_means(start, end))
        _, covariance = batch(dense, start, end, rows_of, linearised)
        for i, block in enumerate(grown.tree.covariance[node]):
            part = slice(3 * i, 3 * i + 3)
            np.testing.assert_allclose(block, covariance[part, part], rtol=1e-7, atol=1e-12)
        # Cost: the uncertainty of every step after the earliest start, each counted once.
        total, spread, mean = 0.0, start.covariance[0], start.mean
        for time in range(1, end + 1):
            mean, spread = predict_state(dense.process, mean, spread, time - 1)
            rows = [row for row, _ in rows_of(time, mean)]
            information = np.linalg.inv(spread) + sum(row.T @ row for row in rows)
            spread = np.linalg.inv(information)
            if time > problem.times.min():
                total += np.linalg.eigvalsh(spread)[-1]
        np.testing.assert_allclose(grown.tree.cost[node], total, rtol=1e-9)
