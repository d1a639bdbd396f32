"""The state of a session's folder: whether it is described, and how many views it has."""

from pathlib import Path

from calib.errors import InputError
from calib.io.images import list_images
from capture.session_file import picture_folder, read_setup
from capture.tui.farewell import calibration_folder
from capture.tui.fit_requirements import is_lens_known


def has_session_file(session: Path) -> bool:
    return (session / "session.yaml").exists()


def count_pictures(session: Path, *, bare: bool) -> int:
    """Return the number of pictures without the cover, or through it."""
    folder = picture_folder(session, bare=bare)
    return len(list_images(folder)) if folder.is_dir() else 0


def describe_session(session: Path) -> str:
    """Return the set-up's first line."""
    if not has_session_file(session):
        return f"{session}: a new session. Fill in what is needed, check what is assumed."
    text = (
        f"{session}: continued, {_views(count_pictures(session, bare=True))} without cover and"
        f" {_views(count_pictures(session, bare=False))} through it."
    )
    if calibration_folder(session):
        text += " It is fitted: ^o opens its results."
    elif count_pictures(session, bare=False) and not _lens_known(session):
        text += " Views without the cover would make its lens surer."
    return text + " Values that you correct here go into its session.yaml when you go on."


def _lens_known(session: Path) -> bool:
    try:
        return is_lens_known(session, read_setup(session / "session.yaml"))
    except InputError:  # the set-up reports this error itself
        return True


def _views(count: int) -> str:
    return f"{count} view{'s' * (count != 1)}"
