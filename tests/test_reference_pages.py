"""The pages that say what the code says: every key of session.yaml, and every command."""

import argparse
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import pytest
import yaml

from calib import cli
from calib.commands.command_line import _parser
from calib.errors import InputError, NotEnoughDataError
from calib.session.board_section import EXAMPLES, KEYS, read_board
from calib.session.camera import read_camera
from calib.session.cover_section import cover_sections, read_cover
from calib.session.schema import Section
from calib.session.session import read_session
from calib.session.shapes.registry import find_shape, stated_shape_names
from capture import cli as capture_cli
from fixtures import command_page
from fixtures.pages import BOARD_DEFAULTS, pages

DOCS = Path(__file__).parents[1] / "docs"
GLASS_KEYS = ("low", "high", "degree", "mean_um", "covariance_um2", "covariance_um")
"""The keys of what `calib fleet-prior` wrote, which nobody writes by hand."""


@pytest.mark.parametrize(("name", "text"), pages().items(), ids=pages())
def test_a_page_says_what_the_code_says(name: str, text: str) -> None:
    written = (DOCS / name).read_text(encoding="utf-8")
    assert written == text, "run python -m fixtures.pages"


def test_the_page_of_unknown_numbers_has_the_same_ranges() -> None:
    ranges: dict[str, set[str]] = {}
    for key, row in re.findall(
        r"^\| `(\w+)` \| (.*) \|$", pages()["session-yaml.md"], re.MULTILINE
    ):
        ranges.setdefault(key, set()).add(row.rpartition(" | ")[2])
    page = (DOCS / "unknown.md").read_text(encoding="utf-8")
    stated = re.findall(
        r"^\|[^|]*\|[^|]*`(\w+): (?:unknown|\[unknown|1\.333)[^|]*\| (-?[\d.]+ to [\d.]+)",
        page,
        re.MULTILINE,
    )
    assert len(stated) == 9
    for key, words in stated:
        assert words in ranges[key], key


def test_intrinsics_that_are_left_out_are_unknown() -> None:
    intrinsics = {"fx": 600, "cx": 320, "cy": 240}
    section = _section({"width": 640, "height": 480, "intrinsics": intrinsics})
    camera = read_camera(section)
    assert camera.intrinsics
    assert camera.intrinsics.fy.unknown
    page = pages()["session-yaml.md"]
    for key in ("fx", "fy", "cx", "cy"):
        row = next(line for line in page.splitlines() if line.startswith(f"| `{key}` |"))
        assert "| unknown |" in row


def test_every_key_that_is_read_is_on_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """The readers say themselves which keys they allow."""
    allowed: set[str] = set()
    check = Section.allow_only

    def record(
        section: Section,
        keys: Sequence[str],
        kind: str = "known key",
        inner: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        allowed.update(keys)
        check(section, keys, kind, inner)

    monkeypatch.setattr(Section, "allow_only", record)
    read_session(Path("fixtures/wet-flat"))
    for kind, board in EXAMPLES.items():
        read_board(_section({"type": kind, **board}))
    camera = {"width": 640, "height": 480}
    offsets = [0.0] * 16
    spline = {"columns": 4, "rows": 4, "x_px": offsets, "y_px": offsets}
    pinhole: Mapping[str, object] = {"fx": 600, "fy": 600, "cx": 320, "cy": 240}
    splined = {**pinhole, "model": "splined", "distortion": [0, 0, 0, 0], "spline": spline}
    read_camera(_section({**camera, "intrinsics": splined, "shutter": {"type": "global"}}))
    for shape in stated_shape_names():
        cover = {"shape": shape, **find_shape(shape).example}
        read_cover(*cover_sections(_section({"cover": cover}), ""))
    layer = {"thickness_mm": 3, "refractive_index": 1.5}
    layered = {"shape": "flat", "distance_mm": 20, "layers": [layer, layer]}
    read_cover(*cover_sections(_section({"cover": layered}), ""))
    page = pages()["session-yaml.md"]
    assert len(allowed) > 50
    for key in allowed - {*GLASS_KEYS, "value", "sigma", "exact"}:
        assert f"`{key}`" in page, key


def test_the_defaults_of_boards_are_those_of_the_reader() -> None:
    for kind, example in EXAMPLES.items():
        stated = {key: value for key, value in BOARD_DEFAULTS.items() if key in KEYS[kind]}
        without = {key: value for key, value in example.items() if key not in BOARD_DEFAULTS}
        stated["type"] = kind
        short = {"type": kind, **without}
        assert read_board(_section({**without, **stated})) == read_board(_section(short))


def test_the_examples_are_read() -> None:
    readers: dict[str, Callable[[Section], object]] = {
        "board": read_board,
        "camera": read_camera,
        "cover": read_cover,
    }
    blocks = re.findall(r"```yaml\n(.*?)```", pages()["session-yaml.md"], re.DOTALL)
    assert len(blocks) > 8
    for block in blocks:
        for key, value in yaml.safe_load(block).items():
            if key != "format":
                readers[key](Section(value, "session.yaml", key))


def test_every_exit_code_is_on_the_page() -> None:
    codes = {int(code) for code in re.findall(r"^\| (\d) \|", command_page.HEAD, re.MULTILINE)}
    assert codes >= {InputError.exit_code, NotEnoughDataError.exit_code}


def test_every_option_is_in_its_command_s_section_or_in_a_table_that_the_section_links_to() -> None:
    sections = _sections(pages()["command-line.md"])
    parsers = {"calib": _parser("calib", "", cli.COMMANDS, cli.GROUPS)}
    parsers["capture"] = _parser("capture", "", capture_cli.COMMANDS)
    commands = dict(_commands(parsers))
    assert len(commands) > 30
    for title, parser in commands.items():
        links = re.findall(r"\[([^]]*)\]\(#(\w+)-options\)", sections[title])
        for action in parser._actions:
            if isinstance(action, argparse._HelpAction) or action.help == argparse.SUPPRESS:
                continue
            for name in action.option_strings[-1:]:
                shared = [
                    sections[f"{topic.capitalize()} options"]
                    for names, topic in links
                    if f"`{name}`" in names or names == f"all {topic} options"
                ]
                tables = [sections[title], *shared]
                rows = [row for table in tables for row in _rows_of(name, table)]
                assert len(rows) == 1, (title, name)
                default = {"default": action.default, "prog": parser.prog}
                words = " ".join(((action.help or "") % default).split())
                assert re.sub(r"docs/([\w-]+)\.md", r"[\1](\1.md)", words) in rows[0].replace(
                    "\\", ""
                )


def _sections(page: str) -> dict[str, str]:
    """Return the text of each section by its heading."""
    parts = re.split(r"^#{2,4} (.*)$", page, flags=re.MULTILINE)[1:]
    return dict(zip(parts[::2], parts[1::2], strict=True))


def _commands(
    parsers: Mapping[str, argparse.ArgumentParser],
) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Yield every command below the given ones, such as calib rig fit, with its parser."""
    for title, parser in parsers.items():
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                inner = {f"{title} {name}": choice for name, choice in action.choices.items()}
                yield from inner.items()
                yield from _commands(inner)


def _rows_of(option: str, text: str) -> list[str]:
    """Return the lines of the tables in a text that explain an option."""
    return re.findall(rf"^\| `(?:-\w, )?{option}[ `].*$", text, re.MULTILINE)


def _section(values: Mapping[str, object]) -> Section:
    return Section(values, "session.yaml")
