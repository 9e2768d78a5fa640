"""A planner of your own: each robot chooses once, in the order of the team, and never again.

A planner is any class with a `name` and `plan(mission, generator, progress)` that returns a
`fgplan.Plan`. A scenario names it as "module:object"; the scenario's folder is searched first.
"""

import dataclasses

import numpy as np

import fgplan


class GreedyPlanner:
    """Robot 1 takes its best path, robot 2 its best given that, and so on."""

    name = "greedy_planner:GreedyPlanner"
    option_tables = (fgplan.CandidateOptions,)  # what `fgplan fields` says of it

    def plan(self, mission, generator: np.random.Generator, progress=None) -> fgplan.Plan:
        """Plan for every robot; options come from the scenario's table of this planner."""
        options = fgplan.read_options(fgplan.CandidateOptions, mission.options, self.name)
        sets = fgplan.candidate_sets(mission, options, generator)
        evaluator = fgplan.Incremental()
        announced, chosen, value = {}, {}, np.nan
        for robot in sets.problem.robots:
            if progress is not None:
                progress(len(announced), len(mission.robots), "robots")
            state = evaluator.start(sets.problem, robot, sets.candidates[robot])
            _, evaluations = evaluator.evaluate(state, announced)
            chosen[robot] = evaluations.best
            announced[robot] = sets.candidates[robot][evaluations.best]
            value = float(evaluations.values[evaluations.best])
        known = fgplan.pose_covariances(sets.problem, announced)
        return fgplan.Plan(
            planner=self.name,
            mission=mission.name,
            scenario_digest=mission.digest,
            seed=mission.seed,
            robots=fgplan.robot_plans(mission, sets, announced, chosen, known),
            objective=(fgplan.ObjectiveValue(0, "", value),),
            options=dataclasses.asdict(options),
        )
