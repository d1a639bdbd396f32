"""Setting a picture aside: it leaves the session's frames, and can return."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path

from calib.errors import InputError
from calib.io.images import frames_folder, list_images
from capture.disk import sync_folder, writing
from capture.recorder import DROPPED


@dataclass(frozen=True, slots=True)
class DroppedPicture:
    """A picture that was set aside."""

    file: str
    """The name that it has in frames/."""
    path: Path
    """The path where it lies."""


def drop_picture(session: Path, file: str) -> DroppedPicture:
    """Move a picture to frames/dropped, where calib does not look."""
    frames = frames_folder(session)
    if not (frames / file).exists():
        raise InputError(
            f"{frames / file} is missing: it was moved or deleted outside of this program."
        )
    aside = frames / DROPPED
    if aside.is_symlink():
        raise InputError(
            f"{aside} is a symbolic link, and no picture is moved through one: remove it first."
        )
    with writing(aside):
        aside.mkdir(exist_ok=True)
        place = next(place for place in candidate_paths(aside, file) if not place.exists())
        (frames / file).rename(place)
        sync_folder(frames)
    return DroppedPicture(file, place)


def find_dropped(session: Path, files: Iterable[str]) -> list[DroppedPicture]:
    """Return the pictures among these that were set aside, by any program, and lie where
    `drop_picture` puts them.
    """
    frames = frames_folder(session)
    pictures = []
    for file in files:
        copies = (
            []
            if (frames / file).exists()
            else list(takewhile(Path.exists, candidate_paths(frames / DROPPED, file)))
        )
        if copies:
            pictures.append(DroppedPicture(file, copies[-1]))
    return pictures


def find_dropped_earlier(session: Path, files: Iterable[str]) -> list[DroppedPicture]:
    """Return the pictures that lie where `drop_picture` puts them and are not among these files: an
    earlier fit went on without them. The newest is the last.
    """
    frames, fitted = frames_folder(session), set(files)
    if not (frames / DROPPED).is_dir():
        return []
    earlier = [
        DroppedPicture(place.name, place)
        for place in list_images(frames / DROPPED)
        if place.name not in fitted
    ]
    missing = [picture for picture in earlier if not (frames / picture.file).exists()]
    return sorted(
        missing, key=lambda picture: picture.path.stat().st_ctime_ns
    )  # ctime: when the name changed, not the content


def candidate_paths(aside: Path, file: str) -> Iterable[Path]:
    """Return the possible paths of a picture that is set aside: with its name, or with a number
    added.
    """
    return (
        aside / f"{Path(file).stem}{f'-{number}' if number else ''}{Path(file).suffix}"
        for number in count()
    )


def restore_picture(picture: DroppedPicture) -> None:
    frames = picture.path.parent.parent
    with writing(frames):
        picture.path.rename(frames / picture.file)
        sync_folder(frames)
