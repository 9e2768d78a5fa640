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
    plot = verbs.add_parser("plot", help="draw the figures of a run folder again")
    plot.add_argument("folder", metavar="DIR", help="a folder that fgplan run or demo wrote")
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


def _add_common(parser: argparse.ArgumentParser) -> None:
    """The arguments that run, demo, bench and reproduce share."""
    parser.add_argument("--out", metavar="DIR", help="run folder (default: runs/COMMAND-NAME)")
    parser.add_argument("--json", metavar="FILE", help="write the result here too")
    parser.add_argument("--seeds", metavar="N", type=_count, help="number of seeds")
    parser.add_argument(
        "--first-seed", metavar="S", type=_seed, help="first seed (default 0, or the scenario's)"
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
