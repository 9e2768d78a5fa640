"""The figures of a run folder, drawn from its records: after a run, again by ``plot``."""

from pathlib import Path

from fgplan.cli.loop_command import draw_loop_folder
from fgplan.io.loop_folder import LOOP
from fgplan.io.run_folder import read_record
from fgplan.viz.candidate_paths import candidate_paths_figure
from fgplan.viz.chosen_paths import chosen_paths_figure
from fgplan.viz.figure import save
from fgplan.viz.histories import objective_history_figure
from fgplan.viz.impacted_paths import impacted_paths_figure


def draw_run_figures(folder: Path) -> tuple[Path, ...]:
    """Draw the figures of a run folder; those of a closed loop where it holds one.

    Args:
        folder: A folder with a record.

    Returns:
        The figures' files.

    Raises:
        InvalidInputError: If the folder has no record.
        MissingExtraError: If matplotlib is not installed.
    """
    if (folder / LOOP).exists():
        return draw_loop_folder(folder)
    record = read_record(folder)
    workspace = record.workspace.workspace()
    team = tuple(record.goals)
    figures = {}
    if any(len(paths) > 1 for paths in record.candidates.values()):
        figures["candidate_paths"] = candidate_paths_figure(
            record.candidates, workspace=workspace, goals=record.goals
        )
    if record.chosen:
        figures["chosen_paths"] = chosen_paths_figure(
            record.chosen,
            record.covariances,
            joined=record.joined,
            targets=record.targets,
            target_covariances=record.target_covariances,
            landmarks=record.landmarks or None,
            workspace=workspace,
            # Whoever gathers information goes where that is, not to a goal.
            goals={robot: record.goals[robot] for robot in record.chosen if not record.targets},
            team=team,
        )
    if len(record.values) > 1:
        figures["objective"] = objective_history_figure(
            record.values, record.announced_by, team=team
        )
    for number, impact in enumerate(record.impacts, start=1):
        figures[f"impacted_paths_{number}"] = impacted_paths_figure(
            record.candidates[impact.robot],
            impact.impacted,
            impact.before,
            impact.after,
            kept=impact.kept,
            removed=impact.removed,
            added=impact.added,
            team=team,
            workspace=workspace,
        )
    return tuple(save(figure, folder / f"{name}.png") for name, figure in figures.items())
