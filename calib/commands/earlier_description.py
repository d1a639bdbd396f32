"""The session.yaml that the options of `calib fit` replace, and what they keep of it."""

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING

from calib.commands.cover_options import cover_from_options, intrinsics_from_options
from calib.commands.described_board import board_options
from calib.session.lens import AUTO, OPENCV

if TYPE_CHECKING:
    from calib.importing.named_pictures import NamedPictures


def earlier_document(source: "NamedPictures") -> dict[str, object]:
    """Return the session.yaml that is to be replaced; empty if there is none."""
    from calib.importing.named_pictures import DESCRIPTION
    from calib.io.yaml_reader import read_yaml

    return dict(read_yaml(source.session / DESCRIPTION)) if source.is_described else {}


def sections_of(document: Mapping[str, object]) -> dict[str, dict[str, object]]:
    """Return the sections board, cover, camera and its intrinsics of a session.yaml, those that are
    mappings. Intrinsics are left out if they are unknown.
    """
    camera = document.get("camera")
    sections = {
        "board": document.get("board"),
        "cover": document.get("cover"),
        "camera": camera,
        "intrinsics": camera.get("intrinsics") if isinstance(camera, dict) else None,
    }
    return {name: value for name, value in sections.items() if isinstance(value, dict)}


def camera_section(
    args: argparse.Namespace, earlier: dict[str, dict[str, object]]
) -> dict[str, object]:
    """Return the section `camera`: what the options say, and else what it said earlier."""
    camera = dict(earlier.get("camera", {}))
    if args.lens:
        camera["lens"] = args.lens
        if args.lens not in (OPENCV, AUTO):
            camera.pop("lens_coefficients", None)
    camera.pop("intrinsics", None)
    intrinsics = intrinsics_from_options(args) or earlier.get("intrinsics")
    return camera | ({"intrinsics": intrinsics} if intrinsics else {})


def describe_kept_values(
    args: argparse.Namespace,
    earlier: dict[str, dict[str, object]],
    cover: dict[str, object] | None,
) -> str:
    """Return what the options take over from an earlier description: the board, the lens, and the
    keys of the cover with their values.

    Args:
        cover: the section `cover` by the options and the earlier description; None: no option
            describes it, and the earlier one stays.
    """
    old = earlier.get("cover", {})
    new = (cover_from_options(args, {"shape": cover["shape"]}) if cover else None) or {}
    new["shape"] = args.cover
    numbers = {
        key: value
        for key, value in (old if cover is None else cover).items()
        if key in old and new.get(key) != value
    }
    board = earlier.get("board", {})
    size = f" {board['columns']}x{board['rows']}" if {"columns", "rows"} <= board.keys() else ""
    side = _earlier_side(board)
    texts = {
        f"the board{size}": bool(board) and not (args.board or board_options(args)),
        side: bool(side) and not board_options(args),
        ", ".join(f"{key} {_in_words(value)}" for key, value in numbers.items()): bool(numbers),
        "the lens": "intrinsics" in earlier and not args.intrinsics,
        f"the lens model {_lens_of(earlier)}": bool(_lens_of(earlier)) and not args.lens,
    }
    return ", ".join(text for text, is_earlier in texts.items() if text and is_earlier)


def _earlier_side(board: dict[str, object]) -> str:
    """Return the size of an earlier board's squares or tags in words; empty without one."""
    sides = [f"{key} {_in_words(board[key])}" for key in ("square_mm", "tag_mm") if key in board]
    return sides[0] if sides else ""


def _in_words(value: object) -> str:
    """Return a value of session.yaml in words, such as 1.333 ± 0.004."""
    if isinstance(value, dict) and "value" in value:
        sigma = f" ± {value['sigma']:g}" if "sigma" in value else ""
        return f"{_in_words(value['value'])}{sigma}"
    if isinstance(value, list):
        return f"({', '.join(map(_in_words, value))})"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _lens_of(earlier: dict[str, dict[str, object]]) -> str:
    """Return the lens model of an earlier description; "" if it states none."""
    lens = earlier.get("camera", {}).get("lens")
    return lens if isinstance(lens, str) else ""
