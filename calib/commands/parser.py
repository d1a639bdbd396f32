"""The parser of a program with several commands: how it reads words, and what its help shows."""

import argparse
import copy
import re
import sys
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from types import ModuleType
from typing import IO, Any, NoReturn

from calib.commands.printing import print_error
from calib.errors import RefracalError, brief, harmless, meant

NUMBER = re.compile(
    r"[+-]?([0-9]+([.,][0-9]*)?|[.,][0-9]+)(e[+-]?[0-9]+)?(mm|cm|m)?|[+-]?(inf|nan)", re.IGNORECASE
)
"""A word that can only be meant as a number, rightly written or not."""
NEGATIVE = re.compile(r"-[0-9.]")
"""The beginning of a negative number, or of a list that begins with one. No option begins so."""
COMPONENT = re.compile(r"[+-]?[0-9.]+(e[+-]?[0-9]+)?((\+-|±)[0-9.]+)?", re.IGNORECASE)
"""One number of an option that takes several, such as 0, -8 or 40+-5."""
CHOICES = re.compile(
    r"(Choose from|allowed here are|[Ww]rite (none, auto, or )?some of)(?= [^ ]+, )"
)
"""The words before a list of choices in a message."""
LINE = 80
"""The width of the lines that list choices."""
MISSING = ("the following arguments are required: ", "one of the arguments ")
"""The first words of argparse's messages on arguments that are missing."""
SURPLUS = "unrecognized arguments: "
"""The first words of argparse's message on arguments that belong to nothing."""
HELP_ALL = "--help-all"
"""The option that explains every option of a command with many."""
HELP_OPTIONS = {
    "--help": "show this help and exit",
    HELP_ALL: "explain every option and exit",
}
"""The options that explain a command, with the same words in every help."""
OPTION_WIDTH = 32
"""The column at which short explanations begin."""
LONG_OPTION = re.compile(r"--[a-z][\w-]*", re.IGNORECASE)


def with_choices_below(message: str) -> str:
    """Return a message whose list of choices stands on indented lines of its own."""
    match = CHOICES.search(message)
    if not match:
        return str(RefracalError(message))
    choices = " ".join(map(harmless, message[match.start() :].split()))
    listed = textwrap.fill(
        choices, LINE, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False
    )
    return f"{RefracalError(message[: match.start()].rstrip())}\n{listed}"


@dataclass(frozen=True, slots=True)
class CommandGroup:
    """Commands that stand together in the help of their program."""

    title: str
    commands: tuple[ModuleType, ...]

    @property
    def examples(self) -> tuple[str, ...]:
        """The first example of each of its first two commands."""
        return tuple(examples_of(command)[0] for command in self.commands[:2])


def command_name(command: ModuleType) -> str:
    """Return the name that a command has on the command line."""
    return command.__name__.rpartition(".")[2].removesuffix("_command").replace("_", "-")


def examples_of(command: ModuleType) -> tuple[str, ...]:
    """Return the command lines that the command's help shows."""
    examples: tuple[str, ...] = getattr(command, "EXAMPLES", ())
    return examples


class Parser(argparse.ArgumentParser):
    """A parser that suggests the word that was meant, and lets positional words follow the numbers
    of an option: `--depth 0.5 1 SESSION`.
    """

    def __init__(
        self,
        *args: Any,
        example: str = "",
        common: Mapping[str, str] | None = None,
        common_epilog: str = "",
        **settings: Any,
    ) -> None:
        """Options are written in full: a misspelt one must not pass for the start of another.

        Args:
            example: a whole command, for the message on arguments that are missing.
            common: the options that --help explains, each with a short explanation, and the
                metavars of arguments. --help names the other options, and --help-all explains all
                of them. None if --help explains all.
            common_epilog: the last lines of --help, if `common` is given.
        """
        super().__init__(*args, **{"allow_abbrev": False, **settings})
        for option in HELP_OPTIONS.keys() & self._option_string_actions.keys():
            self._option_string_actions[option].help = HELP_OPTIONS[option]
        self._positionals.title = "arguments"  # as the help of common options has it
        self._example = example
        self._common = common
        self._common_epilog = common_epilog
        if common:
            self.add_argument(HELP_ALL, action=_HelpAll, help=HELP_OPTIONS[HELP_ALL])

    def format_help(self) -> str:
        """Return the help of the common options, or of all options if none is named common."""
        if self._common is None:
            return super().format_help()
        formatter = Help(self.prog, max_help_position=OPTION_WIDTH)
        formatter.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
        formatter.add_text(self.description)
        arguments = [a for a in self._positionals._group_actions if not _is_option(a)]
        formatter.start_section("arguments")
        formatter.add_arguments(list(filter(None, map(self._shortened, arguments))))
        formatter.end_section()
        explained: list[argparse.Action] = []
        rare: list[str] = []
        for group in self._action_groups:
            options = list(filter(_is_option, group._group_actions))
            short = [self._shortened(action) for action in options]
            explained += filter(None, short)
            names = [
                action.option_strings[-1]
                for action, shown in zip(options, short, strict=True)
                if shown is None
            ]
            if names:
                title = "general" if group is self._optionals else group.title
                rare.append(f"  {title}:  {' '.join(names)}")
        formatter.start_section("common options" if rare else "options")
        formatter.add_arguments(explained)
        formatter.end_section()
        if rare:
            formatter.add_text("\n".join([f"more options, which {HELP_ALL} explains:", *rare]))
        formatter.add_text(self._common_epilog)
        return formatter.format_help()

    def format_full_help(self) -> str:
        """Return the help of all options."""
        return super().format_help()

    def _shortened(self, action: argparse.Action) -> argparse.Action | None:
        """Return an argument or common option with its short explanation; None for any other."""
        short = HELP_OPTIONS | dict(self._common or {})
        for option in action.option_strings or [str(action.metavar)]:
            if option in short:
                shown = copy.copy(action)
                shown.help = short[option]
                shown.metavar = action.metavar or (action.dest.upper() if action.choices else None)
                return shown
        return None

    def _print_message(  # type: ignore[override]
        self, message: str, file: IO[str] | None = None
    ) -> None:
        """Print a text at once. Unlike that of argparse, a disk that is full raises OSError."""
        print(message, end="", file=file or sys.stderr, flush=True)

    def error(self, message: str) -> NoReturn:
        """Print the message alone, and where the options are explained. An argument may hold any
        character, for example a file name that a shell's * inserted: the message is made printable.
        """
        surplus = message.removeprefix(SURPLUS)
        if surplus != message and all(map(NUMBER.fullmatch, surplus.split())):
            message = f"{surplus} is too much: the option in front of it takes one number"
        if message.startswith(MISSING[0]) and (actions := self._action_names()):
            message += f", one of {', '.join(actions)}"
        if message.startswith(MISSING) and self._example:
            message += f". A whole command is: {self._example}"
        print_error(self.prog, with_choices_below(message))
        self.exit(2, f"see {self.prog} --help\n")

    def _action_names(self) -> list[str]:
        """Return the names of the command's own commands, such as those of calib rig."""
        kinds = [a for a in self._actions if isinstance(a, argparse._SubParsersAction)]
        return [name for kind in kinds for name in kind.choices]

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse the words. A word that is left over is an error here already: only the parser of
        its command knows the options that may have been meant.
        """
        if args is not None:
            self._check_options(args)
        words = args if args is None else self._join_numbers(args)
        parsed, unknown = super().parse_known_args(words, namespace or argparse.Namespace())
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(map(brief, unknown))}")
        return parsed, unknown

    def _check_options(self, words: Sequence[str]) -> None:
        """Refuse the first word that looks like an option and is none, with the option that may
        have been meant. It comes before argparse, which would complain about the consequences: a
        value without its option, or an argument that is missing.
        """
        options = [option for action in self._actions for option in action.option_strings]
        has_commands = any(isinstance(a, argparse._SubParsersAction) for a in self._actions)
        for word in words:
            if word == "--" or (has_commands and not word.startswith("-")):
                return  # the words of a command are checked by its own parser
            name = word.partition("=")[0]
            if LONG_OPTION.fullmatch(name) and name not in options:
                self.error(f"{brief(name)} is not an option{self._suggestion(name, options)}")

    def _suggestion(self, word: str, options: Sequence[str]) -> str:
        """Return the option that may have been meant by a word, as a hint."""
        names = [option.removeprefix("--") for option in options if option.startswith("--")]
        start = word.removeprefix("--")
        longer = [name for name in names if name.startswith(start)]
        close = meant(start, names) or (longer[0] if len(longer) == 1 else "")
        return f": did you mean --{close}?" if close else f" of {self.prog}"

    def _join_numbers(self, words: Sequence[str]) -> list[str]:
        """Return the words with the numbers of each option joined to it by an equals sign. argparse
        would give an option with several values all words that follow it, and would take the list
        -1,2 for an option.
        """
        joined: list[str] = []
        place = 0
        while place < len(words):
            word = words[place]
            if word == "--":
                return [*joined, *words[place:]]
            place += 1
            values: list[str] = []
            match self._value_count(word):
                case "+":
                    values = list(takewhile(NUMBER.fullmatch, words[place:]))
                case "1":
                    self._check_commas(word, words[place:])
                    values = list(takewhile(NEGATIVE.match, words[place : place + 1]))
            place += len(values)
            joined += [f"{word}={value}" for value in values] or [word]
        return joined

    def _check_commas(self, option: str, words: Sequence[str]) -> None:
        """Refuse the numbers of one option that blanks separate: it takes them joined by commas."""
        names = self._option_string_actions[option].metavar
        if not isinstance(names, str) or "," not in names:
            return
        numbers = list(takewhile(COMPONENT.fullmatch, words))
        if "..." not in names:
            numbers = numbers[: names.count(",") + 1]
        if len(numbers) > 1:
            self.error(
                f"{option} takes its numbers joined by commas: write {option} {','.join(numbers)}"
            )

    def _value_count(self, word: str) -> str:
        """Return "+" for an option that takes values, "1" for one that takes one value, and ""
        for every other word.
        """
        match self._option_string_actions.get(word):
            case argparse.Action(nargs="+"):
                return "+"
            case argparse.Action(nargs=None):
                return "1"
        return ""

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """Return the value that a word stands for. An empty word, and one that is no whole number,
        get a sentence that says so.

        Path("") is the current folder, so an unset variable of a shell must not become a path.
        """
        if not arg_string and arg_string != action.default:
            raise argparse.ArgumentError(
                action, "the word is empty: write it, or set the variable that it comes from"
            )
        if action.type is int and not re.fullmatch(r"[+-]?[0-9]+", arg_string):
            raise argparse.ArgumentError(action, f"{brief(repr(arg_string))} is not a whole number")
        return super()._get_value(action, arg_string)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Raise ArgumentError for a value that is none of the choices, with the one that may have
        been meant.
        """
        if action.choices is None or value in action.choices:
            return
        choices = [str(choice) for choice in action.choices]
        close = meant(value, choices)
        hint = f": did you mean {close}?" if close else "."
        raise argparse.ArgumentError(
            action,
            f"invalid choice {brief(repr(value))}{hint} Choose from {', '.join(choices)}",
        )


def _is_option(action: argparse.Action) -> bool:
    return bool(action.option_strings)


class _HelpAll(argparse._HelpAction):
    """The action of --help-all: it prints the help of all options and exits."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object, **__: object) -> None:
        assert isinstance(parser, Parser)
        print(parser.format_full_help(), end="")
        parser.exit()


class Help(argparse.HelpFormatter):
    """A formatter that fills paragraphs to the terminal's width. A paragraph with an indented line,
    such as a list, keeps its lines; the last column of a line that is too long wraps within itself.
    """

    def __init__(self, *args: Any, groups: Sequence[CommandGroup] = (), **options: Any) -> None:
        """`groups` are those of the commands; without them the commands are one list."""
        super().__init__(*args, **options)
        self._groups = groups

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        paragraphs = text.strip().split("\n\n")
        return "\n\n".join(
            (
                _wrap_list(paragraph, width)
                if "\n " in paragraph
                else super(Help, self)._fill_text(paragraph, width, indent)
            )
            for paragraph in paragraphs
        )

    def _split_lines(self, text: str, width: int) -> list[str]:
        """Return the lines of an explanation. An option in it is not divided at its hyphens."""
        return textwrap.wrap(" ".join(text.split()), width, break_on_hyphens=False)

    def _format_action(self, action: argparse.Action) -> str:
        if not (self._groups and isinstance(action, argparse._SubParsersAction)):
            return super()._format_action(action)
        entries = {entry.dest: entry for entry in action._get_subactions()}
        blocks: list[str] = []
        for group in self._groups:
            self._indent()
            lines = [self._format_action(entries[command_name(c)]) for c in group.commands]
            self._dedent()
            examples = [f"      {example}\n" for example in group.examples]
            blocks.append("".join([f"  {group.title}\n", *lines, "    for example\n", *examples]))
        return "\n".join(blocks)


def _wrap_list(lines: str, width: int) -> str:
    columns = ((line, re.match(r" *\S.*?  +", line)) for line in lines.split("\n"))
    return "\n".join(
        textwrap.fill(
            line,
            width,
            subsequent_indent=" " * (first.end() if first else 0),
            break_on_hyphens=False,
        )
        for line, first in columns
    )
