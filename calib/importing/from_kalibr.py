"""Kalibr: a folder with camchain.yaml, the target's yaml and each camera's pictures in cam0/,
cam1/, ...

Kalibr's bag is to be unpacked first (kalibr_bagextractor). Checkerboards and aprilgrids; calib does
not detect Kalibr's circlegrid.
"""

import re
from collections.abc import Iterable
from pathlib import Path

from calib.errors import InputError
from calib.importing.from_pictures import contents
from calib.importing.session_draft import Draft
from calib.io.files import reading
from calib.io.images import list_images
from calib.io.yaml_reader import read_yaml
from calib.session.board import Board
from calib.session.board_section import SPACING as SPACING_OF_TAGS
from calib.session.camera import Camera
from calib.session.coding import AprilGrid
from calib.session.schema import Quantity, Section

CAMERA = re.compile("cam[0-9]+")
TAG = Quantity("tagSize", low=5e-5, high=100.0)
TAG_SPACING = Quantity("tagSpacing", low=SPACING_OF_TAGS.low, high=SPACING_OF_TAGS.high)
SPACING = tuple(
    Quantity(key, low=1e-4, high=100.0) for key in ("colSpacingMeters", "rowSpacingMeters")
)


def from_kalibr(folder: Path, board: Board | None, camera: str | None) -> Draft:
    """One camera's pictures. `board` is needed where no target.yaml describes it, and wins over
    one; `camera`, such as cam1, where camchain.yaml describes several.
    """
    with reading(folder):
        if not folder.is_dir():
            raise InputError(
                f"{folder} is not a folder: give the folder that holds Kalibr's camchain.yaml and"
                " the pictures in cam0/."
            )
        files = sorted(path for path in folder.iterdir() if path.suffix in (".yaml", ".yml"))
    said = {path: Section(read_yaml(path), str(path)) for path in files}
    chain = next((section for section in said.values() if "cam0" in section.values), None)
    if chain is None:
        raise InputError(
            f"{folder} has no camchain.yaml with a cam0: give the folder that holds the one that"
            " Kalibr wrote."
        )
    cameras = [key for key in chain.values if CAMERA.fullmatch(key)]
    own = camera or "cam0"
    if own not in cameras or (camera is None and len(cameras) > 1):
        raise InputError(
            f"{chain.file} describes {', '.join(cameras)}: choose one of them, such as --camera"
            " cam0."
        )
    board = board or _board(folder, said.values())
    described = _camera(chain.section(own, "{camera_model: pinhole, resolution: [752, 480]}"))
    places = (own, f"{own}/data", *(("images", ".") if len(cameras) == 1 else ()))
    with reading(folder):
        paths = next(
            (
                found
                for name in places
                if (folder / name).is_dir() and (found := list_images(folder / name))
            ),
            (),
        )
    if not paths:
        raise InputError(
            f"{folder} has no pictures in {own}/: unpack Kalibr's bag there (kalibr_bagextractor)."
        )
    return Draft(folder, board, described, frames=contents(paths))


def _camera(section: Section) -> Camera:
    expected = "[width, height], whole numbers of px"
    match section.get("resolution", expected):
        case [int() as width, int() as height] if width > 0 and height > 0:
            return Camera(width, height)
        case other:
            raise section.error("resolution", other, expected)


def _board(folder: Path, files: Iterable[Section]) -> Board:
    section = next((section for section in files if "target_type" in section.values), None)
    if section is None:
        raise InputError(
            f"{folder} has no target.yaml that describes the board: add --board and --square-mm,"
            " such as --board 9x6."
        )
    kind = section.text("target_type", "checkerboard")
    if kind == "aprilgrid":
        columns, rows = (section.integer(key, 2, 500) for key in ("tagCols", "tagRows"))
        spacing = section.read(TAG_SPACING)[TAG_SPACING.key].value
        return Board(
            2 * columns, 2 * rows, section.read(TAG)[TAG.key].value, coding=AprilGrid(spacing)
        )
    if kind != "checkerboard":
        raise InputError(
            f"{section.file}: target_type is {kind}, which calib cannot detect: take pictures of a"
            " checkerboard or an aprilgrid, or detect its corners with another program and use"
            " calib import mrcal-corners."
        )
    columns, rows = (section.integer(key, 3, 1000) for key in ("targetCols", "targetRows"))
    across, down = (section.read(quantity)[quantity.key].value for quantity in SPACING)
    if across != down:
        raise InputError(
            f"{section.file}: colSpacingMeters is {across:g} and rowSpacingMeters {down:g}: only"
            " square fields can be used."
        )
    return Board(columns, rows, across)
