"""The pages of docs/ that say what the code says: every key of session.yaml, and every command and
option. `python -m benchmarks.pages [-o DIR]`.

What to write for a key is what the reader of session.yaml asks for when it finds nonsense there.
"""

import argparse
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType

from calib.cli import COMMANDS, GROUPS
from calib.commands.command_line import _parser
from calib.commands.effect_names import effects_help
from calib.commands.parser import command_name
from calib.errors import InputError
from calib.session.board_section import EXAMPLES, KALIBR, explain_keys, read_board
from calib.session.camera import EXPLANATIONS as CAMERA
from calib.session.camera import read_camera
from calib.session.cover_section import SURFACE_EXPLANATION, cover_sections, read_cover
from calib.session.schema import Section
from calib.session.shapes.dimension import Dimension
from calib.session.shapes.layer import LAYER, OUTSIDE
from calib.session.shapes.registry import find_shape, shape_names
from calib.session.shapes.shape import Shape
from calib.session.tolerances import (
    FOCAL,
    PRINCIPAL_POINT,
    RADIAL,
    SQUARE_SIDE,
    TANGENTIAL,
    UNKNOWN_CENTRE,
    UNKNOWN_FOCAL,
    UNKNOWN_RADIAL,
    UNKNOWN_TANGENTIAL,
    WidePrior,
)
from capture import cli as capture_cli

NONSENSE = None
"""A value that no key may have."""
REQUIRED = "required"
FILE = "session.yaml"
GENERATED = "\n<!-- Made by `python -m benchmarks.pages`. Do not change it here. -->\n"
BOARD_DEFAULTS: Mapping[str, object] = {
    "type": "checkerboard",
    "legacy_pattern": False,
    "first_marker": 0,
    "inverted": False,
    "border_cells": KALIBR.border,
    "numbered_from": KALIBR.numbered_from,
    "tag_rotation_deg": KALIBR.rotation_deg,
}
LAYER_KEYS = tuple(kind.quantity.key for kind in LAYER)
CAMERA_BASE: Mapping[str, object] = {"width": 1640, "height": 1232}
INTRINSICS: Mapping[str, str] = {
    "fx": "The focal length along x.",
    "fy": "The focal length along y.",
    "cx": "The principal point, x. Pixel (0, 0) is the centre of the upper left pixel.",
    "cy": "The principal point, y.",
    "distortion": "The coefficients of the lens, in the order of OpenCV.",
    "model": "The lens model that the coefficients belong to.",
    "spline": "Control points of a splined lens: `columns`, `rows`, `x_px`, `y_px`. calib writes"
    " them.",
    "correlations": "Rows of the correlation matrix of these numbers. calib writes them.",
}
INTRINSICS_BASE: Mapping[str, object] = {"fx": 1279.2, "fy": 1279.2, "cx": 832.8, "cy": 636.6}
INTRINSICS_DEFAULTS = {
    "distortion": "[]",
    "model": "opencv",
    "spline": "none",
    "correlations": "none",
}

SESSION_HEAD = """\
# session.yaml: every key

`session.yaml` describes one camera: its board, its lens and its cover. `calib init SESSION`
writes one with a comment on every key, and `calib fit PICTURES --board 9x6 --square-mm 25` writes
one from its options. A key that is not listed here is refused, with the key that you may have
meant.

## How to write a number

| write | it means |
|---|---|
| `40` | 40, within the tolerance in the tables below. The fit estimates the number. |
| `{value: 40, sigma: 5}` | 40, known to 5 (one standard deviation). The fit estimates it. |
| `{value: 40, exact: true}` | exactly 40. The fit holds it. `sigma: 0` says the same. |
| `unknown` | you do not know it. The fit estimates it within the range in the last column. |

The same may stand inside a list: `centre_mm: [0, 0, {value: -8, sigma: 1}]`. A key with a range
in the last column may also be left out, unless it has a default. A tolerance is one standard
deviation, in the unit of its key. Lengths are in millimetres, angles in degrees, pixels in px.
The camera looks along z, x is to the right and y is down ([conventions](conventions.md)). [I do
not know it](unknown.md) shows what each unknown costs.

## At the top

| key | what it is | write | default |
|---|---|---|---|
| `format` | The version of this file's format. | 1 | required |
| `board` | The board: a mapping, see below. | a mapping | required |
| `camera` | The camera without its cover: a mapping, see below. | a mapping | required |
| `cover` | The cover: a mapping, see below. A list of two to four mappings is several covers, from the camera outwards. | a mapping, a list or `unknown` | required |
| `corners` | A file with corners in mrcal's format, which is read instead of pictures. | a file name, such as `corners.vnl` | pictures are read |
| `prior` | The file of a fleet that `calib fleet-prior` wrote ([fleets](fleet.md)). | a file name, such as `../prior.yaml` | none |

A complete example:

```yaml
format: 1
board: {columns: 9, rows: 6, square_mm: 25.0}
camera:
  width: 1640
  height: 1232
cover:
  shape: dome
  inner_radius_mm: {value: 50, sigma: 0.3}
  centre_mm: [0, 0, {value: -8, sigma: 1}]
  thickness_mm: 4
  refractive_index: 1.49
```

"""  # noqa: E501
COVER_TAIL = """\
### For every shape with glass

| key | what it is | write | default |
|---|---|---|---|
| `layers` | Laminated glass, instead of `thickness_mm` and `refractive_index`. | {layers} | one layer |
| `surface` | {surface} | {surfaces} | auto |
| `correlations` | Correlations of numbers of cover and camera. calib writes them. | {correlations} | none |
| `glass` | What a fleet knows of the glass's unevenness. `calib fleet-prior` writes it. | nothing by hand | none |

With `shape: unknown` the fit tries `none`, `cone`, `cylinder`, `flat` and `dome` and takes the
most probable one. Only `thickness_mm`, `refractive_index`, `outside_index`, `layers` and
`surface` may stand beside it.
"""  # noqa: E501
COMMANDS_HEAD = """\
# Command line

Every command of `calib` and `capture`, with every option. The option
`--help` of each command prints the same.
`calib` and `capture` are in the folder `.venv/bin` of the installation; `. .venv/bin/activate`
lets the shell find them.

Both programs print the result on stdout, and progress and remarks on stderr.

| exit code | meaning |
|---|---|
| 0 | done |
| 1 | a bug: run it again with `REFRACAL_TRACEBACK=1` and report what it prints |
| 2 | wrong usage or input |
| 3 | not enough good data |
| 4 | the camera or the disk of a recording failed |
| 5 | `calib check`: the calibration is not valid |
| 6 | `calib batch`: the cluster is gone, or no worker can start, before all cameras were done |
"""

Row = Sequence[object]


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pages", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("docs"), metavar="DIR")
    folder = parser.parse_args().output
    for name, text in pages().items():
        (folder / name).write_text(text, encoding="utf-8")


def pages() -> dict[str, str]:
    """Return the text of each page by its name in docs/."""
    return {"session-yaml.md": session_page(), "command-line.md": command_page()}


def session_page() -> str:
    texts = [SESSION_HEAD, "## board\n\n"]
    for kind, example in EXAMPLES.items():
        texts += [
            f"### {kind}\n\n",
            _board_table(kind),
            _yaml("board", {"type": kind, **example}),
        ]
    texts += ["## camera\n\n", _camera_table(), "### camera.intrinsics\n\n", _intrinsics_table()]
    intrinsics = {"intrinsics": dict(INTRINSICS_BASE) | {"distortion": [0, 0, 0, 0, 0]}}
    texts += [_yaml("camera", {**CAMERA_BASE, **intrinsics})]
    texts += ["### camera.shutter\n\n", _shutter_table()]
    texts += [
        "## cover\n\n",
        f"`shape` is one of {', '.join(f'`{name}`' for name in shape_names())} or `unknown`. With"
        " `none` there are no other keys. [How to measure a cover](measuring.md) shows each number"
        " in a drawing.\n\n",
    ]
    for shape in map(find_shape, shape_names()):
        if shape.has_glass:
            texts += [f"### {shape.name}\n\n", _cover_table(shape)]
            texts += [_yaml("cover", {"shape": shape.name, **shape.example})]
    wanted = {key: _wanted(_cover_of("flat", key)) for key in ("layers", "surface")}
    pairs = "such as `[[cover.thickness, camera.fx, 0.5]]`"
    texts += [
        COVER_TAIL.format(
            layers=_cell(wanted["layers"]),
            surface=SURFACE_EXPLANATION,
            surfaces=_cell(wanted["surface"]),
            correlations=f"a list of two names and a number, {pairs}",
        ),
        GENERATED,
    ]
    return "".join(texts)


def _board_table(kind: str) -> str:
    explained = {"type": f"The kind of board: `{kind}` here."} | explain_keys(kind)
    example = {"type": kind, **EXAMPLES[kind]}
    rows: list[Row] = []
    for key, text in explained.items():
        default = _written(BOARD_DEFAULTS[key]) if key in BOARD_DEFAULTS else REQUIRED
        tolerance = ""
        if key in ("square_mm", "tag_mm"):
            tolerance = f"{100 * SQUARE_SIDE.sigma:g} %"
        wanted = _wanted(_board_of(example, key))
        rows.append((f"`{key}`", text, wanted, default, tolerance))
    return _table(("key", "what it is", "write", "default", "tolerance"), rows)


def _camera_table() -> str:
    rows: list[Row] = []
    for key, (text, example) in CAMERA.items():
        default = REQUIRED if key in CAMERA_BASE else "not stated"
        wanted = _wanted(_camera_of({**CAMERA_BASE, key: NONSENSE}))
        if key == "intrinsics":
            wanted = "a mapping, see below, or unknown"
        rows.append((f"`{key}`", text, wanted, default, f"`{example}`" if example else ""))
    return _table(("key", "what it is", "write", "default", "example"), rows)


def _intrinsics_table() -> str:
    rows: list[Row] = []
    focal = f"up to {UNKNOWN_FOCAL.mean + 2 * UNKNOWN_FOCAL.sigma:g} times the longer side"
    centre = f"the middle, within {2 * UNKNOWN_CENTRE.sigma:g} of the longer side"
    wide = {
        "f": (f"{100 * FOCAL.sigma:g} %", focal),
        "c": (f"{PRINCIPAL_POINT.sigma:g} px", centre),
        "d": (
            f"{RADIAL.sigma:g}; of p1 and p2 {TANGENTIAL.sigma:g}",
            f"within {2 * UNKNOWN_RADIAL.sigma:g}; of p1 and p2 {2 * UNKNOWN_TANGENTIAL.sigma:g}",
        ),
    }
    for key, text in INTRINSICS.items():
        document = {**CAMERA_BASE, "intrinsics": {**INTRINSICS_BASE, key: NONSENSE}}
        wanted = _wanted(_camera_of(document))
        if key == "spline":
            wanted = "what calib wrote, with model splined"
        is_number = key in (*INTRINSICS_BASE, "distortion")
        tolerance, unknown = wide[key[0]] if is_number else ("", "")
        default = INTRINSICS_DEFAULTS.get(key, REQUIRED)
        rows.append((f"`{key}`", text, wanted, default, tolerance, unknown))
    return _table(("key", "what it is", "write", "default", "tolerance", "unknown means"), rows)


def _shutter_table() -> str:
    kind = _wanted(_camera_of({**CAMERA_BASE, "shutter": {"type": NONSENSE}}))
    rolling = {"type": "rolling", "readout_ms": NONSENSE}
    readout = _wanted(_camera_of({**CAMERA_BASE, "shutter": rolling}))
    rows: list[Row] = [
        ("`type`", "Whether all lines of a picture are exposed at once.", kind, REQUIRED),
        ("`readout_ms`", "From the first line to the last one.", readout, "not known"),
    ]
    return _table(("key", "what it is", "write", "default"), rows)


def _cover_table(shape: Shape) -> str:
    rows: list[Row] = []
    for kind in (*shape.dimensions, *LAYER, OUTSIDE):
        quantity = kind.quantity
        wanted = _wanted(_cover_of(shape.name, quantity.key))
        default = "unknown" if quantity.wide else REQUIRED
        if quantity.default is not None:
            default = _written([quantity.default] * len(quantity.components) or quantity.default)
        rows.append(
            (
                f"`{quantity.key}`",
                kind.explanation,
                wanted,
                default,
                _tolerance(kind),
                _range(kind, quantity.wide),
            )
        )
    return _table(("key", "what it is", "write", "default", "tolerance", "unknown means"), rows)


def _tolerance(kind: Dimension) -> str:
    if not kind.tolerance:
        return "held"
    return f"{kind.tolerance.sigma * kind.quantity.unit[1]:.2g}"


def _range(kind: Dimension, wide: WidePrior | None) -> str:
    """Return the range of two standard deviations of an unknown number, within its limits."""
    if wide is None:
        return ""
    per_si = kind.quantity.unit[1]
    low = max(kind.quantity.low, (wide.mean - 2 * wide.sigma) * per_si)
    high = min(kind.quantity.high, (wide.mean + 2 * wide.sigma) * per_si)
    return f"{low:.3g} to {high:.3g}"


def _section(values: Mapping[str, object]) -> Section:
    return Section(values, FILE)


def _board_of(example: Mapping[str, object], key: str) -> Callable[[], object]:
    return lambda: read_board(_section({**example, key: NONSENSE}))


def _camera_of(mapping: Mapping[str, object]) -> Callable[[], object]:
    return lambda: read_camera(_section(mapping))


def _cover_of(shape: str, key: str) -> Callable[[], object]:
    example = {"shape": shape, **find_shape(shape).example, key: NONSENSE}
    if key == "layers":
        example = {name: value for name, value in example.items() if name not in LAYER_KEYS}
    return lambda: read_cover(*cover_sections(_section({"cover": example}), ""))


def _wanted(read: Callable[[], object]) -> str:
    """Return what the reader asks for in its message on a value that is nonsense."""
    try:
        read()
    except InputError as error:
        return str(error).partition(": write ")[2].removesuffix(".")
    raise AssertionError("the value is accepted")


def command_page() -> str:
    texts = [COMMANDS_HEAD]
    calib = _subparsers(_parser("calib", "", COMMANDS, GROUPS))
    for group in GROUPS:
        texts.append(f"\n## {group.title}\n")
        for command in group.commands:
            name = command_name(command)
            texts += _command("calib", name, command, calib[name])
    texts.append("\n## Record\n")
    capture = _subparsers(_parser("capture", "", capture_cli.COMMANDS))
    for command in capture_cli.COMMANDS:
        name = command_name(command)
        texts += _command("capture", name, command, capture[name])
    texts += ["\n## Effects\n\nNames for `calib fit --effects`:\n\n", _effects(), GENERATED]
    return "".join(texts)


def _subparsers(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return the parsers of a program's commands, or of a command's sources."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}


def _command(
    program: str, name: str, command: ModuleType, parser: argparse.ArgumentParser
) -> Iterator[str]:
    """Yield the section of a command."""
    yield f"\n### {program} {name}\n\n{_prose(command.SUMMARY)}\n\n"
    if examples := getattr(command, "EXAMPLES", ()):
        yield "```sh\n" + "\n".join(examples) + "\n```\n\n"
    yield f"{_prose(command.DESCRIPTION)}\n\n"
    yield _options(parser)
    for source, inner in _subparsers(parser).items():
        yield f"\n#### {program} {name} {source}\n\n{_prose(inner.description or '')}\n\n"
        yield _options(inner)


def _options(parser: argparse.ArgumentParser) -> str:
    """Return the table of a parser's arguments, the positional ones first."""
    rows: list[Row] = []
    for action in parser._actions:
        if action.help == argparse.SUPPRESS or isinstance(
            action, argparse._HelpAction | argparse._SubParsersAction
        ):
            continue
        text = (action.help or "") % {"default": action.default, "prog": parser.prog}
        rows.append((_signature(parser, action), text))
    rows.sort(key=lambda row: str(row[0]).startswith("`-"))
    return _table(("argument", "meaning"), rows)


def _signature(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    formatter = parser._get_formatter()
    metavar = formatter._format_args(action, formatter._get_default_metavar_for_optional(action))
    if not action.option_strings:
        name = action.metavar or action.dest
        return f"`{name} ...`" if action.nargs in ("+", "*") else f"`{name}`"
    metavar = re.sub(r"^(\S+) \[.*", r"\1 ...", metavar)
    return "`" + ", ".join(action.option_strings) + (f" {metavar}" if metavar else "") + "`"


def _effects() -> str:
    rows: list[Row] = []
    for line in effects_help().splitlines()[1:]:
        name, text = line.split(maxsplit=1)
        rows.append((f"[`{name}`](effects/{name}.md)", text))
    return _table(("name", "what it is"), rows)


def _prose(text: str) -> str:
    """Return the paragraphs of a help text, each on one line; indented lines become a block."""
    paragraphs = []
    for paragraph in text.strip().split("\n\n"):
        if "\n " in paragraph or paragraph.startswith(" "):
            paragraphs.append(f"```text\n{paragraph}\n```")
        else:
            paragraphs.append(_escaped(" ".join(paragraph.split())))
    return "\n\n".join(paragraphs)


def _escaped(text: str) -> str:
    return text.replace("<", "&lt;").replace("*", "\\*")


def _yaml(section: str, mapping: Mapping[str, object]) -> str:
    lines = [f"{section}:"]
    for key, value in mapping.items():
        if isinstance(value, Mapping):
            lines += [f"  {key}:", *(f"    {k}: {_written(v)}" for k, v in value.items())]
        else:
            lines.append(f"  {key}: {_written(value)}")
    return "```yaml\n" + "\n".join(lines) + "\n```\n\n"


def _written(value: object) -> str:
    """Return a value as YAML has it."""
    if isinstance(value, list):
        return f"[{', '.join(map(_written, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else str(value)


def _table(head: Sequence[str], rows: Sequence[Row]) -> str:
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    lines += [f"| {' | '.join(_cell(str(cell)) for cell in row)} |" for row in rows]
    return "\n".join(lines) + "\n\n"


def _cell(text: str) -> str:
    """Return a text without what would end a cell, or begin a tag."""
    escaped = " ".join(text.split()).replace("|", "\\|")
    return escaped if "`" in escaped else _escaped(escaped)


if __name__ == "__main__":
    main()
