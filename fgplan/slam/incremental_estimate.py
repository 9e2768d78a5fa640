"""gtsam.ISAM2 that relinearises, with the graph that it holds, robust or Gaussian.

Rules that GTSAM 4.3 asks for:

    QR, not Cholesky            Cholesky loses rank on long chains that are well posed
    no wildfire threshold       what back-substitution leaves out below it depends on which
                                estimates were asked for in between, and 1 mm is much beside a
                                prior of 1e-6 m
    no damping of its steps     where they raise the error (a robot passes through a landmark of
                                which it sees the bearing), the whole graph is solved by
                                Levenberg-Marquardt, and the object is built anew there
    after any exception         the object is unusable and is built anew from the graph

Marginals of a robust graph have no definition, so the Gaussian graph is handed out that has the
same linear steps (fgplan.slam.robust_noise).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import gtsam
import numpy as np

from fgplan.checks import frozen
from fgplan.factors.boundary import gtsam_boundary
from fgplan.slam.robust_noise import RobustFactor
from fgplan.slam.slam_options import SlamOptions
from fgplan.typing import Covariance, FloatArray, Key, Pose

ERROR_SLACK = 1.0
"""How much half the squared residuals may grow: what linearising late costs is below."""


@dataclass(slots=True, kw_only=True)
class Addition:
    """What one update adds: factors, first estimates, and which factors have robust noise.

    Attributes:
        factors: In order.
        robust: Those of them whose noise is robust, by their place in ``factors``.
        values: First estimate of each new variable.
    """

    factors: list[gtsam.NonlinearFactor] = field(default_factory=list)
    robust: dict[int, RobustFactor] = field(default_factory=dict)
    values: gtsam.Values = field(default_factory=gtsam.Values)

    def add_robust(self, robust: RobustFactor) -> None:
        """Add a factor with robust noise."""
        self.robust[len(self.factors)] = robust
        self.factors.append(robust.factor())


@dataclass(slots=True, eq=False)
class IncrementalEstimate:
    """An ISAM2 object, changing in place, and all factors that it holds.

    Attributes:
        options: How it is run.
        rebuilds: How often it was built anew, because its steps ran away or after an exception.
    """

    options: SlamOptions
    rebuilds: int = 0
    _graph: gtsam.NonlinearFactorGraph = field(default_factory=gtsam.NonlinearFactorGraph)
    _robust: dict[int, RobustFactor] = field(default_factory=dict)
    _smoother: gtsam.ISAM2 = field(init=False)
    _values: gtsam.Values = field(default_factory=gtsam.Values)
    _error: float = 0.0

    def __post_init__(self) -> None:
        """Make the empty object."""
        self._smoother = self._new()

    def update(self, addition: Addition, doing: str) -> None:
        """Add factors and variables and move the estimate. After an error nothing has changed.

        Args:
            addition: What is new.
            doing: What is being done, for messages.

        Raises:
            IllPosedBeliefError: If a variable is not determined.
            InvalidInputError: If GTSAM refuses the factors.
        """
        new = gtsam.NonlinearFactorGraph()
        for factor in addition.factors:
            new.add(factor)
        size, estimate, error = self._graph.size(), self._values, self._error
        try:
            with gtsam_boundary(doing):
                start = gtsam.Values(estimate)
                start.insert(addition.values)
                self._graph.push_back(new)
                before = self._error + new.error(start)
                self._step(new, addition.values)
                if not self._error <= before + ERROR_SLACK:
                    self._solve(start)
        except Exception:  # of GTSAM, or of a user's own sensor
            self._graph.resize(size)
            self._values, self._error = estimate, error
            self._rebuild()
            raise
        self._robust.update({size + place: one for place, one in addition.robust.items()})

    def _step(self, new: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
        """Steps of iSAM2 until nothing moves; the error is infinite if they ran away."""
        try:
            self._smoother.update(new, values)
            for _ in range(self.options.iterations - 1):
                if self._smoother.update().getVariablesRelinearized() == 0:
                    break
            self._values = self._smoother.calculateEstimate()
            self._error = self._graph.error(self._values)
        except RuntimeError as error:
            if "Indetermina" not in str(error):
                raise
            self._error = np.inf

    def _solve(self, start: gtsam.Values) -> None:
        """The whole graph by damped least squares, and the object built anew there."""
        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setLinearSolverType("MULTIFRONTAL_QR")
        found = gtsam.LevenbergMarquardtOptimizer(self._graph, start, parameters).optimize()
        self._values = found
        self._rebuild()
        self._values = self._smoother.calculateEstimate()
        self._error = self._graph.error(self._values)

    def values(self) -> gtsam.Values:
        """Current estimate of every variable; not to be changed."""
        return self._values

    def pose(self, key: Key, *, planar: bool) -> Pose:
        """Estimate of a pose, shape (3,) or (4, 4), world frame."""
        if not planar:
            return frozen(self._values.atPose3(key).matrix())
        pose = self._values.atPose2(key)
        return frozen((pose.x(), pose.y(), pose.theta()))

    def point(self, key: Key, size: int) -> FloatArray:
        """Estimate of a landmark, shape (size,), metres, world frame."""
        return frozen(self._values.atPoint2(key) if size == 2 else self._values.atPoint3(key))

    def covariance(self, key: Key) -> Covariance:
        """Marginal covariance of one variable, where iSAM2 last linearised."""
        with gtsam_boundary("covariance by iSAM2"):
            found = self._smoother.marginalCovariance(key)
        return frozen(0.5 * (found + found.T))

    def joint_covariance(self, keys: Sequence[Key], dim: int) -> Covariance:
        """Joint covariance of poses, one may be named several times, shape (n dim, n dim)."""
        distinct = list(dict.fromkeys(keys))
        if len(distinct) == 1:
            joint = self.covariance(distinct[0])
        else:
            with gtsam_boundary("joint covariance by iSAM2"):
                joint = self._smoother.jointMarginalCovariance(distinct).fullMatrix()
        places = {key: place for place, key in enumerate(distinct)}
        rows = np.concatenate([np.arange(dim) + dim * places[key] for key in keys])
        found: Covariance = joint[np.ix_(rows, rows)]
        return 0.5 * (found + found.T)

    def graph(self) -> gtsam.NonlinearFactorGraph:
        """All factors with Gaussian noise; a copy."""
        graph = gtsam.NonlinearFactorGraph(self._graph)
        for index, robust in self._robust.items():
            graph.replace(index, robust.reweighted(self._values))
        return graph

    def weights(self) -> dict[str, tuple[float, ...]]:
        """Weight at the estimate of each factor with robust noise, by sensor, in order of time."""
        found: dict[str, list[float]] = {name: [] for name in self.options.robust}
        for robust in self._robust.values():
            found[robust.sensor].append(robust.weight(self._values))
        return {name: tuple(weights) for name, weights in found.items()}

    def _new(self) -> gtsam.ISAM2:
        """An empty ISAM2 object."""
        steps = gtsam.ISAM2GaussNewtonParams()
        steps.setWildfireThreshold(0.0)
        parameters = gtsam.ISAM2Params()
        parameters.setOptimizationParams(steps)
        parameters.setFactorization("QR")
        parameters.setRelinearizeThreshold(self.options.relinearise_threshold)
        parameters.relinearizeSkip = self.options.relinearise_every
        return gtsam.ISAM2(parameters)

    def _rebuild(self) -> None:
        """Build the object anew from the graph at the estimate."""
        self._smoother = self._new()
        self._smoother.update(self._graph, self._values)
        self.rebuilds += 1
