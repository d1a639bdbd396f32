"""The requirements of a fit, checked before torch is loaded for it."""

from pathlib import Path

from calib.errors import InputError
from calib.io.images import frames_folder, list_images
from calib.session.schema import UNKNOWN
from calib.session.session import MIN_FIT_VIEWS, read_session
from capture.session_file import Setup, read_setup
from capture.tui.camera import Task


def no_lens_advice(session: Path) -> str:
    """Return the advice on how to make the lens known."""
    return (
        "The lens is not known yet. In the set-up, choose record now: without the cover, and name"
        " those pictures as the source; or name a session that knows it beside like; or write"
        f" camera.intrinsics into {session / 'session.yaml'}, {UNKNOWN} if nobody knows them."
    )


def no_board_advice(task: Task, pictures: int, where: str = "esc corrects the board") -> str:
    """Return the advice about a source whose pictures show no board.

    `where` says where to correct a board that no file describes yet.
    """
    board, file = task.setup[0], task.session / "session.yaml"
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
    return (
        f"{subject} {count_text}: {hint};"
        f" {f'correct the board in {file}' if file.exists() else where}."
    )


def has_bare(session: Path) -> bool:
    """Return True if there are views without the cover, which determine the lens."""
    bare = session / "bare"
    return bare.is_dir() and ((bare / "session.yaml").exists() or bool(list_images(bare)))


def is_lens_known(session: Path, setup: Setup) -> bool:
    """Return True if a fit can get the lens; without a cover, it estimates the lens itself."""
    _, camera, cover = setup
    return cover.shape == "none" or camera.intrinsics is not None or has_bare(session)


def is_lens_missing(session: Path) -> bool:
    """Return True if a described session has no lens.

    Raises:
        InputError: session.yaml cannot be read.
    """
    file = session / "session.yaml"
    return file.exists() and not is_lens_known(session, read_setup(file))


def find_missing(session: Path) -> str:
    """Return a sentence about a missing requirement; empty where a fit can begin."""
    frames = frames_folder(session)
    if not (frames.is_dir() and list_images(frames)):
        return (
            f"There is nothing to fit yet: {frames} has no picture. Views are taken by themselves,"
            " or by space."
        )
    try:
        if is_lens_missing(session):
            return no_lens_advice(session)
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
