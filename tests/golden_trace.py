"""Traces of golden scenarios: ids and counts are compared exactly, numbers to 1e-9."""

import difflib
import json
import math
from pathlib import Path

RELATIVE = 1e-9


def assert_follows(golden: Path, came: object, *, update: bool) -> None:
    """Compare what a run did with its trace; ``pytest --update-golden`` writes the trace anew."""
    came = json.loads(json.dumps(came))
    text = json.dumps(came, indent=1) + "\n"
    if update:
        golden.write_text(text, encoding="utf-8")
    kept = golden.read_text(encoding="utf-8")
    places = difference(json.loads(kept), came)
    lines = difflib.unified_diff(kept.splitlines(), text.splitlines(), "golden", "now", n=1)
    assert not places, "\n".join([*places[:20], "", *list(lines)[:60]])


def difference(wanted: object, came: object, place: str = "") -> list[str]:
    """Places where two traces differ by more than rounding."""
    if isinstance(wanted, dict) and isinstance(came, dict) and wanted.keys() == came.keys():
        return [
            line for key in wanted for line in difference(wanted[key], came[key], f"{place}.{key}")
        ]
    if isinstance(wanted, list) and isinstance(came, list) and len(wanted) == len(came):
        pairs = enumerate(zip(wanted, came, strict=True))
        return [line for i, (a, b) in pairs for line in difference(a, b, f"{place}[{i}]")]
    if isinstance(wanted, float) and isinstance(came, float):
        same = math.isclose(wanted, came, rel_tol=RELATIVE)
    else:
        same = type(wanted) is type(came) and wanted == came
    return [] if same else [f"{place}: expected {wanted!r}, got {came!r}"]
