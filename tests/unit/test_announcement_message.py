"""The announcement: round trips without loss, and every fault is found and named."""

import json

import msgspec
import numpy as np
import pytest

from fgplan.announcement.announcement import (
    MAX_BYTES,
    Announcement,
    Sender,
    Withdrawal,
    announcement_of,
    decode_message,
    goal_of,
)
from fgplan.announcement.array_data import ArrayData, pack
from fgplan.announcement.term_data import PathTermData, term_data, term_of, terms_of
from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.evaluation.objective import (
    Objective,
    PathLengthTerm,
    PathTerm,
    PosesOf,
    PriorVariables,
    Trajectory,
    TravelTimeTerm,
    UncertaintyTerm,
)
from fgplan.paths.candidate_path import CandidatePath, Observation

TERMS = (
    PathLengthTerm(robot="ann", weight=0.1),
    UncertaintyTerm(of=PosesOf(("ann",)), weight=1.0),
    UncertaintyTerm(of=PosesOf(("ann", "bob")), function="entropy", block="pose", read=(2, 5)),
    UncertaintyTerm(of=Trajectory("bob"), read="arrival"),
    UncertaintyTerm(of=PriorVariables((7, 2**62 + 5)), read="arrival", arrival_of="ann"),
    TravelTimeTerm(robot="bob", weight=2.0),
)


def make_path(seed=0, spatial=False, steps=6, full=True, observations=True):
    generator = np.random.default_rng(seed)
    dim = 6 if spatial else 3
    if spatial:
        poses = np.tile(np.eye(4), (steps + 1, 1, 1))
        for pose in poses:
            q, r = np.linalg.qr(generator.standard_normal((3, 3)))
            q *= np.sign(np.diagonal(r))
            pose[:3, :3] = q * np.linalg.det(q)
        poses[:, :3, 3] = generator.standard_normal((steps + 1, 3))
    else:
        poses = generator.standard_normal((steps + 1, 3))
    roots = generator.standard_normal((steps, dim, dim))
    covariances = np.array([root @ root.T + np.eye(dim) for root in roots])
    covariances = 0.5 * (covariances + np.swapaxes(covariances, 1, 2))
    if not full:
        covariances = np.array([np.diag(np.diagonal(item)) for item in covariances])
    seen = (
        Observation(step=1, landmark=2**62 + 5, sensor="camera", covariance=np.diag([0.1, 0.2])),
        Observation(step=3, landmark=9, sensor="sonar", covariance=np.array([[0.3]])),
        Observation(
            step=3, landmark=11, sensor="camera", covariance=np.array([[0.2, 0.05], [0.05, 0.1]])
        ),
    )
    return CandidatePath(
        robot="ann",
        poses=poses,
        times_s=np.cumsum(0.1 + generator.random(steps + 1)),
        motion_covariances=covariances,
        vertices=tuple(generator.integers(-1, 400, steps + 1).tolist()),
        observations=seen if observations else (),
    )


def make_message(path=None, **changes):
    given = {
        "sequence": 3,
        "basis": {"ann": 2, "bob": 5},
        "sender": Sender(
            session=4,
            prior_digest="d" * 64,
            goal=goal_of(np.array([3.0, 4.0])),
            terms=terms_of(Objective(TERMS), "ann"),
        ),
        "value": 12.5,
        "incumbent_value": 13.5,
    }
    return announcement_of(path or make_path(), **{**given, **changes})


def same_path(first, second):
    assert first.robot == second.robot
    assert first.poses.tobytes() == second.poses.tobytes()
    assert first.times_s.tobytes() == second.times_s.tobytes()
    assert first.motion_covariances.tobytes() == second.motion_covariances.tobytes()
    assert first.vertices == second.vertices
    assert first.length_m == second.length_m
    assert len(first.observations) == len(second.observations)
    for one, other in zip(first.observations, second.observations, strict=True):
        assert (one.step, one.landmark, one.sensor) == (other.step, other.landmark, other.sensor)
        assert one.covariance.tobytes() == other.covariance.tobytes()


@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("observations", [False, True])
@pytest.mark.parametrize("as_json", [False, True])
def test_round_trip_is_exact(spatial, full, observations, as_json):
    path = make_path(1, spatial=spatial, full=full, observations=observations)
    message = make_message(path)
    assert message.path() is path
    data = msgspec.json.encode(message) if as_json else message.encoded
    back = decode_message(data, "ann", json=as_json)
    assert back == message
    same_path(back.path(), path)
    assert back.path() is back.path()
    assert back.byte_size == message.byte_size == len(message.encoded)
    assert back.steps.tolist() == list(range(path.steps + 1))
    assert back.goal == (3.0, 4.0)


def test_schema_is_on_the_wire():
    data = msgspec.msgpack.decode(make_message().encoded)
    assert data["schema"] == "announcement.v1"
    for schema in ("announcement.v2", None):
        wrong = {**data, "schema": schema}
        if schema is None:
            del wrong["schema"]
        with pytest.raises(InvalidInputError, match="message of robot 'ann'"):
            decode_message(msgspec.msgpack.encode(wrong), "ann")
    with pytest.raises(InvalidInputError, match="extra"):
        decode_message(msgspec.msgpack.encode({**data, "extra": 1}), "ann")


def test_motion_noise_without_correlation_travels_as_variances():
    assert make_message(make_path(full=False)).motion.shape == (6, 3)
    assert make_message(make_path(full=True)).motion.shape == (6, 3, 3)


def test_withdrawal_round_trip():
    withdrawal = Withdrawal(
        robot="ann", session=1, sequence=2, basis={"ann": 1}, prior_digest="x", by="bob"
    )
    assert decode_message(withdrawal.encoded, "bob") == withdrawal
    assert withdrawal.byte_size == len(withdrawal.encoded)


def changed(**changes):
    """Bytes of an announcement with fields replaced."""
    return msgspec.structs.replace(make_message(), **changes).encoded


POSES = make_path().poses
TIMES = make_path().times_s
NAN = np.array(POSES)
NAN[2, 1] = np.nan
WRONG_MOTION = np.array(make_path().motion_covariances)
WRONG_MOTION[1, 0, 1] += 10.0
WRONG_MOTION[1, 1, 0] += 10.0
ROWS = np.array([[1, 0, 2], [3, 1, 1], [3, 0, 2]])


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"poses": pack(NAN, "<f8")}, "poses"),
        ({"poses": pack(POSES[:, :2], "<f8")}, "poses"),
        ({"poses": pack(POSES[:1], "<f8")}, "poses"),
        ({"poses": pack(POSES, "<i8")}, "poses: expected items <f8"),
        ({"poses": pack(POSES[0], "<f8")}, "poses: expected 2 or 3 dimensions"),
        ({"poses": ArrayData("<f8", (7, 3), b"\0" * 8)}, "poses: expected 168 bytes"),
        ({"poses": ArrayData("<f8", (10_000_000, 4, 4), b"")}, "poses: expected"),
        ({"times_s": pack(TIMES[::-1], "<f8")}, "increasing times"),
        ({"times_s": pack(TIMES[:3], "<f8")}, "times_s"),
        ({"motion": pack(np.zeros((6, 3)), "<f8")}, "motion covariance of step 1"),
        ({"motion": pack(np.full((6, 3), np.inf), "<f8")}, "motion_covariances"),
        ({"motion": pack(WRONG_MOTION, "<f8")}, "motion covariance of step 2"),
        ({"motion": pack(np.ones((2, 3)), "<f8")}, "motion_covariances"),
        ({"vertices": pack([1, 2], "<i8")}, "vertices"),
        ({"observations": pack(ROWS[:2], "<i8")}, "observations: expected shape"),
        ({"observations": pack(np.add(ROWS, [0, 1, 0]), "<i8")}, "expected sensors 0 to 1"),
        ({"observations": pack(np.add(ROWS, [9, 0, 0]), "<i8")}, "observations at steps 1 to 6"),
        ({"observations": pack(np.add(ROWS, [0, 0, 1]), "<i8")}, "noise: expected one covariance"),
        ({"observations": pack(ROWS * [1, 1, 0], "<i8")}, "noise: expected one covariance"),
        ({"noise": pack(np.zeros(9), "<f8")}, "noise of landmark"),
        ({"noise": pack(np.full(9, np.nan), "<f8")}, "noise of landmark"),
        ({"value": float("nan")}, "value: expected a finite number"),
        ({"incumbent_value": float("inf")}, "incumbent_value"),
        ({"length_m": float("inf")}, "length_m"),
        ({"goal": (1.0, float("nan"))}, "goal"),
        ({"terms": (PathTermData("path_length", "ann", float("nan")),)}, r"terms\[0\].weight"),
    ],
)
def test_faults_name_robot_and_field(changes, field):
    with pytest.raises(InvalidInputError, match=f"announcement 3 of robot 'ann'.*{field}"):
        decode_message(changed(**changes), "ann")


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"sequence": 0}, "sequence"),
        ({"session": -1}, "session"),
        ({"basis": {"bob": 0}}, "basis"),
        ({"robot": ""}, "robot"),
        ({"length_m": -1.0}, "length_m"),
        ({"goal": (0.0,) * 7}, "goal"),
        ({"poses": ArrayData("<f4", (1,), b"")}, "poses"),
        ({"poses": ArrayData("<f8", (-1, 3), b"")}, "poses"),
        ({"poses": ArrayData("<f8", (1, 1, 1, 1, 1), b"")}, "poses"),
    ],
)
def test_malformed_fields_are_refused_on_decoding(changes, field):
    with pytest.raises(InvalidInputError, match=rf"message of robot 'carl'.*\$\.{field}"):
        decode_message(changed(**changes), "carl")


def test_spatial_poses_must_be_rigid():
    path = make_path(spatial=True)
    for place, value in (((2, 0, 0), 3.0), ((2, 3, 0), 1.0)):
        poses = np.array(path.poses)
        poses[place] = value
        data = msgspec.structs.replace(make_message(path), poses=pack(poses, "<f8")).encoded
        with pytest.raises(InvalidInputError, match=r"poses: expected rigid motions.*step 2"):
            decode_message(data, "ann")


def test_garbage_truncation_nesting_and_size_are_refused(monkeypatch):
    data = make_message().encoded
    for wrong in (b"", b"\xff\xff", data[:-7], b"\x91" * 100_000):
        with pytest.raises(InvalidInputError, match="message of robot 'ann'"):
            decode_message(wrong, "ann")
    monkeypatch.setattr("fgplan.announcement.announcement.MAX_BYTES", 100)
    with pytest.raises(InvalidInputError, match="expected at most 100 bytes"):
        decode_message(data, "ann")
    assert len(data) < MAX_BYTES


def test_terms_round_trip_and_concern_their_robots():
    for term in TERMS:
        assert term_of(term_data(term)) == term
    kinds = [data.of for data in terms_of(Objective(TERMS), "ann")]
    assert kinds == ["path_length", "poses", "poses", "prior_variables"]
    kinds = [data.of for data in terms_of(Objective(TERMS), "bob")]
    assert kinds == ["poses", "trajectory", "prior_variables", "travel_time"]
    back = json.loads(msgspec.json.encode(terms_of(Objective(TERMS), "ann")))
    assert back[2]["read"] == [2, 5]


def test_a_users_function_does_not_travel():
    own = PathTerm(robot="ann", name="risk", function=lambda path: 1.0, weight=3.0)
    data = term_data(own)
    assert (data.of, data.name, data.weight) == ("path_term", "risk", 3.0)
    with pytest.raises(InvalidInputError, match=r"'risk' of robot 'ann'.*does not travel"):
        term_of(data)
    unknown = msgspec.structs.replace(term_data(TERMS[1]), function="magic")
    with pytest.raises(UnknownNameError, match="magic"):
        term_of(unknown)


def test_message_cannot_be_changed():
    message = make_message()
    with pytest.raises(AttributeError):
        message.robot = "bob"
    assert isinstance(message, Announcement)
    back = decode_message(message.encoded, "ann")
    with pytest.raises(ValueError, match="read-only"):
        back.path().poses[0, 0] = 1.0


def test_places_whose_distance_is_no_number_are_refused():
    path = make_path()
    poses = np.array(path.poses)
    poses[-1, 0] = 1e200
    with pytest.raises(InvalidInputError, match="places whose distances are finite"):
        CandidatePath(
            robot="ann",
            poses=poses,
            times_s=path.times_s,
            motion_covariances=path.motion_covariances,
        )
