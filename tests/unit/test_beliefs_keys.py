import gtsam
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fgplan.errors import InvalidInputError
from fgplan.factors.keys import (
    check_no_future_keys,
    describe_key,
    describe_keys,
    future_key,
    is_future_key,
)


def test_describe_key_reads_as_its_maker_wrote_it():
    assert describe_key(gtsam.symbol("x", 12)) == "x12"
    assert describe_key(gtsam.LabeledSymbol(ord("a"), ord("B"), 3).key()) == "aB3"
    assert describe_key(0) == "0"
    assert describe_key(6969) == "6969"
    assert describe_key(2**63) == str(2**63)
    assert describe_key(future_key(3, 7)) == "~3.7"


@given(st.integers(0, 2**64 - 1))
def test_describe_key_never_fails_and_agrees_with_gtsam_on_symbols(key):
    name = describe_key(key)
    assert name.isprintable()
    character, rest = key >> 56, key & (2**56 - 1)
    if character == 0:
        assert name == gtsam.DefaultKeyFormatter(key)
    if chr(character).isalpha() and character < 127 and rest < 2**31:
        assert name == gtsam.DefaultKeyFormatter(key)


def test_describe_keys_stops_at_the_limit():
    assert describe_keys([1, 2]) == "1, 2"
    assert describe_keys(range(9), limit=2) == "0, 1 and 7 more"


def test_future_key_is_a_labelled_symbol_and_unique():
    keys = {future_key(r, s) for r in (0, 1, 65, 255) for s in (1, 2, 2**32, 2**48 - 1)}
    assert len(keys) == 16
    assert all(is_future_key(key) for key in keys)
    symbol = gtsam.LabeledSymbol(future_key(65, 9))
    assert (symbol.chr(), symbol.label(), symbol.index()) == (ord("~"), 65, 9)


@pytest.mark.parametrize(
    ("robot", "step", "word"),
    [(-1, 1, "robot_index"), (256, 1, "robot_index"), (0, 0, "present pose"), (0, 2**48, "step")],
)
def test_future_key_refuses_what_would_clash(robot, step, word):
    with pytest.raises(InvalidInputError, match=word):
        future_key(robot, step)


def test_reserved_keys_of_the_user_are_refused_by_name():
    check_no_future_keys([gtsam.symbol("x", 1), 5])
    with pytest.raises(InvalidInputError, match=r"~2\.5 .* kept for fgplan"):
        check_no_future_keys([1, future_key(2, 5)])
    with pytest.raises(InvalidInputError, match="kept for fgplan"):
        check_no_future_keys([gtsam.symbol("~", 4)])
