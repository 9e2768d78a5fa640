"""Where GTSAM's exceptions become fgplan's.

GTSAM 4.3 does not export its exception classes: what arrives is a RuntimeError, IndexError or
ValueError with a text. The text is recognised here and nowhere else:

    "Indetermina(n)t(e) linear system" ... "variable <key>"   -> IllPosedBeliefError
    "does not exist in the Values", "map::at", "not in the BayesTree"  -> UnknownNameError
    anything else                                               -> InvalidInputError

The original stays attached as ``__cause__``. An exception of fgplan passes through unchanged.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager

from fgplan.errors import FgplanError, IllPosedBeliefError, InvalidInputError, UnknownNameError
from fgplan.factors.keys import describe_key

_INDETERMINATE = re.compile(r"Indetermina\w* linear system.*?variable\s+(\d+)", re.DOTALL)
_MISSING = re.compile(r'key "([^"]+)", which does not exist')
_WRONG_TYPE = re.compile(
    r'value with key "([^"]+)", type stored in Values is (.+?) but requested type was (.+)'
)


@contextmanager
def gtsam_boundary(doing: str) -> Iterator[None]:
    """Run GTSAM calls so that what they raise is one of fgplan's errors.

    Args:
        doing: What is being done, for the message: "linearising the graph".

    Raises:
        IllPosedBeliefError: If GTSAM found an indeterminate linear system; names the variable.
        UnknownNameError: If a key is not in the values, graph or Bayes tree.
        InvalidInputError: For everything else that GTSAM refuses.

    Example:
        >>> import gtsam
        >>> with gtsam_boundary("reading a pose"):
        ...     gtsam.Values().atPose2(gtsam.symbol("x", 3))
        Traceback (most recent call last):
        ...
        fgplan.errors.UnknownNameError: reading a pose: key x3 is not in the values
    """
    try:
        yield
    except FgplanError:
        raise
    except (RuntimeError, IndexError, ValueError) as error:
        raise translate(error, doing) from error


def translate(error: Exception, doing: str) -> FgplanError:
    """Turn one exception of GTSAM into the error of fgplan that says the same.

    Args:
        error: What GTSAM raised.
        doing: What was being done.

    Returns:
        The error to raise; not raised here.
    """
    text = str(error).strip()
    indeterminate = _INDETERMINATE.search(text)
    if indeterminate:
        name = describe_key(int(indeterminate.group(1)))
        return IllPosedBeliefError(
            f"{doing}: variable {name} is not determined by the factors, or so weakly that "
            "GTSAM's Cholesky elimination gave up; add the missing factor, or, if the problem is "
            "well posed, use fgplan.beliefs.belief.Belief, which eliminates by QR"
        )
    missing = _MISSING.search(text)
    if missing:
        return UnknownNameError(f"{doing}: key {missing.group(1)} is not in the values")
    if "map::at" in text or "not in the BayesTree" in text:
        return UnknownNameError(f"{doing}: a key that was asked for is not in the graph")
    wrong = _WRONG_TYPE.search(text)
    if wrong:
        stored = wrong.group(2).removeprefix("gtsam::GenericValue<").removesuffix(">")
        return InvalidInputError(
            f"{doing}: key {wrong.group(1)} holds a {stored}, not a {wrong.group(3)}"
        )
    return InvalidInputError(f"{doing}: GTSAM refused: {text.splitlines()[0] if text else error!r}")
