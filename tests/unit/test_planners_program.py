"""Programs: what each participant makes by itself gives the plan that one process makes."""

import hashlib
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from fgplan.errors import InvalidInputError, NoCandidatePathError, UnknownNameError
from fgplan.io.mission_file import load_mission
from fgplan.planners.program import (
    DistributedPlanner,
    participants,
    run_programs,
    step_program,
)
from fgplan.planners.registry import find_planner
from fgplan.team.envelope import Inbox
from fgplan.team.in_process import InProcessTransport
from fgplan.team.loop import run_robots

SCENARIOS = Path(__file__).parents[2] / "examples" / "scenarios"
GATHERING = SCENARIOS / "distributed_gathering.toml"
DIGEST_OF_FIRST_MESSAGES = """
import hashlib, sys
import numpy as np
from fgplan.io.mission_file import load_mission
from fgplan.planners.registry import find_planner
from fgplan.team.envelope import Inbox

path, robot = sys.argv[1:]
mission = load_mission(path)
planner = find_planner("distributed_aia")
program = planner.program(mission, robot, np.random.default_rng(mission.seed))
_, outbox = program.step(program.state, Inbox(0.0))
print(hashlib.sha256(b"".join(one.envelope.encoded for one in outbox)).hexdigest())
"""


def over_the_wire(value):
    """Plain data as another process would read it."""
    return msgspec.msgpack.decode(msgspec.msgpack.encode(value))


def from_programs(planner, path, **changes):
    """The plan of programs that are each made of the file and the seed alone."""

    def mission():
        made = load_mission(path)
        return replace(made, options={**made.options, **changes})

    seed = mission().seed
    names = participants(planner, mission())
    programs = {
        name: planner.program(mission(), name, np.random.default_rng(seed)) for name in names
    }
    ended = run_programs(programs, InProcessTransport(names))
    assert all(program.finished for program in ended.values())
    reports = {name: over_the_wire(one.report(one.state)) for name, one in ended.items()}
    return planner.team_plan(mission(), reports, np.random.default_rng(seed)), ended


def without_work(plan):
    """A plan without what depends on who is faster."""
    data = plan.to_data()
    for name in ("seconds", "traffic", "report"):
        del data[name]
    data["details"].pop("bytes_per_node", None)
    return data


def test_robots_of_distributed_aia_made_one_by_one_give_the_plan_of_one_process():
    planner = find_planner("distributed_aia")
    mission = load_mission(GATHERING)
    generator = np.random.default_rng(mission.seed)
    expected = planner.plan(mission, generator)
    found, ended = from_programs(planner, GATHERING)
    assert without_work(found) == without_work(expected)
    done, total, doing = ended["bob"].progress(ended["bob"].state)
    assert (done, total) == (found.report["sweeps"], 5000)
    assert "worst target" in doing
    # One by one or all at once, over the same transport: the same to the last count.
    talking = replace(mission, options={**mission.options, "messages": True})
    talked = planner.plan(talking, np.random.default_rng(mission.seed))
    again, _ = from_programs(planner, GATHERING, messages=True)
    assert without_work(again) == without_work(talked)
    assert again.report == talked.report


def test_a_robot_made_in_a_process_of_its_own_says_the_same():
    mission = load_mission(GATHERING)
    planner = find_planner("distributed_aia")
    program = planner.program(mission, "dan", np.random.default_rng(mission.seed))
    assert program.participants == ("ann", "bob", "cat", "dan", "eve")
    assert set(program.seconds) == {"setup"}
    _, outbox = program.step(program.state, Inbox(0.0))
    here = hashlib.sha256(b"".join(one.envelope.encoded for one in outbox)).hexdigest()
    there = subprocess.run(
        [sys.executable, "-c", DIGEST_OF_FIRST_MESSAGES, str(GATHERING), "dan"],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert there.stdout.strip() == here


def test_a_robot_that_was_lost_leaves_the_plan_that_its_teammates_hold():
    planner = find_planner("distributed_aia")
    mission = load_mission(GATHERING)
    expected, ended = from_programs(planner, GATHERING)
    reports = {name: one.report(one.state) for name, one in ended.items() if name != "cat"}
    found = planner.team_plan(mission, reports, np.random.default_rng(mission.seed))
    assert found.to_data()["robots"] == expected.to_data()["robots"]
    assert not found.agreed


def test_reports_of_robots_without_a_plan_name_the_target_farthest_from_the_limit():
    with pytest.raises(NoCandidatePathError, match=r"times the limit, at target 't\d', the farth"):
        from_programs(find_planner("distributed_aia"), GATHERING, iterations=5)


def test_programs_that_cannot_be_made_are_refused():
    planner = find_planner("distributed_aia")
    mission = load_mission(GATHERING)
    with pytest.raises(UnknownNameError, match="'zoe': expected one of ann, bob"):
        planner.program(mission, "zoe", np.random.default_rng(0))
    beyond = replace(mission, options={**mission.options, "delta": 1e-30})
    with pytest.raises(NoCandidatePathError, match="no plan brings"):
        planner.program(beyond, "ann", np.random.default_rng(0))
    with pytest.raises(InvalidInputError, match="got none"):
        planner.team_plan(mission, {}, np.random.default_rng(0))
    with pytest.raises(InvalidInputError, match="report of robot 'bob'"):
        planner.team_plan(mission, {"bob": {"ending": 3}}, np.random.default_rng(0))
    assert isinstance(planner, DistributedPlanner)
    assert not isinstance(find_planner("greedy"), DistributedPlanner)


@pytest.mark.parametrize(("lost_in", "has_plan"), [(5, False), (38, True)])
def test_robots_of_distributed_aia_that_lose_one_report_what_they_have_and_end(lost_in, has_plan):
    planner = find_planner("distributed_aia")
    mission = load_mission(GATHERING)
    mission = replace(mission, options={**mission.options, "wait_s": 3.0})
    names = participants(planner, mission)
    made = {
        name: planner.program(mission, name, np.random.default_rng(mission.seed)) for name in names
    }

    gone = set()

    def lose_dan(program, inbox):
        """Dan is killed in that sweep: from then on he says nothing, and all see that."""
        if program.robot == "dan" and program.state.growth.sweep >= lost_in:
            gone.add("dan")
            return replace(program, state=replace(program.state, wake_s=np.inf)), ()
        present = frozenset(names) - {program.robot} - gone
        return step_program(program, Inbox(inbox.now_s, inbox.envelopes, present))

    ended = run_robots(made, lose_dan, InProcessTransport(names))
    alive = {name: one for name, one in ended.items() if name != "dan"}
    assert all(one.finished for one in alive.values())
    reports = {name: over_the_wire(one.report(one.state)) for name, one in alive.items()}
    if has_plan:
        plan = planner.team_plan(mission, reports, np.random.default_rng(mission.seed))
        assert not plan.agreed
        whole = planner.plan(mission, np.random.default_rng(mission.seed))
        assert plan.value == whole.value
    else:
        with pytest.raises(NoCandidatePathError, match="a robot was lost"):
            planner.team_plan(mission, reports, np.random.default_rng(mission.seed))
