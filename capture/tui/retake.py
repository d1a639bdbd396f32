"""Retaking the pictures without the cover, for example if the camera had it on: the old ones are
set aside.
"""

from pathlib import Path

from capture.disk import locked, sync_folder, writing
from capture.tui.drop import candidate_paths

ASIDE_FOLDER = "bare-aside"


def set_bare_aside(session: Path) -> Path:
    """Rename bare/ to bare-aside, where calib does not look, with its table and all other files.
    Return the new folder.

    InputError: a recording writes into it, or it cannot be renamed.
    """
    bare = session / "bare"
    with locked(session), writing(bare):
        aside = next(
            place for place in candidate_paths(session, ASIDE_FOLDER) if not place.exists()
        )
        bare.rename(aside)
        sync_folder(session)
    return aside
