"""The command ``fgplan``; its start imports nothing heavy."""

from fgplan.cli.command_line import main

__all__ = ["main"]
