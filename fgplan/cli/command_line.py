"""The command line: arguments in, exit status out.

    0 done    1 no feasible plan, or --check and a requirement is not met    2 bad input
    130 interrupted; the result file holds what was done so far

Known errors (those of fgplan and of roadmaps) end in one line on standard error. Anything else is
a bug and keeps its traceback.
"""

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from fgplan.cli.command_registry import REGISTRY


class _OneLineParser(argparse.ArgumentParser):
    """Says what is wrong in one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        """Print one line and exit with status 2."""
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command ``fgplan``.

    Args:
        arguments: Words after ``fgplan``; those of the process by default.

    Returns:
        Exit status.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    # one BLAS thread, see fgplan/threads.py; read once, when numpy is first imported
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    parser = build_parser(words)
    options = parser.parse_args(words)
    if options.verb is None:
        parser.error("expected a command")
    # Everything below needs numpy and more; --help and wrong words must not wait for it.
    from fgplan.cli.execution import execute

    return execute(options, words)


def build_parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """Build the parser; only the command that ``words`` name is imported, for its own arguments.

    Args:
        words: Words after ``fgplan``.

    Returns:
        The parser.
    """
    parser = _OneLineParser(
        prog="fgplan",
        description="Belief-space planning for teams of robots.",
        epilog="exit status: 0 done, 1 no feasible plan (or --check failed), 2 bad input",
    )
    parser.add_argument("--version", action=_VersionAction, nargs=0, help="show the version")
    verbs = parser.add_subparsers(dest="verb", metavar="COMMAND")
    run = verbs.add_parser(
        "run", help="plan (or simulate) a scenario or a log and write a run folder"
    )
    run.add_argument(
        "scenario",
        metavar="SCENARIO",
        help="a .toml or .yaml scenario, or a log: .g2o, .pyfg, a folder of these, MR.CLAM",
    )
    _add_common(run)
    team = verbs.add_parser(
        "team", help="plan a scenario by robots that talk through messages, each in its process"
    )
    _add_team(team)
    robot = verbs.add_parser(
        "robot", help="run one robot of a scenario over the network, for several machines"
    )
    _add_robot(robot)
    check = verbs.add_parser("check", help="read a scenario or a log and say what is wrong with it")
    check.add_argument("scenario", metavar="SCENARIO", help="as of fgplan run")
    plot = verbs.add_parser("plot", help="draw the figures of a run folder again")
    plot.add_argument("folder", metavar="DIR", help="a folder that fgplan run or demo wrote")
    shown = verbs.add_parser("fields", help="every field of a scenario file, with its default")
    shown.add_argument(
        "planner", metavar="PLANNER", nargs="?", help="only the options of this planner"
    )
    shown.add_argument("--markdown", action="store_true", help="as docs/scenarios.md has it")
    for verb, summary in (
        ("demo", "run a worked example on real input"),
        ("bench", "measure, beside the obvious alternatives"),
        ("reproduce", "a published table or figure, beside ours"),
    ):
        named = verbs.add_parser(verb, help=summary).add_subparsers(
            dest="name", metavar="NAME", required=True
        )
        for name, command in REGISTRY[verb].items():
            inner = named.add_parser(name, help=command.summary, description=command.summary)
            _add_common(inner)
            if list(words[:1]) == [verb] and name in words:
                module = importlib.import_module(command.target.partition(":")[0])
                add_arguments = getattr(module, "add_arguments", None)
                if add_arguments is not None:
                    add_arguments(inner)
    return parser


def _add_team(parser: argparse.ArgumentParser) -> None:
    """The arguments of team."""
    parser.add_argument("scenario", metavar="SCENARIO", help="as of fgplan run")
    parser.add_argument(
        "--processes", action="store_true", help="one process a robot, over the loopback"
    )
    parser.add_argument(
        "--gather", metavar="DIR", help="plan of what robots that ran elsewhere wrote into DIR"
    )
    parser.add_argument(
        "--start-wait-s",
        metavar="S",
        type=_seconds,
        help="seconds that processes wait for the whole team before they begin without some whose "
        "processes have not ended (default: 120)",
    )
    parser.add_argument(
        "--time-limit-s", metavar="S", type=_seconds, help="seconds after which robots give up"
    )
    _add_common(parser, seeds=False)


def _add_robot(parser: argparse.ArgumentParser) -> None:
    """The arguments of robot."""
    parser.add_argument("scenario", metavar="SCENARIO", help="as of fgplan run, the same at all")
    parser.add_argument("--name", metavar="NAME", required=True, help="which robot this is")
    parser.add_argument(
        "--listen",
        metavar="ENDPOINT",
        action="append",
        help="where it listens: tcp/HOST:PORT (default: those of [team.network], or any port of "
        "the loopback)",
    )
    parser.add_argument(
        "--connect",
        metavar="ENDPOINT",
        action="append",
        help="where a teammate listens; one is enough to join, but name all that are known",
    )
    parser.add_argument("--out", metavar="DIR", help="run folder (default: runs/robot-SCENARIO)")
    parser.add_argument(
        "--start-wait-s",
        metavar="S",
        type=_seconds,
        default=120.0,
        help="seconds to wait for the whole team before it begins without some (default: 120)",
    )
    parser.add_argument(
        "--linger-s",
        metavar="S",
        type=_seconds,
        default=30.0,
        help="seconds to stay for others after it has finished (default: 30)",
    )
    parser.add_argument(
        "--time-limit-s", metavar="S", type=_seconds, help="seconds after which it gives up"
    )
    parser.add_argument("--quick", action="store_true", help="as of fgplan run, the same at all")
    parser.add_argument(
        "--child",
        action="store_true",
        help="started by fgplan team: kernels are compiled, progress goes out line by line, and it "
        "ends when standard input does",
    )


def _add_common(parser: argparse.ArgumentParser, *, seeds: bool = True) -> None:
    """The arguments that run, team, demo, bench and reproduce share."""
    parser.add_argument("--out", metavar="DIR", help="run folder (default: runs/COMMAND-NAME)")
    parser.add_argument("--json", metavar="FILE", help="write the result here too")
    if seeds:
        parser.add_argument("--seeds", metavar="N", type=_count, help="number of seeds")
        parser.add_argument(
            "--first-seed",
            metavar="S",
            type=_seed,
            help="first seed (default 0, or the scenario's)",
        )
    parser.add_argument("--quick", action="store_true", help="a short version, as tests run it")
    parser.add_argument(
        "--check", action="store_true", help="exit with 1 if a requirement is not met"
    )


def _seed(text: str) -> int:
    """A whole number of zero or more."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"expected a whole number, 0 or more, got {text!r}")
    return int(text)


def _count(text: str) -> int:
    """A whole number of one or more."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number, 1 or more, got {text!r}")
    return int(text)


def _seconds(text: str) -> float:
    """Seconds, zero or more."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"expected seconds, zero or more, got {text!r}")
    return value


class _VersionAction(argparse.Action):
    """Prints the version; looked up only when asked for."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: object,
        option_string: str | None = None,
    ) -> None:
        from importlib.metadata import PackageNotFoundError, version

        del namespace, values, option_string
        try:
            found = version("fgplan")
        except PackageNotFoundError:
            found = "from a checkout, not installed"
        sys.stdout.write(f"fgplan {found}\n")
        parser.exit(0)
