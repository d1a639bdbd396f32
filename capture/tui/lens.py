"""The process that finds the lens from the pictures without the cover: `python -m capture.tui.lens SESSION`, a JSON object a line."""

import sys
from dataclasses import replace
from pathlib import Path

from calib.fitting.inputs import read_views
from calib.fitting.intrinsics import calibrate_bare
from calib.progress import Silent
from calib.session.camera import camera_to_yaml
from calib.session.session import read_session
from capture.tui.fitting import answer


def main(session: Path) -> None:
    answer(lambda: _lens(session))


def _lens(session: Path) -> dict[str, object]:
    described = read_session(session)
    assert described.bare
    views, _ = read_views(described.bare, Silent())
    fitted = calibrate_bare(views, described.bare.board, described.camera, Silent())
    return {"camera": camera_to_yaml(replace(described.camera, intrinsics=fitted.intrinsics))}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
