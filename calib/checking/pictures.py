"""The input of a check: the corners of a session, of a folder of pictures, or of picture files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.calibration import Calibration
from calib.corners.pose_requirements import split_usable_views
from calib.corners.view import RejectedPicture, View
from calib.errors import InputError, NotEnoughDataError, OtherBoardError
from calib.fitting.inputs import read_views
from calib.io.files import reading
from calib.io.images import TYPES, image_size, list_images, most_frequent_size
from calib.progress import Progress
from calib.session.board import Board
from calib.session.session import Session, read_session


@dataclass(frozen=True, slots=True)
class Pictures:
    """The views to check a calibration with."""

    views: tuple[View, ...]
    board: Board
    rejected: tuple[RejectedPicture, ...] = ()
    mismatch: str = ""
    """The reason why the pictures cannot be checked, another mode or board; no views then."""
    mismatch_name: str = ""
    """other_mode or other_board."""


def read_pictures(paths: Sequence[Path], calibration: Calibration, progress: Progress) -> Pictures:
    """Return the corners of a session, of the pictures of a folder, or of picture files; without a
    session, board and camera are those of the calibration.

    Raises:
        InputError: no file can be read, or no picture shows a board.
    """
    with reading(paths[0]):
        is_session = len(paths) == 1 and (paths[0] / "session.yaml").exists()
    if is_session:
        session = read_session(paths[0])
        rejected: tuple[RejectedPicture, ...] = ()
        size = session.camera.width, session.camera.height
    else:
        session, size, rejected = _without_session(paths, calibration)
    camera = calibration.camera
    if size != (camera.width, camera.height):
        words = (
            f"the pictures come from another mode: {size[0]}x{size[1]} px where the calibration has"
            f" {camera.width}x{camera.height}"
        )
        return Pictures((), session.board, rejected, words, "other_mode")
    try:
        views, undetected = read_views(session, progress, min_views=1)
    except OtherBoardError as error:
        return Pictures(
            (),
            session.board,
            rejected,
            f"the board is not that of the calibration: {error}".rstrip("."),
            "other_board",
        )
    except NotEnoughDataError as error:
        raise InputError(f"No picture can be checked: {error}") from error
    views, too_few = split_usable_views(views, session.board)
    rejected = (*rejected, *undetected, *too_few)
    if not views:
        raise InputError(
            f"No picture can be checked ({rejected[0].name}: {rejected[0].reason}): take pictures"
            " that show the whole board."
        )
    return Pictures(views, session.board, rejected)


def _without_session(
    paths: Sequence[Path], calibration: Calibration
) -> tuple[Session, tuple[int, int], tuple[RejectedPicture, ...]]:
    """Return a session of the pictures that have the size of most of them, this size in px, and the
    others and the damaged ones.
    """
    files = [file for path in paths for file in _files(path)]
    sizes: dict[Path, tuple[int, int]] = {}
    rejected = []
    for file in files:
        try:
            sizes[file] = image_size(file)
        except InputError as error:
            rejected.append(RejectedPicture(file.name, str(error)))
    if not sizes:
        raise InputError(f"No picture can be checked: {rejected[0].reason}")
    width, height = size = most_frequent_size(sizes)
    readable = [file for file in sizes if sizes[file] == size]
    rejected += [
        RejectedPicture(
            file.name, f"is {sizes[file][0]}x{sizes[file][1]} px where most are {width}x{height}"
        )
        for file in sizes
        if sizes[file] != size
    ]
    session = Session(
        readable[0].parent,
        calibration.board,
        calibration.camera,
        calibration.cover,
        tuple(readable),
        None,
        None,
    )
    return session, size, tuple(rejected)


def _files(path: Path) -> Sequence[Path]:
    with reading(path):
        if not path.exists():
            raise InputError(
                f"{path} does not exist: give a session, a folder of pictures, or picture files."
            )
        if not path.is_dir():
            return (path,)
        folder = path / "frames" if (path / "frames").is_dir() else path
    files = list_images(folder)
    if not files:
        raise InputError(
            f"{folder} has no pictures: give a session, a folder of {TYPES} files,"
            " or the files themselves."
        )
    return files
