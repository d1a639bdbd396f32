"""What is to be checked: a session, a folder of pictures, or some picture files, to their
corners.
"""

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
from calib.io.images import image_size, list_images
from calib.progress import Progress
from calib.session.board import Board
from calib.session.session import Session, read_session


@dataclass(frozen=True, slots=True)
class Pictures:
    """The views to check a calibration with."""

    views: tuple[View, ...]
    board: Board
    rejected: tuple[RejectedPicture, ...] = ()
    other: str = ""
    """Why they cannot be of the calibrated camera as it was: its other mode, or another board; then
    there are no views.
    """
    name: str = ""
    """Of that, in a word."""


def read_pictures(paths: Sequence[Path], calibration: Calibration, progress: Progress) -> Pictures:
    """The corners of a session, of a folder's pictures, or of picture files; without a session,
    board and camera are the calibration's.

    Raises:
        InputError: nothing there can be read, or no picture shows a board.
    """
    with reading(paths[0]):
        is_session = len(paths) == 1 and (paths[0] / "session.yaml").exists()
    if is_session:
        session = read_session(paths[0])
        rejected: tuple[RejectedPicture, ...] = ()
        sizes = {(session.camera.width, session.camera.height)}
    else:
        session, sizes, rejected = _without_session(paths, calibration)
    camera = calibration.camera
    if other := sizes - {(camera.width, camera.height)}:
        width, height = min(other)
        words = (
            f"the pictures come from another mode: {width}x{height} px where the calibration has"
            f" {camera.width}x{camera.height}"
        )
        return Pictures((), session.board, rejected, words, "other_mode")
    try:
        views, unseen = read_views(session, progress, fewest=1)
    except OtherBoardError as error:
        return Pictures(
            (),
            session.board,
            rejected,
            f"the board is not the one of then: {error}".rstrip("."),
            "other_board",
        )
    except NotEnoughDataError as error:
        raise InputError(f"No picture can be checked: {error}") from error
    views, few = split_usable_views(views, session.board)
    rejected = (*rejected, *unseen, *few)
    if not views:
        raise InputError(
            f"No picture can be checked ({rejected[0].name}: {rejected[0].reason}): take some that"
            " show the whole board."
        )
    return Pictures(views, session.board, rejected)


def _without_session(
    paths: Sequence[Path], calibration: Calibration
) -> tuple[Session, set[tuple[int, int]], tuple[RejectedPicture, ...]]:
    """A session of these pictures, their sizes in px, and those that are damaged."""
    files = [file for path in paths for file in _files(path)]
    whole: list[Path] = []
    sizes: set[tuple[int, int]] = set()
    rejected = []
    for file in files:
        try:
            sizes.add(image_size(file))
            whole.append(file)
        except InputError as error:
            rejected.append(RejectedPicture(file.name, str(error)))
    if not whole:
        raise InputError(f"No picture can be checked: {rejected[0].reason}")
    session = Session(
        whole[0].parent,
        calibration.board,
        calibration.camera,
        calibration.cover,
        tuple(whole),
        None,
        None,
    )
    return session, sizes, tuple(rejected)


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
            f"{folder} has no pictures: give a session, a folder of png, jpg, tiff, bmp or npy"
            " files, or such files."
        )
    return files
