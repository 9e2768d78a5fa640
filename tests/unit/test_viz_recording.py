"""Recordings of a closed loop: read back with the formats' own readers."""

import json
import os
import shutil
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from loop_histories import LANDMARK_KEYS, ROBOTS, make_history

from fgplan.errors import InvalidInputError, MissingExtraError
from fgplan.viz.loop_tracks import first_seen, sightings
from fgplan.viz.recording.loop_layers import Layers, loop_layers, static_layers
from fgplan.viz.recording.loop_recording import record_loop
from fgplan.viz.recording.rerun_recording import _log, _log_looks, _path
from roadmaps import Workspace

WORLD = Workspace(lower=[0, 0], upper=[2000, 2500], obstacles=[[(900, 40), (990, 40), (990, 99)]])
HISTORY = make_history()
SPATIAL = make_history(spatial=True)


def test_static_layers():
    layers = static_layers(HISTORY, WORLD)
    assert layers.time_s == 0.0
    assert layers.points["world/landmarks_true"].points.shape == (len(LANDMARK_KEYS), 3)
    assert layers.points["green/goals"].labels == ("green 1", "green 2", "green 3")
    (obstacle,) = layers.lines["world/obstacles"].lines
    assert obstacle.tolist() == [[900, 40, 0], [990, 40, 0], [990, 99, 0], [900, 40, 0]]
    assert layers.lines["world/bounds"].lines[0].shape == (5, 3)
    assert not static_layers(HISTORY).lines
    assert static_layers(SPATIAL).points["green/goals"].points[0].tolist() == [800, 950, 30]


def test_layers_over_time():
    told = list(loop_layers(HISTORY))
    assert len(told) == 43 + 4 + 1
    assert [one.time_s for one in told] == sorted(one.time_s for one in told)
    record = HISTORY.steps[20]
    layers = next(one for one in told if one.step == 20)
    for robot in ROBOTS:
        pose = layers.poses[f"{robot}/estimate"]
        x, y, heading = record.estimates[robot]
        np.testing.assert_allclose(pose[:, 3], [x, y, 0, 1], rtol=1e-15)
        assert np.arctan2(pose[1, 0], pose[0, 0]) == pytest.approx(heading, rel=1e-12)
        assert layers.poses[f"{robot}/truth"][0, 3] == record.truth[robot][0]
        (outline,) = layers.lines[f"{robot}/covariance"].lines
        assert (outline[0] - outline[-1]).max() == pytest.approx(0.0, abs=1e-9)
        (trail,) = layers.lines[f"{robot}/trail_estimated/0"].lines
        np.testing.assert_array_equal(trail[7, :2], HISTORY.steps[7].estimates[robot][:2])
        assert len(trail) == 21
        mine = [one for one in record.measurements if one.robot == robot]
        assert len(layers.lines[f"{robot}/measurements"].lines) == len(mine)
        error = np.linalg.norm(record.estimates[robot][:2] - record.truth[robot][:2])
        assert layers.numbers[f"error_m/{robot}"] == pytest.approx(error, rel=1e-12)
    session = HISTORY.sessions[2]
    layers = [one for one in told if one.step == 26][1]
    assert len(layers.lines["red/candidates"].lines) == 5
    np.testing.assert_array_equal(
        layers.lines["red/chosen"].lines[0][:, :2], session.chosen["red"].poses[:, :2]
    )
    assert len(layers.lines["red/planned_covariance"].lines) == session.chosen["red"].steps + 1
    assert len(layers.lines["multi_robot_factors"].lines) == len(session.joined)
    assert layers.points["landmarks/estimated"].points.shape[0] == len(session.estimate.landmarks)
    assert layers.numbers["planning_s/from_scratch"] == 14.0
    assert layers.numbers["objective"] == session.values[-1]


def test_a_trail_comes_in_pieces_that_join():
    steps = [*HISTORY.steps, *HISTORY.steps[1:]]
    steps = tuple(replace(one, step=number) for number, one in enumerate(steps))
    told = list(loop_layers(replace(HISTORY, steps=steps, sessions=(), final=None)))
    first, second = told[49].lines, told[50].lines
    assert "red/trail_true/0" in first
    assert "red/trail_true/0" not in second
    (before,), (after,) = first["red/trail_true/0"].lines, second["red/trail_true/1"].lines
    assert len(before) == 50
    np.testing.assert_array_equal(after[0], before[-1])


def test_a_robot_without_a_path_shows_none():
    session = HISTORY.sessions[3]
    alone = replace(session, candidates={}, chosen={}, covariances={}, joined=())
    told = list(loop_layers(replace(HISTORY, sessions=(alone,))))
    lines = next(one for one in told if "red/chosen" in one.lines).lines
    for name in ("red/chosen", "red/candidates", "red/planned_covariance", "multi_robot_factors"):
        assert lines[name].lines == ()


def test_mcap(tmp_path):
    pytest.importorskip("foxglove")
    reader = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_protobuf.decoder")
    path = record_loop(HISTORY, tmp_path / "made" / "loop.mcap", workspace=WORLD)
    with path.open("rb") as file:
        bag = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        summary = bag.get_summary()
        schemas = {
            channel.topic: summary.schemas[channel.schema_id].name
            for channel in summary.channels.values()
        }
        drawn = [
            "/scene",
            "/tf",
            *(f"/{r}/{kind}" for r in ROBOTS for kind in ("estimate", "truth")),
        ]
        messages = [(c.topic, m.log_time, d) for _, c, m, d in bag.iter_decoded_messages(drawn)]
        told = bag.iter_messages(["/metrics"])
        messages += [(c.topic, m.log_time, json.loads(m.data)) for _, c, m in told]
    poses = [f"/{robot}/{kind}" for robot in ROBOTS for kind in ("estimate", "truth")]
    assert schemas == {
        "/scene": "foxglove.SceneUpdate",
        "/tf": "foxglove.FrameTransforms",
        "/metrics": "fgplan.Metrics",
        **dict.fromkeys(poses, "foxglove.PoseInFrame"),
    }
    counts = Counter(topic for topic, _, _ in messages)
    # The world, 43 steps, four sessions, the end; poses at steps; numbers at steps and sessions.
    assert counts == {
        "/scene": 1 + 43 + 4 + 1,
        "/tf": 43,
        "/metrics": 43 + 4,
        **dict.fromkeys(poses, 43),
    }
    stamps = [stamp for topic, stamp, _ in messages if topic == "/tf"]
    assert stamps == [5_000_000_000 * step for step in range(43)]
    red = [told for topic, _, told in messages if topic == "/red/estimate"]
    assert red[9].frame_id == "map"
    assert red[9].timestamp.ToNanoseconds() == 45_000_000_000
    x, y, heading = HISTORY.steps[9].estimates["red"]
    assert (red[9].pose.position.x, red[9].pose.position.y) == (x, y)
    turn = red[9].pose.orientation
    assert 2 * np.arctan2(turn.z, turn.w) == pytest.approx(heading, rel=1e-12)
    frames = [told for topic, _, told in messages if topic == "/tf"][9].transforms
    assert {frame.child_frame_id for frame in frames} == {name[1:] for name in poses}
    assert {frame.parent_frame_id for frame in frames} == {"map"}
    scenes = [told for topic, _, told in messages if topic == "/scene"]
    entities = {one.id: one for one in scenes[0].entities}
    assert len(entities["world/landmarks_true"].spheres) == len(LANDMARK_KEYS)
    assert [text.text for text in entities["red/goals"].texts] == ["red 1", "red 2", "red 3"]
    planned = [{one.id: one for one in scene.entities} for scene in scenes]
    planned = [by_id for by_id in planned if "red/candidates" in by_id]
    assert len(planned) == 4
    assert len(planned[2]["red/candidates"].lines) == 5
    assert len(planned[2]["multi_robot_factors"].lines) == len(HISTORY.sessions[2].joined)
    ellipse = planned[2]["red/planned_covariance"].lines[3]
    assert len(ellipse.points) == 48
    assert planned[2]["red/chosen"].frame_id == "map"
    metrics = [told for topic, _, told in messages if topic == "/metrics"]
    sigma = np.sqrt(np.trace(HISTORY.steps[0].covariances["blue"][:2, :2]))
    assert metrics[0]["sigma_m"]["blue"] == pytest.approx(sigma, rel=1e-12)
    assert metrics[1]["planning_s"] == {
        "incremental": 0.08,
        "from_scratch_fastest": 1.6,
        "from_scratch": 4.0,
    }


def test_mcap_in_space_replaces_a_file(tmp_path):
    pytest.importorskip("foxglove")
    reader = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_protobuf.decoder")
    path = tmp_path / "loop.mcap"
    path.write_bytes(b"something else")
    record_loop(SPATIAL, path)
    with path.open("rb") as file:
        bag = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        told = [message for _, _, _, message in bag.iter_decoded_messages(topics=["/red/truth"])]
    assert told[5].pose.position.z == 30.0
    turn = told[5].pose.orientation
    heading = HISTORY.steps[5].truth["red"][2]
    assert 2 * np.arctan2(turn.z, turn.w) == pytest.approx(heading, rel=1e-12)


def test_rerun(tmp_path):
    pytest.importorskip("rerun")
    path = record_loop(HISTORY, tmp_path / "made" / "loop.rrd", workspace=WORLD)
    assert path.read_bytes()[:3] == b"RRF"
    tool = Path(sys.executable).with_name("rerun")
    if not tool.exists():
        found = shutil.which("rerun")
        if found is None:
            pytest.skip("the rerun command is not installed beside the SDK")
        tool = Path(found)
    # At its first run the command greets, and writes its settings under the home folder.
    home = {**os.environ, "HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path)}
    told = subprocess.run(
        [tool, "rrd", "verify", path], env=home, capture_output=True, text=True, timeout=60
    )
    assert told.returncode == 0, told.stderr
    told = subprocess.run(
        [tool, "rrd", "stats", path], env=home, capture_output=True, text=True, timeout=60
    )
    for robot in ROBOTS:
        for name in ("estimate", "truth", "covariance", "candidates", "chosen", "measurements"):
            assert f"/map/{robot}/{name}: " in told.stdout
        assert f"/metrics/sigma_m/{robot}: " in told.stdout
    for name in ("/map/landmarks/estimated", "/map/multi_robot_factors", "/map/world/obstacles"):
        assert f"{name}: " in told.stdout


def test_rerun_in_space_is_quiet(tmp_path):
    pytest.importorskip("rerun")
    code = (
        "from loop_histories import make_history\n"
        "from fgplan.viz.recording.loop_recording import record_loop\n"
        f"record_loop(make_history(spatial=True), {str(tmp_path / 'loop.rrd')!r})\n"
    )
    tests = str(Path(__file__).parents[1])
    told = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env={**os.environ, "HOME": str(tmp_path), "PYTHONPATH": tests},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (told.returncode, told.stdout, told.stderr) == (0, "", "")
    assert [path.name for path in tmp_path.iterdir()] == ["loop.rrd"]


@pytest.mark.parametrize(
    ("suffix", "package", "extra"),
    [(".rrd", "rerun", "rerun"), (".mcap", "foxglove", "mcap")],
)
def test_without_the_extra(tmp_path, monkeypatch, suffix, package, extra):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtraError, match=rf"pip install 'fgplan\[{extra}\]'"):
        record_loop(HISTORY, tmp_path / f"loop{suffix}")
    assert not list(tmp_path.iterdir())


def test_bad_input(tmp_path):
    with pytest.raises(InvalidInputError, match=r"'loop\.bag': expected a name that ends in \.rrd"):
        record_loop(HISTORY, tmp_path / "loop.bag")
    with pytest.raises(InvalidInputError, match="at least one step"):
        list(loop_layers(replace(HISTORY, steps=())))


@pytest.mark.parametrize(("suffix", "package"), [(".rrd", "rerun"), (".mcap", "foxglove")])
def test_a_loop_without_steps_leaves_the_file_that_is_there(tmp_path, suffix, package):
    pytest.importorskip(package)
    path = tmp_path / f"loop{suffix}"
    path.write_bytes(b"earlier")
    with pytest.raises(InvalidInputError, match="expected at least one step to draw, got none"):
        record_loop(replace(HISTORY, steps=()), path)
    assert path.read_bytes() == b"earlier"


def test_measurements_count_whatever_integer_their_landmark_is():
    step = next(record for record in HISTORY.steps if record.measurements)
    one = step.measurements[0]
    of_numpy = replace(one, target=np.uint64(one.target))
    of_robot = replace(one, kind="robot", target="blue")
    history = replace(HISTORY, steps=(replace(step, measurements=(of_numpy, of_robot)),))
    (layers, *_) = loop_layers(history)
    assert len(layers.lines[f"{one.robot}/measurements"].lines) == 1
    assert first_seen(history) == {one.target: step.step}
    drawn = sightings(history, HISTORY.final, step.step, step.step)
    assert sum(map(len, drawn.values())) == 1


def test_rerun_puts_looks_where_poses_are_for_a_name_with_a_slash():
    rr = pytest.importorskip("rerun")
    logged = []
    stream = SimpleNamespace(log=lambda path, *_, **__: logged.append(list(path)))
    _log_looks(rr, stream, SimpleNamespace(robots=("team/red",)))
    assert [*_path("team/red/estimate"), "body"] in logged
    _log(rr, stream, Layers(step=0, time_s=0.0, numbers={"sigma_m/team/red": 1.0}))
    assert logged.count(["metrics", "sigma_m", "team", "red"]) == 2
    assert _path("team/red/estimate") == ["map", "team", "red", "estimate"]
