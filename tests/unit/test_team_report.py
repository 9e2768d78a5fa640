"""What a robot hands in travels as bytes and says the same; recorded turns are replayed."""

import msgspec
import pytest
from faulty_teams import FaultyTeam
from table_teams import make_team

from fgplan.errors import InvalidInputError, StaleAnnouncementError
from fgplan.team.coordination import set_up_team
from fgplan.team.replay import replay_turns
from fgplan.team.report import decode_report, encode_report, report_of


@pytest.fixture(name="team", scope="module")
def team_that_agreed():
    problem, candidates, evaluator = make_team(3, seed=4)
    return FaultyTeam(set_up_team(problem, candidates, evaluator)).run(10.0)


def test_report_is_the_same_after_it_travelled(team):
    report = report_of(team.states["r1"])
    read = decode_report(encode_report(report))
    assert read.ledger.encode() == report.ledger.encode()
    assert (read.head, read.turn, read.chosen) == (report.head, report.turn, report.chosen)
    assert read.records == report.records
    assert any(record.decision is not None for record in read.records)
    assert [entry.encoded for entry in read.entries] == [e.encoded for e in report.entries]


def test_reports_that_are_none_are_refused(team):
    data = encode_report(report_of(team.states["r0"]))
    plain = msgspec.msgpack.decode(data)
    stale = {**plain, "ledger": {**plain["ledger"], "messages": plain["ledger"]["messages"][1:]}}
    for wrong in (b"", data[:60], b"\x93" * 1000, msgspec.msgpack.encode({**plain, "turn": "x"})):
        with pytest.raises(InvalidInputError, match="report"):
            decode_report(wrong)
    with pytest.raises(
        StaleAnnouncementError
    ):  # its messages are accepted again, one after the other
        decode_report(msgspec.msgpack.encode(stale))


def test_replay_finds_what_was_stated_and_notices_what_is_not_in_order(team):
    report = report_of(team.states["r2"])
    log, turns = replay_turns(team.setups, report.entries)
    assert log.head.hex() == report.head
    assert turns
    assert all(turn.found == turn.stated for turn in turns)
    announced = [turn for turn in turns if turn.announced]
    assert all(turn.best == turn.found for turn in announced)
    with pytest.raises(InvalidInputError, match="replay: expected an entry that goes on from"):
        replay_turns(team.setups, report.entries[:4] + report.entries[5:])
