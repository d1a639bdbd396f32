"""Setting a picture aside: it leaves the session's frames, and can come back."""

from dataclasses import dataclass
from itertools import count
from pathlib import Path

from capture.disk import sync_folder, writing


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
    aside = frames / "dropped"
    with writing(aside):
        aside.mkdir(exist_ok=True)
        names = (aside / f"{Path(file).stem}{f'-{number}' if number else ''}{Path(file).suffix}" for number in count())
        place = next(name for name in names if not name.exists())
        (frames / file).rename(place)
        sync_folder(frames)
    return Dropped(file, place)


def take_back(dropped: Dropped) -> None:
    frames = dropped.now.parent.parent
    with writing(frames):
        dropped.now.rename(frames / dropped.file)
        sync_folder(frames)
