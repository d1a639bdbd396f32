"""Kalibr: a folder with camchain.yaml, the target's yaml and the first camera's pictures in cam0/.

Kalibr's bag is to be unpacked first (kalibr_bagextractor). Only checkerboards: calib does not detect Kalibr's aprilgrid.
"""

from collections.abc import Iterable
from pathlib import Path

from calib.board import Board
from calib.camera import Camera
from calib.errors import InputError
from calib.files import reading
from calib.images import list_images
from calib.importing.draft import Draft
from calib.importing.pictures import contents
from calib.schema import Quantity, Section
from calib.strict_yaml import read_yaml

PICTURES = ("cam0", "cam0/data", "images", ".")
"""Where they are looked for, in this order."""
SPACING = tuple(Quantity(key, low=1e-4, high=100.0) for key in ("colSpacingMeters", "rowSpacingMeters"))


def from_kalibr(folder: Path, board: Board | None) -> Draft:
    """The first camera's pictures. `board` is needed where no target.yaml describes it, and wins over one."""
    with reading(folder):
        if not folder.is_dir():
            raise InputError(f"{folder} is not a folder: give the folder that holds Kalibr's camchain.yaml and the pictures in cam0/.")
        files = sorted(path for path in folder.iterdir() if path.suffix in (".yaml", ".yml"))
    said = {path: Section(read_yaml(path), str(path)) for path in files}
    chain = next((section for section in said.values() if "cam0" in section.values), None)
    if chain is None:
        raise InputError(f"{folder} has no camchain.yaml with a cam0: give the folder that holds the one that Kalibr wrote.")
    board = board or _board(folder, said.values())
    camera = _camera(chain.section("cam0", "{camera_model: pinhole, resolution: [752, 480]}"))
    with reading(folder):
        paths = next((found for name in PICTURES if (folder / name).is_dir() and (found := list_images(folder / name))), ())
    if not paths:
        raise InputError(f"{folder} has no pictures in cam0/: unpack Kalibr's bag there (kalibr_bagextractor).")
    return Draft(folder, board, camera, frames=contents(paths))


def _camera(section: Section) -> Camera:
    expected = "[width, height], whole numbers of px"
    match section.get("resolution", expected):
        case [int() as width, int() as height] if width > 0 and height > 0:
            return Camera(width, height)
        case other:
            raise section.wrong("resolution", other, expected)


def _board(folder: Path, files: Iterable[Section]) -> Board:
    section = next((section for section in files if "target_type" in section.values), None)
    if section is None:
        raise InputError(f"{folder} has no target.yaml that describes the board: add --board and --square-mm, such as --board 9x6.")
    kind = section.text("target_type", "checkerboard")
    if kind != "checkerboard":
        raise InputError(
            f"{section.file}: target_type is {kind}, which calib cannot detect: take pictures of a checkerboard, or detect its corners "
            "with another program and use calib import mrcal-corners."
        )
    columns, rows = (section.whole(key, 3, 1000) for key in ("targetCols", "targetRows"))
    across, down = (section.numbers(quantity)[quantity.key].value for quantity in SPACING)
    if across != down:
        raise InputError(f"{section.file}: colSpacingMeters is {across:g} and rowSpacingMeters {down:g}: only square fields can be used.")
    return Board(columns, rows, across)
