"""A sparse information matrix that factors are added to and subtracted from.

Equations (12) and (21) of Regev and Indelman 2017:

    Lambda' = Lambda - sum_{f removed} Lambda(f) + sum_{f added} Lambda(f).

Variables are named by anything hashable. A variable is appended when a factor first touches it and
dropped when its last factor is gone; so the number of factors on each is counted, because after a
subtraction its rows hold rounding, not zeros.
"""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from fgplan.beliefs.belief import Belief
from fgplan.beliefs.from_scratch import GraphPart
from fgplan.errors import IllPosedBeliefError, UnknownNameError
from fgplan.typing import Covariance, FloatArray, IntArray, Key

Variable = Hashable


@dataclass(frozen=True, slots=True)
class FactorInformation:
    """Information of one linearised factor: Lambda(f) of Algorithm 3.

    Attributes:
        variables: Variables in the order of the blocks.
        dims: Tangent dimension of each.
        matrix: A'A of the whitened Jacobian, shape (d, d), d the sum of the dims.
    """

    variables: tuple[Variable, ...]
    dims: tuple[int, ...]
    matrix: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class SparseInformation:
    """An information matrix over named variables.

    Attributes:
        variables: Variables in the order of the blocks.
        dims: Tangent dimension of each, shape (n,).
        counts: Number of factors on each, shape (n,).
        matrix: Sparse, by columns, shape (d, d), symmetric.
    """

    variables: tuple[Variable, ...]
    dims: IntArray
    counts: IntArray
    matrix: scipy.sparse.csc_array

    @property
    def bytes_held(self) -> int:
        """Memory of the numbers."""
        held = self.matrix
        return int(held.data.nbytes + held.indices.nbytes + held.indptr.nbytes)


def prior_information(prior: Belief) -> SparseInformation:
    """Lambda_k of equation (12): the information of everything so far."""
    rows = prior.rows
    shape = (rows.row_start.size - 1, int(rows.dims.sum()))
    whitened = scipy.sparse.csr_array((rows.entries, rows.columns, rows.row_start), shape=shape)
    matrix = scipy.sparse.csc_array(whitened.T @ whitened)
    return SparseInformation(rows.keys, rows.dims, np.ones(len(rows.keys), dtype=np.int64), matrix)


def factor_informations(
    part: GraphPart, names: Mapping[Key, Variable], dims: Mapping[Key, int], pose_dim: int
) -> tuple[FactorInformation, ...]:
    """Information of each factor of a part, its variables renamed.

    Args:
        part: Factors and their linearisation.
        names: Name of each key; keys that are not here keep their own.
        dims: Tangent dimension of keys that are not poses of paths.
        pose_dim: Tangent dimension of a pose.

    Returns:
        One information a factor, in the part's order.
    """
    found = []
    for place in range(part.linear.size()):
        factor = part.linear.at(place)
        keys = tuple(factor.keys())
        found.append(
            FactorInformation(
                tuple(names.get(key, key) for key in keys),
                tuple(dims.get(key, pose_dim) for key in keys),
                factor.information(),
            )
        )
    return tuple(found)


def update_information(
    information: SparseInformation, factors: Sequence[FactorInformation], *, add: bool
) -> SparseInformation:
    """Add or subtract the information of factors: updInfo, Algorithm 3.

    Args:
        information: Lambda.
        factors: Causal factors already (equation 21).
        add: Whether to add or to subtract.

    Returns:
        Lambda with new variables appended at the end; none is dropped here.
    """
    if not factors:
        return information
    place = {variable: i for i, variable in enumerate(information.variables)}
    variables, dims = list(information.variables), information.dims.tolist()
    for factor in factors:
        for variable, dim in zip(factor.variables, factor.dims, strict=True):
            if variable not in place:
                place[variable] = len(variables)
                variables.append(variable)
                dims.append(dim)
    sizes = np.array(dims, dtype=np.int64)
    start = np.cumsum(sizes) - sizes
    counts = np.concatenate(
        [information.counts, np.zeros(len(variables) - information.counts.size, dtype=np.int64)]
    )
    rows, columns, entries = [], [], []
    for factor in factors:
        places = [place[variable] for variable in factor.variables]
        counts[places] += 1 if add else -1
        scalars = np.concatenate([np.arange(start[p], start[p] + sizes[p]) for p in places])
        rows.append(np.repeat(scalars, scalars.size))
        columns.append(np.tile(scalars, scalars.size))
        entries.append(factor.matrix.ravel())
    total = int(sizes.sum())
    change = scipy.sparse.csc_array(
        (np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))),
        shape=(total, total),
    )
    old = information.matrix.copy()
    old.resize((total, total))
    matrix = scipy.sparse.csc_array(old + change if add else old - change)
    return SparseInformation(tuple(variables), sizes, counts, matrix)


def without_unused(information: SparseInformation) -> SparseInformation:
    """Drop variables that no factor touches any more."""
    used = information.counts > 0
    if used.all():
        return information
    scalars = np.flatnonzero(np.repeat(used, information.dims))
    matrix = scipy.sparse.csc_array(information.matrix[scalars][:, scalars])
    variables = tuple(v for v, keep in zip(information.variables, used, strict=True) if keep)
    return SparseInformation(variables, information.dims[used], information.counts[used], matrix)


def marginal_covariance(
    information: SparseInformation, variables: Sequence[Variable]
) -> Covariance:
    """Joint covariance of some variables by a sparse factorisation.

    Args:
        information: Lambda.
        variables: Variables in the order wanted.

    Returns:
        Shape (d, d), d the sum of their dimensions.

    Raises:
        UnknownNameError: If a variable is not there.
        IllPosedBeliefError: If the matrix is not positive definite.
    """
    place = {variable: i for i, variable in enumerate(information.variables)}
    missing = [variable for variable in variables if variable not in place]
    if missing:
        raise UnknownNameError(f"information matrix: variable {missing[0]!r} is not in it")
    start = np.cumsum(information.dims) - information.dims
    rows = np.concatenate(
        [np.arange(information.dims[place[v]]) + start[place[v]] for v in variables]
    )
    units = np.zeros((information.matrix.shape[0], rows.size))
    units[rows, np.arange(rows.size)] = 1.0
    try:
        # Diagonal pivots keep the symmetry, so the signs of U tell whether Lambda is definite.
        factor = scipy.sparse.linalg.splu(
            information.matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:  # SuperLU's only way to say "singular"
        raise IllPosedBeliefError("information matrix: it is singular") from error
    if not (factor.U.diagonal() > 0.0).all():
        raise IllPosedBeliefError("information matrix: it is not positive definite")
    covariance = factor.solve(units)[rows]
    return 0.5 * (covariance + covariance.T)
