"""The requirements of a fit, checked before torch is loaded for it."""

from pathlib import Path

from calib.errors import InputError
from calib.io.images import frames_folder, list_images
from calib.session.board import Board
from calib.session.session import MIN_FIT_VIEWS, read_session
from capture.session_file import Setup


def no_board_advice(board: Board, pictures: int, where: str) -> str:
    """Return the advice about a source whose pictures show no board.

    `where` says where to correct it.
    """
    subject = (
        f"No board of {board} inner corners"
        if board.coding is None
        else f"No board as described, {board},"
    )
    hint = (
        "count the inner corners"
        if board.coding is None
        else "compare its type, its columns and rows, and its dictionary"
    )
    count_text = f"in any of the {pictures} pictures" if pictures > 1 else "in the picture"
    return f"{subject} {count_text}: {hint}; {where}."


def has_bare(session: Path) -> bool:
    """Return True if there are views without the cover, which determine the lens."""
    bare = session / "bare"
    return bare.is_dir() and ((bare / "session.yaml").exists() or bool(list_images(bare)))


def is_lens_known(session: Path, setup: Setup) -> bool:
    """Return True if a fit knows the lens before it looks through the cover. Else it estimates the
    lens from those views, less surely.
    """
    _, camera, cover = setup
    return cover.shape == "none" or camera.intrinsics is not None or has_bare(session)


def find_missing(session: Path) -> str:
    """Return a sentence about a missing requirement; empty where a fit can begin."""
    frames = frames_folder(session)
    if not (frames.is_dir() and list_images(frames)):
        return (
            f"There is nothing to fit yet: {frames} has no picture. Views are taken by themselves,"
            " or press space."
        )
    try:
        if (count := len(list_images(frames))) < MIN_FIT_VIEWS:
            shortage = f"{MIN_FIT_VIEWS - count} more view{'s' * (MIN_FIT_VIEWS - count > 1)}"
            return (
                f"A fit needs {MIN_FIT_VIEWS} views and there {'is' if count == 1 else 'are'}"
                f" {count}: take {shortage}."
            )
        read_session(session)
    except InputError as error:
        return str(error)
    return ""
