"""The completion script for a shell. shtab writes it once, so that a Tab starts no Python.

The script completes commands, options, choices, files, folders, and names that commas join, such as
the effects' names.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

from calib.commands.arguments import effects, free
from calib.errors import InputError
from calib.extras import how_to_install

SHELLS = ("bash", "zsh", "fish")
FOLDERS = ("DIR", "SESSION")
FILES = ("MANIFEST",)
"""The metavars of folders and of files. Any other argument of type Path may be either."""
JOINED = """
_refracal_{key}() {{
  local before=
  [[ $1 == *,* ]] && before="${{1%,*}},"
  compgen -P "$before" -W "{names}" -- "${{1##*,}}"
}}
"""
FALLBACK = "\ncomplete -o bashdefault -o default -F _shtab_{program} {program}"
"""If no word of the script fits, bash completes files: SESSION may stand at the place of a command
of capture.
"""


class PrintCompletion(argparse.Action):
    """The action of `--print-completion SHELL`: it prints the script and exits."""

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
    help_text = (
        "print a script with which the shell completes commands, options, files and names, and"
        " exit: docs/install.md"
    )
    parser.add_argument(
        "--print-completion",
        choices=SHELLS,
        action=PrintCompletion,
        default=argparse.SUPPRESS,
        help=help_text,
    )


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """Return the script for the shell. Raise InputError if shtab is not installed."""
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
    text = str(shtab.complete(parser, shell))
    return text + (FALLBACK.format(program=parser.prog) if shell == "bash" else "")


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield the actions of a parser and of all its commands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from _actions(command)


def _joined(key: str, names: Sequence[str]) -> dict[str, object]:
    """Return shtab's description of names that commas may join."""
    name_list = " ".join(names)
    return {
        "bash": f"_refracal_{key}",
        "zsh": f" _values -s , {key} {name_list}",
        "fish": f"(__fish_append , {name_list})",
        "preamble": {"bash": JOINED.format(key=key, names=name_list)},
    }


def _effects() -> tuple[str, Sequence[str]]:
    from calib.commands.effect_names import registered_names

    return "effects", ("none", "auto", *registered_names())


def _free() -> tuple[str, Sequence[str]]:
    from calib.session import freeing

    return "free", freeing.option_names()


NAMES = {effects: _effects, free: _free}
"""The functions that return the allowed names of an argument, by the type of the argument."""
