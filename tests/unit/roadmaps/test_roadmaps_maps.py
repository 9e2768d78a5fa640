import sys

import numpy as np
import pytest

from roadmaps import MapFileError, ParameterError, read_movingai_map, read_ros_map
from roadmaps.map_yaml import parse_map_yaml, parse_map_yaml_strictly
from roadmaps.pgm import read_pgm

GOOD = """image: m.pgm
resolution: 0.5
origin: [1.0, -2.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.25
"""
# top row: black, white; bottom row: grey 205 (p = 0.196), grey 128 (p = 0.498)
PGM = b"P5\n# made by hand\n2 2\n255\n" + bytes([0, 255, 205, 128])


@pytest.fixture
def write(tmp_path):
    def write_map(text=GOOD, image=PGM):
        (tmp_path / "m.pgm").write_bytes(image)
        (tmp_path / "m.yaml").write_text(text)
        return tmp_path / "m.yaml"

    return write_map


@pytest.fixture(params=["PyYAML", "own parser"])
def parser(request, monkeypatch):
    if request.param == "own parser":
        monkeypatch.setitem(sys.modules, "yaml", None)
    return request.param


def test_small_map_worked_by_hand(write, parser):
    grid = read_ros_map(write())
    # flipped: the image's bottom row is row 0
    np.testing.assert_array_equal(grid.occupancy, [[0, -1], [100, 0]])
    np.testing.assert_array_equal(grid.origin, [1.0, -2.0])
    assert grid.resolution_m == 0.5


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("negate: 0", "negate: 1", [[100, -1], [0, 100]]),
        ("free_thresh: 0.25", "free_thresh: 0.196", [[-1, -1], [100, 0]]),
        ("occupied_thresh: 0.65", "occupied_thresh: 0.4", [[0, 100], [100, 0]]),
        ("negate: 0\n", "mode: trinary\n", [[0, -1], [100, 0]]),
        ("occupied_thresh: 0.65\nfree_thresh: 0.25\n", "", [[0, -1], [100, 0]]),
    ],
)
def test_thresholds_and_negate(write, parser, old, new, expected):
    np.testing.assert_array_equal(read_ros_map(write(GOOD.replace(old, new))).occupancy, expected)


def test_yaw_is_kept(write, parser):
    assert read_ros_map(write(GOOD.replace("0.0]", "1e-3]"))).yaw_rad == 1e-3


@pytest.mark.parametrize(
    ("name", "shape", "occupied", "unknown"),
    [("depot", (307, 604), 5947, 0), ("tb3_sandbox", (384, 384), 870, 138683)],
)
def test_vendored_ros_maps(maps, parser, name, shape, occupied, unknown):
    grid = read_ros_map(maps / f"{name}.yaml")
    assert grid.shape == shape
    assert (grid.occupancy == 100).sum() == occupied
    assert (grid.occupancy == -1).sum() == unknown


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("image: m.pgm\n", "", "field 'image': expected the name of a PGM"),
        (
            "m.pgm",
            "none.pgm",
            "field 'image': expected a PGM file relative to this one, got 'none.pgm'",
        ),
        ("resolution: 0.5\n", "", "field 'resolution': expected a finite number, got nothing"),
        ("0.5", "fast", "field 'resolution': .* got 'fast'"),
        ("0.5", "-0.5", "field 'resolution': expected metres a pixel greater than 0"),
        ("[1.0, -2.0, 0.0]", "[1.0, -2.0]", r"field 'origin': expected \[x, y, yaw\]"),
        ("[1.0, -2.0, 0.0]", "[1.0, -2.0, north]", "field 'origin'"),
        ("origin: [1.0, -2.0, 0.0]\n", "", "field 'origin': .* got nothing"),
        ("negate: 0", "negate: 2", "field 'negate': expected 0 or 1, got '2'"),
        ("negate: 0", "mode: scale", "field 'mode': expected trinary, got 'scale'"),
        ("occupied_thresh", "occupied_tresh", "field 'occupied_tresh' is not one of image, "),
        ("0.65", "0.1", "expected 0 <= free <= occupied <= 1, got 0.25 and 0.1"),
    ],
)
def test_wrong_fields_are_refused_by_name(write, parser, old, new, words):
    with pytest.raises(MapFileError, match=words) as caught:
        read_ros_map(write(GOOD.replace(old, new)))
    assert ".yaml" in str(caught.value) or ".pgm" in str(caught.value)


def test_missing_yaml_is_refused_by_name(tmp_path):
    with pytest.raises(MapFileError, match=r"none\.yaml: expected a readable"):
        read_ros_map(tmp_path / "none.yaml")


TEXTS = [
    GOOD,
    "---\nimage: 'a b.pgm'  # the picture\norigin:\n  - 1\n  - -2.5\n- 0\nmode: \"raw\"\n",
    "image: a#b.pgm\nnegate:\norigin: [ 1, 2, ]\n",
]


@pytest.mark.parametrize("text", TEXTS[:1] + TEXTS[2:] + [TEXTS[1].replace("\n- 0", "\n  - 0")])
def test_both_yaml_parsers_agree(text, tmp_path):
    assert parse_map_yaml(text, tmp_path) == parse_map_yaml_strictly(text, tmp_path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("image: a\n- b\n", "line 2: .* the list item '- b' that belongs to no field"),
        ("image: a\n  nested: b\n", "line 2: expected `field: value`"),
        ("only words\n", "line 1: expected `field: value`"),
        ("image: a\nimage: b\n", "line 2: field 'image' is given twice"),
        ("origin: [1, 2\n", "line 1: expected `]`"),
    ],
)
def test_own_parser_names_the_line(text, words, tmp_path):
    with pytest.raises(MapFileError, match=words):
        parse_map_yaml_strictly(text, tmp_path / "m.yaml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("image: [a\n", "expected YAML: .*line"),
        ("- a\n- b\n", "expected lines `field: value`, got list"),
        ("origin: {x: 1}\n", "field 'origin': expected text or a flat list"),
    ],
)
def test_pyyaml_errors_name_the_file(text, words, tmp_path):
    with pytest.raises(MapFileError, match=f"(?s)m.yaml.*{words}"):
        parse_map_yaml(text, tmp_path / "m.yaml")


@pytest.mark.parametrize(
    "data",
    [
        b"P5 2 2 255 " + bytes([0, 51, 102, 255]),
        b"P2\n#c\n2 2 # size\n255\n0 51 # half\n102 255\n",
        b"P2 2 2 5 0 1 2 5",
        b"P5 2 2 65535\n" + np.array([0, 13107, 26214, 65535], dtype=">u2").tobytes(),
    ],
    ids=["raw", "plain", "plain to 5", "16 bits"],
)
def test_pgm_forms_give_the_same_grey(tmp_path, data):
    (tmp_path / "a.pgm").write_bytes(data)
    np.testing.assert_allclose(read_pgm(tmp_path / "a.pgm"), [[0, 0.2], [0.4, 1]])


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"\x89PNG\r\n", "expected a PGM image .* convert"),
        (b"P5 2 x 255 ", "height: expected a positive integer, got b'x'"),
        (b"P5 2", "height: expected a positive integer, got b''"),
        (b"P5 2 2 70000 ", "greatest value: expected at most 65535"),
        (b"P5 2 2 255 abc", "pixels: expected 2 x 2 = 4, got 3; the file is cut off"),
        (b"P5 2 2 9 \x00\x01\x02\x0a", "pixels: expected at most the header's 9, got 10"),
        (b"P2 2 2 9 1 2 3 4 5", "pixels: expected 2 x 2 = 4, got 5"),
        (b"P2 2 2 9 1 2 3 4.5", "pixels: expected integers, got b'4.5'"),
    ],
)
def test_wrong_pgm_is_refused(tmp_path, data, words):
    (tmp_path / "a.pgm").write_bytes(data)
    with pytest.raises(MapFileError, match=rf"a\.pgm: {words}"):
        read_pgm(tmp_path / "a.pgm")


def test_movingai_small_map_worked_by_hand(tmp_path):
    path = tmp_path / "a.map"
    path.write_text("type octile\nheight 2\nwidth 4\nmap\n.GS.\n@OTW\n\n")
    grid = read_movingai_map(path, cell_size_m=2.0)
    np.testing.assert_array_equal(grid.occupancy, [[100] * 4, [0] * 4])
    np.testing.assert_array_equal(grid.bounds[1], [8.0, 4.0])


@pytest.mark.parametrize(
    ("name", "size", "free"), [("random-64-64-20", 64, 3270), ("room-32-32-4", 32, 682)]
)
def test_vendored_movingai_maps(maps, name, size, free):
    grid = read_movingai_map(maps / f"{name}.map")
    assert grid.shape == (size, size)
    assert (grid.occupancy == 0).sum() == free  # the benchmark's own number of states
    first = (maps / f"{name}.map").read_text().splitlines()[4]
    np.testing.assert_array_equal(grid.occupancy[-1] == 0, [letter == "." for letter in first])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "line 1: expected 'type octile', got ''"),
        ("type tile\nheight 1\nwidth 1\nmap\n.\n", "line 1: expected 'type octile'"),
        ("type octile\nheight 0\nwidth 1\nmap\n.\n", "line 2: expected 'height N'"),
        ("type octile\nheight 1\nwide 1\nmap\n.\n", "line 3: expected 'width N'"),
        ("type octile\nheight 1\nwidth 1\n.\n", "line 4: expected 'map', got '.'"),
        ("type octile\nheight 2\nwidth 1\nmap\n.\n", "expected 2 rows after line 4, got 1"),
        ("type octile\nheight 2\nwidth 2\nmap\n..\n.\n", "line 6: expected 2 characters, got 1"),
        ("type octile\nheight 2\nwidth 2\nmap\n..\n.x\n", "line 6: .* got 'x' in column 2"),
    ],
)
def test_wrong_movingai_maps_name_the_line(tmp_path, text, words):
    path = tmp_path / "a.map"
    path.write_text(text)
    with pytest.raises(MapFileError, match=rf"a\.map.*{words}"):
        read_movingai_map(path)


def test_movingai_refuses_no_file_and_no_size(tmp_path):
    with pytest.raises(MapFileError, match=r"none\.map: expected a readable"):
        read_movingai_map(tmp_path / "none.map")
    with pytest.raises(ParameterError, match="cell_size_m"):
        read_movingai_map(tmp_path / "none.map", cell_size_m=0)
