"""Styles tell sixteen robots apart."""

import pytest

from fgplan.errors import InvalidInputError
from fgplan.viz.palette import ADDED, LIMIT, REMOVED, UNCHANGED, robot_styles


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
