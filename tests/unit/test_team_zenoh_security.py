"""Mutual TLS, access control by common name, and signatures, on the loopback."""

import dataclasses
import time
import tomllib
from pathlib import Path

import msgspec
import pytest
from network_teams import LONG_S, eventually, letter, open_team, options_of, received

from fgplan.errors import InvalidInputError
from fgplan.team.certificates import make_certificates
from fgplan.team.credentials import Credentials
from fgplan.team.envelope import Envelope
from fgplan.team.network_options import NetworkOptions, free_endpoint, read_network
from fgplan.team.zenoh_settings import zenoh_settings
from fgplan.team.zenoh_transport import ZenohTransport

zenoh = pytest.importorskip("zenoh")

ROBOTS = ("ann", "bob", "eve")


@pytest.fixture(scope="module", name="folder")
def certificates_of_the_team(tmp_path_factory):
    folder = tmp_path_factory.mktemp("team") / "certificates"
    make_certificates(folder, ROBOTS)
    return folder


def files(folder):
    """Options that name the files."""
    return {
        "ca": folder / "ca.pem",
        "certificate": folder / "{robot}.pem",
        "key": folder / "{robot}.key",
    }


def entry(robot, number=1):
    """An entry of the log, which teammates may pass on."""
    return letter(robot, number, "announcement", b"path")


def intruder(settings):
    """A session of zenoh that keeps to no rule of ours."""
    config = zenoh.Config()
    for path, value in settings.items():
        config.insert_json5(path, msgspec.json.encode(value).decode())
    return zenoh.open(config)


def test_a_team_with_certificates_talks_and_passes_on(folder):
    with open_team(ROBOTS, **files(folder)) as team:
        team["bob"].send("bob", entry("bob"))
        (at_eve,) = received(team["eve"], 1)
        (at_ann,) = received(team["ann"], 1)
        assert at_eve.signature
        assert at_eve == at_ann
        team["eve"].send("eve", at_eve, "ann")  # as it was written
        assert received(team["ann"], 1) == [at_eve]
        assert {name: one.refused.counts for name, one in team.items()} == {
            name: {} for name in ROBOTS
        }


def test_what_is_forged_or_changed_under_the_own_key_is_refused_by_its_signature(folder):
    with open_team(ROBOTS, **files(folder)) as team:
        team["bob"].send("bob", entry("bob"))
        (true,) = received(team["eve"], 1)
        received(team["ann"], 1)
        other_team = Credentials.read("bob", ROBOTS, NetworkOptions(name="other", **files(folder)))
        own = Credentials.read("eve", ROBOTS, NetworkOptions(**files(folder)))
        forged = [
            entry("bob"),
            msgspec.structs.replace(true, payload=b"lies"),
            msgspec.structs.replace(true, sequence=9),
            msgspec.structs.replace(true, basis={"ann": 1}),
            msgspec.structs.replace(true, parent=b"1234"),
            msgspec.structs.replace(true, session=1),
            msgspec.structs.replace(true, signature=b"garbage"),
            own.sign(entry("bob")),
            other_team.sign(entry("bob")),
            msgspec.structs.replace(true, robot="ann"),
        ]
        for envelope in forged:
            team["eve"].send("eve", envelope, "ann")
        team["eve"]._session.put("fgplan/team/eve/to/ann", entry("eve").encoded)  # unsigned, hers
        team["eve"].send("eve", letter("bob"), "ann")  # a kind that only its writer may send
        found = []

        def all_are_looked_at():
            found.extend(team["ann"].receive("ann"))
            return team["ann"].refused.total + len(found) >= len(forged) + 2

        eventually(all_are_looked_at)
        assert found == []
        assert team["ann"].refused.counts == {"signature": len(forged) + 1, "passed on": 1}


@pytest.mark.parametrize("dials", [True, False])
def test_puts_and_tokens_under_another_robots_key_are_dropped_by_zenoh(folder, dials):
    options = options_of(("ann", "eve") if dials else ("eve", "ann"), **files(folder))
    settings = zenoh_settings("eve", ROBOTS, options["eve"])
    del settings["access_control"]  # she does not restrain herself
    with intruder(settings) as eve, ZenohTransport("ann", ROBOTS, options["ann"]) as ann:
        spied = eve.declare_subscriber("fgplan/**", zenoh.handlers.RingChannel(100))
        meant = eve.declare_subscriber("fgplan/team/ann/to/eve", zenoh.handlers.RingChannel(100))
        false = eve.liveliness().declare_token(f"fgplan/team/bob/alive/{eve.info.zid()}")
        true = eve.liveliness().declare_token(f"fgplan/team/eve/alive/{eve.info.zid()}")
        eventually(lambda: ann.present("ann") == {"eve"})
        forged = letter("bob").encoded
        for key in ("bob/to/ann", "bob/to/*", "*/to/ann", "**"):
            eve.put(f"fgplan/team/{key}", forged)
        eve.put("fgplan/team/eve/to/ann", forged)  # the only one that comes through
        ann.send("ann", letter("ann", 1), "bob")
        ann.send("ann", letter("ann", 2), "eve")
        eventually(lambda: ann.wait(0.0))
        time.sleep(0.2)
        assert ann.receive("ann") == ()
        assert ann.refused.counts == {"passed on": 1}
        assert ann.present("ann") == {"eve"}
        notes, heard = [], set()

        def eve_has_heard():
            notes.extend(sample.payload.to_bytes() for sample in iter(meant.try_recv, None))
            heard.update(str(sample.key_expr) for sample in iter(spied.try_recv, None))
            return notes and "fgplan/team/ann/to/eve" in heard

        eventually(eve_has_heard)
        assert b"note" in notes[0]
        assert "fgplan/team/ann/to/bob" not in heard
        for token in (false, true):
            token.undeclare()


def test_strangers_do_not_get_in(folder, tmp_path):
    make_certificates(tmp_path / "others", ROBOTS)
    make_certificates(tmp_path / "more", ["mallory"])
    options = options_of(("ann", "eve"), **files(folder))
    with ZenohTransport("ann", ROBOTS, options["ann"]) as ann:
        with ZenohTransport("eve", ROBOTS, options["eve"]) as eve:  # she herself gets in
            quick_s = eventually(lambda: eve.present("eve") == {"ann"})
        eventually(lambda: not ann.present("ann"))
        ours = zenoh_settings("eve", ROBOTS, options["eve"])
        tls, no_tls = "transport/link/tls", {"listen/endpoints": ["tcp/127.0.0.1:0"]}
        their = {
            f"{side}_{what}": str(tmp_path / "others" / f"eve.{end}")
            for side in ("connect", "listen")
            for what, end in (("certificate", "pem"), ("private_key", "key"))
        }
        plain = {
            "connect/endpoints": [options["eve"].connect[0].replace("tls", "tcp")],
            "transport/link/protocols": ["tcp"],
        }
        for settings in (
            ours | {tls: ours[tls] | their},  # the same names from another authority
            {**ours, tls: {"root_ca_certificate": str(folder / "ca.pem")}, **no_tls}
            | {"transport/link/protocols": ["tcp", "tls"]},  # no certificate of its own
            {key: value for key, value in (ours | no_tls | plain).items() if key != tls},
        ):
            settings.pop("access_control")
            with intruder(settings) as stranger:
                stranger.liveliness().declare_token(f"fgplan/team/eve/alive/{stranger.info.zid()}")
                time.sleep(max(0.4, 2.0 * quick_s))
                stranger.put("fgplan/team/eve/to/ann", letter("eve").encoded)
                assert stranger.info.peers_zid() == []
        assert ann.present("ann") == frozenset()
        assert not ann.wait(0.0)


def test_a_certificate_of_the_authority_with_a_name_outside_the_team_says_nothing(folder):
    options = options_of(("ann", "eve"), **files(folder))
    pair = ("ann", "bob")  # eve's certificate is good, but she is not of this team
    with ZenohTransport("ann", pair, options["ann"]) as ann:
        settings = zenoh_settings("eve", ROBOTS, options["eve"])
        del settings["access_control"]
        with intruder(settings) as eve:
            eve.liveliness().declare_token(f"fgplan/team/bob/alive/{eve.info.zid()}")
            eventually(lambda: eve.info.peers_zid())
            time.sleep(0.3)
            eve.put("fgplan/team/bob/to/ann", letter("bob").encoded)
            time.sleep(0.2)
            assert ann.present("ann") == frozenset()
            assert not ann.wait(0.0)


def test_files_that_do_not_fit_are_named(folder, tmp_path):
    good = files(folder)
    make_certificates(tmp_path / "others", ROBOTS)
    make_certificates(tmp_path / "old", ROBOTS, days=1e-9)
    broken = tmp_path / "broken"
    broken.write_text("nothing")

    def says(match, **changes):
        with pytest.raises(InvalidInputError, match=match):
            Credentials.read("ann", ROBOTS, NetworkOptions(**good | changes))

    says("ca: robot 'ann': no file", ca=tmp_path / "none.pem")
    says("certificate .*broken", ca=broken)
    says("not issued by the team's authority", ca=tmp_path / "others" / "ca.pem")
    says("expected common name 'ann', got \\['bob'\\]", certificate=folder / "bob.pem")
    says("certificate of robot 'bob', got none", certificate=folder / "ann.pem")
    says("key of robot 'ann': .*broken", key=broken)
    says("expected the private key of its certificate", key=folder / "bob.key")
    says("none.pem: No such file", certificates={"bob": tmp_path / "none.pem"})
    time.sleep(0.01)
    with pytest.raises(InvalidInputError, match="make a new one"):
        Credentials.read("ann", ROBOTS, NetworkOptions(**files(tmp_path / "old")))


def test_certificates_are_not_written_over_and_keys_are_private(folder, tmp_path):
    assert (folder / "ann.key").stat().st_mode & 0o077 == 0
    assert not list(folder.glob("ca.key"))
    for robots, match in ((["ann"], "there already"), (["ca"], "not 'ca'"), (["a/b"], "without")):
        with pytest.raises(InvalidInputError, match=match):
            make_certificates(folder, robots)
    made = make_certificates(tmp_path / "new", ["ann"], hosts=["10.0.0.1", "ann.local"])
    assert [path.name for path in made] == ["ca.pem", "ann.pem", "ann.key"]


def test_a_key_on_another_curve_is_refused(folder, tmp_path, monkeypatch):
    from cryptography.hazmat.primitives.asymmetric import ec

    monkeypatch.setattr(ec, "SECP256R1", ec.SECP384R1)
    make_certificates(tmp_path / "p384", ROBOTS)
    monkeypatch.undo()
    with pytest.raises(InvalidInputError, match="on the curve P-256"):
        Credentials.read("ann", ROBOTS, NetworkOptions(**files(tmp_path / "p384")))


def test_a_signature_is_the_same_each_time_and_for_this_robot_only(folder):
    credentials = Credentials.read("ann", ROBOTS, NetworkOptions(**files(folder)))
    signed = credentials.sign(entry("ann"))
    assert signed == credentials.sign(entry("ann"))
    credentials.verify(signed)
    stranger = Envelope(robot="zoe", session=0, sequence=0, kind="note", signature=b"x")
    with pytest.raises(InvalidInputError, match="expected a robot with a certificate"):
        credentials.verify(stranger)


def test_the_secure_scenario_of_the_examples_works_with_certificates_made_beside_it(tmp_path):
    path = Path(__file__).parents[2] / "examples" / "scenarios" / "secure_team.toml"
    scenario = tomllib.loads(path.read_text(encoding="utf-8"))
    robots = tuple(robot["name"] for robot in scenario["robots"])
    make_certificates(tmp_path / "certificates", robots)
    first = free_endpoint("tls")
    options = read_network(scenario["team"]["network"], tmp_path)
    with (
        ZenohTransport("ann", robots, dataclasses.replace(options, listen=(first,))) as ann,
        ZenohTransport("bob", robots, dataclasses.replace(options, connect=(first,))) as bob,
    ):
        assert ann.wait_for_team(LONG_S) == {"bob"}
        bob.send("bob", entry("bob"))
        (envelope,) = received(ann, 1)
        assert envelope.signature
