"""Every marginal covariance at once, from the root of the elimination tree down.

A variable's conditional [R S] given its separator s, whose covariance is known by then, gives

    T = R^-1 S,   cov(p, s) = -T cov(s, s),   cov(p, p) = R^-1 R^-T + T cov(s, s) T'

so that all n marginals cost about as much as one elimination, where n single queries
(``SquareRootFactor.covariance``) each walk to the root. Only positive terms are added.
"""

from collections.abc import Sequence

from fgplan.beliefs.square_root import SquareRootFactor
from fgplan.checks import frozen
from fgplan.errors import UnknownNameError
from fgplan.factors.keys import describe_keys
from fgplan.typing import Covariance, Key


def marginal_covariances(
    factor: SquareRootFactor, keys: Sequence[Key] | None = None
) -> dict[Key, Covariance]:
    """Marginal covariance of each of many keys.

    Args:
        factor: An eliminated graph.
        keys: Keys wanted; None for all, in elimination order.

    Returns:
        Covariance of each key in its own tangent, symmetric, read-only, shape (d, d).

    Raises:
        UnknownNameError: If a key is not in the graph.
        IllPosedBeliefError: If elimination found a variable that is not determined.
    """
    from fgplan.beliefs.marginal_kernels import recover_covariances

    factor.check_determined()
    wanted = factor.keys if keys is None else tuple(keys)
    missing = [key for key in wanted if key not in factor.position]
    if missing:
        raise UnknownNameError(f"key {describe_keys(missing)} is not in the graph")
    found = recover_covariances(
        factor.dims, factor.separator_start, factor.separators, factor.value_start, factor.values
    )
    covariances = {}
    for key in wanted:
        place = factor.position[key]
        dim = int(factor.dims[place])
        rows = found[factor.value_start[place] : factor.value_start[place + 1]].reshape(dim, -1)
        covariances[key] = frozen(rows[:, :dim])
    return covariances
