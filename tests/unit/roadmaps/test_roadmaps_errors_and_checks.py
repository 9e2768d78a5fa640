import numpy as np
import pytest

import roadmaps
from roadmaps import checks, errors
from roadmaps.errors import ParameterError, RoadmapError


@pytest.mark.parametrize(
    ("name", "builtin"),
    [
        ("ParameterError", ValueError),
        ("WorkspaceError", ValueError),
        ("MapFileError", ValueError),
        ("InvalidPositionError", ValueError),
        ("UnknownVertexError", LookupError),
        ("UnreachableError", RuntimeError),
        ("NoCandidatePathError", RuntimeError),
        ("SamplingError", RuntimeError),
        ("MissingDependencyError", ImportError),
    ],
)
def test_every_error_is_a_roadmap_error_and_a_builtin(name, builtin):
    error = getattr(errors, name)
    assert issubclass(error, RoadmapError)
    assert issubclass(error, builtin)
    assert name in roadmaps.__all__


def test_all_names_exist():
    assert all(hasattr(roadmaps, name) for name in roadmaps.__all__)


def test_one_position_becomes_one_row():
    assert checks.as_positions([1, 2], 2, "p").shape == (1, 2)
    assert checks.as_positions([], 2, "p").shape == (0, 2)
    assert checks.as_positions([[1, 2, 3]], None, "p").dtype == np.float64


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([[1, 2, 3]], r"p: expected positions of shape \(n, 2\), got shape \(1, 3\)"),
        ("ab", "p: expected numbers"),
        ([[1, 2], [np.nan, 0]], "p: expected finite coordinates, got .* in row 1"),
    ],
)
def test_wrong_positions_are_refused_by_name(values, words):
    with pytest.raises(ParameterError, match=words):
        checks.as_positions(values, 2, "p")


def test_two_positions_are_not_one():
    with pytest.raises(ParameterError, match=r"p: expected one position of shape \(2,\)"):
        checks.as_position([[1, 2], [3, 4]], 2, "p")


@pytest.mark.parametrize(
    ("check", "value"),
    [
        (checks.check_positive, 0.0),
        (checks.check_positive, np.inf),
        (checks.check_non_negative, -1.0),
        (checks.check_non_negative, np.nan),
        (checks.check_count, 0),
        (checks.check_count, 1.5),
        (checks.check_count, True),
    ],
)
def test_numbers_out_of_range_are_refused_by_name(check, value):
    with pytest.raises(ParameterError, match="speed: expected"):
        check(value, "speed")


def test_read_only_copies():
    given = np.zeros(3)
    kept = checks.read_only(given)
    given[0] = 1.0
    assert kept[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        kept[0] = 2.0


@pytest.mark.parametrize(
    "call",
    [
        lambda yard, square, seed: roadmaps.build_prm(yard, 30, seed),
        lambda yard, square, seed: roadmaps.sample_positions(yard, 3, seed),
        lambda yard, square, seed: roadmaps.RRT(yard, [1.0, 1.0], seed, step_m=1.0),
        lambda yard, square, seed: roadmaps.RRTStar(yard, [1.0, 1.0], seed, step_m=1.0),
        lambda yard, square, seed: roadmaps.RRG(yard, [1.0, 1.0], seed, step_m=1.0),
        lambda yard, square, seed: roadmaps.find_perturbed_paths(square, 0, 1, 2, seed),
        lambda yard, square, seed: roadmaps.find_penalty_paths(
            square, 0, 1, 2, jitter=0.1, rng=seed
        ),
        lambda yard, square, seed: roadmaps.find_candidate_paths(
            square, 0, 1, 2, method="perturbed", rng=seed
        ),
    ],
)
def test_a_seed_in_place_of_a_generator_is_refused(call):
    yard = roadmaps.Workspace(lower=[0, 0], upper=[20, 20])
    square = roadmaps.build_prm(yard, 20, np.random.default_rng(0))
    with pytest.raises(ParameterError) as refused:
        call(yard, square, 7)
    assert str(refused.value) == (
        "rng: expected a numpy.random.Generator, got 7; pass numpy.random.default_rng(7)"
    )
