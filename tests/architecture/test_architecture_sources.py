"""Rules that no linter has, read from the sources: size, names, docstrings, ``__all__``."""

import ast
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("fgplan", "roadmaps")
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
NAMES = [str(path.relative_to(ROOT)) for path in SOURCES]
TESTS = sorted((ROOT / "tests").rglob("*.py"))
LONGEST = 400
VAGUE = {"utils", "util", "helpers", "helper", "common", "misc", "core", "base"}

PUBLIC = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def public_definitions(tree: ast.Module) -> list[tuple[str, PUBLIC]]:
    """Public functions and classes of a module, and public methods of public classes."""
    found: list[tuple[str, PUBLIC]] = []
    for node in tree.body:
        if not isinstance(node, PUBLIC) or node.name.startswith("_"):
            continue
        found.append((node.name, node))
        if isinstance(node, ast.ClassDef):
            found += [
                (f"{node.name}.{inner.name}", inner)
                for inner in node.body
                if isinstance(inner, PUBLIC) and not inner.name.startswith("_")
            ]
    return found


def parameters(node: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    """Names of a function's parameters, without self and cls."""
    given = node.args
    every = [*given.posonlyargs, *given.args, *given.kwonlyargs]
    names = [argument.arg for argument in every]
    if given.vararg is not None:
        names.append(given.vararg.arg)
    return [name for name in names if name not in ("self", "cls")]


def documented(docstring: str, section: str) -> set[str] | None:
    """Names that a section of a Google docstring documents, or None without that section."""
    match = re.search(rf"^{section}:\n((?:[ ]+.*\n?|\n)*)", docstring, re.MULTILINE)
    if match is None:
        return None
    heads = re.findall(r"^    (\*{0,2}\w[\w, *]*):", match.group(1), re.MULTILINE)
    return {name.strip(" *") for head in heads for name in head.split(",")}


def test_there_is_something_to_check():
    assert len(SOURCES) > 50


@pytest.mark.parametrize("path", SOURCES, ids=NAMES)
def test_module_is_short_named_for_a_noun_and_documented(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= LONGEST, f"{len(lines)} lines; cut it where it holds two things"
    assert path.stem not in VAGUE
    assert path.parent.name not in VAGUE
    tree = ast.parse("\n".join(lines))
    assert ast.get_docstring(tree), "no module docstring"
    for name, node in public_definitions(tree):
        text = ast.get_docstring(node)
        assert text, f"{name} has no docstring"
        if isinstance(node, ast.ClassDef):
            continue
        names = documented(text, "Args")
        if names is not None:
            # Compiled kernels take dozens of flat arrays and document them in groups.
            grouped = path.stem.endswith("_kernels")
            missing = set() if grouped else set(parameters(node)) - names
            assert not missing, f"{name}: parameters {sorted(missing)} are not documented"
            strangers = names - set(parameters(node)) - {"kwargs"}
            assert not strangers, f"{name}: documents {sorted(strangers)}, which it does not take"


@pytest.mark.parametrize("path", SOURCES, ids=NAMES)
def test_no_module_imports_its_own_package_root(path):
    package = path.relative_to(ROOT).parts[0]
    if path == ROOT / package / "__init__.py":
        return
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            assert all(alias.name != package for alias in node.names)
        if isinstance(node, ast.ImportFrom):
            assert node.module != package
            assert node.level == 0


def test_names_of_test_files_are_unique():
    names = [path.name for path in TESTS if path.name.startswith("test_")]
    assert sorted(set(names)) == sorted(names)


def test_tests_import_nothing_from_outside_the_checkout():
    for path in [*TESTS, *SOURCES]:
        assert "../" + "shared" not in path.read_text(encoding="utf-8"), path


@pytest.mark.parametrize("package", PACKAGES)
def test_public_names_exist_and_are_listed(package):
    module = importlib.import_module(package)
    assert len(module.__all__) == len(set(module.__all__))
    for name in module.__all__:
        assert hasattr(module, name), name


def test_lazy_names_of_fgplan_agree_with_what_type_checkers_see():
    import fgplan

    tree = ast.parse((ROOT / "fgplan" / "__init__.py").read_text(encoding="utf-8"))
    seen = {
        alias.asname or alias.name: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("fgplan.")
        for alias in node.names
    }
    assert seen == fgplan.MODULE_OF
    assert sorted(seen) == list(fgplan.__all__)
