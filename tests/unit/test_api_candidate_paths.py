"""Candidate paths from paths over roadmap vertices: what a user without a mission calls."""

import networkx as nx
import numpy as np
import pytest

import fgplan
from fgplan.errors import InvalidInputError
from fgplan.models.motion import MotionModel
from fgplan.models.range_bearing import BearingRangeSensor, RangeSensor
from fgplan.paths.path_making import make_candidate_paths
from roadmaps import ParameterError, VertexPath, Workspace, find_candidate_paths

MOTION = MotionModel(sigmas=[0.1, 0.1, 0.01], speed_m_per_s=2.0)
START = np.array([1.0, 2.0, 0.7])
WAY = VertexPath((4, 7, 9), [[1.0, 2.0], [4.0, 2.0], [4.0, 6.0]], 7.0)
WALL = [(2.0, 3.0), (5.0, 3.0), (5.0, 3.5), (2.0, 3.5)]


def test_poses_times_and_vertices_follow_the_way():
    [path] = make_candidate_paths("ann", START, [WAY], MOTION, spacing_m=2.0)
    assert path.robot == "ann"
    np.testing.assert_array_equal(path.poses[0], START)
    np.testing.assert_allclose(
        path.poses[1:],
        [[2.5, 2.0, 0.0], [4.0, 2.0, 0.0], [4.0, 4.0, np.pi / 2], [4.0, 6.0, np.pi / 2]],
        rtol=1e-15,
    )
    np.testing.assert_allclose(path.times_s, [0.0, 0.75, 1.5, 2.5, 3.5], rtol=1e-15)
    assert path.vertices == (4, -1, 7, -1, 9)
    assert path.length_m == 7.0
    np.testing.assert_array_equal(path.motion_covariances, MOTION.covariances(path.poses))
    assert path.observations == ()


def test_robot_in_space_stays_level_at_its_height():
    start = np.eye(4)
    start[:3, 3] = [1.0, 2.0, 5.0]
    motion = MotionModel(sigmas=np.full(6, 0.1))
    [path] = make_candidate_paths("drone", start, [WAY], motion)
    assert (path.poses[:, 2, 3] == 5.0).all()
    np.testing.assert_allclose(path.poses[2, :3, 0], [0.0, 1.0, 0.0], atol=1e-15)


def test_sensor_without_limit_sees_every_landmark_unless_something_blocks_it():
    radar = RangeSensor(sigma_m=0.2)
    landmarks = {100: [4.5, 2.5], 101: [4.0, 8.0]}
    given = {"sensors": {"radar": radar}, "landmarks": landmarks}
    [path] = make_candidate_paths("ann", START, [WAY], MOTION, **given)
    assert [(seen.step, seen.landmark, seen.sensor) for seen in path.observations] == [
        (step, key, "radar") for step in (1, 2) for key in (100, 101)
    ]
    assert path.observations[0].covariance == pytest.approx(np.array([[0.04]]), rel=1e-15)
    hall = Workspace(lower=[0, 0], upper=[10, 10], obstacles=[WALL])
    [path] = make_candidate_paths("ann", START, [WAY], MOTION, workspace=hall, **given)
    assert [(seen.step, seen.landmark) for seen in path.observations] == [(1, 100), (2, 101)]
    near = BearingRangeSensor(bearing_sigma_rad=0.1, range_sigma_m=0.1, max_range_m=1.0)
    [path] = make_candidate_paths(
        "ann", START, [WAY], MOTION, sensors={"near": near}, landmarks=landmarks
    )
    assert [(seen.step, seen.landmark) for seen in path.observations] == [(1, 100)]


def test_no_path_and_no_landmark_are_no_error():
    sensors = {"radar": RangeSensor(sigma_m=0.2)}
    assert make_candidate_paths("ann", START, (), MOTION, sensors=sensors, landmarks={}) == ()
    assert (
        make_candidate_paths("ann", START, (), MOTION, sensors=sensors, landmarks={1: [0, 0]}) == ()
    )
    [path] = make_candidate_paths("ann", START, [WAY], MOTION, sensors=sensors, landmarks={})
    assert path.observations == ()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"vertex_paths": WAY}, r"'ann': expected a sequence of VertexPath, got VertexPath"),
        ({"vertex_paths": [[[1.0, 2.0]]]}, "expected a sequence of VertexPath"),
        ({"motion": MotionModel(sigmas=np.full(6, 0.1))}, "motion model of 3 sigmas.*got 6"),
        ({"spacing_m": 0.0}, "spacing_m: expected a number above zero"),
        ({"start": [4.0, 2.0, 0.0]}, r"current position \[4.0, 2.0\], got path 0 from"),
        ({"start": [1.0, 2.0]}, "robot 'ann': start"),
        ({"sensors": {}}, "got no landmarks"),
        ({"landmarks": {}}, "got no sensors"),
        (
            {"sensors": {"r": RangeSensor(sigma_m=0.1)}, "landmarks": {3: [np.nan, 0.0]}},
            "landmark 3: expected finite",
        ),
        ({"vertex_paths": [VertexPath((4,), [[1.0, 2.0]], 0.0)]}, "path 0 starts at its goal"),
        (
            {"vertex_paths": [VertexPath((0, 1), [[1.0, 2.0, 3.0], [1.0, 2.0, 4.0]], 1.0)]},
            "paths in the plane",
        ),
    ],
)
def test_what_does_not_fit_is_refused_by_robot(changes, words):
    given = {"start": START, "vertex_paths": [WAY], "motion": MOTION} | changes
    with pytest.raises(InvalidInputError, match=words):
        make_candidate_paths("ann", **given)


def test_positions_in_place_of_vertices_are_refused():
    graph = nx.Graph()
    graph.add_node(0, position=np.zeros(2))
    graph.add_node(1, position=np.ones(2))
    graph.add_edge(0, 1, length=2.0**0.5)
    with pytest.raises(ParameterError, match=r"start: expected the id of a vertex, got \[0.0, 0.0"):
        find_candidate_paths(graph, [0.0, 0.0], 1, 3)
    with pytest.raises(ParameterError, match=r"goal: .*got array.*required_positions"):
        find_candidate_paths(graph, 0, np.ones(2), 3)


def test_public_name():
    assert fgplan.make_candidate_paths is make_candidate_paths
