"""``fgplan demo multi-robot-slam``: the quick run, going on with it, and (``full``) the whole."""

import argparse
import json
import time

import pytest

from fgplan.demos import multi_robot_slam as demo
from fgplan.demos.multi_robot_slam import FILM, RECORDINGS, add_arguments, multi_robot_slam
from fgplan.errors import InvalidInputError, MissingExtraError
from fgplan.io.command import CommandOptions
from fgplan.io.loop_folder import LOOP, read_loop
from fgplan.io.plain_value import plain_value
from fgplan.viz.figure import save
from fgplan.viz.loop_figures import loop_covariance_figure


def run(out, **options):
    return multi_robot_slam(CommandOptions(name="multi-robot-slam", out=out, **options))


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    out = tmp_path_factory.mktemp("demo")

    def one_figure(history, folder, _):  # all of them are tested elsewhere and take ten seconds
        return (save(loop_covariance_figure(history), folder / "position_covariance.png"),)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo, "draw_loop_figures", one_figure)
        patch.setattr(demo, "QUICK_FRAMES", 3)
        return _run_quick(out)


def _run_quick(out):
    return out, run(out, quick=True, arguments={"scenario": 1, "record": None})


def test_quick_demo_meets_its_requirements(quick):
    _, outcome = quick
    assert [requirement.name for requirement in outcome.requirements if not requirement.met] == []
    assert outcome.results["reached"] == dict.fromkeys(("red", "green", "blue", "purple"), 2)
    assert outcome.results["new_records"] > 10
    assert outcome.summary[0].startswith("scenario 1, seed 0: ")
    assert any("session 1 at step 0 (start)" in line for line in outcome.summary)
    json.dumps(plain_value(outcome.results))


def test_quick_demo_leaves_its_folder(quick):
    out, outcome = quick
    folder = out / "scenario-1-quick"
    assert (folder / LOOP).exists()
    assert {path.name for path in outcome.figures} >= {
        "red.tum",
        "position_covariance.png",
        FILM,
    }
    assert all(path.stat().st_size > 500 for path in outcome.figures)
    history, _ = read_loop(folder)
    assert history.final is not None
    assert sum(session.max_rel_diff is not None for session in history.sessions) == 2


def test_demo_goes_on_with_what_is_there(quick, monkeypatch):
    out, first = quick
    monkeypatch.setattr(demo, "_draw", lambda *_: ((), ()))
    path = out / "scenario-1-quick" / LOOP
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:8]))
    again = run(out, quick=True, arguments={"scenario": 1})
    assert again.results["new_records"] == len(lines) - 8
    assert again.results["steps"] == first.results["steps"]
    assert again.results["position_error_m"] == first.results["position_error_m"]
    assert run(out, quick=True).results["new_records"] == 0


@pytest.mark.parametrize("format_", RECORDINGS)
def test_demo_writes_the_recording_that_is_asked_for(quick, monkeypatch, format_):
    out, _ = quick
    written = []
    monkeypatch.setattr(demo, "draw_loop_figures", lambda *_: ())
    monkeypatch.setattr(demo, "animate_loop", lambda _, path, **__: path)
    monkeypatch.setattr(
        demo, "record_loop", lambda history, path, **_: written.append((history, path)) or path
    )
    outcome = run(out, quick=True, arguments={"scenario": 1, "record": format_})
    [(history, path)] = written
    assert path == out / "scenario-1-quick" / RECORDINGS[format_]
    assert path in outcome.figures
    assert history.final is not None


def test_demo_without_matplotlib_says_so(quick, monkeypatch):
    def missing(*_, **__):
        raise MissingExtraError("figures need matplotlib")

    monkeypatch.setattr(demo, "draw_loop_figures", missing)
    out, _ = quick
    assert run(out, quick=True).summary[-1] == "no figures: figures need matplotlib"


def test_demo_without_a_folder_is_refused():
    with pytest.raises(InvalidInputError, match="expected a run folder"):
        run(None, quick=True)


def test_demo_has_its_arguments():
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    assert vars(parser.parse_args([])) == {"scenario": 1, "record": None}
    chosen = parser.parse_args(["--scenario", "3", "--record", "rerun"])
    assert (chosen.scenario, chosen.record) == (3, "rerun")


@pytest.mark.full
@pytest.mark.timeout(600)
def test_whole_demo(tmp_path):
    began = time.perf_counter()
    outcome = run(tmp_path)
    assert [requirement.name for requirement in outcome.requirements if not requirement.met] == []
    assert outcome.results["reached"] == dict.fromkeys(("red", "green", "blue", "purple"), 3)
    assert time.perf_counter() - began < 300.0
