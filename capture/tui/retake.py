"""Pictures without the cover that were no good, such as those of a camera that had it on: all are
set aside, and taken anew.
"""

from pathlib import Path

from capture.disk import locked, sync_folder, writing
from capture.tui.drop import places

ASIDE = "bare-aside"


def set_bare_aside(session: Path) -> Path:
    """Rename bare/ to bare-aside, where calib does not look, with its table and what else is in it.
    The new folder.

    InputError: it is being recorded into, or cannot be renamed.
    """
    bare = session / "bare"
    with locked(session), writing(bare):
        aside = next(place for place in places(session, ASIDE) if not place.exists())
        bare.rename(aside)
        sync_folder(session)
    return aside
