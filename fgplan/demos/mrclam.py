"""``fgplan demo mrclam --data FOLDER``: five real robots, their joint estimate, and a plan.

    log -> steps (fgplan.io.mrclam_steps) -> iSAM2 (fgplan.io.mrclam_slam) -> belief
        -> errors against Vicon (mrclam_judgement), what is wrong in the log (mrclam_truth)
        -> candidate paths from the last poses (mrclam_team) -> agreement

The values of all candidates under the agreed paths are compared with those from scratch by QR. The
data are the user's: fgplan has none of them (see fgplan.io.mrclam for where they are and what to
cite). What was found on Dataset 6 is in docs/mrclam.md.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from fgplan.closed_loop.comparison import EVERYBODY, EXECUTED, largest_difference, plan_as
from fgplan.demos.announced_views import joined_states
from fgplan.demos.arrival import know_on_arrival
from fgplan.demos.mrclam_figures import draw_figures
from fgplan.demos.mrclam_judgement import judge
from fgplan.demos.mrclam_results import MrclamRun, Planned, results_of, summary_lines
from fgplan.demos.mrclam_team import MrclamTeam, MrclamTeamOptions, prepare_mrclam_team
from fgplan.demos.mrclam_truth import log_errors
from fgplan.demos.mrclam_variants import run_variants
from fgplan.errors import InvalidInputError, MissingExtraError
from fgplan.io.command import CommandOptions, CommandOutcome
from fgplan.io.mrclam import read_mrclam
from fgplan.io.mrclam_slam import mrclam_slam
from fgplan.io.mrclam_steps import MrclamOptions, mrclam_steps
from fgplan.io.result_file import Requirement, require_at_most, require_true
from fgplan.team.options import CoordinationOptions

QUICK_S, QUICK_CANDIDATES = 120.0, 6
LARGEST_DIFFERENCE = 1e-9
CONTESTANTS = (EXECUTED, "from_scratch_fastest", "from_scratch")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of this demo."""
    parser.add_argument(
        "--data",
        metavar="FOLDER",
        help="folder of an MR.CLAM dataset with ground truth, such as MRCLAM_Dataset6",
    )
    parser.add_argument(
        "--variants",
        action="store_true",
        help="estimate again with one thing changed at a time (a few minutes)",
    )


def mrclam(options: CommandOptions) -> CommandOutcome:
    """Estimate an MR.CLAM log jointly and plan from the last poses.

    Args:
        options: ``quick`` takes the first 120 s and 6 candidates a robot; the first seed makes the
            roadmap. Arguments: ``data``, ``variants``.

    Returns:
        Errors robot by robot, what is wrong in the log, the planning session, times and memory.

    Raises:
        InvalidInputError: If no folder is given.
        ScenarioError: If the folder is not as the format says.
        NoCandidatePathError: If a goal cannot be reached.
    """
    folder = options.arguments.get("data")
    if not folder:
        raise InvalidInputError(
            "demo mrclam: expected --data FOLDER, a folder of the UTIAS MR.CLAM dataset, which is "
            "not part of fgplan; obtain it from http://asrl.utias.utoronto.ca/datasets/mrclam/ "
            "(educational use; cite Leung, Halpern, Barfoot, Liu, IJRR 30(8):969-974, 2011)"
        )
    until_s = QUICK_S if options.quick else None
    choices = MrclamTeamOptions(candidates=QUICK_CANDIDATES if options.quick else 20)
    seeds = options.seed_range(1)[:1]
    stages = _Stages(options)
    noise = MrclamOptions()
    log = read_mrclam(Path(folder))
    stages.end("read")
    steps = mrclam_steps(log, noise, until_s)
    stages.end("lags and steps")
    slam = mrclam_slam(
        steps, noise, progress=lambda done, total: options.progress(done, total, "SLAM")
    )
    stages.end("SLAM")
    belief = slam.belief()
    belief.eliminated()
    stages.end("belief")
    judgement = judge(log, steps, slam, belief)
    errors = log_errors(log)
    stages.end("compare with Vicon")
    team = prepare_mrclam_team(slam, belief, noise, choices, np.random.default_rng(seeds[0]))
    stages.end("roadmap and candidates")
    planned = _plan(team, stages)
    peak_mb = peak_memory_mb()
    variants = run_variants(log, until_s, options.progress) if options.arguments["variants"] else ()
    stages.end("variants")
    notes: tuple[str, ...] = ()
    figures: tuple[Path, ...] = ()
    if options.out is not None:
        try:
            figures = draw_figures(options.out, log, steps, slam, judgement, planned)
        except MissingExtraError as error:
            notes = (f"no figures: {error}",)
    stages.end("figures")
    run = MrclamRun(
        log=log,
        steps=steps,
        options=noise,
        log_errors=errors,
        judgement=judgement,
        planned=planned,
        variants=variants,
        factors=belief.graph.size(),
        seconds=stages.seconds,
        peak_memory_mb=peak_mb,
    )
    return CommandOutcome(
        results=results_of(run),
        requirements=_requirements(run),
        seeds=seeds,
        summary=(*summary_lines(run, choices), *notes),
        figures=figures,
    )


class _Stages:
    """Seconds by stage; tells progress when one ends."""

    def __init__(self, options: CommandOptions) -> None:
        self.seconds: dict[str, float] = {}
        self._progress = options.progress
        self._last = time.perf_counter()

    def end(self, stage: str) -> None:
        """Note the seconds since the last stage ended."""
        now = time.perf_counter()
        self.seconds[stage] = now - self._last
        self._last = now
        self._progress(len(self.seconds), 0, stage)


def _plan(team: MrclamTeam, stages: _Stages) -> Planned:
    """Let the team agree, by every contestant, and compare all values with QR's."""
    digest = team.problem.prior.digest()
    found = {
        name: plan_as(
            EVERYBODY[name], team.problem, team.candidates, CoordinationOptions(), digest, {}
        )
        for name in CONTESTANTS
    }
    stages.end("plan, also from scratch")
    agreement = found[EXECUTED][1]
    difference = largest_difference(team.problem, team.candidates, agreement.paths, {})
    stages.end("compare with QR")
    return Planned(
        team=team,
        agreement=agreement,
        runs={name: record for name, (record, _) in found.items()},
        arrival=know_on_arrival(team.problem, agreement.paths),
        joined=joined_states(team.problem, agreement.paths),
        max_rel_diff=difference,
    )


def _requirements(run: MrclamRun) -> tuple[Requirement, ...]:
    """What the demo must show."""
    of_robots = tuple(
        require_at_most(f"ate_m of {errors.robot}", errors.ate_m, errors.required_m)
        for errors in run.judgement.robots
    )
    return (
        *of_robots,
        require_true("agreed", run.planned.agreement.agreed),
        require_true("same_choices", run.planned.same_choices),
        require_at_most("max_rel_diff", run.planned.max_rel_diff, LARGEST_DIFFERENCE),
    )


def peak_memory_mb() -> float:
    """Largest resident memory of this process so far, megabytes; NaN where it cannot be known."""
    try:
        import resource  # not on Windows
    except ImportError:
        return float("nan")
    size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(size) / (1e6 if sys.platform == "darwin" else 1e3 / 1.024)
