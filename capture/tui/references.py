"""What a person names in the set-up: where pictures come from, and another session."""

from dataclasses import replace

from calib.errors import RefracalError
from calib.io.files import reading
from capture.session_file import Setup, read_calibrated, read_setup
from capture.sources.registry import open_source
from capture.tui.farewell import CALIBRATION
from capture.typed_path import expand_typed_path


def read_like(like: str) -> Setup | None:
    """What another session says, its lens as its fit found it where it states none; None where no
    session is named.
    """
    if not like.strip():
        return None
    place = expand_typed_path(like.strip())
    with reading(place):
        place = place / "session.yaml" if place.is_dir() else place
    board, camera, cover = read_setup(place)
    found = place.parent / "calibration" / CALIBRATION
    if camera.intrinsics is None and found.exists():
        camera = replace(camera, intrinsics=read_calibrated(found)[1].intrinsics)
    return board, camera, cover


def played(source: str) -> bool:
    """Whether it is no camera, which may be plugged in yet, but pictures that are there or not."""
    return source.startswith(("folder:", "video:"))


def cannot_be_opened(source: str) -> str:
    """Why these pictures cannot be opened; empty where they can. Blocks."""
    try:
        with open_source(source, "source"):
            return ""
    except RefracalError as error:
        return str(error)
