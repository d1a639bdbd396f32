"""Import a plain folder of pictures of a board."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.errors import InputError, brief
from calib.importing.session_draft import SessionDraft
from calib.io.camera_names import choose_camera
from calib.io.exif import camera_settings, describe_differences, list_names
from calib.io.files import read_file, reading
from calib.io.images import TYPES, list_images, list_unread, most_frequent_size, stated_size
from calib.session.board import Board
from calib.session.camera import Camera


@dataclass(frozen=True, slots=True)
class UniformPictures:
    """The pictures of a folder that have the size of most of them."""

    paths: tuple[Path, ...]
    size: tuple[int, int]
    """Width and height, px."""
    notices: tuple[str, ...]
    """Sentences on the files that are left out, and on pictures of different cameras."""


def from_pictures(
    folder: Path, board: Board, model: str = "", camera: str | None = None
) -> SessionDraft:
    """Import the pictures of a folder that have the size of most of them.

    Args:
        folder: the folder.
        board: the board that they show.
        model: the camera's name.
        camera: the camera of a pair to import, as the pictures' names say it.
    """
    with reading(folder):
        if not folder.is_dir():
            raise InputError(f"{folder} is not a folder: give the folder that holds the pictures.")
    pictures = uniform_pictures(folder, choose_camera(list_images(folder), camera))
    return SessionDraft(
        folder,
        board,
        Camera(*pictures.size, model),
        frames=read_contents(pictures.paths),
        notices=pictures.notices,
    )


def uniform_pictures(folder: Path, paths: Sequence[Path]) -> UniformPictures:
    """Return those of a folder's pictures that have the size of most of them.

    Raises:
        InputError: there are none, one is damaged, or no size is that of more than half of them.
    """
    unread = [brief(path.name) for path in list_unread(folder)]
    unread_words = f"files that are not read as pictures: {list_names(unread)}" if unread else ""
    if not paths:
        exception = f", only {unread_words}" if unread else ""
        raise InputError(f"{folder} has no pictures{exception}: give a folder of {TYPES} files.")
    sizes = {}
    settings = {}
    for path in paths:
        data = read_file(path)
        sizes[path] = stated_size(path, data)
        settings[path.name] = camera_settings(data)
    width, height = size = most_frequent_size(sizes)
    uniform = tuple(path for path in paths if sizes[path] == size)
    strays = [path for path in paths if sizes[path] != size]
    if 2 * len(uniform) <= len(paths) and strays:
        size_names = sorted({f"{w}x{h}" for w, h in sizes.values()})
        raise InputError(
            f"{folder} has pictures of {len(size_names)} sizes, {', '.join(size_names[:6])} px,"
            " none of them that of most: put those of one camera mode into a folder of their own."
        )
    notices = [f"left out, {unread_words}. Save them as {TYPES}."] if unread else []
    if strays:
        stray_names = [f"{brief(path.name)} ({'x'.join(map(str, sizes[path]))})" for path in strays]
        stray_words = list_names(stray_names)
        notices.append(
            f"left out, pictures of another size than {width}x{height} px: {stray_words}."
        )
    notices += describe_differences({path.name: settings[path.name] for path in uniform})
    return UniformPictures(uniform, size, tuple(notices))


def read_contents(paths: Sequence[Path]) -> Iterator[tuple[str, bytes]]:
    """Yield names and contents, with one picture in memory at a time."""
    for path in paths:
        yield path.name, read_file(path)
