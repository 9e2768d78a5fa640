"""The Riccati core equals the GTSAM factor graph of the same path, cut at every step."""

import gtsam
import numpy as np
import pytest
from scipy.linalg import block_diag

from fgplan.errors import IllPosedBeliefError, InvalidInputError
from fgplan.models.hidden_state import HiddenBlock, HiddenState, coupled
from fgplan.riccati.block_diagonal import riccati_map_blocks
from fgplan.riccati.covariance_path import propagate, propagate_blocks
from fgplan.riccati.gaussian import information_of, predict, riccati_map, update
from fgplan.riccati.information import (
    from_information,
    predict_information,
    to_information,
    update_information,
)
from fgplan.riccati.step import RiccatiStep, arriving, compose, identity_step

STEPS = 6


def spd(generator, size, scale=1.0):
    root = generator.standard_normal((size, size))
    return scale * (root @ root.T + 0.3 * np.eye(size))


def draw_state(generator, sizes, *, noise=True, varying=True):
    blocks = []
    for index, size in enumerate(sizes):
        lead = (STEPS,) if varying else ()
        transition = np.eye(size) + 0.2 * generator.standard_normal((*lead, size, size))
        drift = generator.standard_normal((*lead, size))
        process = np.zeros((size, size))
        if noise:
            draws = [spd(generator, size, 0.1) for _ in range(STEPS if varying else 1)]
            process = np.array(draws) if varying else draws[0]
        blocks.append(
            HiddenBlock(targets=(f"t{index}",), transition=transition, drift=drift, process=process)
        )
    return HiddenState(tuple(blocks))


def draw_rows(generator, state):
    """Whitened rows of every configuration, each row in one block; some steps see nothing."""
    out = []
    ends = np.cumsum([block.size for block in state.blocks])
    for step in range(STEPS + 1):
        rows = []
        for block, end in zip(state.blocks, ends, strict=True):
            for _ in range(0 if step == 2 else int(generator.integers(0, 3))):
                row = np.zeros(state.size)
                row[end - block.size : end] = generator.standard_normal(block.size)
                rows.append(row / generator.uniform(0.3, 1.0))
        out.append(np.array(rows).reshape(-1, state.size))
    return out


def graph_marginal(state, prior, rows, step, *, measure_at):
    """Covariance of x(step) from the factor graph cut at that step."""
    graph = gtsam.GaussianFactorGraph()
    size = state.size
    unit = gtsam.noiseModel.Unit.Create(size)
    root = np.linalg.inv(np.linalg.cholesky(prior))
    graph.add(gtsam.JacobianFactor(0, root, np.zeros(size), unit))
    last = step if measure_at == "child" else step - 1
    for t in range(last + 1):
        if len(rows[t]):
            zero = np.zeros(len(rows[t]))
            noise = gtsam.noiseModel.Unit.Create(len(rows[t]))
            graph.add(gtsam.JacobianFactor(t, rows[t], zero, noise))
    for t in range(step):
        transition, _, process = state.dense(t)
        weight = np.linalg.inv(np.linalg.cholesky(process))
        graph.add(
            gtsam.JacobianFactor(t, -weight @ transition, t + 1, weight, np.zeros(size), unit)
        )
    ordering = gtsam.Ordering()
    for t in range(step + 1):
        ordering.push_back(t)
    bayes = graph.eliminateSequential(ordering)
    upper = bayes.at(bayes.size() - 1).R()
    inverse = np.linalg.inv(upper)
    return inverse @ inverse.T


@pytest.mark.parametrize("measure_at", ["parent", "child"])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("varying", [False, True])
def test_dense_and_blocks_equal_the_factor_graph_at_every_step(measure_at, seed, varying):
    generator = np.random.default_rng(seed)
    state = draw_state(generator, (2, 3, 1), varying=varying)
    priors = [spd(generator, block.size) for block in state.blocks]
    rows = draw_rows(generator, state)
    prior = block_diag(*priors)
    dense = propagate(state, prior, rows, measure_at=measure_at)
    blocks = propagate_blocks(state, priors, rows, measure_at=measure_at)
    for step in range(STEPS + 1):
        expected = graph_marginal(state, prior, rows, step, measure_at=measure_at)
        scale = np.abs(expected).max()
        np.testing.assert_allclose(dense[step], expected, atol=1e-9 * scale, rtol=0)
        joined = block_diag(*(block[step] for block in blocks))
        np.testing.assert_allclose(joined, expected, atol=1e-9 * scale, rtol=0)


@pytest.mark.parametrize("measure_at", ["parent", "child"])
def test_coupled_state_equals_the_factor_graph(measure_at):
    generator = np.random.default_rng(5)
    n = 5
    block = HiddenBlock(
        targets=tuple("abcde"),
        sizes=(1,) * n,
        transition=np.eye(n) + 0.1 * generator.standard_normal((STEPS, n, n)),
        process=np.array([spd(generator, n, 0.05) for _ in range(STEPS)]),
    )
    state = HiddenState((block,))
    prior = spd(generator, n)
    rows = [generator.standard_normal((2, n)) for _ in range(STEPS + 1)]
    dense = propagate(state, prior, rows, measure_at=measure_at)
    for step in range(STEPS + 1):
        expected = graph_marginal(state, prior, rows, step, measure_at=measure_at)
        scale = np.abs(expected).max()
        np.testing.assert_allclose(dense[step], expected, atol=1e-9 * scale, rtol=0)


@pytest.mark.parametrize("measure_at", ["parent", "child"])
def test_without_process_noise_all_steps_are_one_shared_variable(measure_at):
    generator = np.random.default_rng(7)
    state = draw_state(generator, (2, 2), noise=False)
    prior = block_diag(spd(generator, 2), spd(generator, 2))
    rows = draw_rows(generator, state)
    dense = propagate(state, prior, rows, measure_at=measure_at)
    unit = gtsam.noiseModel.Unit.Create(4)
    for step in range(STEPS + 1):
        graph = gtsam.GaussianFactorGraph()
        root = np.linalg.inv(np.linalg.cholesky(prior))
        graph.add(gtsam.JacobianFactor(0, root, np.zeros(4), unit))
        product = np.eye(4)
        for t in range(step + 1):
            if len(rows[t]) and (t < step or measure_at == "child"):
                noise = gtsam.noiseModel.Unit.Create(len(rows[t]))
                graph.add(gtsam.JacobianFactor(0, rows[t] @ product, np.zeros(len(rows[t])), noise))
            if t < step:
                product = state.dense(t)[0] @ product
        bayes = graph.eliminateSequential()
        inverse = np.linalg.inv(bayes.at(0).R())
        expected = product @ inverse @ inverse.T @ product.T
        scale = np.abs(expected).max()
        np.testing.assert_allclose(dense[step], expected, atol=1e-9 * scale, rtol=0)


def test_composed_steps_equal_the_factor_graph_of_the_whole_stretch():
    generator = np.random.default_rng(11)
    state = draw_state(generator, (3,))
    prior = spd(generator, 3)
    rows = draw_rows(generator, state)
    whole = identity_step(3)
    for t in range(STEPS):
        transition, _, process = state.dense(t)
        step = RiccatiStep(A=transition, C=process, J=information_of(rows[t]))
        whole = compose(whole, step)
        expected = graph_marginal(state, prior, rows, t + 1, measure_at="parent")
        scale = np.abs(expected).max()
        np.testing.assert_allclose(whole.apply(prior), expected, atol=1e-9 * scale, rtol=0)


def test_composed_steps_measuring_on_arrival_equal_the_factor_graph():
    generator = np.random.default_rng(12)
    state = draw_state(generator, (2,))
    prior = spd(generator, 2)
    rows = draw_rows(generator, state)
    zero = np.zeros((2, 2))
    whole = RiccatiStep(A=np.eye(2), C=zero, J=information_of(rows[0]))
    for t in range(STEPS):
        transition, _, process = state.dense(t)
        for step in arriving(transition, process, information_of(rows[t + 1])):
            whole = compose(whole, step)
        expected = graph_marginal(state, prior, rows, t + 1, measure_at="child")
        scale = np.abs(expected).max()
        np.testing.assert_allclose(whole.apply(prior), expected, atol=1e-9 * scale, rtol=0)


def test_composition_is_associative():
    generator = np.random.default_rng(13)
    steps = [
        RiccatiStep(A=generator.standard_normal((3, 3)), C=spd(generator, 3), J=spd(generator, 3))
        for _ in range(3)
    ]
    left = compose(compose(steps[0], steps[1]), steps[2])
    right = compose(steps[0], compose(steps[1], steps[2]))
    for name in ("A", "C", "J"):
        np.testing.assert_allclose(getattr(left, name), getattr(right, name), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("noise", [False, True])
def test_information_form_equals_covariance_form_with_means(noise):
    generator = np.random.default_rng(17)
    state = draw_state(generator, (3,), noise=noise)
    mean, covariance = generator.standard_normal(3), spd(generator, 3)
    vector, matrix = to_information(mean, covariance)
    for t in range(STEPS):
        rows = generator.standard_normal((2, 3))
        measured = generator.standard_normal(2)
        mean, covariance = update(mean, covariance, rows, np.eye(2), measured - rows @ mean)
        vector, matrix = update_information(vector, matrix, rows, measured)
        step = state.dense(t)
        mean, covariance = predict(mean, covariance, *step)
        vector, matrix = predict_information(vector, matrix, *step)
        found, spread = from_information(vector, matrix)
        np.testing.assert_allclose(found, mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(spread, covariance, rtol=1e-9, atol=1e-9)


def test_update_equals_the_factor_graph_mean():
    generator = np.random.default_rng(19)
    mean, prior = generator.standard_normal(3), spd(generator, 3)
    rows, noise = generator.standard_normal((2, 3)), spd(generator, 2)
    measured = generator.standard_normal(2)
    graph = gtsam.GaussianFactorGraph()
    for matrix, value, covariance in ((np.eye(3), mean, prior), (rows, measured, noise)):
        weight = np.linalg.inv(np.linalg.cholesky(covariance))
        unit = gtsam.noiseModel.Unit.Create(len(value))
        graph.add(gtsam.JacobianFactor(0, weight @ matrix, weight @ value, unit))
    found, _ = update(mean, prior, rows, noise, measured - rows @ mean)
    np.testing.assert_allclose(found, graph.optimize().at(0), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("at_child", [False, True])
def test_batched_blocks_equal_one_by_one(at_child):
    generator = np.random.default_rng(23)
    prior = np.array([spd(generator, 2) for _ in range(4)])
    rows = generator.standard_normal((4, 1, 2))
    transition = generator.standard_normal((4, 2, 2))
    process = np.array([spd(generator, 2, 0.1) for _ in range(4)])
    gained = np.swapaxes(rows, 1, 2) @ rows
    found = riccati_map_blocks(prior, gained, transition, process, at_child=at_child)
    for i in range(4):
        block = HiddenBlock(targets=("t",), transition=transition[i], process=process[i])
        path = propagate(
            HiddenState((block,)),
            prior[i],
            [np.zeros((0, 2)), rows[i]] if at_child else [rows[i], np.zeros((0, 2))],
            measure_at="child" if at_child else "parent",
        )
        np.testing.assert_allclose(found[i], path[1], rtol=1e-10, atol=1e-12)


def test_more_uncertain_before_is_more_uncertain_after():
    generator = np.random.default_rng(29)
    for _ in range(20):
        small = spd(generator, 3)
        large = small + spd(generator, 3, 0.1)
        rows = generator.standard_normal((2, 3))
        transition, process = generator.standard_normal((3, 3)), spd(generator, 3)
        after = riccati_map(large, rows, transition, process) - riccati_map(
            small, rows, transition, process
        )
        assert np.linalg.eigvalsh(after).min() > -1e-12 * np.abs(after).max()


def test_bad_input_is_refused_by_name():
    generator = np.random.default_rng(0)
    state = draw_state(generator, (2, 2))
    priors = [spd(generator, 2), spd(generator, 2)]
    with pytest.raises(InvalidInputError, match="at least one configuration"):
        propagate(state, block_diag(*priors), [])
    with pytest.raises(InvalidInputError, match=r"step 1: expected rows of shape \(m, 4\)"):
        propagate(state, block_diag(*priors), [np.zeros((0, 4)), np.zeros((1, 3))])
    with pytest.raises(InvalidInputError, match="touch one block"):
        propagate_blocks(state, priors, [np.ones((1, 4))])
    with pytest.raises(InvalidInputError, match="one a block"):
        propagate_blocks(state, priors[:1], [np.zeros((0, 4))])
    with pytest.raises(InvalidInputError, match="positive definite"):
        update(np.zeros(2), np.eye(2), np.eye(2), -np.eye(2), np.zeros(2))
    with pytest.raises(InvalidInputError, match="equal sizes"):
        compose(identity_step(2), identity_step(3))
    with pytest.raises(InvalidInputError, match=r"A of shape \(n, n\)"):
        RiccatiStep(A=np.zeros(3), C=np.eye(3), J=np.eye(3))
    with pytest.raises(InvalidInputError, match="invertible"):
        predict_information(np.zeros(2), np.eye(2), np.zeros((2, 2)), np.zeros(2), np.eye(2))
    with pytest.raises(IllPosedBeliefError, match="neither prior nor measurement"):
        from_information(np.zeros(2), np.diag([1.0, 0.0]))


def test_coupled_and_independent_dynamics_agree():
    generator = np.random.default_rng(31)
    state = draw_state(generator, (2, 2))
    prior = block_diag(spd(generator, 2), spd(generator, 2))
    rows = draw_rows(generator, state)
    np.testing.assert_allclose(
        propagate(state, prior, rows), propagate(coupled(state), prior, rows), rtol=1e-12
    )
