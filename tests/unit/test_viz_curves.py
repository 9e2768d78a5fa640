"""Running times, histories, files, and what happens without matplotlib."""

import subprocess
import sys

import numpy as np
import pytest

from fgplan.errors import InvalidInputError, MissingExtraError, UnknownNameError
from fgplan.viz.figure import new_figure, save
from fgplan.viz.histories import (
    covariance_over_time_figure,
    objective_history_figure,
    position_covariance_figure,
)
from fgplan.viz.running_times import running_time_bars_figure, running_time_figure

matplotlib = pytest.importorskip("matplotlib")


def written(figure, folder):
    target = save(figure, folder / "figure.png")
    assert matplotlib.image.imread(target).shape[1] == 1000
    return figure


def legend(holder):
    return [text.get_text() for text in holder.get_texts()]


def test_running_times(tmp_path):
    generator = np.random.default_rng(0)
    counts = [5, 10, 25, 50]
    seconds = {
        f"{robots} robots": {
            name: generator.uniform(1, 2, (4, 11)) * scale * np.array(counts)[:, None]
            for name, scale in (("from_scratch", 0.1), ("incremental", 0.001))
        }
        for robots in (2, 4)
    }
    published = {"2 robots": {"published: Standard": [(25, 30), (50, 85)], "one": [(50, 35)]}}
    figure = written(running_time_figure(counts, seconds, published=published), tmp_path)
    left, right = figure.axes
    assert [axes.get_title() for axes in figure.axes] == ["2 robots", "4 robots"]
    assert left.get_yscale() == "log"
    assert left.get_ylabel() == "running time (s)"
    assert right.get_xlabel() == "candidate paths a robot"
    assert left.get_xticks().tolist() == counts
    assert len(left.lines) == 4
    assert len(right.lines) == 2
    assert len(left.collections) == 2  # one band an evaluator
    np.testing.assert_allclose(
        left.lines[0].get_ydata(), np.median(seconds["2 robots"]["from_scratch"], axis=1)
    )
    band = left.collections[0].get_datalim(left.transData)
    assert band.y1 == pytest.approx(np.percentile(seconds["2 robots"]["from_scratch"][3], 75))
    assert left.lines[2].get_xydata().tolist() == [[25, 30], [50, 85]]
    assert legend(figure.legends[0]) == [
        "from_scratch",
        "incremental",
        "published: Standard",
        "one",
    ]


def test_running_time_bars(tmp_path):
    seconds = {"from_scratch": [1.0, 200.0], "isam2": [2.0, 50.0], "incremental": [0.1, 4.0]}
    figure = written(
        running_time_bars_figure(["1", "2"], seconds, reference="from_scratch"), tmp_path
    )
    left, right = figure.axes
    assert [bar.get_height() for bar in left.patches] == [1.0, 200.0, 2.0, 50.0, 0.1, 4.0]
    np.testing.assert_allclose([bar.get_height() for bar in right.patches], [0.5, 4.0, 10.0, 50.0])
    assert [text.get_text() for text in right.texts] == ["0.5×", "4×", "10×", "50×"]
    assert left.get_ylabel() == "running time (s)"
    assert right.get_ylabel() == "ratio: from_scratch / evaluator (no unit)"
    assert legend(figure.legends[0]) == list(seconds)


def test_objective_history(tmp_path):
    values, robots = [9.0, 8.0, 6.5, 6.0], ["a", "b", "a", "c"]
    figure = written(objective_history_figure(values, robots, team=["c", "a", "b"]), tmp_path)
    axes = figure.axes[0]
    assert axes.lines[0].get_ydata().tolist() == values
    assert legend(axes.get_legend()) == ["announced by c", "announced by a", "announced by b"]
    assert axes.lines[2].get_xydata().tolist() == [[1, 9.0], [3, 6.5]]
    assert [text.get_text() for text in axes.texts] == ["9", "6"]
    assert axes.get_xlabel() == "accepted announcement (number)"
    single = written(objective_history_figure([3.0], ["a"]), tmp_path)
    assert [text.get_text() for text in single.axes[0].texts] == ["3"]


def test_position_covariances(tmp_path):
    growing = np.eye(2) * np.linspace(1e-6, 9, 30)[:, None, None]
    figure = written(
        position_covariance_figure({"a": growing, "b": growing[:10]}, sessions=[0, 12]), tmp_path
    )
    axes = figure.axes[0]
    assert legend(axes.get_legend()) == ["planning session", "a", "b"]
    assert axes.get_ylabel() == "trace of the position covariance (m²)"
    assert len(axes.lines) == 4
    np.testing.assert_allclose(axes.lines[2].get_ydata(), 2 * np.linspace(1e-6, 9, 30))


def test_running_time_bars_without_a_reference(tmp_path):
    figure = written(
        running_time_bars_figure(["1", "2"], {"x": [1.0, 20.0]}, reference=None), tmp_path
    )
    (axes,) = figure.axes
    assert [bar.get_height() for bar in axes.patches] == [1.0, 20.0]
    assert legend(figure.legends[0]) == ["x"]


def test_many_running_time_bars(tmp_path):
    seconds = {"from_scratch": np.arange(1.0, 10.0), "incremental": np.full(9, 0.1)}
    names = [str(number) for number in range(1, 10)]
    figure = written(running_time_bars_figure(names, seconds, reference="from_scratch"), tmp_path)
    above, below = figure.axes
    assert above.get_position().y0 > below.get_position().y1
    assert {text.get_rotation() for text in above.texts} == {90.0}
    # Nine ratios stand beside one another.
    assert {text.get_rotation() for text in below.texts} == {0.0}
    assert [text.get_text() for text in below.texts][::4] == ["10×", "50×", "90×"]


def test_covariance_over_time(tmp_path):
    times = np.arange(0.0, 50.0, 10.0)
    traces = {"a": [0.0, 1.0, 4.0, 9.0, 16.0], "b": [2.0, 2.0, 2.0, 1.0, 1.0]}
    figure = written(
        covariance_over_time_figure(
            times, traces, sessions={1: 0.0, 2: 20.0}, arrivals={"a": [20.0, 40.0]}
        ),
        tmp_path,
    )
    axes = figure.axes[0]
    assert legend(figure.legends[0]) == [
        "a",
        "b",
        "planning session (number above)",
        "goal reached",
    ]
    assert [text.get_text() for text in axes.texts] == ["1", "2"]
    assert axes.get_xlabel() == "time (s)"
    assert axes.get_ylabel() == "trace of the position covariance (m²)"
    curves = {line.get_label(): line.get_xydata() for line in axes.lines}
    np.testing.assert_array_equal(curves["a"], np.column_stack([times, traces["a"]]))
    rings = [line.get_xydata().tolist() for line in axes.lines if line.get_marker() == "o"]
    assert rings == [[[20.0, 4.0], [40.0, 16.0]], [], []]
    (right,) = axes.child_axes
    assert right.get_ylabel() == "square root of it (m)"
    assert right.get_ylim()[1] == pytest.approx(np.sqrt(axes.get_ylim()[1]), rel=1e-9)
    plain = covariance_over_time_figure(times, traces)
    assert legend(plain.legends[0]) == ["a", "b"]


def test_bad_covariances_over_time():
    with pytest.raises(InvalidInputError, match="at least one robot"):
        covariance_over_time_figure([0.0], {})
    with pytest.raises(InvalidInputError, match="robot 'a': expected none below zero, got -1"):
        covariance_over_time_figure([0.0], {"a": [-1.0]})
    with pytest.raises(InvalidInputError, match="traces of robot 'a': expected shape"):
        covariance_over_time_figure([0.0], {"a": [1.0, 2.0]})


def test_bad_input(tmp_path):
    with pytest.raises(InvalidInputError, match="at least one team"):
        running_time_figure([5], {})
    with pytest.raises(InvalidInputError, match="2 robots, x: expected shape"):
        running_time_figure([5], {"2 robots": {"x": [[1.0], [2.0]]}})
    with pytest.raises(InvalidInputError, match="all above zero"):
        running_time_figure([5], {"2 robots": {"x": [[0.0]]}})
    with pytest.raises(UnknownNameError, match="'3 robots', expected of 2 robots"):
        running_time_figure([5], {"2 robots": {"x": [[1.0]]}}, published={"3 robots": {}})
    with pytest.raises(UnknownNameError, match="reference 'y' is not one of: x"):
        running_time_bars_figure(["1"], {"x": [1.0]}, reference="y")
    with pytest.raises(InvalidInputError, match="running times of x"):
        running_time_bars_figure(["1", "2"], {"x": [1.0]}, reference="x")
    with pytest.raises(InvalidInputError, match="at least one objective value"):
        objective_history_figure([], [])
    with pytest.raises(InvalidInputError, match="objective values: expected shape"):
        objective_history_figure([1.0], ["a", "b"])
    with pytest.raises(InvalidInputError, match="at least one robot"):
        position_covariance_figure({})
    with pytest.raises(InvalidInputError, match="traces above zero"):
        position_covariance_figure({"a": np.zeros((3, 2, 2))})
    with pytest.raises(InvalidInputError, match=r"ends in \.png, \.pdf, \.svg"):
        save(new_figure(), tmp_path / "figure.jpeg")


def test_vector_files(tmp_path):
    figure = objective_history_figure([2.0, 1.0], ["a", "a"])
    assert save(figure, tmp_path / "figure.svg").read_text().startswith("<?xml")
    assert save(figure, tmp_path / "figure.pdf").read_bytes().startswith(b"%PDF")


def test_without_matplotlib(monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'fgplan\[viz\]'"):
        objective_history_figure([1.0], ["a"])


def test_matplotlib_is_imported_late_and_pyplot_never():
    code = (
        "import sys, fgplan.viz.candidate_paths, fgplan.viz.chosen_paths, fgplan.viz.histories\n"
        "import fgplan.viz.impacted_paths, fgplan.viz.running_times, fgplan.viz.loop_figures\n"
        "import fgplan.viz.animation, fgplan.viz.recording.loop_recording\n"
        "assert not {'PIL', 'rerun', 'foxglove', 'imageio_ffmpeg'} & set(sys.modules)\n"
        "assert 'matplotlib' not in sys.modules\n"
        "fgplan.viz.histories.objective_history_figure([2.0], ['a'])\n"
        "assert 'matplotlib' in sys.modules and 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
