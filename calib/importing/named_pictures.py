"""The pictures, or the video, that a person named on a command line: of a folder, of a pattern, or
of one camera among several.
"""

import os
import re
import shlex
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.detect import eight_bits
from calib.errors import InputError, brief
from calib.importing.from_pictures import describe_unread
from calib.importing.from_video import sharpest_frames
from calib.io.bag_names import refuse_bag
from calib.io.camera_names import ALL, choose_camera
from calib.io.exif import camera_settings
from calib.io.files import reading
from calib.io.images import (
    CONVERTIBLE,
    SUFFIXES,
    TYPES,
    DamagedPictureError,
    conversion,
    conversion_of_unread,
    list_images,
    picture_bytes,
    read_grey,
    session_pictures,
)
from calib.io.output_folder import LEDGER
from calib.io.patterns import expand, unread_matches
from calib.io.result_names import CALIBRATION_FILE
from calib.io.shell import shell_path
from calib.io.videos import OTHER_VIDEOS, VIDEOS, convert_command, list_videos
from calib.progress import Progress

DESCRIPTION = "session.yaml"
RIG = "rig.yaml"
DESCRIPTION_NAMES = ("session.yaml", "session.yml")
"""Names that people give it, in any case."""
CAMERA = re.compile("/dev/(video|media)[0-9]+")
EXAMPLE = "--board 9x6 --square-mm 25"
"""The options of a command that describes a board, as messages quote them."""
LEVELS = ("*", "*/*", "*/*/*")
"""The levels below a folder without pictures where they are looked for: cards of cameras have
DCIM/100CANON, data sets cam0/data.
"""
MAX_INNER = 3
"""Folders that a message lists."""
MIN_PICTURES = 3
"""Pictures that make a camera of their EXIF: one or two among many are strays."""


@dataclass(frozen=True, slots=True)
class NamedPictures:
    """The pictures, or the video, that a person named on a command line."""

    session: Path
    """The folder of the session."""
    pictures: tuple[Path, ...] = ()
    video: Path | None = None
    words: str = ""
    """The named paths, quoted for a shell."""
    unread: tuple[Path, ...] = ()
    """The files that match a named pattern, and are of a type that is not read."""

    @property
    def in_place(self) -> bool:
        """True if the session's folder holds the pictures already, and no others. A session of
        corners or of points holds none.
        """
        return self.video is None and self.pictures == session_pictures(self.session)

    @property
    def is_described(self) -> bool:
        """True if there is a session.yaml."""
        with reading(self.session / DESCRIPTION):
            return (self.session / DESCRIPTION).exists()


def find_pictures(paths: Sequence[Path]) -> NamedPictures:
    """Return what the paths name: one folder, some pictures, or a video. A pattern such as
    'photos/*.jpg', which the shell left as it is, stands for the files that match it.

    Raises:
        InputError: a path is neither, or there is no picture.
    """
    words = " ".join(map(shell_path, paths))
    existing = _matches(paths)
    for path in existing:
        _check_exists(path)
        _check_no_calibration(path)
    if len(existing) == 1 and existing[0].is_dir():
        return _pictures_of_folder(existing[0], words)
    videos = [path for path in existing if path.suffix.lower() in VIDEOS]
    if len(existing) == 1 and videos:
        return NamedPictures(videos[0].with_suffix(""), video=videos[0], words=words)
    if videos:
        raise InputError(
            f"{videos[0]} is a video among other files: give one video, or pictures, such as"
            f" `calib fit {shell_path(videos[0])} {EXAMPLE}`."
        )
    distinct: dict[Path, None] = {}  # '**/*' matches a folder and its pictures
    for path in existing:
        pictures_of_path = session_pictures(path) if path.is_dir() else [_checked_picture(path)]
        distinct |= dict.fromkeys(pictures_of_path)
    pictures = list(distinct)
    folders = {path.parent for path in pictures}
    common = Path(os.path.commonpath([str(folder) for folder in folders] or ["."]))
    if len(folders) == 1 and set(pictures) == set(list_images(common)):
        return _pictures_of_folder(common, words)
    unread = tuple(unread_matches(paths))
    return NamedPictures(common / "session", tuple(pictures), words=words, unread=unread)


def _matches(paths: Sequence[Path]) -> list[Path]:
    """Return the paths with what matches each pattern in its place: without what an earlier fit
    wrote there, and without folders that have no pictures, unless nothing else matches.
    """
    existing: list[Path] = []
    for path in paths:
        media = expand([path])
        originals = [match for match in media if len(media) == 1 or _is_original(match)]
        existing += originals or media
    return existing


def _is_original(path: Path) -> bool:
    """Return True for a picture, or a folder with pictures, that is no copy made by a fit."""
    with reading(path):
        if path.is_dir() and not session_pictures(path):
            return False
        return not any((place / "frames" / LEDGER).exists() for place in (path, *path.parents[:2]))


def _check_no_calibration(path: Path) -> None:
    """Check that a path is not what `calib fit` wrote; a session may hold it beside its pictures.

    Raises:
        InputError: it is.
    """
    with reading(path):
        is_calibration = (path / CALIBRATION_FILE).is_file() and not (path / DESCRIPTION).exists()
        if is_calibration and not session_pictures(path):
            raise InputError(
                f"{path} is a calibration: give the folder of pictures to fit, or look at it by"
                f" `calib report {shell_path(path)}`."
            )


def _check_exists(path: Path) -> None:
    """Raise InputError if a path does not exist, or is a camera."""
    if CAMERA.fullmatch(str(path)):
        raise InputError(
            f"{path} is a camera, and a fit takes pictures: record some by"
            f" `capture SESSION --source v4l2:{path}`. `capture sources` lists the cameras."
        )
    with reading(path):
        if path.exists():
            return
    raise InputError(
        f"{path} is not a folder, a picture or a video that exists: check its name, or record"
        f" pictures there by `capture {shell_path(path)}`."
    )


def _checked_picture(path: Path) -> Path:
    """Return the path of a picture.

    Raises:
        InputError: it is another file; the message has the command for it, or how to convert it.
    """
    if path.name == RIG:
        raise InputError(
            f"{path} describes a rig: `calib rig fit {shell_path(path)}` calibrates it."
        )
    if path.name == DESCRIPTION:
        raise InputError(
            f"{path} describes a session: `calib fit {shell_path(path.parent)}` calibrates it."
        )
    refuse_bag(path)
    if path.suffix.lower() in OTHER_VIDEOS:
        raise InputError(
            f"{path} is a video of a type that is not read: convert it by"
            f" `{convert_command(path)}`."
        )
    if path.suffix.lower() in CONVERTIBLE:
        raise InputError(f"{path} is a picture of a type that is not read: {conversion(path)}.")
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(
            f"{path} is neither a picture nor a video: give {TYPES} files, a folder of them,"
            f" or a video ({', '.join(VIDEOS)})."
        )
    return path


def _pictures_of_folder(folder: Path, words: str) -> NamedPictures:
    """Return the pictures of a folder, which may be a session."""
    with reading(folder):
        place = folder.absolute()
        session = place.resolve().parent
        is_inner = place.name in ("frames", "bare") and (session / DESCRIPTION).exists()
        described = (folder / DESCRIPTION).exists()
        if not described:
            _check_description_name(folder)
    if is_inner and not described:
        around = folder.parent if folder.name else folder / ".."
        raise InputError(
            f"{folder} belongs to the session {around}: type `calib fit {shell_path(around)}`,"
            " or copy the pictures elsewhere to describe them anew."
        )
    pictures = session_pictures(folder)
    if not pictures and not described:
        videos = list_videos(folder)
        if videos:
            raise InputError(
                f"{folder} has no pictures, but a video: `calib fit {shell_path(videos[0])}"
                f" {EXAMPLE}` makes a session of it."
            )
        unread = describe_unread(folder)
        exception = f", only {unread}" if unread else ""
        advice = _advice_without_pictures(folder)
        raise InputError(f"{folder} has no session.yaml and no pictures{exception}: {advice}")
    return NamedPictures(folder, pictures, words=words)


def _check_description_name(folder: Path) -> None:
    """Raise InputError for a session.yaml of another spelling, which nothing would read."""
    for path in folder.iterdir():
        if path.name.lower() in DESCRIPTION_NAMES:
            raise InputError(f"{path} is not read under that name: rename it to {DESCRIPTION}.")


def _advice_without_pictures(folder: Path) -> str:
    """Return what to do about a folder without pictures: name its folders that have some, or
    convert files of another type.
    """
    levels = (
        [path for path in sorted(folder.glob(level)) if _holds_pictures(path, folder)]
        for level in LEVELS
    )
    inner = next(filter(None, levels), [])
    if inner and not (folder / RIG).is_file():
        return _advice_on_inner_folders(folder, inner)
    if (folder / RIG).is_file():
        return f"it is a rig, which `calib rig fit {shell_path(folder)}` calibrates."
    if advice := conversion_of_unread(folder):
        return f"{advice}."
    return f"record some by `capture {shell_path(folder)}`, or put {TYPES} files there."


def _advice_on_inner_folders(folder: Path, inner: Sequence[Path]) -> str:
    """Return what to do about a folder whose inner folders have pictures: a command with the
    first, which may be a session, and the names of some.
    """
    names = ", ".join(str(path.relative_to(folder)) for path in inner[:MAX_INNER])
    count = len(inner) - MAX_INNER
    further = f" and {count} more" if count > 0 else ""
    first = inner[0]
    command = f"calib fit {shell_path(first)} {EXAMPLE}"
    if first.name in ("frames", "bare") and (first.parent / DESCRIPTION).is_file():
        command = f"calib fit {shell_path(first.parent)}"
    pictures = "give a folder with the pictures of one camera"
    advice = f"{pictures} ({names}{further}), such as `{command}`."
    if len(inner) == 1 or any((path.parent / DESCRIPTION).is_file() for path in inner):
        return advice
    return f"{advice} If one camera took all of them, give {shell_path(folder / '**' / '*')}."


def _holds_pictures(path: Path, folder: Path) -> bool:
    """Return True for a folder below another one that has pictures, can be read and is not
    hidden.
    """
    if any(name.startswith(".") for name in path.relative_to(folder).parts):
        return False
    try:
        return path.is_dir() and bool(list_images(path))
    except (OSError, InputError):
        return False


def choose_pictures(source: NamedPictures, camera: str | None) -> NamedPictures:
    """Return the source with the pictures of one camera, which get a session of its name.

    Args:
        camera: a part of its maker and model in the pictures' EXIF, or its name, as
            `choose_camera` takes it.

    Raises:
        InputError: the pictures' EXIF or names are of several cameras and none is chosen.
    """
    pictures, name = _pictures_of_camera(source.pictures, camera)
    if camera is None:
        return source
    words = f"{source.words} --camera {shlex.quote(camera)}"
    if camera == ALL:
        return replace(source, words=words)
    folder = source.session if source.in_place else source.session.parent
    return replace(source, session=folder / name, pictures=pictures, words=words)


def _pictures_of_camera(
    pictures: Sequence[Path], camera: str | None
) -> tuple[tuple[Path, ...], str]:
    """Return the pictures of one camera, by the EXIF or by their names, and the name of a folder
    for them.
    """
    cameras: dict[str, list[Path]] = {}
    for path in pictures:
        with suppress(DamagedPictureError):  # the fit leaves it out, and says so
            if stated := camera_settings(picture_bytes(path)).get("camera"):
                cameras.setdefault(stated, []).append(path)
    if camera is not None:
        matches = [stated for stated in cameras if camera.lower() in stated.lower()]
        if len(matches) == 1:
            return tuple(cameras[matches[0]]), re.sub(r"[^\w-]+", "-", camera).strip("-")
    elif sum(len(group) >= MIN_PICTURES for group in cameras.values()) > 1:
        groups = sorted(cameras.items(), key=lambda entry: -len(entry[1]))
        counts = " and ".join(f"{brief(stated)} ({len(group)})" for stated, group in groups[:4])
        raise InputError(
            f"The pictures are of several cameras by their EXIF, {counts}: choose one with --camera"
            f" {shlex.quote(groups[0][0])}, or --camera all if it is one camera."
        )
    return choose_camera(pictures, camera), str(camera)


def sample(source: NamedPictures, count: int, progress: Progress) -> list[NDArray[np.uint8]]:
    """Return up to `count` of the pictures, spread over all of them, as (H, W) grey, without
    damaged ones; of a video sharp ones.

    Raises:
        DamagedPictureError: all of them are damaged.
    """
    if source.video:
        return [
            np.asarray(cv2.cvtColor(frame.pixels, cv2.COLOR_BGR2GRAY), np.uint8)
            for frame in sharpest_frames(source.video, count, progress)
        ]
    last = len(source.pictures) - 1
    numbers = sorted({round(index) for index in np.linspace(0, last, count)})
    pictures = []
    for number in numbers:
        with suppress(DamagedPictureError):
            pictures.append(eight_bits(read_grey(source.pictures[number])))
    if not pictures:
        read_grey(source.pictures[0])  # raises with the reason
    return pictures
