"""Figures of a closed loop: what is in each is counted against the records."""

from dataclasses import replace

import numpy as np
import pytest
from loop_histories import LANDMARK_KEYS, ROBOTS, make_history

from fgplan.errors import InvalidInputError
from fgplan.viz.ellipse import world_position_covariances
from fgplan.viz.loop_figures import (
    draw_loop_figures,
    final_slam_figure,
    loop_covariance_figure,
    loop_running_times_figure,
    session_candidates_figure,
    session_chosen_figure,
    session_slam_figure,
)
from fgplan.viz.loop_tracks import (
    first_seen,
    loop_extent,
    loop_tracks,
    pose_at,
    result_of_session,
    sightings,
    true_landmarks,
)
from fgplan.viz.palette import NAMED_COLORS, UNCHANGED
from fgplan.viz.slam_result import slam_result_figure
from roadmaps import Workspace

matplotlib = pytest.importorskip("matplotlib")
WORLD = Workspace(lower=[0, 0], upper=[2000, 2500], obstacles=[[(900, 40), (990, 40), (990, 99)]])
HISTORY = make_history()
SPATIAL = make_history(spatial=True)
RUNNING = make_history(finished=False)


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def segments(axes, color):
    rgb = matplotlib.colors.to_rgb(color)
    return sum(
        len(one.get_segments())
        for one in axes.collections
        if isinstance(one, matplotlib.collections.LineCollection)
        and np.allclose(one.get_colors()[0][:3], rgb)
    )


def lines(axes, color):
    return [line for line in axes.lines if line.get_color() == color]


def markers(axes, marker):
    return sum(len(line.get_xdata()) for line in axes.lines if line.get_marker() == marker)


def limits(axes):
    return axes.get_xlim(), axes.get_ylim()


def test_tracks():
    tracks = loop_tracks(HISTORY)
    assert tracks.steps.tolist() == list(range(43))
    assert tracks.times_s[-1] == 210.0
    record = HISTORY.steps[17]
    for robot in ROBOTS:
        np.testing.assert_array_equal(tracks.positions[robot][17], record.estimates[robot][:2])
        np.testing.assert_array_equal(tracks.true_positions[robot][17], record.truth[robot][:2])
        block = record.covariances[robot][:2, :2]
        heading = record.estimates[robot][2]
        turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
        np.testing.assert_allclose(tracks.covariances[robot][17], turn @ block @ turn.T, rtol=1e-12)
        assert tracks.traces[robot][17] == pytest.approx(np.trace(block), rel=1e-12)
    with pytest.raises(ValueError, match="read-only"):
        tracks.positions["red"][0] = 0.0


def test_tracks_in_space_are_those_of_the_plane():
    plane, space = loop_tracks(HISTORY), loop_tracks(SPATIAL)
    for robot in ROBOTS:
        np.testing.assert_array_equal(space.positions[robot], plane.positions[robot])
        np.testing.assert_allclose(space.covariances[robot], plane.covariances[robot], atol=1e-12)
        # Height adds 1e-6 to the trace, see the builder.
        np.testing.assert_allclose(space.traces[robot], plane.traces[robot] + 1e-6, rtol=1e-12)
    np.testing.assert_array_equal(true_landmarks(SPATIAL), true_landmarks(HISTORY))


def test_first_seen_and_sightings():
    seen = first_seen(HISTORY)
    assert list(seen.values()) == sorted(seen.values())
    assert set(seen) == set(HISTORY.final.landmarks)
    key, step = list(seen.items())[10]
    for record in HISTORY.steps[: step + 1]:
        assert (key in [one.target for one in record.measurements]) == (record.step == step)
    drawn = sightings(HISTORY, HISTORY.final, 13, 26)
    measured = [one for record in HISTORY.steps[13:27] for one in record.measurements]
    for robot in ROBOTS:
        mine = [one for one in measured if one.robot == robot]
        assert drawn[robot].shape == (len(mine), 2, 2)
        ends = np.array([HISTORY.final.landmarks[one.target] for one in mine])
        np.testing.assert_array_equal(drawn[robot][:, 1], ends)
    first = next(record for record in HISTORY.steps[13:27] if record.measurements)
    robot = first.measurements[0].robot
    np.testing.assert_array_equal(drawn[robot][0, 0], first.estimates[robot][:2])
    # What the map does not hold yet is not drawn.
    early = HISTORY.sessions[1].estimate
    assert sum(map(len, sightings(HISTORY, early, 13, 26).values())) < len(measured)


def test_pose_of_a_robot_that_stands():
    session = HISTORY.sessions[1]
    still = replace(
        session.estimate,
        trajectory_steps={**session.estimate.trajectory_steps, "red": (2, 5, 9)},
        trajectories={**session.estimate.trajectories, "red": np.arange(9.0).reshape(3, 3)},
    )
    assert [pose_at(still, "red", step)[0] for step in (2, 4, 5, 8, 9, 12)] == [0, 0, 3, 3, 6, 6]
    with pytest.raises(InvalidInputError, match="robot 'red' has no pose at step 1"):
        pose_at(still, "red", 1)


def test_candidates_of_a_session():
    figure = session_candidates_figure(HISTORY, 2, WORLD)
    axes = figure.axes[0]
    assert axes.get_title() == "Session 3 at 130 s: candidate paths"
    assert limits(axes) == limits(session_slam_figure(HISTORY, 0, WORLD).axes[0])
    for robot in ROBOTS:
        assert segments(axes, NAMED_COLORS[robot]) == 5
    assert markers(axes, "*") == 4
    assert markers(axes, "+") == len(HISTORY.sessions[2].estimate.landmarks)
    assert markers(axes, ".") == len(LANDMARK_KEYS)
    # Three goals a robot; the one that it heads for is filled with its colour.
    filled = [line for line in axes.lines if line.get_markerfacecolor() in NAMED_COLORS.values()]
    filled = [line for line in filled if line.get_marker() == "o"]
    assert markers(axes, "o") == 12
    assert [line.get_xydata()[0].tolist() for line in filled] == [
        list(HISTORY.sessions[2].goals[robot]) for robot in ROBOTS
    ]
    assert legend(figure) == [
        *(f"{robot}: 5 candidates" for robot in ROBOTS),
        "start",
        "goal",
        "goal headed for",
        f"mapped landmark ({len(HISTORY.sessions[2].estimate.landmarks)})",
        "landmark, true (60)",
        "obstacle",
    ]


def test_chosen_paths_of_a_session():
    session = HISTORY.sessions[2]
    figure = session_chosen_figure(HISTORY, 2, WORLD)
    axes = figure.axes[0]
    planned = sum(len(path.observations) for path in session.chosen.values())
    assert segments(axes, UNCHANGED) == len(session.joined) + planned
    ellipses = [one for one in axes.patches if isinstance(one, matplotlib.patches.Polygon)]
    assert len(ellipses) == sum(path.steps + 1 for path in session.chosen.values())
    assert f"multi-robot factor ({len(session.joined)})" in legend(figure)
    assert f"landmark observation ({planned})" in legend(figure)


def test_colours_do_not_depend_on_who_plans():
    late = replace(
        HISTORY.sessions[0],
        candidates={"blue": HISTORY.sessions[0].candidates["blue"]},
        chosen={"blue": HISTORY.sessions[0].chosen["blue"]},
        covariances={},
    )
    names = {"red": "r1", "green": "r2", "blue": "blue", "purple": "r4"}
    history = replace(
        HISTORY,
        robots=tuple(names.values()),
        goals={names[robot]: goals for robot, goals in HISTORY.goals.items()},
        steps=(),
        sessions=(late,),
    )
    third = session_candidates_figure(history, 0).axes[0]
    assert segments(third, "#117733") == 5
    assert lines(session_chosen_figure(history, 0).axes[0], "#117733")


def test_slam_after_a_session():
    figure = session_slam_figure(HISTORY, 1, WORLD)
    axes = figure.axes[0]
    result = result_of_session(HISTORY, 1)
    assert result is HISTORY.sessions[2].estimate
    assert axes.get_title() == "SLAM after session 2, step 26"
    for robot in ROBOTS:
        (way, *_) = lines(axes, NAMED_COLORS[robot])
        np.testing.assert_array_equal(way.get_xydata(), result.trajectories[robot][:, :2])
    true = [line for line in lines(axes, "black") if len(line.get_xdata()) == 27]
    assert len(true) == 4
    np.testing.assert_array_equal(
        true[1].get_xydata(), [record.truth["green"][:2] for record in HISTORY.steps[:27]]
    )
    count = sum(len(record.measurements) for record in HISTORY.steps[13:27])
    assert sum(segments(axes, color) for color in NAMED_COLORS.values()) == count
    shared = sum(len(robots) > 1 for robots in result.seen_by.values())
    assert (markers(axes, "P"), markers(axes, "+")) == (shared, len(result.landmarks) - shared)
    assert legend(figure)[:5] == [*(f"{robot}, estimated" for robot in ROBOTS), "true trajectory"]
    assert f"landmark measurement ({count})" in legend(figure)
    assert "covariance of a robot, 3σ\n(98.9% inside),\ndrawn 5× larger" in legend(figure)
    assert "covariance of a landmark, 3σ\n(98.9% inside),\ndrawn 5× larger" in legend(figure)


def test_slam_at_its_own_size():
    truth = loop_tracks(HISTORY).true_positions
    figure = slam_result_figure(HISTORY.final, truth=truth, magnification=1)
    assert "covariance of a robot, 3σ\n(98.9% inside)" in legend(figure)
    ellipses = [
        one for one in figure.axes[0].patches if isinstance(one, matplotlib.patches.Polygon)
    ]
    # 42 steps and more a robot: every second one; and one a landmark.
    assert len(ellipses) == 4 * 22 + len(HISTORY.final.landmarks)
    last = ellipses[21].get_xy()
    block = loop_tracks(HISTORY).covariances["red"][-1]
    half = 3 * np.sqrt(np.linalg.eigvalsh(block).max())
    across = np.linalg.norm(last - HISTORY.steps[-1].estimates["red"][:2], axis=1).max()
    assert across == pytest.approx(half, rel=1e-2)  # a polygon inside the ellipse


def test_covariance_over_time():
    figure = loop_covariance_figure(HISTORY)
    axes = figure.axes[0]
    assert [text.get_text() for text in axes.texts] == ["1", "2", "3", "4"]
    tracks = loop_tracks(HISTORY)
    curves = {line.get_label(): line.get_ydata() for line in axes.lines}
    np.testing.assert_array_equal(curves["purple"], tracks.traces["purple"])
    rings = [line.get_xdata().tolist() for line in axes.lines if line.get_marker() == "o"]
    assert rings[0] == [60.0, 170.0, 210.0]
    assert rings[1] == [60.0, 130.0, 210.0]


def test_running_times():
    figure = loop_running_times_figure(HISTORY)
    left, right = figure.axes
    assert [label.get_text() for label in left.get_xticklabels()] == ["1", "2", "3", "4"]
    heights = [bar.get_height() for bar in right.patches]
    slow, ours = (4.0, 9.0, 14.0, 12.0), (0.08, 0.16, 0.24, 0.32)
    np.testing.assert_allclose(heights[:4], np.divide(slow, ours))
    np.testing.assert_allclose(heights[4:], 2.5)


def test_running_times_that_not_all_took_part_in():
    first, *rest = HISTORY.sessions
    alone = replace(first, runs={"incremental": first.runs["incremental"]})
    figure = loop_running_times_figure(replace(HISTORY, sessions=(alone, *rest)))
    assert figure.get_suptitle().endswith("(not timed by all: 1)")
    assert len(figure.axes[0].get_xticklabels()) == 3
    one = loop_running_times_figure(replace(HISTORY, sessions=(alone,)))
    assert len(one.axes) == 1
    with pytest.raises(InvalidInputError, match="timed by every evaluator"):
        loop_running_times_figure(
            replace(
                HISTORY, sessions=(alone, replace(rest[0], runs={"x": first.runs["incremental"]}))
            )
        )


def test_all_files(tmp_path):
    written = draw_loop_figures(
        replace(HISTORY, sessions=HISTORY.sessions[2:]), tmp_path / "made", WORLD
    )
    sessions = [
        f"session_{number}_{what}.png"
        for number in (3, 4)
        for what in ("candidates", "chosen", "slam")
    ]
    rest = ["position_covariance.png", "running_times.png", "final_slam.png"]
    assert [path.name for path in written] == [*sessions, *rest]
    assert sorted(path.name for path in (tmp_path / "made").iterdir()) == sorted([*sessions, *rest])
    for path in written:
        pixels = matplotlib.image.imread(path)
        assert pixels.shape[1] == 1000
        assert pixels[..., :3].std() > 0.02


def test_files_of_a_loop_that_still_runs(tmp_path):
    untimed = tuple(replace(session, runs={}) for session in RUNNING.sessions[:2])
    written = draw_loop_figures(replace(RUNNING, sessions=untimed), tmp_path)
    assert [path.name for path in written] == [
        "session_1_candidates.png",
        "session_1_chosen.png",
        "session_1_slam.png",
        "session_2_candidates.png",
        "session_2_chosen.png",
        "position_covariance.png",
    ]


def test_in_space():
    for place in range(4):
        session_candidates_figure(SPATIAL, place)
        session_chosen_figure(SPATIAL, place)
    figure = session_slam_figure(SPATIAL, 1)
    flat = session_slam_figure(HISTORY, 1)
    assert legend(figure) == legend(flat)
    assert limits(figure.axes[0]) == limits(flat.axes[0])


def test_extent_holds_all_there_is():
    lower, upper = loop_extent(HISTORY)
    points = np.concatenate([true_landmarks(HISTORY), *HISTORY.goals.values()])
    assert (points > lower).all()
    assert (points < upper).all()
    within, _ = loop_extent(HISTORY, WORLD)
    np.testing.assert_allclose(within, [-75.0, -75.0])


def test_bad_input():
    with pytest.raises(InvalidInputError, match="'four robots': expected at least one step"):
        loop_covariance_figure(replace(HISTORY, steps=()))
    for draw in (session_candidates_figure, session_chosen_figure, session_slam_figure):
        with pytest.raises(InvalidInputError, match="one of 4 sessions, from 0, got 4"):
            draw(HISTORY, 4)
        with pytest.raises(InvalidInputError, match="got -1"):
            draw(HISTORY, -1)
    with pytest.raises(InvalidInputError, match="session 4 has not been followed to its end"):
        session_slam_figure(RUNNING, 3)
    with pytest.raises(InvalidInputError, match="it still runs"):
        final_slam_figure(RUNNING)
    short = replace(HISTORY.steps[3], estimates={"red": np.zeros(3)})
    with pytest.raises(InvalidInputError, match="step 3: expected estimates of robot 'green'"):
        loop_tracks(replace(HISTORY, steps=(*HISTORY.steps[:3], short)))
    with pytest.raises(InvalidInputError, match="at least one trajectory"):
        slam_result_figure(replace(HISTORY.final, trajectories={}), truth={})
    with pytest.raises(InvalidInputError, match="true positions of robot 'red'"):
        slam_result_figure(HISTORY.final, truth={"red": np.zeros((2, 3))})
    with pytest.raises(InvalidInputError, match="sightings of robot 'red'"):
        slam_result_figure(HISTORY.final, truth={}, sightings={"red": np.zeros((2, 2))})
    for fields in ({"sightings": {"zz": np.zeros((1, 2, 2))}}, {"goals": {"zz": [0.0, 0.0]}}):
        with pytest.raises(
            InvalidInputError, match="robot 'zz': expected sightings and goals of red"
        ):
            slam_result_figure(HISTORY.final, truth={}, **fields)
    final = HISTORY.final
    lost = {robot: poses * np.nan for robot, poses in final.trajectories.items()}
    with pytest.raises(InvalidInputError, match="poses of ellipses: expected finite"):
        slam_result_figure(replace(final, trajectories=lost), truth={})
    none = {**final.trajectories, "red": np.zeros((0, 3))}
    for changed in ({"trajectories": none}, {"covariances": {}}):
        with pytest.raises(InvalidInputError, match="robot 'red': expected at least one pose, and"):
            slam_result_figure(replace(final, **changed), truth={})
    with pytest.raises(InvalidInputError, match="ellipses: expected numbers"):
        world_position_covariances([["a", "b", "c"]], np.zeros((1, 3, 3)))
    for name in ("sigmas", "magnification"):
        with pytest.raises(InvalidInputError, match=f"figure {name}"):
            slam_result_figure(HISTORY.final, truth={}, **{name: 0.0})
