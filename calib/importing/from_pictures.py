"""Import a plain folder of pictures of a board."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from calib.errors import InputError
from calib.importing.session_draft import SessionDraft
from calib.io.files import read_file, reading
from calib.io.images import image_size, list_images
from calib.session.board import Board
from calib.session.camera import Camera


def from_pictures(folder: Path, board: Board, model: str = "") -> SessionDraft:
    """Import all pictures of a folder; the first one determines their size. `model` is the camera's
    name.
    """
    with reading(folder):
        if not folder.is_dir():
            raise InputError(f"{folder} is not a folder: give the folder that holds the pictures.")
    paths = list_images(folder)
    if not paths:
        raise InputError(
            f"{folder} has no pictures: give a folder of png, jpg, tiff, bmp or npy files."
        )
    width, height = image_size(paths[0])
    return SessionDraft(folder, board, Camera(width, height, model), frames=read_contents(paths))


def read_contents(paths: Sequence[Path]) -> Iterator[tuple[str, bytes]]:
    """Yield names and contents, with one picture in memory at a time."""
    for path in paths:
        yield path.name, read_file(path)
