"""Styles tell sixteen robots apart."""

import pytest

from fgplan.errors import InvalidInputError
from fgplan.viz.palette import ADDED, LIMIT, NAMED_COLORS, REMOVED, UNCHANGED, robot_styles


def test_sixteen_robots_look_different():
    styles = robot_styles([f"r{i}" for i in range(LIMIT)])
    assert LIMIT == 16
    assert len(set(styles.values())) == 16
    assert not {style.color for style in styles.values()} & {UNCHANGED, REMOVED, ADDED}
    assert list(robot_styles([f"r{i}" for i in range(40)])) == [f"r{i}" for i in range(40)]


def test_a_robot_keeps_its_look_when_others_join():
    assert robot_styles(["a", "b"])["b"] == robot_styles(["a", "b", "c"])["b"]


def test_names_are_unique():
    with pytest.raises(InvalidInputError, match="unique robot names"):
        robot_styles(["a", "a"])


def test_robots_called_by_colours():
    styles = robot_styles(["purple", "red"])
    assert {name: style.color for name, style in styles.items()} == {
        "purple": NAMED_COLORS["purple"],
        "red": NAMED_COLORS["red"],
    }
    assert not set(NAMED_COLORS.values()) & {UNCHANGED, REMOVED, ADDED}
    # Not all are called by a colour: then none of them is.
    assert robot_styles(["red", "r2"])["red"] == robot_styles(["r1", "r2"])["r1"]
