"""``[team.network]`` of a scenario: how robots that are processes reach each other.

File names count from the scenario's folder. They are never copied into a run folder: some are
private keys.
"""

from pathlib import Path

from fgplan.io.place import Place
from fgplan.io.scenario import Scenario
from fgplan.team.network_options import NetworkOptions, read_network


def make_network(scenario: Scenario, path: Path) -> NetworkOptions:
    """The network of a scenario.

    Args:
        scenario: The scenario.
        path: The file it was read from.

    Returns:
        The options; the loopback where the scenario says nothing.

    Raises:
        ScenarioError: If a field is not known, or has a value that is not usable.
    """
    with Place(path).at("team.network").checking():
        return read_network(scenario.team.network, path.parent)
