"""Small scenes for the planner `intermittent`."""

import numpy as np

from fgplan.models.clamped_range import ClampedRangeSensor
from fgplan.models.hidden_state import HiddenBlock, HiddenState
from fgplan.planners.intermittent.block_model import BlockModel
from fgplan.planners.intermittent.dense_model import DenseModel
from fgplan.planners.intermittent.estimate import Estimate, Record
from fgplan.planners.intermittent.segment_problem import SegmentProblem
from fgplan.planners.intermittent.state_model import HiddenProcess, TargetObservation
from roadmaps import Workspace

WALL = [(4.0, 0.0), (4.4, 0.0), (4.4, 6.0), (4.0, 6.0)]


def room():
    """10 m x 10 m with one wall."""
    return Workspace(lower=[0, 0], upper=[10, 10], obstacles=[WALL])


def moving_targets(size, process=1e-4):
    """Three targets of so many coordinates: turning, drifting with time, and nearly still."""
    turn = np.eye(size)
    turn[:2, :2] = [[0.999, -0.02], [0.02, 0.999]]
    drifts = np.zeros((40, size))
    drifts[:, 0] = 0.01 * np.cos(0.1 * np.arange(40))
    noise = process * (np.eye(size) + 0.2)
    return HiddenState(
        (
            HiddenBlock(targets=("a",), transition=turn, process=noise),
            HiddenBlock(targets=("b",), transition=np.eye(size), drift=drifts, process=noise),
            HiddenBlock(targets=("c",), transition=0.99 * np.eye(size), process=2 * noise),
        )
    )


def estimate_of(size, time=0):
    """Where they are believed to be."""
    mean = np.array([[2.0, 2.5, 0.8], [7.0, 3.0, 1.2], [5.0, 8.0, 0.5]])[:, :size]
    spread = np.array([[0.3, 0.05, 0.02], [0.05, 0.2, 0.0], [0.02, 0.0, 0.25]])[:size, :size]
    return Estimate(time, mean.reshape(-1), np.array([spread, 0.5 * spread, 0.8 * spread]))


def block_model(robots, size=3, sensors=None, metric="largest_eigenvalue", every=1):
    """The compiled model; every robot carries the same sensors."""
    carried = (ClampedRangeSensor(),) if sensors is None else sensors
    return BlockModel(moving_targets(size), (carried,) * robots, room(), metric, every)


def dense_model(blocks, form="covariance"):
    """The same model in dense numpy."""
    parts = tuple(blocks.hidden.slice_of(name) for name in blocks.hidden.targets)
    observations = tuple(
        tuple(TargetObservation(sensor, part) for sensor in carried for part in parts)
        for carried in blocks.sensors
    )
    return DenseModel(
        HiddenProcess(blocks.hidden),
        observations,
        blocks.workspace,
        blocks.metric,
        blocks.every,
        parts,
        form,
    )


def dense_estimate(estimate):
    """Blocks as one dense covariance."""
    from scipy.linalg import block_diag

    return Estimate(estimate.time, estimate.mean, block_diag(*estimate.covariance)[None])


def segment_problem(model, starts, times, estimate=None, **kwargs):
    """A problem in the room."""
    return SegmentProblem(
        workspace=model.workspace,
        model=model,
        estimate=estimate_of(3) if estimate is None else estimate,
        starts=np.array(starts, dtype=float),
        times=np.array(times),
        **kwargs,
    )


def drawn_records(model, steps, generator, robots=2):
    """Records of robots that wander, with noisy values of whatever they see."""
    targets = len(model.hidden.targets)
    records = []
    for time in range(1, steps + 1):
        state = model.predicted_means(estimate_of(model.hidden.blocks[0].size), time)[-1]
        for robot in range(robots):
            place = generator.uniform(0.5, 9.5, 2)
            readings = []
            for c, sensor in enumerate(model.sensors[robot]):
                for i in range(targets):
                    target = state.reshape(targets, -1)[i]
                    pose = np.array([*place, 0.0])
                    if sensor.visible(pose, target, model.workspace):
                        value = sensor.predict(pose, target) + 0.05 * generator.standard_normal()
                        readings.append((c * targets + i, tuple(value.tolist())))
            records.append((robot, Record(time, tuple(place.tolist()), tuple(readings))))
    return records
