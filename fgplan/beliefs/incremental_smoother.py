"""The others' belief in gtsam.ISAM2, to which one candidate after another is added and removed.

Rules that GTSAM 4.3 asks for, each of them learned by measuring:

    QR, not Cholesky            Cholesky loses rank on long chains that are well posed
    no relinearisation          planning is about one linearisation point
    removal by slot             a slot freed is used again, so slots are forgotten when removed
    newTheta                    must hold the new variables of the new factors and no others; a
                                variable disappears with its last factor and may come back with
                                another value
    remove, then add            in two updates, since a variable cannot go and come back in one
    after any exception         the object is unusable and is built anew
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import gtsam

from fgplan.beliefs.belief import Belief
from fgplan.errors import IllPosedBeliefError, InvalidInputError, UnknownNameError
from fgplan.factors.boundary import gtsam_boundary
from fgplan.factors.factor_set import FactorId, FactorSet, factor_difference
from fgplan.typing import Covariance, Key

_REFUSALS = (IllPosedBeliefError, InvalidInputError, UnknownNameError)


@dataclass(slots=True, eq=False)
class IncrementalSmoother:
    """An ISAM2 object with what is needed to change and to rebuild it.

    GTSAM's object changes in place, so this is not a value. What it holds is compared with what is
    asked for each time, so that no result depends on what was asked before.

    Attributes:
        prior: Belief at planning time.
        factors: Planned factors of the announced paths that the object holds.
        rebuilds: How often the object was built anew.
    """

    prior: Belief
    factors: FactorSet = field(default_factory=FactorSet)
    rebuilds: int = 0
    _poses: gtsam.Values = field(default_factory=gtsam.Values, repr=False)
    _slots: dict[FactorId, int] = field(default_factory=dict, repr=False)
    _smoother: gtsam.ISAM2 | None = field(default=None, repr=False)

    def announce(self, factors: FactorSet, poses: gtsam.Values) -> None:
        """Make the object hold exactly these factors of the announced paths beside the prior.

        Args:
            factors: Planned factors, cut already.
            poses: Value of every pose that they touch, and no others.

        Raises:
            IllPosedBeliefError: If a variable is not determined.
        """
        change = factor_difference(self.factors, factors)
        self.factors, self._poses = factors, poses
        if self._smoother is None:
            self._rebuild()
            return
        try:
            with gtsam_boundary("changing the announced paths in ISAM2"):
                if len(change.removed):
                    removed = [self._slots.pop(f) for f in change.removed.identities()]
                    _remove(self._smoother, removed)
                if len(change.added):
                    new = gtsam.Values()
                    for key in poses.dims():
                        if not self._smoother.valueExists(key):
                            _copy_pose(poses, key, new)
                    result = self._smoother.update(change.added.graph(), new)
                    slots = result.getNewFactorsIndices()
                    self._slots.update(zip(change.added.identities(), slots, strict=True))
        except _REFUSALS:
            self._rebuild()

    def covariances(
        self,
        graph: gtsam.NonlinearFactorGraph,
        poses: gtsam.Values,
        wanted: Sequence[tuple[Key, ...]],
    ) -> list[Covariance]:
        """Joint covariances if a candidate's factors are added; they are removed again.

        Args:
            graph: Factors of the candidate, cut already.
            poses: Value of every new pose that they touch, and no others.
            wanted: Lists of keys; a joint covariance of each is returned.

        Raises:
            IllPosedBeliefError: If GTSAM finds a variable not determined; the object is rebuilt.
        """
        smoother = self._smoother or self._rebuild()
        try:
            with gtsam_boundary("adding a candidate path to ISAM2"):
                slots = []
                if graph.size():
                    slots = smoother.update(graph, poses).getNewFactorsIndices()
                found = [
                    smoother.marginalCovariance(group[0])
                    if len(group) == 1
                    else smoother.jointMarginalCovariance(list(group)).fullMatrix()
                    for group in wanted
                ]
                if slots:
                    _remove(smoother, slots)
        except _REFUSALS:
            self._smoother = None
            raise
        return found

    def _rebuild(self) -> gtsam.ISAM2:
        """Build the object anew from the prior and the announced factors."""
        parameters = gtsam.ISAM2Params()
        parameters.setFactorization("QR")
        parameters.enableRelinearization = False
        parameters.findUnusedFactorSlots = True
        self._smoother = None
        smoother = gtsam.ISAM2(parameters)
        with gtsam_boundary("building ISAM2 of the prior and the announced paths"):
            smoother.update(self.prior.graph, self.prior.values)
            result = smoother.update(self.factors.graph(), self._poses)
        slots = result.getNewFactorsIndices()
        self._slots = dict(zip(self.factors.identities(), slots, strict=True))
        self._smoother = smoother
        self.rebuilds += 1
        return smoother


def _remove(smoother: gtsam.ISAM2, slots: Sequence[int]) -> None:
    """Remove factors; variables that lose their last factor disappear."""
    parameters = gtsam.ISAM2UpdateParams()
    parameters.removeFactorIndices = list(slots)
    smoother.update(gtsam.NonlinearFactorGraph(), gtsam.Values(), parameters)


def _copy_pose(source: gtsam.Values, key: Key, into: gtsam.Values) -> None:
    """Copy one pose from values to values."""
    planar = source.dims()[key] == 3
    into.insert(key, source.atPose2(key) if planar else source.atPose3(key))
