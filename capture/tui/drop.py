"""Setting a picture aside: it leaves the session's frames, and can come back."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path

from calib.errors import InputError
from calib.io.images import list_images
from capture.disk import sync_folder, writing
from capture.recorder import DROPPED


@dataclass(frozen=True, slots=True)
class Dropped:
    """A picture that was set aside."""

    file: str
    """Its name in frames/."""
    now: Path
    """Where it is."""


def drop(session: Path, file: str) -> Dropped:
    """Move a picture to frames/dropped, where calib does not look."""
    frames = session / "frames"
    if not (frames / file).exists():
        raise InputError(
            f"{frames / file} is not there any more: it was moved or deleted outside of this"
            " program."
        )
    aside = frames / DROPPED
    if aside.is_symlink():
        raise InputError(
            f"{aside} is a symbolic link, and no picture is moved through one: remove it first."
        )
    with writing(aside):
        aside.mkdir(exist_ok=True)
        place = next(place for place in places(aside, file) if not place.exists())
        (frames / file).rename(place)
        sync_folder(frames)
    return Dropped(file, place)


def dropped(session: Path, files: Iterable[str]) -> list[Dropped]:
    """Which of these pictures were set aside, by whomever, and lie where `drop` puts them."""
    frames = session / "frames"
    found = []
    for file in files:
        there = (
            []
            if (frames / file).exists()
            else list(takewhile(Path.exists, places(frames / DROPPED, file)))
        )
        if there:
            found.append(Dropped(file, there[-1]))
    return found


def dropped_before(session: Path, files: Iterable[str]) -> list[Dropped]:
    """Those that lie where `drop` puts them and are none of these pictures: a fit has gone on
    without them. The last one last.
    """
    frames, known = session / "frames", set(files)
    if not (frames / DROPPED).is_dir():
        return []
    gone = [
        Dropped(place.name, place)
        for place in list_images(frames / DROPPED)
        if place.name not in known
    ]
    there = [each for each in gone if not (frames / each.file).exists()]
    return sorted(
        there, key=lambda each: each.now.stat().st_ctime_ns
    )  # of its name, not of what is in it


def places(aside: Path, file: str) -> Iterable[Path]:
    """Where what is set aside may come to lie: of that name, or one with a number."""
    return (
        aside / f"{Path(file).stem}{f'-{number}' if number else ''}{Path(file).suffix}"
        for number in count()
    )


def take_back(one: Dropped) -> None:
    frames = one.now.parent.parent
    with writing(frames):
        one.now.rename(frames / one.file)
        sync_folder(frames)
