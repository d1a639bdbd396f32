"""The help of calib: groups, examples that can be typed, and numbers before a positional word."""

import re
import shlex
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from calib import cli
from calib.cli import main
from calib.commands import fit_command, init_command
from calib.commands.command_line import _parser
from calib.commands.effect_names import registered_names
from calib.commands.parser import command_name, examples_of
from calib.commands.verdict_lines import print_verdict
from calib.export.formats import FORMATS
from calib.verdict.verdict import Reason, Trust, Verdict
from capture.cli import COMMANDS as CAPTURE_COMMANDS
from capture.cli import main as capture_main

LINES = 50
"""The lines of a help that fit on a screen."""
PARSER = _parser("calib", "", cli.COMMANDS, cli.GROUPS)


def test_the_help_shows_groups_with_two_examples_each(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    places = []
    for group in cli.GROUPS:
        places.append(text.index(f"\n  {group.title}\n"))
        assert len(group.examples) == 2
        for example in group.examples:
            assert f"\n      {example}\n" in text
        for command in group.commands:
            assert f"\n    {command_name(command)} " in text
    assert places == sorted(places)
    assert max(map(len, text.splitlines())) <= 80


@pytest.mark.parametrize("command", [fit_command, init_command], ids=command_name)
def test_the_help_explains_the_common_options_and_names_the_others(
    command: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    texts = []
    for option in ("--help", "--help-all"):
        with pytest.raises(SystemExit) as ended:
            main([command_name(command), option])
        assert ended.value.code == 0
        texts.append(capsys.readouterr().out)
    short, full = texts
    assert len(short.splitlines()) <= LINES
    assert max(map(len, short.splitlines())) <= 80
    assert "\n  general:  " in short
    options = set(re.findall(r"^  (?:-\w(?: \S+)?, )?(--[a-z-]+)", full, re.MULTILINE))
    named = set(re.findall(r"(?<![\w-])(--[a-z-]+)", short)) | {"--output"}
    assert len(options) > 20
    assert options <= named
    for option, text in command.COMMON.items():
        assert re.search(rf"^  {option} .*  {re.escape(text)}$", short, re.MULTILINE)


@pytest.mark.parametrize(
    ("program", "command"),
    [
        *((main, command) for command in cli.COMMANDS),
        *((capture_main, command) for command in CAPTURE_COMMANDS),
    ],
    ids=lambda value: command_name(value) if isinstance(value, ModuleType) else "",
)
def test_a_help_fits_on_a_screen(
    program: Callable[[list[str]], int],
    command: ModuleType,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        program([command_name(command), "--help"])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= LINES
    assert max(map(len, lines)) <= 80
    assert [line.split(maxsplit=2)[1:] for line in lines if line.startswith("  -h,")] == [
        ["--help", "show this help and exit"]
    ]
    assert not [line for line in lines if re.search(r"--[a-z-]*-$", line)], "options stay whole"
    has_common_options = "common options:" in lines
    assert not has_common_options or lines[0].endswith(" [options]")


def test_the_short_help_names_every_effect_and_every_format(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for command, names in (
        ("diagnose", tuple(registered_names())),
        ("export", tuple(form.name for form in FORMATS)),
    ):
        with pytest.raises(SystemExit):
            main([command, "--help"])
        text = capsys.readouterr().out
        assert [name for name in names if not re.search(rf"\W{name}\b", text)] == []


def test_help_is_a_command(capsys: pytest.CaptureFixture[str]) -> None:
    texts = []
    for words in (["help", "fit"], ["fit", "--help"]):
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert ended.value.code == 0
        texts.append(capsys.readouterr().out)
    assert texts[0] == texts[1]


def test_a_program_by_its_name_shows_the_help(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["calib"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    output = capsys.readouterr()
    assert "Calibrate one camera" in output.out
    assert output.err == "calib: error: name a COMMAND; calib COMMAND --help explains it.\n"


@pytest.mark.parametrize("command", cli.COMMANDS, ids=command_name)
def test_each_command_has_examples_that_are_accepted(command: object) -> None:
    examples = examples_of(command)  # type: ignore[arg-type]
    assert 2 <= len(set(examples)) == len(examples) <= 3
    for example in examples:
        program, *words = shlex.split(example)
        assert program == "calib"
        assert words[0] == command_name(command)  # type: ignore[arg-type]
        assert PARSER.parse_args(words).run is command.run  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("line", "depths", "sessions"),
    [
        ("fit --depth 0.5 s", [0.5], ["s"]),
        ("fit --depth 0.5 1 inf s t", [0.5, 1.0, float("inf")], ["s", "t"]),
        ("fit s --depth 2 1e1", [2.0, 10.0], ["s"]),
        ("fit --depth 1 s --depth 3", [1.0, 3.0], ["s"]),
        ("fit --depth=1 s", [1.0], ["s"]),
        ("fit --depth 1 ./2024", [1.0], ["2024"]),
        ("fit --depth 1 -- 2024", [1.0], ["2024"]),
        ("fit s -o out --depth 1", [1.0], ["s"]),
    ],
)
def test_positional_words_may_follow_numbers(
    line: str, depths: list[float], sessions: list[str]
) -> None:
    args = PARSER.parse_args(line.split())
    assert args.depth == depths
    assert list(map(str, args.session)) == sessions


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("fit --depth -1 s", "'-1' is not a depth"),
        ("fit --depth 1 0,5 s", "'0,5' is not a depth"),
        ("fit --depth 1 50cm s", "'50cm' is not a depth"),
        ("fit --depth wide s", "'wide' is not a depth"),
        ("fit --depth", "expected at least one argument"),
        ("fit s --sqare-mm 3", "did you mean --square-mm?"),
        ("undistort c p --depth 1 --over-write -o o", "did you mean --overwrite?"),
        ("fitt s", "did you mean fit?"),
        ("exprt s", "did you mean export?"),
        ("import image x", "did you mean images?"),
        ("fit s --cover dom", "did you mean dome?"),
        ("fit --bord 9x9 s", "--bord is not an option: did you mean --board?"),
        ("fit --dep 1", "--dep is not an option: did you mean --depth?"),
        ("undistort --xyz", "--xyz is not an option of calib undistort"),
        ("import kalibr --squaremm=3", "--squaremm is not an option: did you mean --square-mm?"),
        ("rig fit --gird 8x8", "--gird is not an option: did you mean --grid?"),
        ("--verson", "did you mean --version?"),
        ("fit s --border-cells 9x9", "argument --border-cells: '9x9' is not a whole number"),
        ("fit s --centre 0 0 -8", "write --centre 0,0,-8"),
        ("fit --centre 0 0+-1 -8 2024", "write --centre 0,0+-1,-8\n"),
        ("fit s --intrinsics 900 900 320 240 0.1", "write --intrinsics 900,900,320,240,0.1"),
    ],
)
def test_a_mistyped_word_gets_what_was_meant(
    line: str, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(line.split())
    assert ended.value.code == 2
    error, *choices, hint = capsys.readouterr().err.splitlines(keepends=True)
    assert says in error
    assert all(len(choice) <= 81 and choice.startswith("  ") for choice in choices)
    assert re.fullmatch(r"see calib( \w+)* --help\n", hint)


@pytest.mark.parametrize(
    ("command", "says"),
    [
        ("rig", "required: ACTION, one of fit, evaluate, check,"),
        ("import", "required: SOURCE, one of mrcal,"),
        ("fit", "required: SESSION. A whole command is"),
    ],
)
def test_a_command_without_its_words_names_them(
    command: str, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([command])
    assert ended.value.code == 2
    assert says in capsys.readouterr().err


@pytest.mark.parametrize("words", ["--quiet", "--board=9x6", "-q"])
def test_an_option_is_written_in_full_or_by_its_letter(words: str) -> None:
    args = PARSER.parse_args(["fit", "s", words])
    assert args.quiet or args.board == (9, 6)


def test_an_option_of_the_cover_has_the_words_of_each_shape(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        main(["fit", "--help-all"])
    words = " ".join(capsys.readouterr().out.split())
    assert "--tilt DEG,DEG cone, cylinder: degrees of tilt, first about x" in words
    assert "flat: degrees of tilt, first about x" in words
    assert "dome: inner radius in millimetres" in words
    assert "--thickness MM thickness in mm" in words, "every shape has glass"


def test_a_word_behind_two_dashes_is_no_option() -> None:
    assert PARSER.parse_args(["fit", "--", "--bord"]).session == [Path("--bord")]


@pytest.mark.parametrize(
    "words",
    [
        ["fit", ""],
        ["fit", "s", "-o", ""],
        ["fit", "s", "--output="],
        ["evaluate", "c", ""],
        ["check", "", "p"],
        ["batch", "", "-o", "fleet"],
        ["import", "images", "p", "-o", ""],
        ["demo", "-o", ""],
    ],
)
def test_an_empty_word_is_not_the_current_folder(
    words: list[str],
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A shell puts it in the place of a variable that is not set."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    assert "is empty: write it, or set the variable" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def test_capture_refuses_an_empty_word(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["record", "", "--source", "folder:p"], ["record", "s", "--source", ""], [""]):
        with pytest.raises(SystemExit) as ended:
            capture_main(words)
        assert ended.value.code == 2
        assert "is empty: write it" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("word", "code"), [(None, "32"), (Trust.CARE, "33"), (Trust.DO_NOT_USE, "31")]
)
def test_the_verdict_has_its_colour_in_a_terminal(
    word: Trust | None,
    code: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    reasons = (Reason("it is so.", "calib report x", word=word),) if word else ()
    verdict = Verdict(reasons, "calib export x")
    print_verdict(verdict, ())
    assert "\x1b" not in capsys.readouterr().out
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    print_verdict(verdict, ())
    line = next(line for line in capsys.readouterr().out.splitlines() if "\x1b" in line)
    assert f";{code}m" in line
    assert verdict.word.sentence in line
