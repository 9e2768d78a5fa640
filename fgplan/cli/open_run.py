"""What a command plans: a scenario or a log, read and checked, and the run folder made ready."""

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fgplan.cli.run_past import LogRun, copy_log_run, open_log_run
from fgplan.errors import (
    FgplanError,
    MissingExtraError,
    NoCandidatePathError,
    OptionError,
    ScenarioError,
)
from fgplan.io.mission_file import make_mission
from fgplan.io.named_files import named_files
from fgplan.io.past_files import remove_past_files
from fgplan.io.past_formats import is_team_past
from fgplan.io.place import Place
from fgplan.io.plan_file import PLANS
from fgplan.io.prior_table import Prior, make_prior
from fgplan.io.run_folder import begin_run
from fgplan.io.scenario import Scenario
from fgplan.io.scenario_file import read_scenario
from fgplan.io.user_object import is_object_name, load_object
from fgplan.planners.mission import Mission
from fgplan.planners.planner import AbstractPlanner, CheckedPlanner
from fgplan.planners.program import DistributedPlanner
from fgplan.planners.registry import find_planner
from roadmaps import RoadmapError

QUICK_CANDIDATES = 8
"""Candidate paths a robot with ``--quick``, at most."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OpenRun:
    """A scenario or log, read and checked.

    Attributes:
        path: The file or folder.
        log: The log, where it is one.
        scenario: The scenario.
        planner: The planner that it names.
        prior: The belief at planning time.
        mission: The mission.
    """

    path: Path
    log: LogRun | None
    scenario: Scenario
    planner: AbstractPlanner
    prior: Prior
    mission: Mission


def open_run(path: Path, *, quick: bool = False) -> OpenRun:
    """Read a scenario or log.

    Args:
        path: The file or folder.
        quick: Whether robots get fewer candidate paths.

    Returns:
        What to plan.

    Raises:
        ScenarioError: If the scenario or log is wrong.
    """
    log = open_log_run(path) if is_team_past(path) else None
    scenario = read_scenario(path) if log is None else log.scenario
    planner = _find_planner(scenario, Place(path))
    prior = make_prior(scenario, Place(path), None if log is None else log.estimate)
    mission = make_mission(scenario, path, prior)
    if isinstance(planner, CheckedPlanner):
        with _naming_scenario(scenario, Place(path)):
            planner.check_options(mission.options)
    asked = mission.options.get("candidates")
    if quick and isinstance(asked, int) and asked > QUICK_CANDIDATES:
        fewer = {**mission.options, "candidates": QUICK_CANDIDATES}
        mission = dataclasses.replace(mission, options=fewer)
    return OpenRun(
        path=path, log=log, scenario=scenario, planner=planner, prior=prior, mission=mission
    )


def distributed_planner(run: OpenRun) -> DistributedPlanner:
    """The planner of a scenario, as one whose robots can run by themselves.

    Args:
        run: The scenario.

    Returns:
        The planner.

    Raises:
        ScenarioError: If it is not one.
    """
    if isinstance(run.planner, DistributedPlanner):
        return run.planner
    raise (
        Place(run.path)
        .at("planner.name")
        .error(
            f"expected a planner whose robots talk through messages (it has program and "
            f"team_plan), got {run.scenario.planner_name!r}; fgplan run plans in one process"
        )
    )


def begin_folder(run: OpenRun, folder: Path) -> None:
    """Put the scenario and what it names into the run folder; what an earlier run left goes.

    Args:
        run: What is run.
        folder: The run folder.

    Raises:
        InvalidInputError: If it cannot be written.
    """
    path, log = run.path, run.log
    named = () if log is not None else named_files(run.scenario, path)
    sources = [path.parent / name for name in named] if log is None else log.estimate.past.files
    remove_past_files(folder, sources)
    (folder / PLANS).unlink(missing_ok=True)
    if log is None:
        begin_run(path, folder, named)
        return
    copy_log_run(log, folder)


@contextmanager
def planning(run: OpenRun) -> Iterator[None]:
    """Name the scenario in whatever a planner refuses.

    Args:
        run: What is planned.
    """
    with _naming_scenario(run.scenario, Place(run.path)):
        yield


@contextmanager
def _naming_scenario(scenario: Scenario, place: Place) -> Iterator[None]:
    """Name the file, and of a refused option its table."""
    try:
        yield
    except NoCandidatePathError as error:
        raise NoCandidatePathError(f"{place.file}: {error}") from error
    except OptionError as error:
        raise place.at(f"planner.{scenario.planner_name}").error(str(error)) from error
    except MissingExtraError:
        raise
    except (FgplanError, RoadmapError) as error:
        raise ScenarioError(f"{place.file}: {error}") from error


def _find_planner(scenario: Scenario, place: Place) -> AbstractPlanner:
    """The planner that the scenario names; a user's own may lie beside the scenario."""
    for option, value in scenario.planner_options.items():
        if isinstance(value, str) and is_object_name(value):
            load_object(value, place.at(f"planner.{scenario.planner_name}.{option}"))
    where = place.at("planner.name")
    if is_object_name(scenario.planner_name):
        load_object(scenario.planner_name, where)
    with where.checking():
        return find_planner(scenario.planner_name)
