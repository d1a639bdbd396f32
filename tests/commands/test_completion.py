"""The completions that bash and zsh themselves offer after a Tab."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

from calib import cli
from calib.commands.completion import SHELLS
from calib.commands.parser import command_name
from calib.effects.registry import EFFECTS, FIELDS
from calib.export.formats import FORMATS
from calib.session import freeing
from capture import cli as capture_cli

Printed = Callable[[str, str], str]
ASK = """
source {script}
COMP_WORDS=({words}) COMP_CWORD={last}
_shtab_{program} 2>/dev/null
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@pytest.fixture(scope="module")
def printed() -> Printed:
    """The script of a program for a shell, printed once."""
    pytest.importorskip(
        "shtab",
        reason="shtab is not installed (pip install -e '.[completion]'): no script was written",
    )
    completions: dict[tuple[str, str], str] = {}

    def script(program: str, shell: str) -> str:
        if (program, shell) not in completions:
            command = [sys.executable, "-m", program, "--print-completion", shell]
            completions[program, shell] = subprocess.run(
                command, capture_output=True, text=True, check=True
            ).stdout
        return completions[program, shell]

    return script


@pytest.fixture
def offered(printed: Printed, tmp_path: Path) -> Callable[..., set[str]]:
    """Return the words that bash offers for the last of some words, in a folder with a session and
    a table.
    """
    (tmp_path / "session").mkdir()
    (tmp_path / "fleet.csv").touch()

    def ask(program: str, *words: str) -> set[str]:
        (tmp_path / ".script").write_text(printed(program, "bash"))
        quoted = " ".join(f"'{word}'" for word in (program, *words))
        script_line = ASK.format(script=".script", words=quoted, last=len(words), program=program)
        done = subprocess.run(
            ["bash", "-c", script_line], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        assert done.stderr == ""
        return set(done.stdout.split())

    return ask


@pytest.mark.parametrize(
    ("program", "commands"), [("calib", cli.COMMANDS), ("capture", capture_cli.COMMANDS)]
)
def test_every_command_is_offered(
    offered: Callable[..., set[str]], program: str, commands: tuple[ModuleType, ...]
) -> None:
    names = set(map(command_name, commands))
    assert offered(program, "") == names
    assert offered(program, "--ver") == {"--version"}


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("fit", "ses"), {"session"}),
        (("fit", "session", "--eff"), {"--effects"}),
        (("fit", "session", "-o", ""), {"session"}),
        (("fit", "session", "--method", "p"), {"paper"}),
        (("fit", "session", "--effects", "board_sh"), {"board_shape"}),
        (("fit", "session", "--effects", "board_shape,rol"), {"board_shape,rolling_shutter"}),
        (("fit", "session", "--free", "thick"), {"thickness"}),
        (("batch", "fl"), {"fleet.csv"}),
        (("export", "session", "--format", "calib"), {"calibmar"}),
        (("import", "mrc"), {"mrcal", "mrcal-corners"}),
    ],
    ids=lambda arguments: " ".join(arguments) if isinstance(arguments, tuple) else "",
)
def test_matching_words_are_offered(
    offered: Callable[..., set[str]], words: tuple[str, ...], expected: set[str]
) -> None:
    assert offered("calib", *words) == expected


def test_names_are_all_offered(offered: Callable[..., set[str]]) -> None:
    effects = {effect.name for effect in (*EFFECTS, *FIELDS)}
    assert offered("calib", "fit", "session", "--effects", "") == effects | {"none", "auto"}
    assert offered("calib", "fit", "session", "--free", "") == set(freeing.option_names())
    assert offered("calib", "export", "session", "--format", "") == {form.name for form in FORMATS}


def test_capture_completes_a_session_without_a_command(printed: Printed) -> None:
    """Bash itself completes files if no command fits."""
    script_text = (
        f"source /dev/stdin <<'END'\n{printed('capture', 'bash')}\nEND\ncomplete -p capture"
    )
    output = subprocess.run(
        ["bash", "-c", script_text], capture_output=True, text=True, check=True
    ).stdout
    assert "-o default" in output
    assert "-F _shtab_capture capture" in output


def test_zsh_reads_its_script(printed: Printed, tmp_path: Path) -> None:
    if not shutil.which("zsh"):
        pytest.skip("zsh is not installed: its script was not read")
    (tmp_path / "_calib").write_text(printed("calib", "zsh"))
    script_text = (
        "fpath=($PWD $fpath); autoload -Uz compinit; compinit -u -D; autoload +X _calib && print"
        " $_comps[calib]"
    )
    environment = {"PATH": os.environ["PATH"], "HOME": str(tmp_path)}
    done = subprocess.run(
        ["zsh", "-fc", script_text],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("_calib\n", "")


FISH_QUESTIONS = (
    ("calib fit --method p", "paper"),
    ("calib fit s --effects board_shape,rol", "board_shape,rolling_shutter"),
    ("calib ini", "init"),
)


def test_fish_has_every_command_and_name(printed: Printed) -> None:
    text = printed("calib", "fish")
    for command in cli.COMMANDS:
        assert f"-a {command_name(command)} " in text
    for name in (*freeing.option_names(), *(effect.name for effect in EFFECTS)):
        assert re.search(rf"__fish_append ,[^)]* {name}[ )]", text)


def test_fish_answers_from_its_script(printed: Printed, tmp_path: Path) -> None:
    if not shutil.which("fish"):
        pytest.skip("fish is not installed: its script was not read")
    (tmp_path / "calib.fish").write_text(printed("calib", "fish"))
    for question, answer in FISH_QUESTIONS:
        script_text = f"source calib.fish; complete -C '{question}'"
        done = subprocess.run(
            ["fish", "--no-config", "-c", script_text],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout.split("\t")[0] == answer


@pytest.mark.parametrize("program", ["calib", "capture"])
def test_without_shtab_the_package_to_install_is_named(
    program: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    with pytest.raises(SystemExit) as ended:
        import_module(f"{program}.cli").main(["--print-completion", SHELLS[0]])
    assert ended.value.code == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "Completion needs one more package: " in captured.err
    assert "pip install 'shtab>=1.9,<2'" in captured.err
