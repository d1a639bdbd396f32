"""What a shell completes on its own: a script of shtab, written once, so that a Tab starts no
Python.

It knows commands, options, choices, files and folders, and names that commas join, such as those of
effects.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from calib.commands.arguments import effects, free
from calib.errors import InputError
from calib.extras import how_to_install

SHELLS = ("bash", "zsh")
FOLDERS = ("DIR", "SESSION")
FILES = ("MANIFEST",)
"""What stands for a folder or a file in the help; all else that is a Path may be either."""
JOINED = """
_refracal_{key}() {{
  local before=
  [[ $1 == *,* ]] && before="${{1%,*}},"
  compgen -P "$before" -W "{names}" -- "${{1##*,}}"
}}
"""
FALLBACK = "\ncomplete -o bashdefault -o default -F _shtab_{program} {program}"
"""Where nothing of ours fits, bash completes files: capture's SESSION may stand where its commands
do.
"""


class PrintCompletion(argparse.Action):
    """`--print-completion SHELL`: prints the script and ends."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        _: argparse.Namespace,
        shell: str | Sequence[object] | None,
        *__: object,
    ) -> None:
        try:
            print(script(parser, str(shell)))
        except InputError as error:
            parser.error(str(error))
        parser.exit()


def add_completion(parser: argparse.ArgumentParser) -> None:
    said = (
        "print what makes the shell complete commands, options, files and names, and end:"
        " docs/install.md"
    )
    parser.add_argument(
        "--print-completion",
        choices=SHELLS,
        action=PrintCompletion,
        default=argparse.SUPPRESS,
        help=said,
    )


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """For the shell to read; InputError where shtab is not installed."""
    try:
        import shtab
    except ImportError as error:
        raise InputError(
            f"Completion needs one more package: {how_to_install('completion')}"
        ) from error
    for action in _actions(parser):
        if action.metavar in FOLDERS:
            action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
        elif action.type is Path or action.metavar in FILES:
            action.complete = shtab.FILE  # type: ignore[attr-defined]
        elif action.type in NAMES:
            action.complete = _joined(*NAMES[action.type]())  # type: ignore[attr-defined]
    written = str(shtab.complete(parser, shell))
    return written + (FALLBACK.format(program=parser.prog) if shell == "bash" else "")


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Of a parser and all its commands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions(command)


def _joined(key: str, names: Sequence[str]) -> dict[str, object]:
    """Names of which several may be joined by commas, as shtab is told of them."""
    listed = " ".join(names)
    return {
        "bash": f"_refracal_{key}",
        "zsh": f" _values -s , {key} {listed}",
        "preamble": {"bash": JOINED.format(key=key, names=listed)},
    }


def _effects() -> tuple[str, Sequence[str]]:
    from calib.commands.effect_names import effect_names

    return "effects", ("none", "auto", *effect_names())


def _free() -> tuple[str, Sequence[str]]:
    from calib.session import freeing

    return "free", freeing.NAMES


NAMES = {effects: _effects, free: _free}
"""By the function that reads an argument: what may be written there."""
