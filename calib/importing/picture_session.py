"""A session beside the pictures that a person has: what was named, and the session.yaml for it.

Pictures stay where they are if a whole folder was named: the folder becomes the session. Of a
video, or of some pictures of a folder, a session folder is made that holds them.
"""

import os
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.detect import eight_bits
from calib.errors import InputError, brief
from calib.importing.from_pictures import (
    PictureContents,
    describe_unread,
    notices_of_unread,
    uniform_pictures,
)
from calib.importing.from_video import describe_end, from_video, sharpest_frames
from calib.io.bag_names import refuse_bag
from calib.io.camera_names import ALL, choose_camera
from calib.io.exif import camera_settings
from calib.io.files import make_folder, reading
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
from calib.io.output_folder import LEDGER, OutputFolder
from calib.io.patterns import expand, unread_matches
from calib.io.result_names import CALIBRATION_FILE
from calib.io.shell import shell_path
from calib.io.videos import OTHER_VIDEOS, VIDEOS, convert_command, list_videos
from calib.progress import Progress
from calib.session.board import Board
from calib.session.board_section import board_to_yaml
from calib.session.commented import commented_session
from calib.session.schema import UNKNOWN
from calib.session.session import TARGET_KEY, session_from_mapping
from calib.session.shapes.none import NONE

DESCRIPTION = "session.yaml"
RIG = "rig.yaml"
DESCRIPTION_NAMES = ("session.yaml", "session.yml")
"""Names that people give it, in any case."""
CAMERA = re.compile("/dev/(video|media)[0-9]+")
EXAMPLE = "--board 9x6 --square-mm 25"
"""The options of a command that describes a board, as messages quote them."""


COMMAND = "The command line"
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
    existing = _named(paths)
    for path in existing:
        _check_exists(path)
        _check_no_calibration(path)
    if len(existing) == 1 and existing[0].is_dir():
        return _in_folder(existing[0], words)
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
        distinct |= dict.fromkeys(session_pictures(path) if path.is_dir() else [_picture(path)])
    pictures = list(distinct)
    folders = {path.parent for path in pictures}
    common = Path(os.path.commonpath([str(folder) for folder in folders] or ["."]))
    if len(folders) == 1 and set(pictures) == set(list_images(common)):
        return _in_folder(common, words)
    unread = tuple(unread_matches(paths))
    return NamedPictures(common / "session", tuple(pictures), words=words, unread=unread)


def _named(paths: Sequence[Path]) -> list[Path]:
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


def _picture(path: Path) -> Path:
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


def _in_folder(folder: Path, words: str) -> NamedPictures:
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
        raise InputError(
            f"{folder} has no session.yaml and no pictures{exception}: {_find_advice(folder)}"
        )
    return NamedPictures(folder, pictures, words=words)


def _check_description_name(folder: Path) -> None:
    """Raise InputError for a session.yaml of another spelling, which nothing would read."""
    for path in folder.iterdir():
        if path.name.lower() in DESCRIPTION_NAMES:
            raise InputError(f"{path} is not read under that name: rename it to {DESCRIPTION}.")


def _find_advice(folder: Path) -> str:
    """Return what to do about a folder without pictures: name its folders that have some, or
    convert files of another type.
    """
    levels = (
        [path for path in sorted(folder.glob(level)) if _holds_pictures(path, folder)]
        for level in LEVELS
    )
    inner = next(filter(None, levels), [])
    if inner and not (folder / RIG).is_file():
        return _inner_advice(folder, inner)
    if (folder / RIG).is_file():
        return f"it is a rig, which `calib rig fit {shell_path(folder)}` calibrates."
    if advice := conversion_of_unread(folder):
        return f"{advice}."
    return f"record some by `capture {shell_path(folder)}`, or put {TYPES} files there."


def _inner_advice(folder: Path, inner: Sequence[Path]) -> str:
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
    pictures, name = _pictures_of(source.pictures, camera)
    if camera is None:
        return source
    words = f"{source.words} --camera {shlex.quote(camera)}"
    if camera == ALL:
        return replace(source, words=words)
    folder = source.session if source.in_place else source.session.parent
    return replace(source, session=folder / name, pictures=pictures, words=words)


def _pictures_of(pictures: Sequence[Path], camera: str | None) -> tuple[tuple[Path, ...], str]:
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


def check_replaceable(source: NamedPictures) -> None:
    """Raise InputError if a session.yaml, or a folder for the pictures, is there that calib did not
    write.
    """
    _output(source).check([DESCRIPTION])
    if not source.in_place:
        _check_new(source)


@dataclass(frozen=True, slots=True)
class Description:
    """What session.yaml says of pictures, besides their size."""

    board: Board | None
    """None: the target is in `further`."""
    cover: Mapping[str, object]
    camera: Mapping[str, object]
    """Without `intrinsics`, they come from bare/ if it is there. Else a camera behind a cover gets
    those that say that its lens is not known.
    """
    further: Mapping[str, object]
    """The keys outside of the sections."""


def describe_pictures(
    source: NamedPictures, description: Description, progress: Progress
) -> tuple[str, ...]:
    """Write the session.yaml, and copies of pictures that lie elsewhere and have the size of most;
    return sentences on those that are not copied.

    A file that Refracal wrote there before, and nobody changed, is replaced. Pictures of other
    sizes that lie in the session already stay there, and a fit rejects them by name.
    """
    check_replaceable(source)
    notices: tuple[str, ...] = ()
    board, cover, camera = description.board, description.cover, dict(description.camera)
    if source.video:
        assert board, "a target of points has no video"
        draft = from_video(source.video, board, progress=progress)
        camera |= {"width": draft.camera.width, "height": draft.camera.height}
        frames = draft.frames
    elif source.pictures:
        folder = source.session if source.in_place else source.session.parent
        uniform = uniform_pictures(folder, source.pictures)
        camera |= dict(zip(("width", "height"), uniform.size, strict=True))
        frames = _contents(uniform.paths)
        notices = () if source.in_place else uniform.stray_notices
        notices = (*notices_of_unread(source.unread), *notices)
    remarks = [f"Written by calib fit, from {source.words}."]
    has_bare = (source.session / "bare").is_dir()
    if "intrinsics" not in camera and cover["shape"] != NONE.name and not has_bare:
        camera["intrinsics"] = UNKNOWN
        remarks.append(
            "Nobody gave the lens, so its intrinsics are unknown and the fit estimates them."
        )
    target = {"board": board_to_yaml(board)} if board else {}
    further = description.further
    text = commented_session(target.get("board", {}), camera, cover, remarks, further)
    targets = {key: value for key, value in further.items() if key == TARGET_KEY}
    session_from_mapping({**target, **targets, "camera": camera, "cover": cover}, COMMAND)
    if not source.in_place:
        names = _copy(source.session, frames)
        if source.video and names:
            notices = describe_end(source.video, int(Path(names[-1]).stem))
    _output(source).write(DESCRIPTION, text)
    return notices


def _output(source: NamedPictures) -> OutputFolder:
    return OutputFolder(source.session, flag="", elsewhere=_correction(source))


def _contents(pictures: Sequence[Path]) -> Iterator[tuple[str, bytes]]:
    """Yield names and contents. Pictures of several folders get the path of theirs in front, from
    the folder that holds them all.
    """
    parents = {path.absolute().parent for path in pictures}
    common = Path(os.path.commonpath(parents)) if len(parents) > 1 else None
    for path, (name, data) in zip(pictures, PictureContents.of(pictures), strict=True):
        folders = path.absolute().parent.relative_to(common).parts if common else ()
        yield "-".join((*folders, name)), data


def _correction(source: NamedPictures) -> str:
    """Return what to do about a session.yaml that is not ours to replace."""
    session = shell_path(source.session)
    return f"write there what the options say, or leave the options out: `calib fit {session}`"


def _check_new(source: NamedPictures) -> None:
    """Raise InputError if the folder for the pictures holds anything that calib did not make."""
    folder = source.session
    with reading(folder):
        foreign = folder.exists() and (
            not folder.is_dir() or (any(folder.iterdir()) and not _is_made_by_calib(folder))
        )
    if foreign:
        kind = "video" if source.video else "images"
        raise InputError(
            f"{folder} is there already, and the pictures would go there: rename it, or make a"
            f" session elsewhere by `calib import {kind} {source.words} {EXAMPLE} -o NEW`."
        )


def _is_made_by_calib(folder: Path) -> bool:
    return (folder / "frames" / LEDGER).exists()


def _copy(session: Path, frames: Iterable[tuple[str, bytes]]) -> list[str]:
    """Write the pictures into frames/, remove those that an earlier call wrote there, and return
    their names.
    """
    folder = session / "frames"
    make_folder(folder)
    output = OutputFolder(folder, flag="", elsewhere="move it elsewhere")
    stale = set(output.owned())
    foreign = [path for path in list_images(folder) if path.name not in stale]
    if foreign:
        raise InputError(
            f"{foreign[0]} is not a copy that calib fit made: move it elsewhere, or calibrate the"
            f" session as it is by `calib fit {shell_path(session)}`."
        )
    names: list[str] = []
    for name, data in frames:
        output.write(name, data)
        names.append(name)
    for name in stale.difference(names):
        (folder / name).unlink()
    return names
