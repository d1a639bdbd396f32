"""The lens from the pictures without the cover, as the screen's child finds it: the screen answers
meanwhile.
"""

from dataclasses import replace
from pathlib import Path

from calib.fitting.inputs import read_views
from calib.intrinsics.calibrate import calibrate_bare
from calib.progress import Progress
from calib.session.camera import camera_to_yaml
from calib.session.session import read_session

ENOUGH = 10
"""Views without the cover: from here on the lens is taken as recorded, and the screens propose to
go on through the cover.
"""


def find_lens(progress: Progress, session: Path) -> dict[str, object]:
    """Returns `camera`: the session's, as session.yaml would have it with intrinsics."""
    described = read_session(session)
    assert described.bare
    views, _ = read_views(described.bare, progress)
    fitted = calibrate_bare(views, described.bare.board, described.camera, progress)
    return {"camera": camera_to_yaml(replace(described.camera, intrinsics=fitted.intrinsics))}
