"""A program with several commands: its arguments, its error messages and its exit codes.

This module imports nothing slow.
"""

import argparse
import os
import re
import sys
import textwrap
import traceback
from collections.abc import Sequence
from types import ModuleType
from typing import NoReturn

from calib.commands.completion import add_completion
from calib.errors import RefracalError, brief
from calib.version import VERSION


def run_command(
    program: str,
    description: str,
    commands: Sequence[ModuleType],
    argv: Sequence[str] | None,
) -> int:
    """Run the command that the arguments name, and return the exit code.

    Args:
        description: the text above the list of commands in the program's help.
        commands: modules with the texts SUMMARY (one line) and DESCRIPTION, and the functions
            `add_arguments(parser)` and `run(args)`, which returns an exit code, or None for 0. The
            help lists them in this order. A command has the name of its module, without
            `_command` and with dashes.
        argv: the arguments; None for those of this process.
    """
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    args = _parser(program, description, commands).parse_args(argv)
    try:
        code: int | None = args.run(args)
        print(end="", flush=True)  # a full disk raises here; at exit it would be a traceback
    except RefracalError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(f"{program}: interrupted.", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader of a pipe may stop early
        _drop_stdout()
        return 0
    except Exception as error:
        if (
            isinstance(error, OSError) and error.errno and error.filename is None
        ):  # the error names no file, so it concerns stdout
            print(
                f"{program}: the result cannot be printed ({error.strerror}): send stdout to"
                " another place.",
                file=sys.stderr,
            )
            _drop_stdout()
            return 2
        if "REFRACAL_TRACEBACK" in os.environ:
            traceback.print_exc()
        print(
            f"{program}: this is a bug in {program} ({type(error).__name__}: {brief(error)}): "
            "run it again with REFRACAL_TRACEBACK=1 and report what it prints.",
            file=sys.stderr,
        )
        return 1
    return code or 0


def _drop_stdout() -> None:
    """Redirect stdout to nowhere, so that Python does not write its buffer again at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """Make the message printable: an argument may hold any character, for example a file name
        that a shell's * inserted.
        """
        super().error(str(RefracalError(message)))


class _Help(argparse.HelpFormatter):
    """A formatter that fills paragraphs to the terminal's width. A paragraph with an indented line,
    such as a list, keeps its lines; the last column of a line that is too long wraps within itself.
    """

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        paragraphs = text.strip().split("\n\n")
        return "\n\n".join(
            (
                _wrap_list(paragraph, width)
                if "\n " in paragraph
                else super(_Help, self)._fill_text(paragraph, width, indent)
            )
            for paragraph in paragraphs
        )


def _wrap_list(lines: str, width: int) -> str:
    columns = ((line, re.match(r" *\S.*?  +", line)) for line in lines.split("\n"))
    return "\n".join(
        textwrap.fill(line, width, subsequent_indent=" " * (first.end() if first else 0))
        for line, first in columns
    )


def _parser(
    program: str, description: str, commands: Sequence[ModuleType]
) -> argparse.ArgumentParser:
    parser = _Parser(program, description=description, formatter_class=_Help)
    parser.add_argument("--version", action="version", version=f"refracal {VERSION}")
    add_completion(parser)
    choices = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in commands:
        name = command.__name__.rpartition(".")[2].removesuffix("_command").replace("_", "-")
        subparser = choices.add_parser(
            name,
            help=command.SUMMARY,
            description=f"{command.SUMMARY}\n\n{command.DESCRIPTION.strip()}",
            formatter_class=_Help,
        )
        command.add_arguments(subparser)
        subparser.set_defaults(run=command.run)
    return parser
