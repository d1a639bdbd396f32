"""Checks of a source folder: do its pictures fit the step? Pictures with and without the cover look
alike to the program.
"""

from pathlib import Path

from calib.errors import InputError
from capture.session_file import read_setup
from capture.sources.registry import full_source
from capture.typed_path import expand_typed_path

PICTURE_KINDS = ("without the cover", "through it")


def select_pictures(source: str, *, covered: bool) -> str:
    """Return the source; for a session's folder with both kinds of pictures, return its folder of
    pictures without the cover if those are wanted.
    """
    folder = _folder(source)
    if covered or not folder or not (folder / "bare").is_dir():
        return source
    base, mark, options = source.partition("?")
    return f"{base.rstrip('/')}/bare{mark}{options}"


def check_source_folder(source: str, *, covered: bool) -> None:
    """Raise InputError if `source` is the folder of a session that keeps the wanted pictures in
    another folder.
    """
    folder = _folder(source)
    if not folder:
        return
    if not covered and (folder / "bare").is_dir():
        raise InputError(
            f"{source} gives a session's pictures through its cover: for those without, write"
            f" folder:{folder / 'bare'}."
        )
    if covered and folder.name == "bare":
        raise InputError(
            f"{source} has pictures without the cover: name those that were taken through it, as in"
            " folder:SESSION."
        )


def describe_mismatch(source: str, *, covered: bool) -> str:
    """Return a sentence if the folder's own session.yaml contradicts this step; else an empty
    string.
    """
    folder = _folder(source)
    if not folder:
        return ""
    file = (folder.parent if folder.name == "frames" else folder) / "session.yaml"
    if not file.is_file():
        return ""
    try:
        described = read_setup(file)[2]
    except InputError:  # the pictures were described by somebody else
        return ""
    has_cover = described.shape != "none"
    if has_cover == covered:
        return ""
    cover = f"a cover, {described.words}" if has_cover else "no cover"
    return (
        f"{file} says that its pictures have {cover}, where those {PICTURE_KINDS[covered]} are"
        " wanted."
    )


def is_kind_unknown(source: str) -> bool:
    """Return True for recorded pictures of which nothing says whether they show the cover: neither
    the name bare nor a session.yaml.
    """
    folder = _folder(source)
    if not folder:
        return full_source(source).startswith("video:")
    outer = folder.parent if folder.name == "frames" else folder
    return folder.name != "bare" and not (outer / "session.yaml").is_file()


def _folder(source: str) -> Path | None:
    scheme, _, path = full_source(source).partition(":")
    return expand_typed_path(path.partition("?")[0]) if scheme == "folder" else None
