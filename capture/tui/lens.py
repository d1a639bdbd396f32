"""The lens from the pictures without the cover, computed in the screen's child process while the
screen stays responsive.
"""

from dataclasses import replace
from pathlib import Path

from calib.fitting.inputs import read_views
from calib.intrinsics.calibrate import calibrate_bare
from calib.progress import Progress
from calib.session.camera import camera_to_yaml
from calib.session.session import read_session

ENOUGH_BARE_VIEWS = 10
"""The number of views without the cover from which on the lens counts as recorded, and the screens
propose to go on through the cover.
"""


def find_lens(progress: Progress, session: Path) -> dict[str, object]:
    """Return `camera`: the session's, as session.yaml would have it with intrinsics."""
    session_input = read_session(session)
    assert session_input.bare
    views, _ = read_views(session_input.bare, progress)
    fitted = calibrate_bare(views, session_input.bare.board, session_input.camera, progress)
    return {"camera": camera_to_yaml(replace(session_input.camera, intrinsics=fitted.intrinsics))}
