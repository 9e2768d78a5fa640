"""A loose start, weak factors between robots and ever tighter odometry: no digit is lost unseen."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import random_scene

from fgplan.evaluation.from_scratch import FromScratch
from fgplan.evaluation.incremental.evaluator import Incremental
from fgplan.models.relative_pose import RelativePoseSensor
from fgplan.paths.multi_robot import MultiRobotModel


@pytest.mark.parametrize("scale", [1.0, 1e-2, 1e-4, 1e-5, 1e-6])
def test_tight_odometry_beside_a_loose_start_is_exact(scale):
    problem, paths = random_scene(np.random.default_rng(0), robots=3, prior_sigma=1e3)
    weak = RelativePoseSensor(covariance=np.diag([1e3, 1e3, 10.0]) ** 2)
    model = MultiRobotModel(criterion=problem.multi_robot[0].criterion, sensor=weak)
    problem = replace(problem, multi_robot=(model,))
    tight = {
        robot: [replace(p, motion_covariances=p.motion_covariances * scale**2) for p in found]
        for robot, found in paths.items()
    }
    robot, *others = problem.robots
    announced = {other: tight[other][0] for other in others}
    values = []
    for evaluator in (Incremental(), FromScratch(elimination="qr")):
        state = evaluator.start(problem, robot, tight[robot])
        values.append(evaluator.evaluate(state, announced)[1])
    np.testing.assert_allclose(values[0].terms, values[1].terms, rtol=1e-9)
    if scale <= 1e-4:
        assert values[0].report.fallbacks > len(tight[robot])
