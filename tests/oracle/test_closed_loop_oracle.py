"""In every session of a closed loop: values and choices as from scratch by QR."""

from dataclasses import replace

import closed_loop_worlds as worlds
import numpy as np
import pytest

from fgplan.closed_loop.comparison import EXECUTED, OURS, Contestant
from fgplan.closed_loop.loop import run_loop
from fgplan.evaluation.from_scratch import FromScratch
from fgplan.evaluation.incremental.evaluator import Incremental
from fgplan.models.range_bearing import BearingRangeSensor

TOLERANCE = 1e-9
SHORT_SIGHTED = BearingRangeSensor(bearing_sigma_rad=0.01, range_sigma_m=0.2, max_range_m=9.0)
CONTESTANTS = {
    **OURS,
    "incremental": Contestant(Incremental(), carries=True),
    "fresh": Contestant(Incremental(), choose=True),
    "from_scratch": Contestant(FromScratch(elimination="qr")),
}

CASES = {
    "plain": {},
    "no factors between robots": {"multi_robot": ()},
    "own landmarks": {"others_landmarks": False},
    "always relinearised": {"relinearise_m": 0.0},
    "hardly ever relinearised": {"relinearise_m": 5.0},
    "short-sighted": {"sensor": SHORT_SIGHTED, "landmarks": 20},
    "loose start": {"start_sigma": 3.0},
    "robots measure each other": {"measured": {"meet": worlds.MEETING}},
}


@pytest.mark.parametrize("name", CASES)
def test_values_and_choices_are_those_of_from_scratch(name):
    mission = worlds.small_mission(1, **CASES[name])
    records = list(run_loop(mission, contestants=CONTESTANTS, compare=True))
    sessions = worlds.sessions_of(records)
    assert len(sessions) >= 3
    assert worlds.reached(records) == {"ann": 2, "bob": 2}
    for session in sessions:
        assert session.max_rel_diff <= TOLERANCE
        want = session.runs["from_scratch"]
        for run in session.runs.values():
            assert run.chosen == want.chosen
            np.testing.assert_allclose(run.objective, want.objective, rtol=TOLERANCE)
        assert session.chosen_index == want.chosen
        np.testing.assert_allclose(session.values[-1], want.objective, rtol=TOLERANCE)
    assert any(sum(session.candidates_kept.values()) > 0 for session in sessions)
    assert any(session.counts["landmark_factors"] > 0 for session in sessions)


def test_what_is_carried_is_used_and_changes_no_choice():
    mission = worlds.small_mission(1, sensor=SHORT_SIGHTED, landmarks=20)
    with_carry = list(run_loop(mission))
    alone = {EXECUTED: replace(OURS[EXECUTED], carries=False)}
    without = list(run_loop(mission, contestants=alone))
    reused = 0
    for one, other in zip(worlds.sessions_of(with_carry), worlds.sessions_of(without), strict=True):
        assert one.chosen_index == other.chosen_index
        np.testing.assert_allclose(one.values, other.values, rtol=TOLERANCE)
        assert sum(other.segments_reused.values()) == 0
        reused += sum(
            one.segments_reused[robot] for robot, kept in one.candidates_kept.items() if kept
        )
    assert reused > 0


@pytest.mark.full
@pytest.mark.parametrize("seed", range(2, 12))
def test_ten_more_worlds(seed):
    mission = worlds.small_mission(seed, candidates=10, measured={"meet": worlds.MEETING})
    for session in worlds.sessions_of(run_loop(mission, contestants=CONTESTANTS, compare=True)):
        assert session.max_rel_diff <= TOLERANCE
        assert session.chosen_index == session.runs["from_scratch"].chosen
