"""What a person names in the set-up: where pictures come from, and another session."""

from calib.errors import RefracalError
from calib.io.files import reading
from capture.session_file import Setup, read_setup
from capture.sources.registry import open_source
from capture.typed_path import typed_path


def read_like(like: str) -> Setup | None:
    """What another session says; None where none is named."""
    if not like.strip():
        return None
    place = typed_path(like.strip())
    with reading(place):
        place = place / "session.yaml" if place.is_dir() else place
    return read_setup(place)


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
