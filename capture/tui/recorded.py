"""What a session's folder says: whether it is described, and how many views were taken."""

from pathlib import Path

from calib.io.images import list_images
from capture.tui.farewell import fitted


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
    said = f"{session}: continued, {_views(taken(session, bare=True))} without cover and {_views(taken(session, bare=False))} through it."
    if fitted(session):
        said += " It is fitted: ^o opens its results."
    return said + " What is grey stands in its session.yaml: correct it there."


def _views(count: int) -> str:
    return f"{count} view{'s' * (count != 1)}"
