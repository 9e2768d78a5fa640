"""A belief: a factor graph and the values that it is linearised at, checked once, read exactly.

    information = A'A of the whitened Jacobian rows A at the values,   covariance = (A'A)^-1

Read by square-root elimination (fgplan/beliefs/elimination.py), because gtsam.Marginals throws on
well-posed long chains and is wrong by 1e-7 on Victoria Park. Tangents are GTSAM's: increments act
on the right, Pose2 is (x, y, heading), Pose3 is rotation before translation; so a covariance of a
pose is in that pose's own frame.

What GTSAM accepts without a word is refused here: NaN and infinite values, measurements and
sigmas, zero sigmas (they are hard constraints), covariances that are not positive definite, robust
noise (its weight depends on the values, so it has no covariance), variables in no factor, empty
slots. An asymmetric covariance cannot be seen any more once GTSAM has made a noise model of it
(the off-diagonal is gone); fgplan.checks.check_covariance is for that.
"""

import difflib
import hashlib
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import gtsam
import numpy as np

from fgplan.beliefs.diagnosis import FactorView, check_rank, check_structure
from fgplan.beliefs.elimination import eliminate, elimination_order
from fgplan.beliefs.marginals import marginal_covariances
from fgplan.beliefs.noise_model import check_noise
from fgplan.beliefs.square_root import SquareRootFactor
from fgplan.beliefs.whitened_rows import WhitenedRows, whitened_rows
from fgplan.checks import frozen
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.factors.boundary import gtsam_boundary
from fgplan.factors.keys import describe_key, describe_keys
from fgplan.typing import Covariance, FloatArray, Key, Pose

REMEMBERED = 4
"""Eliminations that a belief remembers, by kept keys."""

_KINDS_BY_DIM = {2: ("Point2",), 3: ("Pose2", "Point3"), 6: ("Pose3",)}


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """A Gaussian belief over the variables of a factor graph, at fixed values.

    Attributes:
        graph: The user's factor graph; a copy, so later changes of theirs do not reach in here.
        values: Linearisation point of every variable; a copy.
        keys: Every variable, ascending.
        kinds: Type of each variable: Pose2, Pose3, Point2, Point3, or "other".
        rows: The whitened rows at the values.
        views: What is known of each factor, for diagnosis.
        eliminations: What was eliminated so far, by kept keys, at most REMEMBERED of them; a
            memory that may be cleared at any time without changing a result.

    Example:
        >>> import gtsam, numpy as np
        >>> graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        >>> noise = gtsam.noiseModel.Isotropic.Sigma(3, 0.1)
        >>> graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(), noise))
        >>> values.insert(0, gtsam.Pose2())
        >>> Belief(graph, values).covariance(0).diagonal().round(12)
        array([0.01, 0.01, 0.01])
    """

    graph: gtsam.NonlinearFactorGraph = field(repr=False)
    values: gtsam.Values = field(repr=False)
    keys: tuple[Key, ...] = field(init=False, repr=False)
    kinds: dict[Key, str] = field(init=False, repr=False)
    rows: WhitenedRows = field(init=False, repr=False)
    views: tuple[FactorView, ...] = field(init=False, repr=False)
    eliminations: dict[tuple[Key, ...], SquareRootFactor] = field(
        init=False, repr=False, default_factory=dict
    )
    _linear: gtsam.GaussianFactorGraph = field(init=False, repr=False)
    _dims: dict[Key, int] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check everything that GTSAM would silently accept, then linearise once.

        Raises:
            InvalidInputError: If a value, measurement or noise model is not usable.
            UnknownNameError: If a factor has a key that is not in the values.
            IllPosedBeliefError: If structure shows that a variable cannot be determined.
        """
        for what, kind in (("graph", gtsam.NonlinearFactorGraph), ("values", gtsam.Values)):
            if not isinstance(getattr(self, what), kind):
                raise InvalidInputError(
                    f"belief: expected {what} of type {kind.__name__}, got "
                    f"{type(getattr(self, what)).__name__}; the call is Belief(graph, values)"
                )
        graph, values = gtsam.NonlinearFactorGraph(self.graph), gtsam.Values(self.values)
        dims = {int(key): int(dim) for key, dim in values.dims().items()}
        kinds = {key: _checked_kind(values, key, dims[key]) for key in sorted(dims)}
        with gtsam_boundary("evaluating the factors at the values"):
            views = _checked_views(graph, values, dims)
        check_structure(kinds, dims, views)
        with gtsam_boundary("linearising the graph"):
            linear = graph.linearize(values)
        for name, value in (
            ("graph", graph),
            ("values", values),
            ("keys", tuple(kinds)),
            ("kinds", kinds),
            ("rows", whitened_rows(linear, dims)),
            ("views", views),
            ("_linear", linear),
            ("_dims", dims),
        ):
            object.__setattr__(self, name, value)

    def linear(self) -> gtsam.GaussianFactorGraph:
        """The graph linearised at the values; computed once, a copy of the list each time."""
        linear = gtsam.GaussianFactorGraph()
        linear.push_back(self._linear)
        return linear

    def digest(self) -> str:
        """Sha256 of variables, values and whitened rows, in hexadecimal.

        The same for the same content in another process and for factors in another order (on the
        same kind of machine and GTSAM version: the rows are compared to the last bit).
        """
        rows = self.rows
        lines = [
            rows.columns[low:high].tobytes() + rows.entries[low:high].tobytes() + right.tobytes()
            for low, high, right in zip(
                rows.row_start[:-1], rows.row_start[1:], rows.right_hand_side, strict=True
            )
        ]
        content = hashlib.sha256(b"fgplan belief 1")
        content.update(np.array(self.keys, dtype=np.uint64).tobytes())
        content.update(rows.dims.tobytes())
        content.update(self.values.serialize().encode())
        for line in sorted(lines):
            content.update(line)
        return content.hexdigest()

    def dim(self, key: Key) -> int:
        """Tangent dimension of a variable.

        Raises:
            UnknownNameError: If the key is not in the belief; lists keys with near names.
        """
        self._check_known([key])
        return self._dims[key]

    def pose(self, key: Key) -> Pose:
        """Pose at the linearisation point: (x, y, heading), or the 4 x 4 matrix ``wTr``.

        Raises:
            UnknownNameError: If the key is not in the belief.
            InvalidInputError: If it is not a pose.
        """
        self._check_known([key])
        if self.kinds[key] not in ("Pose2", "Pose3"):
            raise InvalidInputError(
                f"key {describe_key(key)} is a {self.kinds[key]}, not a pose; for a landmark ask "
                "for Belief.point"
            )
        return _read(self.values, key, self.kinds[key])

    def point(self, key: Key) -> FloatArray:
        """Landmark at the linearisation point: shape (2,) or (3,), metres, world frame.

        Raises:
            UnknownNameError: If the key is not in the belief.
            InvalidInputError: If it is not a point.
        """
        self._check_known([key])
        if self.kinds[key] not in ("Point2", "Point3"):
            raise InvalidInputError(
                f"key {describe_key(key)} is a {self.kinds[key]}, not a point; for a robot ask "
                "for Belief.pose"
            )
        return _read(self.values, key, self.kinds[key])

    def landmarks(self) -> dict[Key, FloatArray]:
        """Every landmark at the linearisation point, by ascending key.

        Returns:
            Shape (2,) or (3,) each, metres, world frame; empty where there is none.
        """
        points = [key for key in self.keys if self.kinds[key] in ("Point2", "Point3")]
        return {key: _read(self.values, key, self.kinds[key]) for key in points}

    def covariance(
        self, rows: Key | Sequence[Key], columns: Key | Sequence[Key] | None = None
    ) -> Covariance:
        """Marginal, joint marginal or cross-covariance: the one query.

        Args:
            rows: A key, or keys in the order wanted.
            columns: None for the (joint) marginal covariance of ``rows``; a key or keys for the
                block between ``rows`` and ``columns``.

        Returns:
            Shape (sum of dims of rows, sum of dims of columns), in the tangents of the keys in
            the order asked; read-only; symmetric positive definite when ``columns`` is None.

        Raises:
            UnknownNameError: If a key is not in the belief; lists keys with near names.
            InvalidInputError: If a key is no integer, or is asked for twice in one list.
            IllPosedBeliefError: If a variable is not determined by the factors.
        """
        wanted = self._listed(rows)
        across = None if columns is None else self._listed(columns)
        factor = next(iter(self.eliminations.values()), None) or self.eliminated()
        return factor.covariance(wanted, across)

    def marginal_covariances(self, keys: Sequence[Key] | None = None) -> dict[Key, Covariance]:
        """Marginal covariance of each of many keys (all by default), in one pass.

        Raises:
            UnknownNameError: If a key is not in the belief.
            IllPosedBeliefError: If a variable is not determined by the factors.
        """
        factor = next(iter(self.eliminations.values()), None) or self.eliminated()
        return marginal_covariances(factor, self.keys if keys is None else self._listed(keys))

    def square_root_information(self, keys: Key | Sequence[Key]) -> FloatArray:
        """Square-root information that QR leaves on keys when all else is eliminated.

        Args:
            keys: A key, or keys in the order wanted for the columns.

        Returns:
            R, upper triangular, shape (d, d), d the sum of the dims, positive diagonal; R'R is
            the information of the joint marginal. Never inverted, so a loose prior beside tight
            odometry loses nothing.

        Raises:
            UnknownNameError: If a key is not in the belief.
            InvalidInputError: If a key is no integer, or is asked for twice.
            IllPosedBeliefError: If a variable is not determined by the factors.
        """
        wanted = self._listed(keys)
        return self.eliminated(wanted).information_rows(wanted)[0]

    def eliminated(self, kept: Key | Sequence[Key] = ()) -> SquareRootFactor:
        """The belief eliminated by QR with some keys last; remembered in ``eliminations``.

        Raises:
            UnknownNameError: If a key is not in the belief.
            InvalidInputError: If a key is no integer, or is asked for twice.
            IllPosedBeliefError: If a variable is not determined by the factors.
        """
        wanted = self._listed(kept)
        if wanted not in self.eliminations:
            order = elimination_order(self._linear, wanted)
            factor = eliminate(self.rows, order, wanted)
            check_rank(factor, self.kinds, self.views)
            while len(self.eliminations) >= REMEMBERED:
                del self.eliminations[next(iter(self.eliminations))]
            self.eliminations[wanted] = factor
        return self.eliminations[wanted]

    def _listed(self, keys: Key | Sequence[Key]) -> tuple[Key, ...]:
        """One key or several as a tuple, checked."""
        if isinstance(keys, int | np.integer):
            keys = (int(keys),)
        if isinstance(keys, str) or not isinstance(keys, Iterable):
            _check_key(keys)
        given = tuple(keys)
        self._check_known(given)
        listed = tuple(int(key) for key in given)
        if len(set(listed)) != len(listed):
            raise InvalidInputError(f"keys: expected distinct keys, got {describe_keys(listed)}")
        return listed

    def _check_known(self, keys: Sequence[Key]) -> None:
        """Raise for the first key that is not in the belief."""
        for key in keys:
            _check_key(key)
            if key not in self._dims:
                name = describe_key(key)
                names = [describe_key(known) for known in self.keys]
                near = difflib.get_close_matches(name, names, n=5, cutoff=0.5) or names[:5]
                raise UnknownNameError(
                    f"key {name} ({int(key)}) is not in the belief of {len(names)} variables; "
                    f"near names: {', '.join(near)}"
                )


def _check_key(key: object) -> None:
    """Refuse what is no key: a name, for one."""
    if not isinstance(key, int | np.integer):
        raise InvalidInputError(
            f"keys: expected a GTSAM key, which is an integer, got {key!r}; make the one of x3 by "
            "fgplan.symbol_key('x', 3)"
        )


def _checked_kind(values: gtsam.Values, key: Key, dim: int) -> str:
    """Type of a variable, after a check that its value is finite."""
    for kind in _KINDS_BY_DIM.get(dim, ()):
        try:
            value = _read(values, key, kind)
        except RuntimeError:  # GTSAM's only way to say "another type"
            continue
        if not np.isfinite(value).all():
            raise InvalidInputError(
                f"value of {describe_key(key)} ({kind}): expected finite numbers, got "
                f"{np.array2string(value, separator=', ')}; was an optimiser's divergence kept?"
            )
        return kind
    return "other"


def _read(values: gtsam.Values, key: Key, kind: str) -> FloatArray:
    """Value of a variable of known type as a read-only array."""
    if kind == "Pose2":
        pose = values.atPose2(key)
        return frozen((pose.x(), pose.y(), pose.theta()))
    if kind == "Pose3":
        return frozen(values.atPose3(key).matrix())
    return frozen(values.atPoint2(key) if kind == "Point2" else values.atPoint3(key))


def _checked_views(
    graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, dims: dict[Key, int]
) -> tuple[FactorView, ...]:
    """What is known of each factor, after checks of its keys, noise and error."""
    if graph.size() == 0:
        raise InvalidInputError("factor graph: expected at least one factor, got none")
    views = []
    for index in range(graph.size()):
        factor = graph.at(index)
        if factor is None:
            raise InvalidInputError(
                f"factor {index}: the slot is empty (graph.remove or graph.add(None)); build the "
                "graph without it"
            )
        keys = tuple(factor.keys())
        view = FactorView(
            index=index, type_name=type(factor).__name__, keys=keys, rows=factor.dim()
        )
        missing = [key for key in keys if key not in dims]
        if missing:
            raise UnknownNameError(
                f"{view}: key {describe_keys(missing)} is not in the values; insert its initial "
                "estimate or leave the factor out"
            )
        if hasattr(factor, "noiseModel"):
            check_noise(factor.noiseModel(), view)
        error = factor.error(values)
        if not math.isfinite(error):
            raise InvalidInputError(
                f"{view}: expected a finite error at the values, got {error}; its measurement is "
                "NaN or infinite"
            )
        views.append(view)
    return tuple(views)
