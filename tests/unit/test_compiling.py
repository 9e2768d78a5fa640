"""Processes that compile variants of one function at once keep their caches apart, and wait for
each other instead of compiling the same variant; what only kernels call is refused to Python."""

import importlib
import os
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from fgplan import compiling

locks = pytest.mark.skipif(compiling.fcntl is None, reason="this system has no such locks")

ROOT = Path(__file__).parents[2]
MODULE = """
from fgplan.compiling import njit

@njit(cache=True)
def add(a, b):
    return a + b

@njit(cache=True, inner=True)
def double(a):
    return add(a, a)

@njit(cache=True)
def quadruple(a):
    return add(double(a), double(a))
"""
CHILD = """
import pathlib, sys, time
import numpy as np
from numba.core.caching import IndexDataCacheFile
from kernel_of_test import add

load = IndexDataCacheFile._load_index
def slowly(self):  # the window in which another process reads the same index
    found = load(self)
    time.sleep(0.1)
    return found
IndexDataCacheFile._load_index = slowly
here = pathlib.Path(sys.argv[2])
(here / f"{sys.argv[1]}.ready").touch()
while len(list(here.glob("*.ready"))) < int(sys.argv[3]):
    time.sleep(0.001)
kinds = [np.float32, np.float64, np.int32, np.int64, np.int16, np.uint8, np.uint16, np.uint32]
for kind in kinds[int(sys.argv[1])::int(sys.argv[3])]:
    found = add(kind(2), kind(3))
    assert found == 5, (kind, found)
stats = add.stats
print(sum(stats.cache_hits.values()), sum(stats.cache_misses.values()))
"""

SAME = """
import pathlib, sys, time
from numba.core import event
from kernel_of_test import quadruple

class Slowly(event.Listener):
    def on_start(self, event):
        time.sleep(0.3)  # the others come while this one compiles
    def on_end(self, event):
        pass

event.register("numba:compile", Slowly())
here = pathlib.Path(sys.argv[2])
(here / f"{sys.argv[1]}.ready").touch()
while len(list(here.glob("*.ready"))) < int(sys.argv[3]):
    time.sleep(0.001)
assert quadruple(3.0) == 12.0
stats = quadruple.stats
print(sum(stats.cache_hits.values()), sum(stats.cache_misses.values()))
"""


def start(folder, first, together, child=CHILD):
    path = os.pathsep.join([str(ROOT), str(folder)])
    environment = {**os.environ, "PYTHONPATH": path}
    environment.pop("NUMBA_CACHE_DIR", None)
    return subprocess.Popen(
        [sys.executable, "-c", child, str(first), str(folder), str(together)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_variants_compiled_at_once_are_all_found_again(tmp_path):
    (tmp_path / "kernel_of_test.py").write_text(MODULE)
    children = [start(tmp_path, first, 3) for first in range(3)]
    for child in children:
        _, error = child.communicate(timeout=120)
        assert child.returncode == 0, error
    again = start(tmp_path, 0, 1)
    out, error = again.communicate(timeout=120)
    assert again.returncode == 0, error
    hits, misses = map(int, out.split())
    assert (hits, misses) == (8, 0)
    index = list((tmp_path / "__pycache__").glob("*.nbi"))
    assert len(index) == 1
    assert len(list((tmp_path / "__pycache__").glob("*.nbc"))) == 8


def test_without_the_compiler_a_kernel_is_the_function_itself(tmp_path):
    (tmp_path / "kernel_of_test.py").write_text(MODULE)
    path = os.pathsep.join([str(ROOT), str(tmp_path)])
    done = subprocess.run(
        [sys.executable, "-c", "from kernel_of_test import add; print(type(add).__name__)"],
        env={**os.environ, "PYTHONPATH": path, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    assert done.stdout.strip() == "function"


@locks
def test_a_variant_wanted_at_once_is_compiled_by_one_and_loaded_by_the_others(tmp_path):
    (tmp_path / "kernel_of_test.py").write_text(MODULE)
    children = [start(tmp_path, first, 3, SAME) for first in range(3)]
    counts = []
    for child in children:
        out, error = child.communicate(timeout=120)
        assert child.returncode == 0, error
        counts.append(tuple(map(int, out.split())))
    assert sorted(counts) == [(0, 1), (1, 0), (1, 0)]


@locks
def test_who_waits_too_long_compiles_for_itself(tmp_path, monkeypatch):
    (tmp_path / "kernel_of_patience.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(compiling, "PATIENCE_S", 0.1)
    add = importlib.import_module("kernel_of_patience").add
    (tmp_path / "__pycache__").mkdir(exist_ok=True)
    with (tmp_path / "__pycache__" / f"{add._cache._impl.filename_base}.lock").open("ab") as other:
        compiling.fcntl.flock(other, compiling.fcntl.LOCK_EX)
        assert add(2, 3) == 5
    assert sum(add.stats.cache_misses.values()) == 1


def test_a_kernel_that_does_not_compile_gives_its_lock_back(tmp_path, monkeypatch):
    (tmp_path / "kernel_of_failure.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    add = importlib.import_module("kernel_of_failure").add
    with pytest.raises(numba.TypingError):
        add("two", 3)
    assert add._cache.lock is None
    assert add(2, 3) == 5
    assert add._cache.lock is None


def test_a_kernel_for_kernels_refuses_python(tmp_path, monkeypatch):
    (tmp_path / "kernel_of_kernels.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    module = importlib.import_module("kernel_of_kernels")
    for _ in range(2):  # whether it is compiled yet or not
        with pytest.raises(TypeError, match="double: expected a call from another kernel, got one"):
            module.double(1.0)
        assert module.quadruple(1.0) == 4.0
