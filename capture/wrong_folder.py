"""Pictures with and without the cover look alike to the program: whether a folder is named for the
step that its pictures are of.
"""

from pathlib import Path

from calib.errors import InputError
from capture.session_file import read_setup
from capture.typed_path import typed_path

WANTED = ("without the cover", "through it")


def half(source: str, *, covered: bool) -> str:
    """The source itself; of a folder that is a session with both, that of its pictures without the
    cover where those are wanted.
    """
    place = _folder(source)
    if covered or not place or not (place / "bare").is_dir():
        return source
    named, mark, options = source.partition("?")
    return f"{named.rstrip('/')}/bare{mark}{options}"


def check_folder(source: str, *, covered: bool) -> None:
    """InputError where `source` is a folder of a session that keeps the wanted pictures in another
    one.
    """
    place = _folder(source)
    if not place:
        return
    if not covered and (place / "bare").is_dir():
        raise InputError(
            f"{source} gives a session's pictures through its cover: for those without, write"
            f" folder:{place / 'bare'}."
        )
    if covered and place.name == "bare":
        raise InputError(
            f"{source} has pictures without the cover: name those that were taken through it, as in"
            " folder:SESSION."
        )


def doubt(source: str, *, covered: bool) -> str:
    """What a folder's own session.yaml says against it; empty where it says nothing."""
    place = _folder(source)
    if not place:
        return ""
    file = (place.parent if place.name == "frames" else place) / "session.yaml"
    if not file.is_file():
        return ""
    try:
        shape = read_setup(file)[2].shape
    except InputError:  # of pictures that somebody else described
        return ""
    if (shape != "none") == covered:
        return ""
    has = "no cover" if shape == "none" else f"a cover, a {shape}"
    return f"{file} says that its pictures have {has}, where those {WANTED[covered]} are wanted."


def _folder(source: str) -> Path | None:
    scheme, _, rest = source.partition(":")
    return typed_path(rest.partition("?")[0]) if scheme == "folder" else None
