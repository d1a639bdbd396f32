"""The input of a check: the corners of a session, of a folder of pictures, or of picture files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.calibration import Calibration
from calib.corners.pose_requirements import split_usable_views
from calib.corners.view import RejectedPicture, View
from calib.errors import NotEnoughDataError, OtherBoardError
from calib.fitting.inputs import read_views, session_of_pictures
from calib.io.files import reading
from calib.progress import Progress
from calib.session.board import Board
from calib.session.session import read_session

OTHER_BOARD = "other_board"
"""The name of a change of the board, or of its description."""
OTHER_MODE = "other_mode"
"""The name of a change of the pictures' size."""


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
        InputError: no file can be read.
        NotEnoughDataError: no picture shows the board.
    """
    with reading(paths[0]):
        is_session = len(paths) == 1 and (paths[0] / "session.yaml").exists()
    if is_session:
        session = read_session(paths[0])
        rejected: tuple[RejectedPicture, ...] = ()
        size = session.camera.width, session.camera.height
    else:
        session, size, rejected = session_of_pictures(paths, calibration)
    camera = calibration.camera
    if size != (camera.width, camera.height):
        words = (
            f"the pictures come from another mode: {size[0]}x{size[1]} px where the calibration has"
            f" {camera.width}x{camera.height}"
        )
        return Pictures((), session.board, rejected, words, OTHER_MODE)
    try:
        views, undetected = read_views(session, progress, min_views=1)
    except OtherBoardError as error:
        return Pictures(
            (),
            session.board,
            rejected,
            f"the board is not that of the calibration: {error}".rstrip("."),
            OTHER_BOARD,
        )
    except NotEnoughDataError as error:
        raise NotEnoughDataError(f"No picture can be checked: {error}") from error
    views, too_few = split_usable_views(views, session.board)
    rejected = (*rejected, *undetected, *too_few)
    if not views:
        raise NotEnoughDataError(
            f"No picture can be checked ({rejected[0].name}: {rejected[0].reason}): take pictures"
            " that show the whole board."
        )
    return Pictures(views, session.board, rejected)
