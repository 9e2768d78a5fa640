"""What is known of a target that nonlinear sensors look for: a bank of extended Kalman filters.

    p(x) = sum_k w_k N(x; mu_k, Sigma_k),    w_k <- w_k N(z - h(mu_k); 0, H Sigma_k H' + R)

One range leaves a ring, and ranges from a straight way leave two places, one on each side of it: a
single filter linearised about a mean 0.5 m wrong settles on one of them and believes it. So the
prior is split into narrow components on a grid along its principal axes (with the prior's mean and
covariance), each is filtered alone, and those that do not explain the readings lose their weight.
A reading that should have come and did not, and one that should not have come and did, count too:
each has a probability of ``_SURPRISE``, as a component is wider than the point that is tested.
"""

from dataclasses import dataclass, replace

import numpy as np

from fgplan.checks import frozen
from fgplan.models.measurement import Measurement
from fgplan.models.pose import position_in
from fgplan.models.sensor import AbstractSensor, SightLines
from fgplan.planners.aia.extended_filter import update_target
from fgplan.riccati.gaussian import predict_covariance
from fgplan.typing import Covariance, FloatArray, Pose

_WIDTH = 0.5
"""Standard deviation of a component over the prior's."""
_REACH = 2.4
"""Standard deviations that the grid covers to each side."""
_SURPRISE = 0.1
_FORGOTTEN = 1e-3
"""Share of the greatest weight below which a component is left out."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetBelief:
    """A mixture of Gaussians.

    Attributes:
        weights: Shape (K,), sum 1.
        means: Shape (K, n), metres, world frame.
        covariances: Shape (K, n, n), square metres.
    """

    weights: FloatArray
    means: FloatArray
    covariances: FloatArray

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("weights", "means", "covariances"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def mean(self) -> FloatArray:
        """Mean of the mixture, shape (n,)."""
        return np.asarray(self.weights @ self.means)

    @property
    def covariance(self) -> Covariance:
        """Covariance of the mixture, shape (n, n)."""
        offset = self.means - self.mean
        spread = self.covariances + offset[:, :, None] * offset[:, None, :]
        return np.asarray(np.tensordot(self.weights, spread, axes=1))


def split_prior(mean: FloatArray, covariance: Covariance, per_axis: int) -> TargetBelief:
    """A Gaussian as a mixture of narrower ones, with its mean and covariance.

    Args:
        mean: Shape (n,).
        covariance: Shape (n, n), positive definite.
        per_axis: Components along each principal axis; one keeps the Gaussian: a single filter.

    Returns:
        The mixture.
    """
    if per_axis == 1:
        return TargetBelief(weights=np.ones(1), means=mean[None], covariances=covariance[None])
    places = np.linspace(-_REACH, _REACH, per_axis)
    shares = np.exp(-0.5 * places**2 / (1.0 - _WIDTH**2))
    shares /= shares.sum()
    places *= np.sqrt((1.0 - _WIDTH**2) / (shares @ places**2))
    values, vectors = np.linalg.eigh(covariance)
    axes = vectors * np.sqrt(values)
    size = len(mean)
    grid = np.stack(np.meshgrid(*[places] * size, indexing="ij"), axis=-1).reshape(-1, size)
    joint = np.stack(np.meshgrid(*[shares] * size, indexing="ij"), axis=-1).reshape(-1, size)
    return TargetBelief(
        weights=joint.prod(axis=1),
        means=mean + grid @ axes.T,
        covariances=np.tile(_WIDTH**2 * covariance, (len(grid), 1, 1)),
    )


def predict_belief(
    belief: TargetBelief, transition: FloatArray, drift: FloatArray, process: Covariance
) -> TargetBelief:
    """Predict one step.

    Args:
        belief: Now.
        transition: A, shape (n, n).
        drift: d, shape (n,).
        process: Q, shape (n, n).

    Returns:
        One step later.
    """
    means = belief.means @ transition.T + drift
    return replace(
        belief, means=means, covariances=predict_covariance(belief.covariances, transition, process)
    )


def update_belief(
    belief: TargetBelief,
    sensor: AbstractSensor,
    pose: Pose,
    measurement: Measurement,
    world: SightLines | None,
) -> TargetBelief:
    """Update by a reading.

    Args:
        belief: Before it.
        sensor: What took it.
        pose: From where.
        measurement: The reading; the noise that it was drawn with is not looked at.
        world: Blocks sight.

    Returns:
        After it.
    """
    means, covariances = np.array(belief.means), np.array(belief.covariances)
    fit = np.zeros(len(means))
    for k in range(len(means)):
        fit[k] = 0.0 if sensor.visible(pose, means[k], world) else np.log(_SURPRISE)
        means[k], covariances[k], gained = update_target(
            sensor, pose, means[k], covariances[k], measurement.value
        )
        fit[k] += gained
    return _weighed(belief, fit, means, covariances)


def miss_belief(
    belief: TargetBelief, sensor: AbstractSensor, pose: Pose, world: SightLines | None
) -> TargetBelief:
    """Update by a reading that did not come.

    Args:
        belief: Before.
        sensor: What saw nothing.
        pose: From where.
        world: Blocks sight.

    Returns:
        After.
    """
    offset = np.linalg.norm(belief.means - position_in(pose, belief.means.shape[1]), axis=1)
    near = offset <= sensor.max_range_m
    if len(belief.weights) == 1 or not near.any():
        return belief
    seen = near.copy()
    for k in np.flatnonzero(near):
        seen[k] = sensor.visible(pose, belief.means[k], world)
    fit = np.where(seen, np.log(_SURPRISE), 0.0)
    return _weighed(belief, fit, belief.means, belief.covariances)


def _weighed(
    belief: TargetBelief, fit: FloatArray, means: FloatArray, covariances: FloatArray
) -> TargetBelief:
    """Components with weights by how well they fit; hopeless ones are left out."""
    scores = np.log(belief.weights) + fit
    weights = np.exp(scores - scores.max())
    kept = weights >= _FORGOTTEN
    weights = weights[kept] / weights[kept].sum()
    return TargetBelief(weights=weights, means=means[kept], covariances=covariances[kept])
