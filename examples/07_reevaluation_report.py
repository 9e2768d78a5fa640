"""What an announcement changes: evaluate, let another robot announce, re-evaluate, read the report.

Ann evaluates twenty candidate paths given what Bob and Cid have announced. When one of the two
announces another path, only those of her paths are evaluated again whose belief the change
reaches; the others keep their own terms and share one constant of the team's. The values are those
of from scratch. (Times: `fgplan bench impacted`, which compiles first and uses one BLAS thread.)
"""

from pathlib import Path

import numpy as np

import fgplan

SCENARIO = Path(__file__).parent / "scenarios" / "yard.toml"

mission = fgplan.load_mission(SCENARIO)
sets = fgplan.candidate_sets(mission, fgplan.CandidateOptions(candidates=20, vertices=300))
problem, (ann, bob, cid) = sets.problem, sets.candidates.values()

# The evaluator's state is a value: it goes in, and comes back with what is worth keeping.
incremental, from_scratch = fgplan.Incremental(), fgplan.FromScratch()
state = incremental.start(problem, "ann", ann)
scratch_state = from_scratch.start(problem, "ann", ann)

turns = (
    ("Bob and Cid announce their shortest paths", {"bob": bob[0], "cid": cid[0]}),
    ("Bob announces candidate 5, which passes elsewhere", {"bob": bob[5], "cid": cid[0]}),
    ("Cid announces candidate 5, which meets nobody", {"bob": bob[5], "cid": cid[5]}),
    ("Cid announces candidate 4, which meets Bob", {"bob": bob[5], "cid": cid[4]}),
    ("Bob leaves the team", {"cid": cid[4]}),
)
solves = solves_from_scratch = 0
for what, announced in turns:
    state, evaluations = incremental.evaluate(state, announced)
    scratch_state, expected = from_scratch.evaluate(scratch_state, announced)
    report = evaluations.report
    difference = np.abs(evaluations.values / expected.values - 1.0).max()
    solves += report.solves
    solves_from_scratch += expected.report.solves
    print(f"{what}:")
    print(
        f"  factors with Ann's paths: {report.factors_added} added, {report.factors_removed} "
        f"removed, {report.factors_kept} kept, at {len(report.involved_vertices)} vertices"
    )
    print(
        f"  {len(report.impacted)} paths impacted, {len(report.untouched)} untouched; "
        f"{report.messages_rebuilt} messages rebuilt, {report.messages_reused} reused; "
        f"{report.solves} solves"
    )
    print(
        f"  best: candidate {evaluations.best} (from scratch {expected.best}), objective "
        f"{evaluations.values[evaluations.best]:.4f}; values differ by {difference:.0e} at most"
    )
print(f"in all {solves} solves, from scratch {solves_from_scratch}")
