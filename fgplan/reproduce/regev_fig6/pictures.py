"""Figures 5, 6 and 7 of section 7.1 as pictures."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from fgplan.beliefs.candidate_belief import candidate_belief
from fgplan.bench.session import CONTESTANTS, plan_session
from fgplan.reproduce.regev_fig6.announcement_change import AnnouncementChange, joined_states
from fgplan.reproduce.regev_fig6.running_times import PUBLISHED, SessionTimes
from fgplan.reproduce.regev_fig6.scenario import Scenario
from fgplan.viz.candidate_paths import candidate_paths_figure
from fgplan.viz.chosen_paths import chosen_paths_figure
from fgplan.viz.ellipse import world_position_covariances
from fgplan.viz.figure import save
from fgplan.viz.impacted_paths import impacted_paths_figure
from fgplan.viz.running_times import running_time_figure


def draw_candidates(scenario: Scenario, candidates: int, folder: Path) -> Path:
    """Figure 5: candidate paths on the roadmap.

    Args:
        scenario: Starts, goals and roadmap.
        candidates: Candidates a robot; the paper shows 25.
        folder: Where to.

    Returns:
        The file.
    """
    world = scenario.with_candidates(candidates, 0)
    count = len(scenario.robots)
    figure = candidate_paths_figure(
        world.candidates,
        workspace=world.workspace,
        roadmap=world.roadmap,
        goals=scenario.goals,
        title=f"Candidate paths of {count} robots (figure 5)",
    )
    return save(figure, folder / f"figure_5_{count}_robots.png")


def draw_belief(scenario: Scenario, candidates: int, folder: Path) -> Path:
    """Figure 6b: belief along one candidate path under an announced path.

    The announced path is what the second robot has announced in the end; the candidate of the first
    is the one with the most multi-robot factors to it.

    Args:
        scenario: The two-robot scenario.
        candidates: Candidates a robot.
        folder: Where to.

    Returns:
        The file.
    """
    world = scenario.with_candidates(candidates, 0)
    robot, other = scenario.robots
    _, agreement = plan_session(world, CONTESTANTS["incremental"], scenario.digest)
    announced = agreement.paths[other]
    path = max(world.candidates[robot], key=lambda path: len(joined_states(world, path, announced)))
    joint = candidate_belief(world.problem, {robot: path, other: announced})
    marginals = joint.belief().marginal_covariances(joint.keys[robot])
    covariances = [marginals[key] for key in joint.keys[robot]]
    figure = chosen_paths_figure(
        {robot: path, other: announced},
        {robot: world_position_covariances(path.poses, covariances)},
        joined=joined_states(world, path, announced),
        workspace=world.workspace,
        roadmap=world.roadmap,
        goals=scenario.goals,
        title="Belief along one candidate path (figure 6b)",
    )
    return save(figure, folder / "figure_6b.png")


def draw_running_times(times: Sequence[SessionTimes], counts: Sequence[int], folder: Path) -> Path:
    """Figure 6a: running time against the number of candidates, published points beside.

    Args:
        times: All sessions.
        counts: Numbers of candidates.
        folder: Where to.

    Returns:
        The file.
    """
    teams = tuple(dict.fromkeys(item.robots for item in times))
    panels: dict[str, dict[str, list[list[float]]]] = {}
    for robots in teams:
        by_count = {item.candidates: item.seconds for item in times if item.robots == robots}
        names = by_count[counts[0]]
        # Rows of one length: who skipped sets at one size is shown on as many at the others.
        shown = {name: min(len(by_count[count][name]) for count in counts) for name in names}
        panels[f"{robots} robots"] = {
            name: [list(by_count[count][name].values())[: shown[name]] for count in counts]
            for name in names
            if shown[name] > 0
        }
    figure = running_time_figure(
        counts,
        panels,
        published=_published_points(teams, counts),
        title="Running time until agreement (figure 6a)",
    )
    return save(figure, folder / "figure_6a.png")


def _published_points(
    teams: Sequence[int], counts: Sequence[int]
) -> dict[str, dict[str, list[tuple[float, float]]]]:
    """The published numbers by panel and label, of the sizes that are shown."""
    points: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for (robots, count), seconds in PUBLISHED.items():
        if robots in teams and count in counts:
            panel = points.setdefault(f"{robots} robots", {})
            for name, value in seconds.items():
                panel[f"published: {name}"] = [(float(count), value)]
    return points


def draw_change(change: AnnouncementChange, goals: Mapping[str, object], folder: Path) -> Path:
    """Figure 7: impacted paths and the factors that changed.

    Args:
        change: What to show.
        goals: Names the robots in the order of the team, for the colours.
        folder: Where to.

    Returns:
        The file.
    """
    count = len(change.world.candidates[change.robot])
    figure = impacted_paths_figure(
        change.world.candidates[change.robot],
        change.impacted,
        change.before,
        change.after,
        kept=change.kept,
        removed=change.removed,
        added=change.added,
        team=tuple(goals),
        workspace=change.world.workspace,
        roadmap=change.world.roadmap,
        title=(
            f"{len(change.impacted)} of {count} candidate paths of {change.robot} are impacted "
            f"(figure 7)"
        ),
    )
    return save(figure, folder / "figure_7.png")
