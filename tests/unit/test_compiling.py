"""Processes that compile variants of one function at once keep their caches apart."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
MODULE = """
from fgplan.compiling import njit

@njit(cache=True)
def add(a, b):
    return a + b
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


def start(folder, first, together):
    path = os.pathsep.join([str(ROOT), str(folder)])
    environment = {**os.environ, "PYTHONPATH": path}
    environment.pop("NUMBA_CACHE_DIR", None)
    return subprocess.Popen(
        [sys.executable, "-c", CHILD, str(first), str(folder), str(together)],
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
