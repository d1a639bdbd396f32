"""A program with several commands: its arguments, its error messages and its exit codes.

This module imports nothing slow.
"""

import argparse
import codecs
import contextlib
import io
import os
import sys
import traceback
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from types import ModuleType

from calib.commands.completion import add_completion
from calib.commands.parser import (
    CommandGroup,
    Help,
    Parser,
    command_name,
    examples_of,
    with_choices_below,
)
from calib.commands.printing import drop, print_error
from calib.commands.standard_streams import prepare_streams
from calib.errors import InputError, RefracalError, brief
from calib.version import VERSION

PLAIN = {"±": "+-", "µ": "u", "²": "^2", "°": " deg"}
"""Spellings in ASCII; other characters become escapes."""
QUIET = "print no progress and no remarks"
OUR_PACKAGES = ("calib", "capture")
"""A module of these that is missing is a bug."""


def run_command(
    program: str,
    description: str,
    commands: Sequence[ModuleType],
    argv: Sequence[str] | None,
    groups: Sequence[CommandGroup] = (),
    epilog: str = "",
) -> int:
    """Run the command that the arguments name, and return the exit code.

    Args:
        description: the text above the list of commands in the program's help.
        commands: modules with the texts SUMMARY (one line) and DESCRIPTION, and the functions
            `add_arguments(parser)` and `run(args)`, which returns an exit code, or None for 0. The
            help lists them in this order. A command has the name of its module, without
            `_command` and with dashes. It may have EXAMPLES, command lines for its help, QUIET, the
            help of its --quiet, and COMMON, the options that its --help explains, with short
            explanations: --help-all explains all of them. `common_epilog()` returns the last lines
            of that --help.
        argv: the arguments; None for those of this process.
        groups: the same commands in groups, for the help of a program that has many. The commands
            then take --quiet.
        epilog: the text below the list of commands.
    """
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    prepare_streams()
    _spell_plainly()
    if os.environ.get("COLUMNS") == "0":  # a terminal without a size: rich would print nothing
        del os.environ["COLUMNS"]
    words = list(sys.argv[1:] if argv is None else argv)
    if words[:1] == ["help"]:  # as git has it
        words = [*words[1:], "--help"]
    try:
        parser = _parser(program, description, commands, groups, epilog)
        if not words:
            parser.print_help()
            print_error(program, f"name a COMMAND; {program} COMMAND --help explains it.")
            parser.exit(2)
        args = parser.parse_args(words)
        args.words = list(words)
        _check_current_folder()
        _check_build_date()
        with _silence_remarks() if getattr(args, "quiet", False) else contextlib.nullcontext():
            code: int | None = args.run(args)
        print(end="", flush=True)  # a full disk raises here; at exit it would be a traceback
    except RefracalError as error:
        print_error(program, with_choices_below(str(error)))
        return error.exit_code
    except KeyboardInterrupt:
        print(f"{program}: interrupted.", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader of a pipe may stop early
        drop(sys.stdout)
        return 0
    except SystemExit as stop:  # rich exits with 1 there
        if not isinstance(stop.__context__, BrokenPipeError):
            raise
        return 0
    except Exception as error:
        if (
            isinstance(error, OSError) and error.errno and error.filename is None
        ):  # the error names no file, so it concerns stdout
            reason = f"the result cannot be printed ({error.strerror})"
            print_error(program, f"{reason}: send stdout to another place.")
            drop(sys.stdout)
            return 2
        if "REFRACAL_TRACEBACK" in os.environ:
            traceback.print_exc()
        if package := _missing_package(error):
            advice = "activate the environment with Refracal (. .venv/bin/activate), or install it."
            print_error(program, f"this Python has no package {package}: {advice}")
            return 2
        bug = f"this is a bug in {program} ({type(error).__name__}: {brief(error)})"
        advice = "run it again with REFRACAL_TRACEBACK=1 and report what it prints."
        print_error(program, f"{bug}: {advice}")
        return 1
    return code or 0


@contextlib.contextmanager
def _silence_remarks() -> Iterator[None]:
    """A context in which nothing that is printed on stderr appears: progress bars and remarks."""
    with Path(os.devnull).open("w") as nowhere, contextlib.redirect_stderr(nowhere):
        yield


def _missing_package(error: Exception) -> str:
    """Return the name of a package that this Python lacks; empty for any other error."""
    if not isinstance(error, ModuleNotFoundError) or not error.name:
        return ""
    package = error.name.partition(".")[0]
    return "" if package in OUR_PACKAGES else package


def _check_current_folder() -> None:
    """Raise InputError if the folder in which the program was started is gone: torch would end the
    process there without a word of ours.
    """
    try:
        Path.cwd()
    except FileNotFoundError as error:
        raise InputError("The current folder was removed: change to another one.") from error


def _check_build_date() -> None:
    """Raise InputError if SOURCE_DATE_EPOCH is not a time: libraries that write files read it."""
    text = os.environ.get("SOURCE_DATE_EPOCH", "")
    if text and not (text.isascii() and text.isdigit() and len(text) < 12):
        raise InputError(
            f"The environment variable SOURCE_DATE_EPOCH is {brief(text)!r}: unset it, or write the"
            " whole seconds since 1970, such as 1700000000."
        )


def _spell_plainly() -> None:
    """Let stdout and stderr spell what their encoding does not have, such as ± in ASCII."""
    codecs.register_error("plain", _plain_spelling)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and codecs.lookup(stream.encoding).name != "utf-8":
            stream.reconfigure(errors="plain")


def _plain_spelling(error: UnicodeError) -> tuple[str, int]:
    """Return the spelling of the characters that cannot be encoded, and where they end."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    characters = error.object[error.start : error.end]
    escapes = (PLAIN.get(c) or c.encode("ascii", "backslashreplace").decode() for c in characters)
    return "".join(escapes), error.end


def _parser(
    program: str,
    description: str,
    commands: Sequence[ModuleType],
    groups: Sequence[CommandGroup] = (),
    epilog: str = "",
) -> argparse.ArgumentParser:
    formatter = partial(Help, groups=groups)
    parser = Parser(program, description=description, epilog=epilog, formatter_class=formatter)
    parser.add_argument("--version", action="version", version=f"refracal {VERSION}")
    add_completion(parser)
    choices = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in commands:
        examples = "\n".join(["Examples:", *(f"  {line}" for line in examples_of(command))])
        common_epilog = getattr(command, "common_epilog", str)
        texts = [command.SUMMARY, command.DESCRIPTION.strip(), examples]
        subparser = choices.add_parser(
            command_name(command),
            help=command.SUMMARY,
            description="\n\n".join(texts if examples_of(command) else texts[:2]),
            formatter_class=Help,
            example=next(iter(examples_of(command)), ""),
            common=getattr(command, "COMMON", None),
            common_epilog=common_epilog(),
        )
        command.add_arguments(subparser)
        if groups:
            quiet = getattr(command, "QUIET", QUIET)
            subparser.add_argument("-q", "--quiet", action="store_true", help=quiet)
        subparser.set_defaults(run=command.run)
    return parser
