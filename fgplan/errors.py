"""Every error that fgplan raises on purpose.

One small tree. Each class is also a builtin, so that callers who know nothing of fgplan can catch
it. A message says what was expected, what came, for which robot, key or field, and the remedy.
Whatever else escapes is a bug.
"""


class FgplanError(Exception):
    """Base of all errors that fgplan raises on purpose."""


class InvalidInputError(FgplanError, ValueError):
    """A value that the caller passed is not usable (NaN, wrong shape, not positive definite)."""


class ScenarioError(FgplanError, ValueError):
    """A scenario file, map or pose graph is malformed; the message names file and field."""


class UnknownNameError(FgplanError, LookupError):
    """A key, robot, planner, sensor or function is not known; the message lists what is."""


class OptionError(InvalidInputError, UnknownNameError):
    """An option of a planner is not known or not usable; the message names planner and option."""


class IllPosedBeliefError(FgplanError, ArithmeticError):
    """A belief has no finite covariance; the message names the variable and the missing factor."""


class StaleAnnouncementError(FgplanError, ValueError):
    """An announcement was computed from a ledger that has changed since."""


class NoCandidatePathError(FgplanError, RuntimeError):
    """A robot has no path to choose from: unreachable goal or empty candidate set."""


class MissingExtraError(FgplanError, ImportError):
    """An optional package is needed; the message names the extra to install."""
