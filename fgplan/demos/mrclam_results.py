"""What the MR.CLAM demo says: lines to print, and the same as results for the result file."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from fgplan.closed_loop.records import EvaluatorRecord
from fgplan.demos.arrival import Arrival
from fgplan.demos.mrclam_judgement import OUTLIER_WEIGHT, Judgement, used_measurements
from fgplan.demos.mrclam_team import MrclamTeam, MrclamTeamOptions
from fgplan.demos.mrclam_truth import MISREAD_RAD, WRONG_RANGE_M, LogErrors
from fgplan.demos.mrclam_variants import Variant
from fgplan.io.mrclam import MrclamLog
from fgplan.io.mrclam_steps import CAMERA, CAMERA_ROBOT, MrclamOptions, MrclamSteps
from fgplan.io.run_record import Pairs
from fgplan.team.agreement import Agreement


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Planned:
    """The planning session from the last poses.

    Attributes:
        team: Problem and candidates.
        agreement: How the team came to agree.
        runs: By evaluator, the same session planned by it; the first is ours.
        arrival: What the robots will know.
        joined: States that multi-robot factors join along the chosen paths.
        max_rel_diff: Largest relative difference of any term of any candidate from QR's.
    """

    team: MrclamTeam = field(repr=False)
    agreement: Agreement = field(repr=False)
    runs: Mapping[str, EvaluatorRecord]
    arrival: Arrival
    joined: Pairs = field(repr=False)
    max_rel_diff: float

    @property
    def same_choices(self) -> bool:
        """Whether every evaluator ended with the same paths."""
        chosen = [dict(run.chosen) for run in self.runs.values()]
        return all(other == chosen[0] for other in chosen)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MrclamRun:
    """Everything that the demo found.

    Attributes:
        log: As read.
        steps: What SLAM was given.
        options: Noise and interval.
        log_errors: What is wrong in the log, by subject.
        judgement: Errors of the estimate.
        planned: The planning session.
        variants: The estimate with one thing changed at a time; empty unless asked for.
        factors: Factors of the joint belief.
        seconds: By stage.
        peak_memory_mb: Of the whole process, when the planning session had ended.
    """

    log: MrclamLog = field(repr=False)
    steps: MrclamSteps = field(repr=False)
    options: MrclamOptions
    log_errors: Mapping[int, LogErrors]
    judgement: Judgement
    planned: Planned
    variants: tuple[Variant, ...]
    factors: int
    seconds: Mapping[str, float]
    peak_memory_mb: float


def results_of(run: MrclamRun) -> dict[str, Any]:
    """Everything that was found, as plain data."""
    steps, judgement, planned = run.steps, run.judgement, run.planned
    agreement = planned.agreement
    ours, *others = planned.runs.values()
    return {
        "robots": [
            {
                **asdict(errors),
                "odometry_lag_s": steps.lags_s[errors.robot],
                "lag_pairs": steps.lag_pairs[errors.robot],
                "longest_odometry_gap_s": steps.longest_gap_s[errors.robot],
            }
            for errors in judgement.robots
        ],
        "together_m": judgement.together_m,
        "landmarks_m": judgement.landmarks_m,
        "landmarks_aligned_m": judgement.landmarks_aligned_m,
        "slam": {
            "ticks": len(steps.times_s),
            "interval_s": run.options.interval_s,
            "poses": sum(errors.poses for errors in judgement.robots),
            "landmarks": len(planned.team.problem.prior.landmarks()),
            "measurements": used_measurements(steps),
            "factors": run.factors,
            "start_sigmas": run.options.start_sigmas,
        },
        "outliers": {
            "left_out": {
                key: steps.counts[key] for key in ("unknown_barcode", "own_barcode", "outside")
            },
            f"weight_below_{OUTLIER_WEIGHT:g}": judgement.outliers,
            "against_truth": {
                f"robot{subject}": asdict(errors) for subject, errors in run.log_errors.items()
            },
        },
        "planning": {
            "candidates": {robot: len(paths) for robot, paths in planned.team.candidates.items()},
            "goals": planned.team.goals,
            "agreed": agreement.agreed,
            "turns": agreement.turns,
            "objective": agreement.values,
            "chosen": agreement.chosen,
            "multi_robot_factors": len(planned.joined),
            "max_rel_diff": planned.max_rel_diff,
            "same_choices": planned.same_choices,
            "seconds": {name: record.seconds for name, record in planned.runs.items()},
            "ratio": {
                name: record.seconds / ours.seconds
                for name, record in zip(list(planned.runs)[1:], others, strict=True)
            },
            "sigma_now_m": planned.arrival.now_m,
            "sigma_on_arrival_m": planned.arrival.with_team_m,
            "sigma_without_team_m": planned.arrival.without_team_m,
        },
        "variants": [asdict(variant) for variant in run.variants],
        "seconds": dict(run.seconds),
        "peak_memory_mb": run.peak_memory_mb,
    }


def summary_lines(run: MrclamRun, choices: MrclamTeamOptions) -> tuple[str, ...]:
    """What was found, in words."""
    return (
        *_log_lines(run),
        *_estimate_lines(run),
        *_planning_lines(run.planned, choices),
        *_variant_lines(run),
        f"seconds: {sum(run.seconds.values()):.1f} in all: "
        + ", ".join(f"{stage} {seconds:.1f}" for stage, seconds in run.seconds.items())
        + f"; peak memory {run.peak_memory_mb:.0f} MB",
    )


def _log_lines(run: MrclamRun) -> list[str]:
    """What the log is and what is wrong in it."""
    steps, counts = run.steps, run.steps.counts
    used = used_measurements(steps)
    lags = ", ".join(f"{lag:.3f}" for lag in steps.lags_s.values())
    found = run.log_errors.values()
    misread = sum(errors.misread for errors in found)
    confirmed = sum(errors.misread_confirmed for errors in found)
    late = ", ".join(f"{errors.camera_late_s:.3f}" for errors in found)
    x, _, heading = run.options.start_sigmas
    return [
        f"MR.CLAM {run.log.folder.name}: {len(steps.robots)} robots, "
        f"{steps.times_s[-1] - steps.times_s[0]:.0f} s, a pose each every "
        f"{run.options.interval_s:g} s; {used[CAMERA]} measurements of landmarks, "
        f"{used[CAMERA_ROBOT]} of robots; {counts['outside']} outside of that time",
        f"  given from Vicon: the first pose of each robot, {x:g} m and {heading:g} rad; landmarks "
        "are unknown beforehand",
        f"  odometry takes effect late, by the robots' own sightings: {lags} s; "
        f"cameras' stamps are late against Vicon by {late} s (not corrected)",
        f"  wrong in the log: {counts['unknown_barcode']} barcodes of nobody, "
        f"{counts['own_barcode']} the robot's own (both left out); against Vicon {misread} taken "
        f"for another's (bearing off by over {MISREAD_RAD:g} rad; {confirmed} of them fit another "
        f"subject), {sum(e.ranges_short for e in found)} ranges too short and "
        f"{sum(e.ranges_long for e in found)} too long by over {WRONG_RANGE_M:g} m (all kept: "
        "Huber's loss)",
    ]


def _estimate_lines(run: MrclamRun) -> list[str]:
    """Errors robot by robot."""
    judgement = run.judgement
    lines = ["position error (RMSE against Vicon, aligned at the first pose only):"]
    lines += [
        f"  {e.robot}: {e.ate_m:.3f} m, odometry alone {e.odometry_ate_m:.3f} m, required "
        f"{e.required_m:.3f} m; largest {e.largest_m:.2f} m; its camera saw nothing for up to "
        f"{e.longest_without_s:.0f} s; {e.measurements} measurements, seen {e.seen_by_others} times"
        for e in judgement.robots
    ]
    own = np.sqrt(np.mean([e.ate_own_alignment_m**2 for e in judgement.robots]))
    lines.append(
        f"  of which under one rigid motion for all robots {judgement.together_m:.3f} m remain, "
        f"under one a robot {own:.3f} m; {len(run.steps.landmarks)} landmarks: "
        f"{judgement.landmarks_m:.3f} m, under their own rigid motion "
        f"{judgement.landmarks_aligned_m:.3f} m"
    )
    weak = ", ".join(f"{count} of {sensor}" for sensor, count in judgement.outliers.items())
    lines.append(f"  weight below {OUTLIER_WEIGHT:g} by Huber's loss: {weak}")
    return lines


def _planning_lines(planned: Planned, choices: MrclamTeamOptions) -> list[str]:
    """The planning session."""
    agreement, arrival = planned.agreement, planned.arrival
    how = "agreed" if agreement.agreed else "NOT agreed"
    values = " -> ".join(f"{value:.5f}" for value in agreement.values)
    ours, *others = planned.runs
    times = ", ".join(
        f"{name} {planned.runs[name].seconds:.1f} s "
        f"({planned.runs[name].seconds / planned.runs[ours].seconds:.0f} x)"
        for name in others
    )
    lines = [
        f"planning from the last poses: {how} after {agreement.turns} turns, objective {values} "
        f"({choices.path_weight:g} a metre + {choices.uncertainty_weight:g} a square metre of "
        f"position variance); {len(planned.joined)} factors between robots on the chosen paths",
        f"  {planned.runs[ours].seconds:.2f} s; from scratch: {times}; same choices: "
        f"{'yes' if planned.same_choices else 'NO'}; largest relative difference of any term of "
        f"any candidate from QR: {planned.max_rel_diff:.1e}",
    ]
    for robot, path in agreement.paths.items():
        lines.append(
            f"  {robot}: candidate {agreement.chosen[robot]} of "
            f"{len(planned.team.candidates[robot])}, {path.length_m:.1f} m; position sigma on "
            f"arrival {arrival.with_team_m[robot]:.3f} m, without the team's factors "
            f"{arrival.without_team_m[robot]:.3f} m (now {arrival.now_m[robot]:.3f} m)"
        )
    return lines


def _variant_lines(run: MrclamRun) -> Sequence[str]:
    """Errors with one thing changed."""
    if not run.variants:
        return ()
    usual = {errors.robot: errors.ate_m for errors in run.judgement.robots}
    cases = [("as above", usual), *((one.name, one.ate_m) for one in run.variants)]
    width = max(len(name) for name, _ in cases)
    return (
        "with one thing changed, RMSE by robot (m):",
        *(
            f"  {name:{width}s}  " + "  ".join(f"{error:.3f}" for error in errors.values())
            for name, errors in cases
        ),
    )
