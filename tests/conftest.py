"""What every test shares: hypothesis profiles and the option that rewrites golden traces.

Profiles: ``dev`` (default), ``ci`` (where CI is set; the same examples every time), ``deep`` (by
hand: ``pytest --hypothesis-profile deep``).
"""

import gc
import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: see fgplan/threads.py
# Tests start a hundred processes: each would translate all sources again where nothing is kept.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

import pytest
from hypothesis import HealthCheck, settings

sys.dont_write_bytecode = False

settings.register_profile("dev", max_examples=25, deadline=None)
settings.register_profile(
    "ci",
    max_examples=200,
    deadline=None,
    derandomize=True,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile("deep", max_examples=5000, deadline=None, print_blob=True)
settings.load_profile("ci" if os.environ.get("CI") else "dev")


def pytest_addoption(parser):
    parser.addoption(
        "--update-golden",
        action="store_true",
        help="rewrite the traces in tests/golden instead of comparing with them",
    )


def pytest_collection_finish(session):
    """What was imported and collected stays: nothing is gained by looking for garbage in it."""
    gc.collect()
    gc.freeze()


def pytest_configure(config):
    if config.getoption("--update-golden") and os.environ.get("CI"):
        raise pytest.UsageError("--update-golden: CI compares with golden traces; it never writes")


@pytest.fixture
def no_pictures(monkeypatch):
    """Runs of a test that looks at none draw none: three pictures take as long as the plan."""
    from fgplan.cli import run_command

    monkeypatch.setattr(run_command, "draw_run_figures", lambda _: ())


@pytest.fixture(scope="session")
def robot_server(tmp_path_factory):
    """The one process that starts robots as processes."""
    from crossing_teams import crossing
    from process_teams import RobotServer

    server = RobotServer(crossing(tmp_path_factory.mktemp("server"), 4))
    try:
        yield server
    finally:
        server.end()
