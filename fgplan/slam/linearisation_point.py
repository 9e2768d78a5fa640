"""Where planning linearises: the estimate, except where it has hardly moved since last time.

iSAM2 relinearises a variable when its estimate has moved by more than a threshold; planning does
the same from session to session. A landmark or past pose that stays keeps its factors' Jacobians,
bit by bit, so whatever was computed from them is still valid. The current poses are always taken
at their estimate, because paths start there.
"""

from collections.abc import Iterable
from typing import Any

import gtsam
import numpy as np

from fgplan.typing import FloatArray, Key


def linearisation_point(
    estimate: gtsam.Values,
    previous: gtsam.Values | None,
    always: Iterable[Key],
    threshold: float,
) -> gtsam.Values:
    """Values at which the belief of a planning session is linearised.

    Args:
        estimate: Current estimate of every variable.
        previous: Values of the session before; None takes the estimate.
        always: Keys that are taken at their estimate in any case.
        threshold: Largest entry of the local coordinates (metres, radians) between the two up to
            which a variable keeps its old value.

    Returns:
        A value for every variable of the estimate.
    """
    if previous is None or threshold <= 0.0:
        return gtsam.Values(estimate)
    moving = {int(key) for key in always}
    dims = {int(key): int(dim) for key, dim in previous.dims().items()}
    chosen = gtsam.Values()
    for key, dim in ((int(key), int(dim)) for key, dim in estimate.dims().items()):
        value = _read(estimate, key, dim)
        if key not in moving and key in dims:
            old = _read(previous, key, dim)
            if np.abs(_offset(old, value)).max() <= threshold:
                value = old
        chosen.insert(key, value)
    return chosen


def _read(values: gtsam.Values, key: Key, dim: int) -> gtsam.Pose2 | gtsam.Pose3 | FloatArray:
    """Value of a variable, whichever type of its dimension it has."""
    if dim == 2:
        return values.atPoint2(key)
    if dim == 6:
        return values.atPose3(key)
    try:
        return values.atPose2(key)
    except RuntimeError:  # GTSAM's only way to say "another type"
        return values.atPoint3(key)


def _offset(old: gtsam.Pose2 | gtsam.Pose3 | FloatArray, new: Any) -> FloatArray:  # noqa: ANN401
    """Local coordinates of a new value about an old one of the same type."""
    return new - old if isinstance(old, np.ndarray) else np.asarray(old.localCoordinates(new))
