"""Takes the pictures that a calibration needs, with any camera that this machine has.

stdout carries the result, stderr what to do next and remarks. Exit codes: 0 done, 1 a bug, 2 wrong usage or input, 3 not enough good
data, 4 the device failed.
"""

import argparse
import os
import sys
import traceback
from collections.abc import Sequence
from importlib.metadata import version

from calib.errors import RefracalError
from capture.commands import record, sources

COMMANDS = (record, sources)
"""In the order of the help."""


def main(argv: Sequence[str] | None = None) -> int:
    """The command `capture`; returns its exit code."""
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    args = _parser().parse_args(argv)
    try:
        args.run(args)
        print(end="", flush=True)  # here a full disk is a sentence; at exit it would be a traceback
    except RefracalError as error:
        print(f"capture: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("capture: interrupted.", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader of a pipe has gone: its right
        _drop_stdout()
        return 0
    except Exception as error:
        if isinstance(error, OSError) and error.errno and error.filename is None:  # of no file by name, so of stdout
            print(f"capture: the result cannot be printed ({error.strerror}): send stdout to another place.", file=sys.stderr)
            _drop_stdout()
            return 2
        if "REFRACAL_TRACEBACK" in os.environ:
            traceback.print_exc()
        print(
            f"capture: this is a bug in capture ({type(error).__name__}: {error}): "
            "run it again with REFRACAL_TRACEBACK=1 and report what it prints.",
            file=sys.stderr,
        )
        return 1
    return 0


def _drop_stdout() -> None:
    """What is still buffered goes nowhere, so that Python does not try again at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("capture", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--version", action="version", version=f"refracal {version('refracal')}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in COMMANDS:
        name = command.__name__.rpartition(".")[2]
        summary = (command.__doc__ or "").partition("\n")[0]
        own = commands.add_parser(name, help=summary, description=command.__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
        command.add_arguments(own)
        own.set_defaults(run=command.run)
    return parser
