"""Import a folder of Kalibr's: camchain.yaml, the target's yaml, and each camera's pictures in
cam0/, cam1/, ...

Kalibr's bag must be unpacked first (kalibr_bagextractor). Checkerboards and aprilgrids are
imported; calib does not detect Kalibr's circlegrid.
"""

import re
from collections.abc import Iterable
from pathlib import Path

from calib.errors import InputError
from calib.importing.from_pictures import PictureContents, uniform_pictures, unread_notices
from calib.importing.session_draft import SessionDraft
from calib.io.files import reading
from calib.io.images import list_images
from calib.io.yaml_reader import read_yaml
from calib.session.board import Board
from calib.session.board_section import SPACING as SPACING_OF_TAGS
from calib.session.board_section import board_to_yaml, read_board
from calib.session.camera import Camera
from calib.session.coding import AprilGrid
from calib.session.schema import Quantity, Section

CAMERA = re.compile("cam[0-9]+")
TAG = Quantity("tagSize", low=5e-5, high=1e6)
TAG_SPACING = Quantity("tagSpacing", low=SPACING_OF_TAGS.low, high=SPACING_OF_TAGS.high)
COLUMN_SPACING = Quantity("colSpacingMeters", low=1e-4, high=1e6)
LARGEST_CELL = 3.0
"""m: no board has larger tags or squares, so a larger number is in another unit."""
ROW_SPACING = Quantity("rowSpacingMeters", low=1e-4, high=1e6)


def from_kalibr(folder: Path, board: Board | None, camera: str | None) -> SessionDraft:
    """Import one camera's pictures.

    Args:
        folder: the folder that Kalibr was given.
        board: needed where no target.yaml describes the board; it takes precedence over one.
        camera: such as cam1; needed where camchain.yaml describes several cameras.
    """
    with reading(folder):
        if not folder.is_dir():
            raise InputError(
                f"{folder} is not a folder: give the folder that holds Kalibr's camchain.yaml and"
                " the pictures in cam0/."
            )
        files = sorted(path for path in folder.iterdir() if path.suffix in (".yaml", ".yml"))
    sections = {path: Section(read_yaml(path), str(path)) for path in files}
    chain = next((section for section in sections.values() if "cam0" in section.values), None)
    if chain is None:
        raise InputError(
            f"{folder} has no camchain.yaml with a cam0: give the folder that holds the one that"
            " Kalibr wrote."
        )
    cameras = [key for key in chain.values if CAMERA.fullmatch(key)]
    camera_name = camera or "cam0"
    if camera_name not in cameras or (camera is None and len(cameras) > 1):
        raise InputError(
            f"{chain.file} describes {', '.join(cameras)}: choose one of them, such as --camera"
            " cam0."
        )
    board = board or _board(folder, sections.values())
    chosen_camera = _camera(
        chain.section(camera_name, "{camera_model: pinhole, resolution: [752, 480]}")
    )
    places = (camera_name, f"{camera_name}/data", *(("images", ".") if len(cameras) == 1 else ()))
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
            f"{folder} has no pictures in {camera_name}/: unpack Kalibr's bag there"
            " (kalibr_bagextractor)."
        )
    pictures = uniform_pictures(paths[0].parent, paths)
    camera_size = (chosen_camera.width, chosen_camera.height)
    if pictures.size != camera_size:
        raise InputError(
            f"{chain.file}: {camera_name}.resolution is {list(camera_size)} where its pictures are"
            f" {pictures.size[0]}x{pictures.size[1]} px: give the pictures that Kalibr was given."
        )
    frames = PictureContents.of(pictures.paths)
    notices = (*unread_notices(paths[0].parent), *pictures.notices)
    return SessionDraft(folder, board, chosen_camera, frames=frames, notices=notices)


def _camera(section: Section) -> Camera:
    expected = "[width, height], whole numbers of px"
    match section.get("resolution", expected):
        case [int() as width, int() as height] if width > 0 and height > 0:
            return Camera(width, height)
        case resolution:
            raise section.error("resolution", resolution, expected)


def _board(folder: Path, files: Iterable[Section]) -> Board:
    section = next((section for section in files if "target_type" in section.values), None)
    if section is None:
        raise InputError(
            f"{folder} has no target.yaml that describes the board: add --board and --square-mm,"
            " such as --board 9x6."
        )
    kind = section.text("target_type", "checkerboard")
    if kind == "aprilgrid":
        columns = section.integer("tagCols", 2, 500)
        rows = section.integer("tagRows", 2, 500)
        spacing = section.read(TAG_SPACING)[TAG_SPACING.key].value
        first = section.integer("codeOffset", 0, 586) if "codeOffset" in section.values else 0
        coding = AprilGrid(spacing, first_marker=first)
        board = Board(2 * columns, 2 * rows, _metres(section, TAG), coding=coding)
        try:
            return read_board(Section(board_to_yaml(board), section.file, "the target"))
        except InputError as error:
            raise InputError(str(error).replace("first_marker", "codeOffset")) from error
    if kind != "checkerboard":
        raise InputError(
            f"{section.file}: target_type is {kind}, which calib cannot detect: take pictures of a"
            " checkerboard or an aprilgrid, or detect its corners with another program and use"
            " calib import mrcal-corners."
        )
    columns = section.integer("targetCols", 3, 1000)
    rows = section.integer("targetRows", 3, 1000)
    column_spacing = _metres(section, COLUMN_SPACING)
    row_spacing = _metres(section, ROW_SPACING)
    if column_spacing != row_spacing:
        raise InputError(
            f"{section.file}: colSpacingMeters is {column_spacing:g} and rowSpacingMeters"
            f" {row_spacing:g}: only square fields can be used."
        )
    return Board(columns, rows, column_spacing)


def _metres(section: Section, quantity: Quantity) -> float:
    """Return a length in m; InputError if it can only be in another unit."""
    length = float(section.read(quantity)[quantity.key].value)
    if length > LARGEST_CELL:
        raise InputError(
            f"{section.file}: {quantity.key} is {length:g}, and Kalibr's unit is the metre: write"
            f" {length / 1000:g} if {length:g} mm is meant."
        )
    return length
