"""Pictures of maps: every figure is drawn to a file, and what is in it is counted."""

import networkx as nx
import numpy as np
import pytest

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.paths.candidate_path import CandidatePath, Observation
from fgplan.viz.candidate_paths import candidate_paths_figure
from fgplan.viz.chosen_paths import chosen_paths_figure
from fgplan.viz.figure import save
from fgplan.viz.impacted_paths import impacted_paths_figure
from fgplan.viz.palette import ADDED, REMOVED, ROADMAP, UNCHANGED, UNTOUCHED, robot_styles
from roadmaps import OccupancyGrid, Workspace, build_roadmap
from roadmaps.workspace import build_grid_workspace

matplotlib = pytest.importorskip("matplotlib")
WORLD = Workspace(
    lower=[0, 0],
    upper=[2000, 2500],
    obstacles=[[(900, 900), (1100, 900), (1000, 1100)], [(100, 1200), (200, 1200), (200, 1300)]],
)
STYLES = robot_styles(("r1", "r2"))


def path(robot, positions, **rest):
    where = np.array(positions, dtype=float)
    poses = np.column_stack([where, np.full(len(where), np.pi / 2)])
    return CandidatePath(
        robot=robot,
        poses=poses,
        times_s=np.arange(float(len(where))),
        motion_covariances=np.tile(np.eye(3), (len(where) - 1, 1, 1)),
        **rest,
    )


def fan(robot, x, count, **rest):
    """Candidates side by side from one start to one goal."""
    return [
        path(robot, [(x, 100), (x + 60 * i, 900), (x + 70 * i, 1700), (x, 2400)], **rest)
        for i in range(count)
    ]


def spatial(robot):
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, 3] = [(0, 0, 5), (10, 0, 5), (10, 20, 9)]
    return CandidatePath(
        robot=robot,
        poses=poses,
        times_s=[0, 1, 2],
        motion_covariances=np.tile(np.eye(6), (2, 1, 1)),
    )


def written(figure, folder):
    """Write the figure and check that it is a picture of the size meant."""
    target = save(figure, folder / "made" / "figure.png")
    pixels = matplotlib.image.imread(target)
    assert pixels.shape[1] == 1000
    assert pixels[..., :3].std() > 0.02
    return figure


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def segments(axes, color):
    """Number of lines in the collections of one colour."""
    rgb = matplotlib.colors.to_rgb(color)
    return sum(
        len(one.get_segments())
        for one in axes.collections
        if isinstance(one, matplotlib.collections.LineCollection)
        and np.allclose(one.get_colors()[0][:3], rgb)
    )


def markers(axes, marker):
    return sum(len(line.get_xdata()) for line in axes.lines if line.get_marker() == marker)


def check_map(axes, lower=(0, 0), upper=(2000, 2500)):
    assert axes.get_xlabel() == "x (m)"
    assert axes.get_aspect() == 1.0
    for limits, low, high in zip((axes.get_xlim(), axes.get_ylim()), lower, upper, strict=True):
        assert low - 0.1 * max(upper) < limits[0] < low
        assert high < limits[1] < high + 0.1 * max(upper)


def inside(figure):
    """All texts lie within the picture: nothing is cut off."""
    renderer = figure.canvas.get_renderer()
    box = figure.bbox
    texts = [figure.axes[0].xaxis.label, figure.axes[0].yaxis.label, figure.axes[0].title]
    for artist in (*texts, figure.legends[0]):
        extent = artist.get_window_extent(renderer)
        assert extent.x0 >= box.x0 - 1
        assert extent.x1 <= box.x1 + 1
        assert extent.y0 >= box.y0 - 1
        assert extent.y1 <= box.y1 + 1


def test_candidate_paths(tmp_path):
    roadmap = build_roadmap([[500, 500], [800, 500], [800, 900]], [(0, 1), (1, 2)])
    candidates = {"r1": fan("r1", 300, 5), "r2": fan("r2", 1000, 3), "r3": []}
    goals = {"r1": [[300, 2400], [400, 300]], "r2": [1000, 2400]}
    figure = written(
        candidate_paths_figure(candidates, workspace=WORLD, roadmap=roadmap, goals=goals), tmp_path
    )
    axes = figure.axes[0]
    check_map(axes)
    inside(figure)
    assert axes.get_title() == "Candidate paths"
    assert axes.get_ylabel() == "y (m)"
    assert segments(axes, STYLES["r1"].color) == 5
    assert segments(axes, STYLES["r2"].color) == 3
    assert segments(axes, ROADMAP) == 2
    assert markers(axes, "*") == 2
    assert markers(axes, "o") == 3
    assert {text.get_text() for text in axes.texts} == {"r1", "r2", "1", "2", ""}
    assert legend(figure) == [
        "r1: 5 candidates",
        "r2: 3 candidates",
        "r3: 0 candidates",
        "start",
        "goal",
        "roadmap",
        "obstacle",
    ]


def test_candidate_paths_without_a_map(tmp_path):
    figure = written(candidate_paths_figure({"r1": [spatial("r1")]}), tmp_path)
    check_map(figure.axes[0], upper=(10, 20))
    inside(figure)
    assert legend(figure) == ["r1: 1 candidate", "start", "goal"]
    corridor = candidate_paths_figure({"r1": [path("r1", [(0, 0), (0, 100)])]})
    assert corridor.axes[0].get_xlim()[1] - corridor.axes[0].get_xlim()[0] > 30
    assert corridor.get_figheight() < 12


def test_a_rotated_grid(tmp_path):
    occupancy = np.zeros((20, 40), dtype=int)
    occupancy[5:8, 10:20], occupancy[:, 35:] = 100, -1
    grid = OccupancyGrid(
        occupancy=occupancy, resolution_m=0.5, origin=np.array([-2.0, 1.0]), yaw_rad=np.pi / 2
    )
    workspace = build_grid_workspace(grid, unknown_is_free=True)
    figure = written(
        candidate_paths_figure({"r1": [path("r1", [(-8, 3), (-8, 18)])]}, workspace=workspace),
        tmp_path,
    )
    axes = figure.axes[0]
    assert legend(figure)[-2:] == ["unknown cells", "obstacle"]
    # The centre of an occupied cell is drawn dark, that of a free one white.
    pixels = np.asarray(figure.canvas.buffer_rgba())
    for cell, expected in (([15, 6], 0x8A), ([5, 6], 255), ([37, 3], 0xE4)):
        x, y = axes.transData.transform(grid.centers(np.array([cell]))[0])
        assert pixels[int(pixels.shape[0] - y), int(x), 0] == pytest.approx(expected, abs=2)


def test_chosen_paths(tmp_path):
    seen = Observation(step=1, landmark=7, sensor="s", covariance=np.eye(2))
    paths = {
        "r1": path("r1", [(300, 100), (300, 900), (300, 2400)], observations=(seen,)),
        "r2": path("r2", [(900, 100), (500, 900), (900, 2400)]),
    }
    covariances = {robot: np.tile(np.diag([4.0, 1.0]), (3, 1, 1)) for robot in paths}
    joined = [(paths["r1"].state(1), paths["r2"].state(1))]
    landmarks = {7: [400, 1000], 8: [1500, 100, 2]}
    figure = written(
        chosen_paths_figure(
            paths, covariances, joined=joined, landmarks=landmarks, workspace=WORLD
        ),
        tmp_path,
    )
    axes = figure.axes[0]
    check_map(axes)
    inside(figure)
    assert legend(figure) == [
        "r1",
        "r2",
        "start",
        "position covariance, 3σ\n(98.9% inside),\ndrawn 10× larger",
        "multi-robot factor (1)",
        "mapped landmark (2)",
        "landmark observation (1)",
        "goal",
        "obstacle",
    ]
    assert segments(axes, UNCHANGED) == 2
    assert markers(axes, "+") == 2
    assert markers(axes, "o") == 2
    assert len(axes.patches) == 6 + 1  # one ellipse a pose, and the bounds
    ellipse = next(one for one in axes.patches if hasattr(one, "get_xy") and not callable(one))
    corners = ellipse.get_xy()  # a polygon inside the ellipse: a little smaller, hence 1e-2
    assert np.ptp(corners[:, 0]) == pytest.approx(2 * 3 * 2 * 10, rel=1e-2)
    assert np.ptp(corners[:, 1]) == pytest.approx(2 * 3 * 1 * 10, rel=1e-2)


def test_chosen_paths_at_true_size(tmp_path):
    paths = {"r1": path("r1", [(300, 100), (300, 900)])}
    figure = chosen_paths_figure(paths, {"r1": np.zeros((2, 2, 2))}, sigmas=2, magnification=1)
    written(figure, tmp_path)
    assert legend(figure)[2] == "position covariance, 2σ\n(86.5% inside)"
    assert legend(chosen_paths_figure(paths, {})) == ["r1", "start", "goal"]


@pytest.mark.parametrize(("moments", "said"), [(2, "2σ at start and end"), (1, "2σ at the end")])
def test_targets_of_a_plan_that_gathers_information(tmp_path, moments, said):
    paths = {"r1": path("r1", [(300, 100), (300, 900)])}
    targets = {"t0": [(500, 500), (600, 500), (700, 500)], "t1": [(900, 2000)] * 3}
    spread = {name: np.tile(4e3 * np.eye(2), (moments, 1, 1)) for name in targets}
    figure = chosen_paths_figure(paths, {}, targets=targets, target_covariances=spread, goals={})
    axes = written(figure, tmp_path).axes[0]
    assert legend(figure) == ["r1", "start", f"target,\n{said}"]
    assert {"t0", "t1"} <= {text.get_text() for text in axes.texts}
    outlines = [line.get_xydata() for line in axes.lines if len(line.get_xydata()) > 10]
    centres = sorted(tuple(np.round(outline[:-1].mean(axis=0))) for outline in outlines)
    ends = [(700, 500), (900, 2000)]
    assert centres == sorted(ends + ([(500, 500), (900, 2000)] if moments == 2 else []))
    with pytest.raises(InvalidInputError, match="covariances of target 't0'"):
        chosen_paths_figure(paths, {}, targets=targets, target_covariances={"t0": [[1.0]]})


def test_impacted_paths(tmp_path):
    candidates = fan("r1", 300, 6)
    before = {"r2": path("r2", [(1000, 100), (700, 900), (1000, 2400)])}
    after = {"r2": path("r2", [(1000, 100), (700, 900), (1500, 2400)])}
    other = before["r2"].state(1)
    kept = [(candidates[3].state(1), other), (other, candidates[4].state(1))]
    removed = [(candidates[3].state(3), before["r2"].state(2))]
    added = [(candidates[5].state(s), after["r2"].state(2)) for s in (1, 2, 3)]
    roadmap = nx.Graph(build_roadmap([[500, 500], [800, 500]], [(0, 1)]))
    figure = written(
        impacted_paths_figure(
            candidates,
            [3, 4, 5],
            before,
            after,
            kept=kept,
            removed=removed,
            added=added,
            workspace=WORLD,
            roadmap=roadmap,
        ),
        tmp_path,
    )
    inside(figure)
    left, right = figure.axes
    for axes, color, factors, other_color in (
        (left, REMOVED, 1, ADDED),
        (right, ADDED, 3, REMOVED),
    ):
        check_map(axes)
        assert segments(axes, UNCHANGED) == 2
        assert segments(axes, color) == factors
        assert segments(axes, other_color) == 0
        assert segments(axes, UNTOUCHED) == 3
        assert segments(axes, STYLES["r1"].color) == 3
        assert segments(axes, ROADMAP) == 1
    # Involved vertices, each once: all candidates share the goal.
    assert markers(left, "o") == 3
    assert markers(right, "o") == 5
    assert left.get_title() == "Previous announcement"
    assert right.get_title() == "New announcement"
    assert figure.get_suptitle() == "3 of 6 candidate paths of r1 are impacted"
    assert legend(figure) == [
        "start",
        "roadmap",
        "obstacle",
        "r1: impacted (3)",
        "r1: untouched (3)",
        "involved vertex",
        "r2: announced",
        "unchanged factor (2)",
        "removed factor (1)",
        "added factor (3)",
    ]


def test_bad_input():
    good = path("r1", [(0, 0), (1, 1)])
    with pytest.raises(InvalidInputError, match="at least one candidate path, got none"):
        candidate_paths_figure({"r1": []})
    with pytest.raises(InvalidInputError, match="at least one chosen path"):
        chosen_paths_figure({}, {})
    with pytest.raises(UnknownNameError, match="covariances of robot 'r2', expected of r1"):
        chosen_paths_figure({"r1": good}, {"r2": np.zeros((2, 2, 2))})
    with pytest.raises(InvalidInputError, match="position covariances of robot 'r1'"):
        chosen_paths_figure({"r1": good}, {"r1": np.zeros((3, 2, 2))})
    with pytest.raises(InvalidInputError, match="figure sigmas"):
        chosen_paths_figure({"r1": good}, {}, sigmas=0.0)
    with pytest.raises(InvalidInputError, match="figure magnification"):
        chosen_paths_figure({"r1": good}, {}, magnification=-1.0)
    changes = {"kept": [], "removed": [], "added": []}
    with pytest.raises(InvalidInputError, match="at least one candidate path"):
        impacted_paths_figure([], [], {}, {}, **changes)
    with pytest.raises(InvalidInputError, match="from 0 to 0, got 1"):
        impacted_paths_figure([good], [1], {}, {}, **changes)
    bare = nx.Graph()
    bare.add_node(3)
    with pytest.raises(InvalidInputError, match="vertex 3 has no `position`"):
        candidate_paths_figure({"r1": [good]}, roadmap=bare)
