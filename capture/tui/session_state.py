"""What a session's folder says: whether it is described, and how many views were taken."""

from pathlib import Path

from calib.errors import InputError
from calib.io.images import list_images
from capture.tui.farewell import fitted
from capture.tui.fit_requirements import lens_missing


def described(session: Path) -> bool:
    return (session / "session.yaml").exists()


def taken(session: Path, *, bare: bool) -> int:
    """Pictures without the cover, or through it."""
    folder = session / ("bare" if bare else "frames")
    return len(list_images(folder)) if folder.is_dir() else 0


def state(session: Path) -> str:
    """The set-up's first line."""
    if not described(session):
        return f"{session}: a new session."
    said = (
        f"{session}: continued, {_views(taken(session, bare=True))} without cover and"
        f" {_views(taken(session, bare=False))} through it."
    )
    if fitted(session):
        said += " It is fitted: ^o opens its results."
    elif taken(session, bare=False) and _lens_missing(session):
        said += " Its lens is not known yet: record without the cover."
    return said + " What is grey stands in its session.yaml: correct it there."


def _lens_missing(session: Path) -> bool:
    try:
        return lens_missing(session)
    except InputError:  # which is said as such
        return False


def _views(count: int) -> str:
    return f"{count} view{'s' * (count != 1)}"
