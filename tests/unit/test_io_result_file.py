"""Result files: plain JSON, written whole or not at all."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from fgplan.errors import InvalidInputError
from fgplan.io.command import CommandOptions
from fgplan.io.plain_value import plain_value
from fgplan.io.result_file import (
    Requirement,
    ResultFile,
    read_result,
    replace_file,
    require_at_least,
    require_at_most,
    require_true,
    write_result,
)


@dataclass(frozen=True)
class Inner:
    where: np.ndarray
    names: tuple[str, ...]


def test_products_become_plain_values():
    value = {
        "array": np.arange(4.0).reshape(2, 2),
        "scalar": np.float64(2.5),
        "count": np.int64(3),
        "flag": np.bool_(True),
        3: [None, "text", Path("a/b")],
        "inner": Inner(np.array([1, 2]), ("x",)),
        "set": {2, 1},
    }
    assert plain_value(value) == {
        "array": [[0.0, 1.0], [2.0, 3.0]],
        "scalar": 2.5,
        "count": 3,
        "flag": True,
        "3": [None, "text", "a/b"],
        "inner": {"where": [1, 2], "names": ["x"]},
        "set": [1, 2],
    }


def test_numbers_that_json_lacks_become_null():
    assert plain_value([math.inf, math.nan, np.array([-math.inf])]) == [None, None, [None]]


def test_what_has_no_plain_form_is_refused_by_place():
    with pytest.raises(InvalidInputError, match=r"result\.rounds\[1\]: .* got object"):
        plain_value({"rounds": [1, object()]})


def test_result_file_has_the_documented_keys_and_reads_back(tmp_path):
    path = tmp_path / "deep" / "result.json"
    result = ResultFile(
        command="fgplan bench impacted --quick",
        seeds=(0, 1),
        results={"ratio": np.float64(3.0), "robots": 2},
        requirements=(require_at_least("ratio", 3.0, 12.0),),
    )
    write_result(path, result)
    content = json.loads(path.read_text())
    assert list(content) == [
        "schema",
        "command",
        "versions",
        "machine",
        "date",
        "seeds",
        "results",
        "requirements",
        "complete",
        "stopped",
    ]
    assert content["requirements"] == [
        {"name": "ratio", "required": "at least 12", "value": 3.0, "met": False}
    ]
    assert {"python", "gtsam", "numpy"} <= set(content["versions"])
    again = read_result(path)
    assert again.results == {"ratio": 3.0, "robots": 2}
    assert again.seeds == (0, 1)
    assert again.unmet == (Requirement(name="ratio", required="at least 12", value=3.0, met=False),)
    assert [p.name for p in path.parent.iterdir()] == ["result.json"]


def test_a_value_that_cannot_be_written_leaves_the_old_file(tmp_path):
    path = tmp_path / "result.json"
    write_result(path, ResultFile(command="first"))
    with pytest.raises(InvalidInputError):
        write_result(path, ResultFile(command="second", results={"bad": object()}))
    assert read_result(path).command == "first"


def test_requirements_judge_numbers():
    assert require_at_least("a", 12.0, 12.0).met
    assert not require_at_least("a", math.nan, 12.0).met
    assert require_at_most("a", 1.5, 1.5).met
    assert not require_at_most("a", math.nan, 1.5).met
    assert not require_true("a", np.bool_(False)).met
    assert require_at_most("a", 1.0, 1.5).required == "at most 1.5"


@pytest.mark.parametrize("text", ["{", "[]", '{"command": 3}', '{"seeds": []}'])
def test_other_json_is_refused_by_file(tmp_path, text):
    path = tmp_path / "result.json"
    path.write_text(text)
    with pytest.raises(InvalidInputError, match=r"result\.json: expected a result file of fgplan"):
        read_result(path)


def test_absent_and_newer_files_are_refused(tmp_path):
    with pytest.raises(InvalidInputError, match="readable result file"):
        read_result(tmp_path / "absent.json")
    newer = tmp_path / "newer.json"
    write_result(newer, ResultFile(command="x", schema=2))
    with pytest.raises(InvalidInputError, match="schema 1, got 2"):
        read_result(newer)


def test_unwritable_place_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InvalidInputError, match="place to write to"):
        replace_file(tmp_path / "file" / "result.json", b"{}")


def test_seed_range_prefers_what_is_asked_for():
    assert CommandOptions().seed_range(5) == (0, 1, 2, 3, 4)
    assert CommandOptions(quick=True).seed_range(5, 2) == (0, 1)
    assert CommandOptions(quick=True, seeds=3).seed_range(5, 2) == (0, 1, 2)
    assert CommandOptions(seeds=2, first_seed=100).seed_range(5) == (100, 101)
