"""What fgplan reproduce tzes-table1 asks of its rows."""

import numpy as np
import pytest

from fgplan.errors import InvalidInputError
from fgplan.reproduce.tzes_table1.command import (
    ALONE,
    PUBLISHED,
    figure_3_rows,
    plan_row,
    read_rows,
    summary,
)
from fgplan.reproduce.tzes_table1.horizon_order import blocks_of_ten, inversions, requirements

FORMS = ("published", "information", "seen", "block")


def row_of(size, **changes):
    """A row in which everything is as it should be."""
    row = {"robots": size[0], "targets": size[1], "trials": 10, "degree": 5.0}
    horizons = {"centralised": 10.0, "all_to_all": 12.0, "connected": 14.0}
    if size in ALONE:
        horizons["none"] = 40.0
    for name, horizon in horizons.items():
        row |= {f"horizon_{name}": horizon, f"solved_{name}": 10}
    for form in FORMS:
        row |= {
            f"iteration_us_centralised_{form}": 100.0,
            f"iteration_us_distributed_{form}": 8.0,
            f"ratio_{form}": 0.08,
        }
    return row | changes


def failed(rows):
    """Names of the requirements that do not hold."""
    return [need.name for need in requirements(rows) if not need.met]


def test_rows_as_they_should_be_pass():
    rows = [row_of(size) for size in PUBLISHED]
    assert len(rows) == 9
    assert failed(rows) == []
    assert len(summary(rows)) == 10


def test_one_small_inversion_a_column_is_let_pass():
    rows = [row_of(size) for size in PUBLISHED]
    rows[3]["horizon_all_to_all"] = 14.5
    assert failed(rows) == []
    rows[4]["horizon_all_to_all"] = 14.5
    assert failed(rows) == ["inversions_all_to_all_connected"]
    rows[4]["horizon_all_to_all"], rows[3]["horizon_all_to_all"] = 12.0, 15.5
    assert failed(rows) == ["largest_inversion_all_to_all_connected"]


def test_equal_horizons_are_an_inversion_for_robots_alone_only():
    row = row_of((10, 10), horizon_connected=12.0, horizon_none=12.0)
    assert inversions([row], "all_to_all", "connected") == []
    assert inversions([row], "connected", "none") == [0.0]
    assert inversions([row_of((15, 20))], "connected", "none") == []


def test_trials_that_are_not_solved_fail():
    nan = float("nan")
    rows = [row_of((10, 20), solved_connected=9, horizon_connected=nan)]
    assert "every_row_solved" in failed(rows)
    assert "largest_inversion_all_to_all_connected" in failed(rows)


def test_a_tenth_is_asked_for_from_10_20_on():
    assert failed([row_of((10, 10), ratio_published=0.2)]) == []
    assert failed([row_of((10, 20), ratio_published=0.11)]) == ["dense_iteration_ratio"]


def test_rows_are_read_by_size():
    assert read_rows("all") == list(PUBLISHED)
    assert read_rows("10/10, 30/50") == [(10, 10), (30, 50)]
    with pytest.raises(InvalidInputError, match="expected some of 10/10"):
        read_rows("10/11")


def test_figure_3_shows_two_forms_of_both_ways():
    (row,) = figure_3_rows([row_of((10, 10))])
    bars = [key for key in row if key.startswith("iteration_us_")]
    assert len(bars) == 4
    assert {row[key] for key in bars} == {100.0, 8.0}


def test_a_row_has_what_the_table_prints():
    row = plan_row(2, 2, (0, 1))
    assert row["trials"] == row["solved_centralised"] == row["solved_connected"] == 2
    assert row["degree"] == 1.0
    assert "horizon_none" not in row
    assert np.isfinite([row[f"{what}_all_to_all"] for what in ("horizon", "runtime")]).all()


def test_blocks_of_ten_are_looked_at_by_themselves():
    good = {"centralised": [8.0] * 20, "all_to_all": [9.0] * 20}
    rows = [
        {"trials": 20, "horizons_connected": [10.0] * 10 + [8.0] * 10}
        | {f"horizons_{name}": given for name, given in good.items()},
        {"trials": 20, "horizons_connected": [10.0] * 20}
        | {f"horizons_{name}": given for name, given in good.items()},
    ]
    first, second = blocks_of_ten(rows)
    assert first["inversions_all_to_all_connected"] == 0
    assert second["inversions_all_to_all_connected"] == 1
    assert second["largest_inversion_all_to_all_connected"] == pytest.approx(0.125)
    assert blocks_of_ten([{**row, "trials": 9} for row in rows]) == []
