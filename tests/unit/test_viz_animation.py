"""Films of a closed loop: which moments are shown, what a frame shows, and the files."""

import importlib
import shutil
import stat
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from loop_histories import ROBOTS, make_history

from fgplan.errors import InvalidInputError, MissingExtraError
from fgplan.viz.animation import animate_loop, film_moments
from fgplan.viz.loop_scene import LoopScene, Moment
from fgplan.viz.palette import LANDMARK, NAMED_COLORS, UNCHANGED
from roadmaps import Workspace

matplotlib = pytest.importorskip("matplotlib")
image = pytest.importorskip("PIL.Image")
WORLD = Workspace(lower=[0, 0], upper=[2000, 2500], obstacles=[[(900, 40), (990, 40), (990, 99)]])
HISTORY = make_history()
SHORT = replace(HISTORY, steps=HISTORY.steps[:4], sessions=HISTORY.sessions[:1], final=None)


def share(pixels, color):
    """Share of the pixels that have just this colour."""
    rgb = np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)])
    return float((pixels == rgb).all(axis=-1).mean())


def cyan_lines(axes):
    rgb = matplotlib.colors.to_rgb(UNCHANGED)
    return [
        one
        for one in axes.collections
        if isinstance(one, matplotlib.collections.LineCollection)
        and np.allclose(one.get_colors()[0][:3], rgb)
    ]


def test_moments():
    moments = film_moments(HISTORY, frames=1000, hold=2)
    places = [moment.place for moment in moments]
    assert places == sorted(places)
    assert set(places) == set(range(43))
    # A frame a step; three frames to fade in and two to hold at each session; the end held on.
    assert len(moments) == 43 + 4 * (3 + 2) + 4 * 2
    at_session = [moment for moment in moments if moment.place == 26]
    assert [moment.session for moment in at_session] == [1, 2, 2, 2, 2, 2]
    assert [moment.chosen for moment in at_session] == [True, False, False, False, True, True]
    assert [moment.planning for moment in at_session] == [False, True, True, True, True, True]
    faded = [moment.candidates for moment in at_session[1:5]]
    assert faded == sorted(faded)
    assert moments[0].session == -1
    assert {moment.session for moment in moments if 26 < moment.place < 34} == {2}


def test_a_long_mission_is_shown_in_steps():
    moments = film_moments(HISTORY, frames=10, hold=1)
    moving = {moment.place for moment in moments}
    assert moving == {*range(0, 43, 5), 0, 12, 26, 34, 42}


def test_what_a_frame_shows():
    scene = LoopScene(HISTORY, WORLD)
    moment = Moment(place=17, session=1, candidates=0.2, chosen=True, planning=False)
    pixels = scene.pixels(moment)
    assert pixels.shape == (600, 800, 3)
    assert pixels.dtype == np.uint8
    left, right = scene.figure.axes
    record, session = HISTORY.steps[17], HISTORY.sessions[1]
    for robot in ROBOTS:
        mine = [line for line in left.lines if line.get_color() == NAMED_COLORS[robot]]
        here = [line.get_xydata() for line in mine if line.get_marker() == "o"]
        np.testing.assert_array_equal(here[-1], [record.estimates[robot][:2]])
        trail = next(line for line in mine if len(line.get_xdata()) == 18)
        np.testing.assert_array_equal(trail.get_xydata()[3], HISTORY.steps[3].estimates[robot][:2])
        chosen = next(line for line in mine if line.get_linestyle() == ":")
        np.testing.assert_array_equal(chosen.get_xydata(), session.chosen[robot].poses[:, :2])
        curve = next(line for line in right.lines if line.get_color() == NAMED_COLORS[robot])
        sigma = np.sqrt(np.trace(record.covariances[robot][:2, :2]))
        assert curve.get_xydata()[-1].tolist() == pytest.approx([85.0, sigma], rel=1e-12)
    mapped = {one.target for step in HISTORY.steps[:18] for one in step.measurements}
    marks = [line for line in left.lines if line.get_color() == LANDMARK]
    assert [len(line.get_xdata()) for line in marks] == [len(mapped)]
    cyan = cyan_lines(left)
    counts = sorted(len(one.get_segments()) for one in cyan)
    assert counts == [0, len(record.measurements)]
    (clock,) = scene.figure.texts
    assert clock.get_text() == "t = 85 s   step 17   session 2"
    # Candidates at a session, and then the factors that join what was chosen.
    scene.pixels(Moment(26, 2, 0.5, False, True))
    assert clock.get_text() == "t = 130 s   step 26   session 3  planning"
    shown = [one for one in left.collections if one.get_alpha() == 0.5]
    assert [len(one.get_segments()) for one in shown] == [5, 5, 5, 5]
    scene.pixels(Moment(26, 2, 0.5, True, True))
    counts = sorted(len(one.get_segments()) for one in cyan)
    assert counts == sorted([len(HISTORY.steps[26].measurements), len(HISTORY.sessions[2].joined)])
    # A frame depends on its moment alone.
    np.testing.assert_array_equal(scene.pixels(moment), pixels)


def test_the_legend_is_never_cut_off():
    """Long entries: ellipses are drawn many times larger; the map leaves little room."""
    scene = LoopScene(HISTORY, Workspace(lower=[0, 0], upper=[3000, 2000]), dpi=80)
    scene.pixels(Moment(0, -1, 0.0, False, False))
    (legend,) = scene.figure.legends
    box, page = legend.get_window_extent(), scene.figure.bbox
    assert page.x0 <= box.x0 < box.x1 <= page.x1
    assert page.y0 <= box.y0 < box.y1 <= page.y1


def test_before_the_first_session_and_robots_that_measure_each_other():
    one = replace(HISTORY.steps[1].measurements[0], robot="red", kind="robot", target="blue")
    target = replace(one, kind="target", target="somebody")
    step = replace(HISTORY.steps[1], measurements=(one, target))
    history = replace(HISTORY, steps=(HISTORY.steps[0], step), sessions=())
    scene = LoopScene(history)
    scene.pixels(Moment(1, -1, 0.0, False, False))
    assert scene.figure.texts[0].get_text() == "t = 5 s   step 1   session 0"
    (line,) = [part for one in cyan_lines(scene.figure.axes[0]) for part in one.get_segments()]
    np.testing.assert_array_equal(line, [step.truth["red"][:2], step.truth["blue"][:2]])


def test_gif(tmp_path):
    path = animate_loop(SHORT, tmp_path / "made" / "film.gif", workspace=WORLD, fps=5)
    with image.open(path) as film:
        assert film.size == (800, 600)
        assert film.info["loop"] == 0
        assert film.info["duration"] == 200
        # Pillow makes one frame of those that are held.
        moments = film_moments(SHORT, frames=100, hold=2)
        assert film.n_frames == len(set(moments))
        total = 0
        for frame in range(film.n_frames):
            film.seek(frame)
            total += film.info["duration"]
        assert total == 200 * len(moments)
        film.seek(film.n_frames - 1)
        last = np.asarray(film.convert("RGB"))
    scene = LoopScene(SHORT, WORLD)
    exact = scene.pixels(moments[-1])
    # The palette keeps white white and every pixel near what it was.
    assert share(last, "#FFFFFF") == pytest.approx(share(exact, "#FFFFFF"), abs=0.01)
    assert share(last, "#FFFFFF") > 0.7
    for robot in ROBOTS:
        color = matplotlib.colors.to_rgb(NAMED_COLORS[robot])
        near = np.abs(last / 255.0 - color).max(axis=-1) < 0.1
        assert near.sum() > 100
    assert np.abs(last.astype(int) - exact).mean() < 1.0
    assert path.stat().st_size < 400_000


def test_a_smaller_film_in_space(tmp_path):
    spatial = make_history(spatial=True)
    spatial = replace(spatial, steps=spatial.steps[:2], sessions=spatial.sessions[:1])
    with image.open(animate_loop(spatial, tmp_path / "film.gif", dpi=50)) as film:
        assert film.size == (400, 300)


def test_mp4(tmp_path):
    if shutil.which("ffmpeg") is None:
        pytest.importorskip("imageio_ffmpeg")
    path = animate_loop(SHORT, tmp_path / "film.mp4", workspace=WORLD, dpi=51)
    assert path.read_bytes()[4:8] == b"ftyp"
    tool = shutil.which("ffmpeg") or importlib.import_module("imageio_ffmpeg").get_ffmpeg_exe()
    told = subprocess.run(
        [tool, "-i", str(path)], capture_output=True, text=True, timeout=30
    ).stderr
    assert "h264" in told
    assert "408x306" in told
    assert "10 fps" in told


def test_mp4_without_ffmpeg(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setitem(importlib.import_module("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(
        MissingExtraError, match=r"pip install 'fgplan\[mp4\]'; a \.gif needs neither"
    ):
        animate_loop(SHORT, tmp_path / "film.mp4")
    assert not (tmp_path / "film.mp4").exists()


def test_mp4_with_an_ffmpeg_that_cannot(tmp_path, monkeypatch):
    tool = tmp_path / "ffmpeg"
    tool.write_text("#!/bin/sh\necho unknown encoder libx264 >&2\nexit 3\n")
    tool.chmod(tool.stat().st_mode | stat.S_IEXEC)
    monkeypatch.setattr(shutil, "which", lambda name: str(tool))
    with pytest.raises(
        MissingExtraError, match=r"film\.mp4.*unknown encoder libx264.*fgplan\[mp4\]"
    ):
        animate_loop(SHORT, tmp_path / "film.mp4", dpi=50)


def test_bad_input(tmp_path):
    with pytest.raises(InvalidInputError, match=r"'film\.avi': expected a name that ends in \.gif"):
        animate_loop(SHORT, tmp_path / "film.avi")
    for name in ("fps", "dpi", "frames"):
        with pytest.raises(InvalidInputError, match=f"film {name}"):
            animate_loop(SHORT, tmp_path / "film.gif", **{name: 0})
    with pytest.raises(InvalidInputError, match=r"film fps: expected at most 100 in a \.gif"):
        animate_loop(SHORT, tmp_path / "film.gif", fps=101)
    with pytest.raises(InvalidInputError, match="at least one step"):
        animate_loop(replace(SHORT, steps=()), tmp_path / "film.gif")


def test_a_frame_of_a_gif_lasts_the_nearest_hundredths_of_a_second(tmp_path):
    with image.open(animate_loop(SHORT, tmp_path / "film.gif", fps=27, dpi=20, frames=1)) as film:
        assert film.info["duration"] == 40  # 37 ms: Pillow alone would cut it to 30
