"""Import a plain folder of pictures of a board."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.errors import InputError, brief
from calib.importing.session_draft import SessionDraft
from calib.io.camera_names import choose_camera
from calib.io.exif import camera_settings, describe_differences, list_names
from calib.io.files import read_file, reading
from calib.io.images import (
    TYPES,
    DamagedPictureError,
    list_images,
    list_unread,
    most_frequent_size,
    picture_bytes,
    stated_size,
)
from calib.session.board import Board
from calib.session.camera import Camera


@dataclass(frozen=True, slots=True)
class PictureContents:
    """Names and contents of pictures, one by one, with one picture in memory at a time."""

    paths: tuple[Path, ...]
    names: tuple[str, ...]
    """The name of each picture in the session."""

    @staticmethod
    def of(paths: Sequence[Path]) -> "PictureContents":
        """Return the contents of pictures under their own names."""
        return PictureContents(tuple(paths), tuple(path.name for path in paths))

    def __iter__(self) -> Iterator[tuple[str, bytes]]:
        for name, path in zip(self.names, self.paths, strict=True):
            yield name, read_file(path)


@dataclass(frozen=True, slots=True)
class UniformPictures:
    """The pictures of the size that most of them have."""

    paths: tuple[Path, ...]
    size: tuple[int, int]
    """Width and height, px."""
    stray_notices: tuple[str, ...]
    """Sentences on the pictures of other sizes and on damaged ones, if there are any."""
    difference_notices: tuple[str, ...]
    """Sentences on pictures of different cameras, lenses or settings."""

    @property
    def notices(self) -> tuple[str, ...]:
        return (*self.stray_notices, *self.difference_notices)


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
    unread = describe_unread(folder)
    paths = choose_camera(list_images(folder), camera)
    if not paths:
        exception = f", only {unread}" if unread else ""
        raise InputError(f"{folder} has no pictures{exception}: give a folder of {TYPES} files.")
    pictures = uniform_pictures(folder, paths)
    return SessionDraft(
        folder,
        board,
        Camera(*pictures.size, model),
        frames=PictureContents.of(pictures.paths),
        notices=(*unread_notices(folder), *pictures.notices),
    )


def describe_unread(folder: Path) -> str:
    """Return words on the files of a folder that are no pictures to calib; "" if there are none."""
    return _in_words(list_unread(folder))


def unread_notices(folder: Path) -> tuple[str, ...]:
    """Return a sentence on the files of a folder that are no pictures to calib, if any."""
    return notices_of_unread(list_unread(folder))


def notices_of_unread(unread: Sequence[Path]) -> tuple[str, ...]:
    """Return a sentence on files that are no pictures to calib, if there are any."""
    return (f"left out, {_in_words(unread)}. Save them as {TYPES}.",) if unread else ()


def _in_words(unread: Sequence[Path]) -> str:
    names = [brief(path.name) for path in unread]
    return f"files that are not read as pictures: {list_names(names)}" if names else ""


def uniform_pictures(folder: Path, paths: Sequence[Path]) -> UniformPictures:
    """Return those of a folder's pictures that have the size of most of them.

    Raises:
        DamagedPictureError: at least half of the pictures are damaged.
        InputError: no size is that of more than half of them.
    """
    sizes = {}
    settings = {}
    damaged: dict[Path, DamagedPictureError] = {}
    for path in paths:
        try:
            data = picture_bytes(path)
            sizes[path] = stated_size(path, data)
        except DamagedPictureError as error:
            damaged[path] = error
            continue
        settings[path] = camera_settings(data)
    if damaged and 2 * len(damaged) >= len(paths):
        raise next(iter(damaged.values()))
    paths = tuple(sizes)
    width, height = size = most_frequent_size(sizes)
    uniform = tuple(path for path in paths if sizes[path] == size)
    strays = [path for path in paths if sizes[path] != size]
    if 2 * len(uniform) <= len(paths) and strays:
        shapes = sorted({*sizes.values()})
        if len(shapes) == 2 and shapes[0] == shapes[1][::-1]:
            (width, height), _ = shapes
            raise InputError(
                f"{folder} has pictures of {width}x{height} and of {height}x{width} px, as of one"
                " camera mode that is turned: turn all of them the same way, as the sensor stores"
                " them, or put those of one size into a folder of their own."
            )
        size_names = sorted({f"{w}x{h}" for w, h in sizes.values()})
        raise InputError(
            f"{folder} has pictures of {len(size_names)} sizes, {', '.join(size_names[:6])} px,"
            " none of them that of most: put those of one camera mode into a folder of their own."
        )
    stray_notices = []
    if strays:
        stray_names = [
            f"{brief(_name(path, folder))} ({'x'.join(map(str, sizes[path]))})" for path in strays
        ]
        stray_words = list_names(stray_names)
        stray_notices.append(
            f"left out, pictures of another size than {width}x{height} px: {stray_words}."
        )
    if damaged:
        damaged_words = list_names(
            [f"{brief(_name(path, folder))} ({error.reason})" for path, error in damaged.items()]
        )
        stray_notices.append(f"left out, damaged pictures: {damaged_words}.")
    differences = describe_differences({_name(path, folder): settings[path] for path in uniform})
    return UniformPictures(uniform, size, tuple(stray_notices), differences)


def _name(path: Path, folder: Path) -> str:
    return str(path.relative_to(folder) if path.is_relative_to(folder) else path)
