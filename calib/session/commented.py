"""Write a session.yaml with a comment beside every key, for someone who has never seen one.

The comments come from the rules that read the file: explanation, limits and tolerance of each key.
"""

import json
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

import yaml

from calib.errors import harmless
from calib.session.board_section import EXAMPLES, KEYS, explain_keys
from calib.session.camera import EXPLANATIONS as CAMERA
from calib.session.cover_section import SURFACE_EXPLANATION, SURFACE_KEY
from calib.session.shapes.dimension import Dimension
from calib.session.shapes.none import NONE
from calib.session.shapes.registry import find_shape, shape_names, stated_shape_names
from calib.session.shapes.shape import Shape

HEAD = """\
# The set-up of one camera. Every number may carry its uncertainty, {value: 40, sigma: 5}, and the
# fit then estimates it; {value: 40, exact: true} is not fitted. A plain number is taken to be
# within the tolerance that stands beside it. Lines that begin with # are examples: remove the # to
# use one.
"""
WIDTH = 100
"""The longest line, in characters."""
COVERS = "# A cover, one of these in place of the one above. Add outside_index: 1.333 under water."


def commented_session(
    board: Mapping[str, object],
    camera: Mapping[str, object],
    cover: Mapping[str, object],
    remarks: Sequence[str] = (),
    further: Mapping[str, object] = MappingProxyType({}),
) -> str:
    """Return the text of a session.yaml with these sections and a comment on every key.

    Args:
        board: as `read_board` reads it, likewise `camera` and `cover`; empty if `further` has a
            target of points.
        remarks: sentences for the top of the file.
        further: keys outside of these sections, which have no comments.
    """
    shape = find_shape(str(cover["shape"]))
    lines = [
        *(f"# {harmless(remark)}" for remark in remarks),
        HEAD + "format: 1",
        *(f"{key}: {_flow(value)}" for key, value in further.items()),
        "",
        *(_board_lines(board) if board else []),
        "camera:",
        *_entries(camera, {key: text for key, (text, _) in CAMERA.items()}),
        *_optional_keys(camera),
        "",
        "cover:",
        *_entries(cover, _explain_cover(shape)),
    ]
    if shape is NONE:
        lines += ["", COVERS]
        explained: set[str] = set()
        for alternative in map(find_shape, shape_names()):
            if alternative.has_glass:
                comments = _explain_cover(alternative)
                new = {key: text for key, text in comments.items() if text not in explained}
                explained |= set(comments.values())
                entries = _entries({"shape": alternative.name, **alternative.example}, new)
                lines += ["# cover:", *(f"# {line}" for line in entries)]
    return "\n".join([*lines, ""])


def _board_lines(board: Mapping[str, object]) -> list[str]:
    """Return the section `board`, and an example of each other type of board."""
    kind = str(board.get("type", "checkerboard"))
    comments = {"type": f"one of {', '.join(KEYS)}"} | explain_keys(kind)
    return ["board:", *_entries(board, comments), *_other_boards(kind), ""]


def _entries(mapping: Mapping[str, object], comments: Mapping[str, str]) -> Iterator[str]:
    """Yield the lines of a section, each with its comment."""
    for key, value in mapping.items():
        yield from _entry(f"  {key}: {_flow(value)}", comments.get(key, ""))


def _entry(line: str, comment: str) -> list[str]:
    """Return the line with its comment, which stands above if it does not fit behind."""
    if not comment:
        return [line]
    if len(line) + len(comment) + 4 <= WIDTH:
        return [f"{line}  # {comment}"]
    return [*textwrap.wrap(comment, WIDTH, initial_indent="  # ", subsequent_indent="  # "), line]


def _other_boards(kind: str) -> list[str]:
    """Return an example of each other type of board."""
    return [
        f"# board: {_flow({'type': alternative, **EXAMPLES[alternative]})}"
        for alternative in KEYS
        if alternative != kind
    ]


def _optional_keys(camera: Mapping[str, object]) -> list[str]:
    """Return the camera's other keys as examples."""
    lines: list[str] = []
    for key, (text, example) in CAMERA.items():
        if key not in camera and example:
            lines += _entry(f"  # {key}: {example}", text)
    return lines


def _explain_cover(shape: Shape) -> dict[str, str]:
    """Return the comment on each key of a cover of this shape."""
    comments = {
        "shape": f"one of {', '.join(stated_shape_names())}",
        SURFACE_KEY: SURFACE_EXPLANATION,
    }
    return comments | {kind.quantity.key: _explain(kind) for kind in shape.keys}


def _explain(kind: Dimension) -> str:
    """Return the explanation of a number, with its tolerance."""
    if not kind.tolerance:
        return kind.explanation
    sigma = kind.tolerance.sigma * kind.quantity.unit[1]
    return f"{kind.explanation} Taken to be within {sigma:.2g}."


def _flow(value: object) -> str:
    """Return a value as YAML has it on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_flow(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, str) and value.isidentifier() and yaml.safe_load(value) == value:
        return value
    return json.dumps(value, ensure_ascii=False)
