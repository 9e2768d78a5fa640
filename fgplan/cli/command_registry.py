"""Which demos, benches and reproductions there are, each as "module:function".

The function takes ``fgplan.io.command.CommandOptions`` and returns a ``CommandOutcome``; its module
may define ``add_arguments(parser)``. Nothing is imported before it is asked for.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RegisteredCommand:
    """One demo, bench or reproduction.

    Attributes:
        target: "module:function".
        summary: One line for ``--help``.
    """

    target: str
    summary: str


DEMOS: dict[str, RegisteredCommand] = {
    "victoria-park": RegisteredCommand(
        "fgplan.demos.victoria_park:victoria_park",
        "four robots plan over the real Victoria Park log that is inside the GTSAM wheel",
    ),
}

BENCHES: dict[str, RegisteredCommand] = {
    "roadmap": RegisteredCommand(
        "fgplan.bench.roadmap:run", "a PRM among polygons, with shapely and without"
    ),
    "impacted": RegisteredCommand(
        "fgplan.bench.impacted:run", "whole planning sessions, evaluators side by side"
    ),
    "history": RegisteredCommand(
        "fgplan.bench.history:run", "milliseconds a candidate when the past grows"
    ),
}

REPRODUCTIONS: dict[str, RegisteredCommand] = {
    "regev-fig6": RegisteredCommand(
        "fgplan.reproduce.regev_fig6.command:run",
        "running times and figures 5, 6 and 7 of Regev and Indelman 2017",
    ),
}

REGISTRY: dict[str, dict[str, RegisteredCommand]] = {
    "demo": DEMOS,
    "bench": BENCHES,
    "reproduce": REPRODUCTIONS,
}
