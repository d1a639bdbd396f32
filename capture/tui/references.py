"""The sources and sessions that a person names in the set-up."""

from dataclasses import replace

from calib.errors import RefracalError
from calib.io.files import reading
from calib.io.result_names import CALIBRATION_FILE
from capture.session_file import Setup, read_calibrated, read_setup
from capture.sources.registry import open_source
from capture.typed_path import expand_typed_path


def read_like(like: str) -> Setup | None:
    """Return another session's set-up, with the lens that its fit found where it states none; None
    where no session is named.
    """
    if not like.strip():
        return None
    path = expand_typed_path(like.strip())
    with reading(path):
        path = path / "session.yaml" if path.is_dir() else path
    board, camera, cover = read_setup(path)
    calibration = path.parent / "calibration" / CALIBRATION_FILE
    if camera.intrinsics is None and calibration.exists():
        camera = replace(camera, intrinsics=read_calibrated(calibration)[1].intrinsics)
    return board, camera, cover


def explain_unreadable(source: str) -> str:
    """Return the reason why these pictures cannot be opened; empty where they can. Blocks."""
    try:
        with open_source(source, "source"):
            return ""
    except RefracalError as error:
        return str(error)
