"""What a fit would lack, said before torch is loaded for it."""

from pathlib import Path

from calib.errors import InputError
from calib.io.images import list_images
from calib.session.session import FEWEST_VIEWS, read_session
from capture.session_file import Setup, read_setup
from capture.tui.camera import Task


def no_lens(session: Path) -> str:
    """How the lens becomes known."""
    return (
        "The lens is not known yet. In the set-up, choose record now: without the cover, and name"
        " those pictures as the source; or name a session that knows it beside like; or write"
        f" camera.intrinsics into {session / 'session.yaml'}."
    )


def none_found(task: Task, pictures: int, where: str = "esc corrects the board") -> str:
    """Of a source in whose pictures there was no board: what to look after.

    `where`: a board is corrected that no file describes yet.
    """
    board, file = task.asked[0], task.session / "session.yaml"
    first = (
        f"No board of {board} inner corners"
        if board.coding is None
        else f"No board as described, {board},"
    )
    count = (
        "count the inner corners"
        if board.coding is None
        else "compare its type, its columns and rows, and its dictionary"
    )
    among = f"in any of the {pictures} pictures" if pictures > 1 else "in the picture"
    return (
        f"{first} {among}: {count}; {f'correct the board in {file}' if file.exists() else where}."
    )


def has_bare(session: Path) -> bool:
    """Whether there are views without the cover, which tell the lens."""
    bare = session / "bare"
    return bare.is_dir() and ((bare / "session.yaml").exists() or bool(list_images(bare)))


def lens_known(session: Path, setup: Setup) -> bool:
    """Whether a fit has where to take the lens from; without a cover, it finds it itself."""
    _, camera, cover = setup
    return cover.shape == "none" or camera.intrinsics is not None or has_bare(session)


def lens_missing(session: Path) -> bool:
    """Whether a session that is described lacks it.

    Raises:
        InputError: its session.yaml cannot be read.
    """
    file = session / "session.yaml"
    return file.exists() and not lens_known(session, read_setup(file))


def lacking(session: Path) -> str:
    """A sentence; empty where a fit can begin."""
    frames = session / "frames"
    if not (frames.is_dir() and list_images(frames)):
        return (
            f"There is nothing to fit yet: {frames} has no picture. Views are taken by themselves,"
            " or by space."
        )
    try:
        if lens_missing(session):
            return no_lens(session)
        if (count := len(list_images(frames))) < FEWEST_VIEWS:
            more = f"{FEWEST_VIEWS - count} more view{'s' * (FEWEST_VIEWS - count > 1)}"
            return (
                f"A fit needs {FEWEST_VIEWS} views and there {'is' if count == 1 else 'are'}"
                f" {count}: take {more}."
            )
        read_session(session)
    except InputError as error:
        return str(error)
    return ""
