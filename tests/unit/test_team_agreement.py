"""A team agrees on the same paths and values whatever the network does."""

import itertools
import math
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from table_teams import ChoosingEvaluator, TableEvaluator, make_path, make_team, outcome

from fgplan.announcement.announcement import Announcement
from fgplan.announcement.ledger import Ledger
from fgplan.errors import (
    InvalidInputError,
    NoCandidatePathError,
    StaleAnnouncementError,
    UnknownNameError,
)
from fgplan.evaluation.evaluations import Evaluations
from fgplan.evaluation.objective import length_and_uncertainty
from fgplan.team.coordination import coordinate, set_up_team
from fgplan.team.envelope import Envelope, Inbox, decode_envelope
from fgplan.team.in_process import InProcessTransport, NetworkFaults, Partition
from fgplan.team.options import CoordinationOptions
from fgplan.team.refusal import Refusal
from fgplan.team.robot import step
from fgplan.team.robot_state import start_robot
from fgplan.team.status import decode_status


def test_nobody_can_improve_alone_and_the_objective_never_rises():
    announcements = 0
    for seed in range(10):
        problem, candidates, evaluator = make_team(4, seed=seed)
        agreement = coordinate(problem, candidates, evaluator)
        assert agreement.agreed
        announcements += len(agreement.values) - 1
        assert all(b < a * (1 - 1e-6) for a, b in itertools.pairwise(agreement.values))
        assert agreement.value == pytest.approx(evaluator.team_value(agreement.paths), rel=1e-12)
        for robot in problem.robots:
            for path in candidates[robot]:
                other = evaluator.team_value({**agreement.paths, robot: path})
                assert other >= agreement.value * (1 - 1e-6)
        assert not agreement.warnings
    assert announcements > 20


def test_round_zero_announces_the_shortest_and_first_value_counts_from_there():
    problem, candidates, evaluator = make_team(3, seed=1)
    agreement = coordinate(problem, candidates, evaluator)
    shortest = {r: min(paths, key=lambda path: path.length_m) for r, paths in candidates.items()}
    assert agreement.values[0] == pytest.approx(evaluator.team_value(shortest), rel=1e-12)
    opening = agreement.ledger.messages[:3]
    assert [message.robot for message in opening] == list(problem.robots)
    assert all(message.basis == {} and message.value is None for message in opening)
    assert all(m.path().length_m == shortest[m.robot].length_m for m in opening)


def test_turns_end_after_as_many_refusals_as_robots():
    problem, candidates, evaluator = make_team(4, seed=2)
    agreement = coordinate(problem, candidates, evaluator)
    tail = [record.announced for record in agreement.records[-5:]]
    assert tail == [True, False, False, False, False]
    # The last to announce finds that nobody else has changed: it refuses without evaluating.
    assert agreement.records[-1].robot == agreement.records[-5].robot
    assert agreement.records[-1].decision is None
    assert evaluator.calls == agreement.evaluations


def test_agreement_survives_loss_duplication_reordering_delay_and_partition():
    slower = lost = 0
    for seed in range(100):
        problem, candidates, evaluator = make_team(2 + seed % 4, seed=seed)
        options = CoordinationOptions(
            order="random" if seed % 2 else "fixed",
            seed=seed,
            repair_after_s=0.5,
            lost_after_s=8.0 if seed % 4 < 2 else math.inf,  # the partition is shorter
        )
        plain = coordinate(problem, candidates, evaluator, options=options)
        robots = problem.robots
        faults = NetworkFaults(
            loss=0.3,
            duplication=0.2,
            reordering=0.3,
            delay_s=(0.01, 0.2),
            partitions=(Partition(0.1, 4.0, (robots[:1], robots[1:])),),
        )
        network = InProcessTransport(robots, faults, np.random.default_rng(seed))
        faulty = coordinate(problem, candidates, evaluator, options=options, transport=network)
        assert plain.agreed
        assert outcome(faulty) == outcome(plain)
        slower += faulty.clock_s > 4.0
        lost += sum(kind.lost for kind in network.traffic.kinds.values())
    assert slower > 50
    assert lost > 1000


def test_simultaneous_answers_survive_faults_too():
    for seed in range(20):
        problem, candidates, evaluator = make_team(3, seed=seed)
        options = CoordinationOptions(turns=False)
        plain = coordinate(problem, candidates, evaluator, options=options)
        faults = NetworkFaults(loss=0.3, duplication=0.2, reordering=0.5, delay_s=(0.0, 0.1))
        network = InProcessTransport(problem.robots, faults, np.random.default_rng(seed))
        faulty = coordinate(problem, candidates, evaluator, options=options, transport=network)
        assert plain.agreed
        assert outcome(faulty) == outcome(plain)


def swap_team():
    """Two robots, two places: each prefers the place where the other is not."""
    problem, candidates, evaluator = make_team(2, candidates=2)
    candidates = {
        robot: (make_path(robot, 0, 5.0), make_path(robot, 1, 5.0)) for robot in problem.robots
    }
    evaluator.pairs = {problem.robots: np.array([[10.0, 0.0], [0.0, 10.0]])}
    return problem, candidates, evaluator


def test_without_the_basis_two_robots_swap_for_ever():
    problem, candidates, evaluator = swap_team()
    options = CoordinationOptions(turns=False, use_basis=False, max_turns=50)
    agreement = coordinate(problem, candidates, evaluator, options=options)
    assert not agreement.agreed
    assert agreement.turns == 50
    assert len(agreement.values) == 1 + 2 * 50
    assert evaluator.team_value(agreement.paths) == pytest.approx(120.0, rel=1e-12)
    assert any("no agreement within 50 turns" in text for text in agreement.warnings)


def test_with_the_basis_the_earlier_robot_wins_and_the_swap_ends():
    problem, candidates, evaluator = swap_team()
    options = CoordinationOptions(turns=False, max_turns=50)
    agreement = coordinate(problem, candidates, evaluator, options=options)
    assert agreement.agreed
    assert agreement.chosen == {"r0": 1, "r1": 0}
    assert agreement.values == (120.0, 110.0)
    assert agreement.stale == 1
    assert agreement.turns == 2


def test_random_order_is_the_same_at_every_robot_and_seeded():
    problem, candidates, evaluator = make_team(5, seed=4)
    orders = []
    for seed in (0, 0, 1):
        options = CoordinationOptions(order="random", seed=seed)
        agreement = coordinate(problem, candidates, evaluator, options=options)
        assert agreement.agreed
        orders.append([record.robot for record in agreement.records])
        rounds = [orders[-1][i : i + 5] for i in range(5, len(orders[-1]) - 4, 5)]
        assert all(sorted(names) == sorted(problem.robots) for names in rounds)
    assert orders[0] == orders[1]
    assert orders[0] != orders[2]


def test_evaluator_that_chooses_gives_the_same_agreement():
    problem, candidates, evaluator = make_team(4, seed=5)
    choosing = ChoosingEvaluator(problem.robots, evaluator.pairs)
    expected = outcome(coordinate(problem, candidates, evaluator))
    for choose in (True, False):
        options = CoordinationOptions(choose=choose)
        assert outcome(coordinate(problem, candidates, choosing, options=options)) == expected


def test_tolerance_keeps_the_path():
    problem, candidates, evaluator = make_team(3, seed=6)
    options = CoordinationOptions(tolerance=10.0)
    agreement = coordinate(problem, candidates, evaluator, options=options)
    assert agreement.turns == 3
    assert len(agreement.values) == 1


def test_robot_without_candidates_is_named_or_stays():
    problem, candidates, evaluator = make_team(3, seed=7)
    candidates = {robot: paths for robot, paths in candidates.items() if robot != "r1"}
    with pytest.raises(NoCandidatePathError, match=r"robot 'r1'.*without_path='stay'"):
        coordinate(problem, candidates, evaluator)
    options = CoordinationOptions(without_path="stay")
    agreement = coordinate(problem, candidates, evaluator, options=options)
    assert agreement.agreed
    assert set(agreement.paths) == set(agreement.chosen) == {"r0", "r2"}
    assert agreement.ledger.basis()["r1"] == 1
    assert "robot 'r1' has no candidate path" in agreement.warnings[0]
    faults = NetworkFaults(loss=0.3, delay_s=(0.0, 0.1))
    network = InProcessTransport(problem.robots, faults, np.random.default_rng(0))
    faulty = coordinate(problem, candidates, evaluator, options=options, transport=network)
    assert outcome(faulty) == outcome(agreement)


def test_one_robot_and_team_without_any_candidate():
    problem, candidates, evaluator = make_team(1, seed=8)
    agreement = coordinate(problem, candidates, evaluator)
    assert agreement.agreed
    assert agreement.chosen == {"r0": int(np.argmin([p.length_m for p in candidates["r0"]]))}
    options = CoordinationOptions(without_path="stay")
    nobody = coordinate(problem, {}, evaluator, options=options)
    assert nobody.agreed
    assert nobody.paths == {}
    assert np.isnan(nobody.value)


def test_candidates_of_an_unknown_robot_are_refused():
    problem, candidates, evaluator = make_team(2)
    with pytest.raises(UnknownNameError, match="robot 'ghost' is not one of r0, r1"):
        coordinate(problem, {**candidates, "ghost": ()}, evaluator)


def test_permanent_partition_ends_at_the_time_limit():
    problem, candidates, evaluator = make_team(2)
    faults = NetworkFaults(partitions=(Partition(0.0, 1e9, (("r0",), ("r1",))),))
    network = InProcessTransport(problem.robots, faults, np.random.default_rng(0))
    options = CoordinationOptions(time_limit_s=30.0)
    agreement = coordinate(problem, candidates, evaluator, options=options, transport=network)
    assert not agreement.agreed
    assert "no agreement within 30 s" in agreement.warnings[0]


def test_rising_objective_is_an_error_or_a_warning():
    problem, candidates, evaluator = make_team(3, seed=0)

    class Drifting(TableEvaluator):
        """Every evaluation adds to the objective: not exact."""

        def evaluate(self, state, announced):
            state, found = super().evaluate(state, announced)
            return state, Evaluations(
                robot=found.robot,
                values=found.values + 50.0 * self.calls,
                terms=found.terms,
                report=found.report,
            )

    drifting = Drifting(problem.robots, evaluator.pairs)
    with pytest.raises(InvalidInputError, match="value: expected at most"):
        coordinate(problem, candidates, drifting)
    options = CoordinationOptions(check_values=False)
    agreement = coordinate(problem, candidates, drifting, options=options)
    assert any("rose" in text for text in agreement.warnings)


def test_value_of_the_announced_candidate_must_be_finite():
    problem, candidates, evaluator = make_team(2, seed=2)

    class Excluding(TableEvaluator):
        def evaluate(self, state, announced):
            state, found = super().evaluate(state, announced)
            values = np.where(np.arange(found.values.size) == found.best, found.values, np.inf)
            return state, Evaluations(
                robot=found.robot, values=values, terms=found.terms, report=found.report
            )

    with pytest.raises(InvalidInputError, match="evaluator 'table': expected finite values"):
        coordinate(problem, candidates, Excluding(problem.robots, evaluator.pairs))


def test_progress_hears_every_entry():
    problem, candidates, evaluator = make_team(3, seed=3)
    heard = []
    agreement = coordinate(problem, candidates, evaluator, progress=heard.append)
    assert heard == list(agreement.records)


def test_bytes_by_reference_are_the_bytes_on_the_wire():
    problem, candidates, evaluator = make_team(3, seed=3)
    by_reference = coordinate(problem, candidates, evaluator).traffic.kinds
    network = InProcessTransport(problem.robots, NetworkFaults(), np.random.default_rng(0))
    by_bytes = coordinate(problem, candidates, evaluator, transport=network).traffic.kinds
    assert by_reference == by_bytes
    counts = by_reference["announcement"]
    assert counts.delivered == 2 * counts.sent
    assert counts.delivered_bytes == 2 * counts.sent_bytes > 0


# Single steps, with what only a broken or foreign teammate would send.


def two_states(**options):
    problem, candidates, evaluator = make_team(2, seed=3)
    setups = set_up_team(problem, candidates, evaluator, options=CoordinationOptions(**options))
    return [start_robot(setup) for setup in setups.values()]


def test_step_leaves_the_state_as_it_was():
    first, _ = two_states()
    after, outbox = step(first, Inbox(0.0))
    assert first.turn == 0
    assert first.pending == {}
    assert set(after.pending) == {"r0"}
    assert [item.to for item in outbox] == [None]
    again, outbox_again = step(first, Inbox(0.0))
    assert outbox_again[0].envelope == outbox[0].envelope
    assert again.pending == after.pending


def test_foreign_envelopes_are_dropped_and_counted():
    first, second = two_states()
    _, (opening,) = step(second, Inbox(0.0))
    foreign = msgspec.structs.replace(opening.envelope, session=7)
    stranger = msgspec.structs.replace(opening.envelope, robot="ghost")
    ask = Envelope(robot="ghost", session=0, sequence=0, kind="status")
    after, outbox = step(first, Inbox(0.0, (foreign, stranger, ask)))
    assert after.dropped == 3
    assert len(outbox) == 1


def test_wrong_writer_kind_basis_prior_and_objective_are_errors():
    first, second = two_states()
    second, (opening,) = step(second, Inbox(0.0))
    received = decode_envelope(opening.envelope.encoded)
    first, (own, *_) = step(first, Inbox(0.0))
    for change, error, words in (
        ({"kind": "gossip"}, InvalidInputError, "turn 0 of robot 'r1': kind"),
        ({"payload": b"\x81"}, InvalidInputError, "message of robot 'r1'"),
        ({"payload": own.envelope.payload}, InvalidInputError, "expected those of the envelope"),
        ({"kind": "withdrawal"}, InvalidInputError, "kind: expected what the envelope says"),
        ({"sequence": 1}, InvalidInputError, "expected an entry of turn 0"),
    ):
        wrong = msgspec.structs.replace(received, **change)
        with pytest.raises(error, match=words):
            step(first, Inbox(0.0, (wrong,)))
    message = opening.envelope.content
    assert isinstance(message, Announcement)
    for change, words in (
        ({"prior_digest": "other"}, "announcement 1 of robot 'r1': prior_digest"),
        ({"terms": ()}, "announcement 1 of robot 'r1': terms"),
    ):
        payload = msgspec.structs.replace(message, **change).encoded
        wrong = msgspec.structs.replace(received, payload=payload)
        with pytest.raises(InvalidInputError, match=words):
            step(first, Inbox(0.0, (wrong,)))
    joined, _ = step(first, Inbox(0.0, (received,)))
    assert joined.turn == 2  # round 0 and its own turn are over
    refusal = Envelope(
        robot="r1",
        session=0,
        sequence=2,
        kind="refusal",
        basis={"r0": 9, "r1": 1},
        parent=joined.log.head,
    )
    bad = msgspec.structs.replace(refusal, payload=b"\x80")  # no schema
    with pytest.raises(InvalidInputError, match="refusal of robot 'r1'"):
        step(joined, Inbox(0.0, (bad,)))
    empty = msgspec.msgpack.encode({"schema": "refusal.v1"})
    with pytest.raises(StaleAnnouncementError, match="turn 2 of robot 'r1': computed from"):
        step(joined, Inbox(0.0, (msgspec.structs.replace(refusal, payload=empty),)))
    infinite = msgspec.msgpack.encode({"schema": "refusal.v1", "value": float("inf")})
    with pytest.raises(InvalidInputError, match="value: expected a finite number"):
        step(joined, Inbox(0.0, (msgspec.structs.replace(refusal, payload=infinite),)))


def test_entry_of_a_robot_whose_turn_it_is_not_is_an_error():
    problem, candidates, evaluator = make_team(3, seed=3)
    setups = set_up_team(problem, candidates, evaluator)
    states = [start_robot(setup) for setup in setups.values()]
    openings = [step(state, Inbox(0.0))[1][0].envelope for state in states]
    waiting, _ = step(states[2], Inbox(0.0, tuple(openings[:2])))
    assert (waiting.turn, waiting.pending) == (1, {})
    wrong = Envelope(
        robot="r1",
        session=0,
        sequence=1,
        kind="refusal",
        parent=waiting.log.head,
        payload=Refusal().encoded,
    )
    with pytest.raises(InvalidInputError, match="expected entries of r0, got one of robot 'r1'"):
        step(waiting, Inbox(0.0, (wrong,)))


def test_silence_is_asked_about_and_answered():
    first, second = two_states(repair_after_s=1.0)
    first, _ = step(first, Inbox(0.0))
    second, _ = step(second, Inbox(0.0))
    quiet, outbox = step(first, Inbox(0.5))
    assert outbox == ()
    asking, (ask,) = step(quiet, Inbox(1.0))
    assert (ask.envelope.kind, ask.to, ask.envelope.sequence) == ("status", None, 0)
    assert decode_status(ask.envelope).ask == "r1"
    assert asking.wake_s == 3.0
    _, (answer,) = step(second, Inbox(0.9, (ask.envelope,)))
    assert answer.to == "r0"
    assert answer.envelope.kind == "announcement"
    joined, _ = step(asking, Inbox(1.1, (answer.envelope,)))
    assert joined.turn == 2


def test_options_refuse_what_makes_no_sense():
    for options, words in (
        ({"order": "alphabetic"}, "order"),
        ({"without_path": "ignore"}, "without_path"),
        ({"tolerance": -1.0}, "tolerance"),
        ({"max_turns": 0}, "max_turns"),
        ({"use_basis": False}, "use_basis"),
        ({"lost_after_s": 3.9}, "lost_after_s: expected at least four times"),
        ({"lost_after_s": 4.0, "turns": False}, "lost_after_s: expected infinite"),
        ({"drop_after_s": 4.0}, "drop_after_s: expected at least lost_after_s"),
        ({"hung_after_s": 4.0}, "hung_after_s: expected at least lost_after_s"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            CoordinationOptions(**options)


def test_value_of_the_ledger_is_that_of_the_agreement():
    problem, candidates, evaluator = make_team(2, seed=2)
    agreement = coordinate(problem, candidates, evaluator)
    assert isinstance(agreement.ledger, Ledger)
    assert agreement.ledger.value == agreement.value


def test_second_session_over_one_transport_ignores_late_copies_of_the_first():
    problem, candidates, evaluator = make_team(3, seed=2)
    faults = NetworkFaults(duplication=0.8, reordering=0.8, reordering_s=5.0, delay_s=(0.0, 0.1))
    network = InProcessTransport(problem.robots, faults, np.random.default_rng(0))
    for session in range(3):
        options = CoordinationOptions(session=session)
        plain = coordinate(problem, candidates, evaluator, options=options)
        again = coordinate(problem, candidates, evaluator, options=options, transport=network)
        assert outcome(again) == outcome(plain)
        assert again.clock_s < network.now() or session == 0


def test_another_objective_is_found_out_within_one_process_too():
    problem, candidates, evaluator = make_team(2, seed=3)
    other = SimpleNamespace(
        **{**vars(problem), "objective": length_and_uncertainty(problem.robots, path_weight=0.2)}
    )
    mine = set_up_team(problem, candidates, evaluator)
    theirs = set_up_team(other, candidates, evaluator)
    _, (opening,) = step(start_robot(theirs["r1"]), Inbox(0.0))
    with pytest.raises(InvalidInputError, match="robot 'r1': terms"):
        step(start_robot(mine["r0"]), Inbox(0.0, (opening.envelope,)))
