"""Write the session.yaml of pictures that options describe.

Pictures stay where they are if a whole folder was named: the folder becomes the session. Of a
video, or of some pictures of a folder, a session folder is made that holds copies.
"""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.errors import InputError
from calib.importing.from_pictures import PictureContents, notices_of_unread, uniform_pictures
from calib.importing.from_video import describe_end, from_video
from calib.importing.named_pictures import DESCRIPTION, EXAMPLE, NamedPictures
from calib.io.files import make_folder, reading
from calib.io.images import list_images
from calib.io.output_folder import LEDGER, OutputFolder
from calib.io.shell import shell_path
from calib.progress import Progress
from calib.session.board import Board
from calib.session.board_section import board_to_yaml
from calib.session.commented import commented_session
from calib.session.schema import UNKNOWN
from calib.session.session import TARGET_KEY, session_from_mapping
from calib.session.shapes.none import NONE

COMMAND = "The command line"
"""The place of a wrong value in messages."""


def check_replaceable(source: NamedPictures) -> None:
    """Raise InputError if a session.yaml, or a folder for the pictures, is there that calib did not
    write.
    """
    _session_folder(source).check([DESCRIPTION])
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
        frames = _names_and_contents(uniform.paths)
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
        names = _copy_pictures(source.session, frames)
        if source.video and names:
            notices = describe_end(source.video, int(Path(names[-1]).stem))
    _session_folder(source).write(DESCRIPTION, text)
    return notices


def _session_folder(source: NamedPictures) -> OutputFolder:
    """Return the folder of the session, in which only files of calib are replaced."""
    return OutputFolder(source.session, flag="", elsewhere=_correction(source))


def _names_and_contents(pictures: Sequence[Path]) -> Iterator[tuple[str, bytes]]:
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
    """Return True if calib copied pictures into a session folder."""
    return (folder / "frames" / LEDGER).exists()


def _copy_pictures(session: Path, frames: Iterable[tuple[str, bytes]]) -> list[str]:
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
