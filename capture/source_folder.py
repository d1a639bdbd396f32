"""Checks of a source folder: do its pictures fit the step? Pictures with and without the cover look
alike to the program.
"""

from itertools import starmap
from pathlib import Path

import numpy as np

from calib.errors import InputError, RefracalError
from calib.io.files import reading
from calib.io.images import list_images, read_image
from capture.session_file import picture_folder, read_setup
from capture.sources.registry import full_source
from capture.typed_path import expand_typed_path

PICTURE_KINDS = ("without the cover", "through the cover")
MAX_COMPARED = 3
"""The largest number of pictures that are compared with recorded ones: reading takes time."""


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


def describe_repeat(source: str, session: Path, *, covered: bool) -> str:
    """Return a sentence if the source's pictures are those that the session has without the cover,
    while pictures through it are wanted, or the reverse; else an empty string. It compares the
    pixels of pictures with the same name, because cameras number their pictures alike.
    """
    folder = _folder(source)
    recorded = picture_folder(session, bare=covered)
    if not folder or not folder.is_dir() or not recorded.is_dir():
        return ""
    inner = folder / "frames"
    with reading(folder):
        pictures = list_images(inner if inner.is_dir() else folder)
    with reading(recorded):
        copies = {copy.stem: copy for copy in list_images(recorded)}
    pairs = [(picture, copies[picture.stem]) for picture in pictures if picture.stem in copies]
    is_repeat = any(starmap(_are_equal, pairs[:MAX_COMPARED]))
    return repeat_sentence(source, session, covered=covered) if is_repeat else ""


def repeat_sentence(source: str, session: Path, *, covered: bool) -> str:
    """Return the sentence on a source whose pictures the session has already, as those of the other
    kind.
    """
    recorded = picture_folder(session, bare=covered)
    shown = "show the cover" if covered else "show no cover"
    return (
        f"{source} has the pictures that were recorded {PICTURE_KINDS[not covered]}: name others,"
        f" which were taken {PICTURE_KINDS[covered]}. If these {shown}, first move the pictures in"
        f" {recorded} elsewhere."
    )


def _are_equal(picture: Path, copy: Path) -> bool:
    """Return True if two files have the same pixels; False for a damaged one."""
    try:
        return np.array_equal(read_image(picture), read_image(copy))
    except RefracalError:  # whoever reads the source reports it
        return False


def is_kind_unknown(source: str) -> bool:
    """Return True for recorded pictures of which nothing says whether they show the cover: neither
    the name bare, nor a folder bare beside them, nor a session.yaml.
    """
    folder = _folder(source)
    if not folder:
        return full_source(source).startswith("video:")
    outer = folder.parent if folder.name == "frames" else folder
    is_described = (outer / "session.yaml").is_file() or (outer / "bare").is_dir()
    return folder.name != "bare" and not is_described


def may_show_cover(source: str) -> bool:
    """Return True for recorded pictures that are likely to show the cover: those of which nothing
    says so, and those of a session with a cover that has no pictures without it there.
    """
    if is_kind_unknown(source):
        return True
    folder = _folder(source)
    if not folder or (folder / "bare").is_dir():
        return False
    is_beside_bare = folder.name == "frames" and (folder.parent / "bare").is_dir()
    return is_beside_bare or bool(describe_mismatch(source, covered=False))


def _folder(source: str) -> Path | None:
    scheme, _, path = full_source(source).partition(":")
    return expand_typed_path(path.partition("?")[0]) if scheme == "folder" else None
