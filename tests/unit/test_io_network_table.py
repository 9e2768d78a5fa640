"""[team.network] of a scenario: read, checked, no part of the digest, never copied."""

import pytest
from process_scenarios import GATHERING

from fgplan.errors import ScenarioError
from fgplan.io.mission_file import load_mission
from fgplan.io.named_files import named_files
from fgplan.io.network_table import make_network
from fgplan.io.scenario_file import read_scenario

TABLE = """
[team.network]
name = "field"
listen = ["tls/127.0.0.1:7447"]
ca = "keys/ca.pem"
certificate = "keys/{robot}.pem"
key = "keys/ann.key"
"""


def written(folder, text):
    path = folder / "scenario.toml"
    path.write_text(text)
    return path


def test_files_of_the_network_count_from_the_scenario_and_stay_where_they_are(tmp_path):
    path = written(tmp_path, GATHERING + TABLE)
    (tmp_path / "keys").mkdir()
    for name in ("ca.pem", "ann.key"):
        (tmp_path / "keys" / name).write_text("secret")
    scenario = read_scenario(path)
    network = make_network(scenario, path)
    assert network.ca == tmp_path / "keys" / "ca.pem"
    assert network.certificate_of("bob") == tmp_path / "keys" / "bob.pem"
    assert network.listen == ("tls/127.0.0.1:7447",)
    assert named_files(scenario, path) == ()  # no key goes into a run folder


def test_how_robots_reach_each_other_is_no_part_of_the_digest(tmp_path):
    plain = load_mission(written(tmp_path, GATHERING)).digest
    assert load_mission(written(tmp_path, GATHERING + TABLE)).digest == plain
    other = load_mission(written(tmp_path, GATHERING.replace("seed = 3", "seed = 4"))).digest
    assert other != plain


@pytest.mark.parametrize(
    ("line", "match"),
    [
        ("listens = 3", r"team network listens: expected one of name.* - at `\$.team.network`"),
        ('listen = ["tcp/10.0.0.1:1"]', "public = true"),
        ("lease_s = 0.0", "lease_s"),
    ],
)
def test_a_network_that_cannot_be_used_is_refused_by_name(tmp_path, line, match):
    path = written(tmp_path, f"{GATHERING}\n[team.network]\n{line}\n")
    with pytest.raises(ScenarioError, match=match):
        load_mission(path)
