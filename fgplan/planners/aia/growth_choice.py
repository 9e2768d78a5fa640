"""Which growth a problem needs."""

from fgplan.planners.aia.arrays import prepare
from fgplan.planners.aia.compilation import COMPILED
from fgplan.planners.aia.densities import Densities
from fgplan.planners.aia.geodesic_fields import GeodesicFields
from fgplan.planners.aia.growth import Growth
from fgplan.planners.aia.guided_growth import GuidedGrowth
from fgplan.planners.aia.options import TreeOptions
from fgplan.planners.aia.plain_growth import PlainGrowth
from fgplan.planners.aia.problem import AcquisitionProblem


def make_growth(
    problem: AcquisitionProblem,
    options: TreeOptions,
    densities: Densities | None = None,
    fields: GeodesicFields | None = None,
) -> Growth:
    """The growth that a problem needs: all compiled where the kernels know every part.

    Where numba does not compile, ``PlainGrowth`` takes the place of the compiled loop.

    Args:
        problem: What is planned for.
        options: How.
        densities: A user's own f_V and f_U.
        fields: Geodesic distances to be used again.

    Returns:
        A growth, not planted yet.
    """
    prepared = prepare(problem, options, fields)
    known = prepared.compiled_sensors and prepared.compiled_terminal and prepared.compiled_objective
    if known and densities is None and options.assignment != "optimal" and problem.packed:
        growth = Growth if COMPILED else PlainGrowth
        return growth(problem, options, prepared)
    return GuidedGrowth(problem, options, prepared, densities or Densities())
