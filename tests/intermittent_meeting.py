"""A robot of an intermittently connected team at a meeting, by steps of the robots alone."""

import numpy as np
from hostile_messages import letter_of
from intermittent_scenes import block_model, estimate_of, room

from fgplan.planners.intermittent import robot as intermittent
from fgplan.planners.intermittent.estimate import Record
from fgplan.planners.intermittent.geodesic_way import geodesic_cells
from fgplan.planners.intermittent.meeting_points import plan_meeting_point
from fgplan.planners.intermittent.message import Sensed, wrap
from fgplan.planners.intermittent.options import SegmentOptions
from fgplan.planners.intermittent.robot_state import TeamSetup
from fgplan.planners.intermittent.robot_state import start_robot as start_intermittent
from fgplan.planners.intermittent.schedule import make_schedule
from fgplan.planners.intermittent.team_graph import propose_teams
from fgplan.planners.intermittent.team_run import first_legs
from fgplan.planners.intermittent.truth import draw_truth
from fgplan.team.envelope import Inbox
from roadmaps import sample_positions


def at_a_meeting(meetings):
    """Three robots, the first at a meeting after so many; its state and what it is told there."""
    graph = propose_teams(3)
    setup = TeamSetup(
        schedule=make_schedule(graph),
        model=block_model(3),
        workspace=room(),
        grid=geodesic_cells(room(), 0.5),
        options=SegmentOptions(samples=60, explore=30, delta=0.05, step_m=0.5, range_m=0.3),
        planner=plan_meeting_point,
    )
    places = sample_positions(room(), 3, np.random.default_rng(1))
    start = estimate_of(3)
    starts = dict(zip(graph.robots, places, strict=True))
    legs = first_legs(setup, starts, start)
    states = {name: start_intermittent(setup, name, legs[name], start) for name in setup.robots}
    truth = draw_truth(setup.model.hidden, start.mean, 60, setup.model, 3, np.random.default_rng(0))
    victim, letters, mail = setup.robots[0], [], {name: [] for name in setup.robots}

    def step(name, *envelopes):
        states[name], outbox = intermittent.step(states[name], Inbox(0.0, envelopes))
        for outgoing in outbox:
            for other in setup.robots:
                if other != name:
                    letter = letter_of(outgoing.envelope.encoded)
                    mail[other].append(letter)
                    if other == victim:
                        letters.append((name, letter))

    def talk():
        while any(mail.values()):
            for name in setup.robots:
                waiting, mail[name] = mail[name], []
                if waiting:
                    step(name, *waiting)

    for now in range(1, 61):
        letters.clear()
        for row, name in enumerate(setup.robots):
            place = intermittent.place_at(states[name], now)
            readings = setup.model.measure(row, truth.states[now], place, truth.normals[now, row])
            record = Record(now, (float(place[0]), float(place[1])), readings)
            step(name, wrap(name, 0, now, Sensed(record)))
        before = states[victim]
        talk()
        for _ in range(2):  # who leads plans, and tells the others
            for name in setup.robots:
                step(name)
            talk()
        ours = [letter for letter in letters if letter[1].session == before.leg.team]
        if ours and before.phase == "meeting" and len(before.meetings) >= meetings:
            return before, ours
    raise AssertionError("expected a meeting")
