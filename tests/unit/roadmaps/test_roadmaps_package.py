import ast
import doctest
import importlib
import pickle
import pkgutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import roadmaps

ROOT = Path(__file__).parents[3]
MODULES = sorted(module.name for module in pkgutil.iter_modules(roadmaps.__path__))


@pytest.mark.parametrize("name", MODULES)
def test_examples_in_docstrings(name, monkeypatch):
    monkeypatch.chdir(ROOT)
    module = importlib.import_module(f"roadmaps.{name}")
    assert doctest.testmod(module, extraglobs={"np": np}).failed == 0


@pytest.mark.parametrize("name", MODULES)
def test_modules_are_short_and_import_neither_the_root_nor_fgplan(name):
    text = (ROOT / "roadmaps" / f"{name}.py").read_text(encoding="utf-8")
    assert len(text.splitlines()) < 400
    allowed = {"numpy", "scipy", "networkx", "shapely", "yaml", "roadmaps"}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            names = [node.module]
        else:
            continue
        for imported in names:
            assert imported != "roadmaps", "import the module, not the package root"
            assert imported.split(".")[0] in allowed | sys.stdlib_module_names


def test_optional_packages_and_gtsam_are_not_imported():
    code = (
        "import sys, roadmaps;"
        "print(sorted({'shapely', 'yaml', 'gtsam', 'fgplan'} & {*sys.modules}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_products_can_be_sent_to_another_process(field, roadmap):
    world, graph, matrix = pickle.loads(
        pickle.dumps((field, roadmap, roadmaps.read_roadmap(roadmap)))
    )
    points = np.random.default_rng(0).uniform(0, 100, (50, 2))
    np.testing.assert_array_equal(
        world.are_positions_valid(points), field.are_positions_valid(points)
    )
    expected = roadmaps.find_candidate_paths(roadmap, 0, 1, 3)
    assert roadmaps.find_candidate_paths(graph, 0, 1, 3) == expected
    assert roadmaps.find_candidate_paths(matrix, 0, 1, 3) == expected
    assert pickle.loads(pickle.dumps(expected)) == expected
