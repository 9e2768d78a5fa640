"""Options of the network: loopback unless asked for, all of TLS or none."""

from pathlib import Path

import pytest

from fgplan.errors import InvalidInputError, UnknownNameError
from fgplan.team.network_options import NetworkOptions, free_endpoint, read_network
from fgplan.team.zenoh_settings import access_control, zenoh_settings

FILES = {"ca": "ca.pem", "certificate": "{robot}.pem", "key": "{robot}.key"}


def test_the_default_is_the_loopback_and_nobody_is_looked_for():
    options = NetworkOptions()
    assert options.listen == ("tcp/127.0.0.1:0",)
    assert not options.secure
    settings = zenoh_settings("ann", ("ann", "bob"), options)
    assert settings["scouting/multicast/enabled"] is False
    assert settings["listen/endpoints"] == ["tcp/127.0.0.1:0"]
    assert settings["transport/shared_memory/enabled"] is False
    assert "access_control" not in settings
    assert NetworkOptions(**FILES).listen == ("tls/127.0.0.1:0",)


@pytest.mark.parametrize("host", ["127.0.0.1", "127.8.0.1", "localhost", "[::1]"])
def test_loopback_by_any_name(host):
    assert NetworkOptions(connect=(f"tcp/{host}:7447",)).connect == (f"tcp/{host}:7447",)


@pytest.mark.parametrize("host", ["0.0.0.0", "[::]", "10.0.0.1", "ann.local", "127.evil.org"])
def test_what_others_can_reach_must_be_asked_for(host):
    with pytest.raises(InvalidInputError, match="not on this machine's loopback; say public"):
        NetworkOptions(listen=(f"tcp/{host}:0",))
    with pytest.raises(InvalidInputError, match="not on this machine's loopback; say public"):
        NetworkOptions(connect=(f"tcp/{host}:7447",))
    assert NetworkOptions(listen=(f"tcp/{host}:0",), public=True).public


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"listen": ("tcp/127.0.0.1",)}, "listen: expected tcp/HOST:PORT"),
        ({"listen": ("tcp/127.0.0.1:70000",)}, "listen: expected tcp/HOST:PORT"),
        ({"listen": ("tcp/127.0.0.1:0#iface=eth0",)}, "listen: expected tcp/HOST:PORT"),
        ({"listen": ("udp/127.0.0.1:0",)}, "listen: expected tcp/HOST:PORT"),
        ({"connect": ("tcp/127.0.0.1:0",)}, "connect: expected tcp/HOST:PORT"),
        ({"connect": "tcp/127.0.0.1:1"}, "connect: expected a list"),
        ({"connect": (1,)}, "connect: expected a list"),
        ({"connect": ("tls/127.0.0.1:1",)}, "expected tcp/HOST:PORT without certificates"),
        (FILES | {"connect": ("tcp/127.0.0.1:1",)}, "expected tls/HOST:PORT with certificates"),
        ({"name": "a/b"}, "name: expected 1 to 256 characters"),
        ({"name": ""}, "name: expected 1 to 256 characters"),
        ({"name": 3}, "name: expected 1 to 256 characters"),
        ({"lease_s": 0.0}, "lease_s"),
        ({"public": 1}, "public: expected true or false"),
        ({"multicast": True}, "multicast: leaves this machine"),
        ({"kept_per_sender": 0}, "kept_per_sender: expected a whole number above zero"),
        ({"kept_bytes": 1.5}, "kept_bytes: expected a whole number above zero"),
        ({"messages_per_s": 0.0}, "messages_per_s"),
        ({"largest_message_bytes": 10**9}, "largest_message_bytes: expected at most"),
        ({"ca": "ca.pem"}, "certificate: expected a file, got none; TLS needs"),
        ({"certificates": {"ann": "a"}}, "expected ca, certificate and key with them"),
    ],
)
def test_what_makes_no_sense_is_refused(changes, says):
    with pytest.raises(InvalidInputError, match=says):
        NetworkOptions(**changes)


def test_plain_data_with_paths_from_a_folder():
    options = read_network(
        {**FILES, "name": "crew", "lease_s": 2.0, "certificates": {"ann": "x.pem"}},
        Path("/somewhere"),
    )
    assert options.ca == Path("/somewhere/ca.pem")
    assert options.certificate_of("ann") == Path("/somewhere/x.pem")
    assert options.certificate_of("bob") == Path("/somewhere/bob.pem")
    assert read_network(FILES).ca == Path("ca.pem")
    with pytest.raises(UnknownNameError, match="team network port: expected one of name, listen"):
        read_network({"port": 1})
    for given, says in (
        ([], "expected a table"),
        ({"ca": 3}, "ca: expected a file name"),
        ({"certificates": ["a"]}, "certificates: expected a table of files by robot"),
        ({"certificates": {"ann": 1}}, "certificates ann: expected a file name"),
    ):
        with pytest.raises(InvalidInputError, match=says):
            read_network(given)
    with pytest.raises(InvalidInputError, match="expected ca, certificate and key, got none"):
        NetworkOptions().own_files("ann")


def test_one_list_of_endpoints_serves_all():
    ends = (free_endpoint(), "tcp/127.0.0.1:7502")
    settings = zenoh_settings("ann", ("ann", "bob"), NetworkOptions(listen=ends[:1], connect=ends))
    assert settings["connect/endpoints"] == ["tcp/127.0.0.1:7502"]


def test_access_control_denies_by_default_and_has_no_rule_for_oneself():
    table = access_control("ann", ("ann", "bob", "eve"), NetworkOptions(**FILES))
    assert table["default_permission"] == "deny"
    assert [subject["cert_common_names"] for subject in table["subjects"]] == [["bob"], ["eve"]]
    writes = [rule["key_exprs"] for rule in table["rules"] if "put" in rule["messages"]]
    assert writes[0] == ["fgplan/team/bob/**"]
