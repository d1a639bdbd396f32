"""Import a rig from another program's calibration: Kalibr's camchain, mrcal's .cameramodels of one
solve, or the stereo files of OpenCV's sample.

The pictures come from folders that the user names, or they are what the program itself used: the
pictures in cam0/, cam1/ beside a camchain, or the corners in mrcal's optimization inputs.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePath

from calib.errors import InputError
from calib.importing.from_kalibr import from_kalibr
from calib.importing.from_mrcal import from_cameramodel
from calib.importing.from_pictures import PictureContents, from_pictures
from calib.importing.session_draft import SessionDraft
from calib.io.camera_names import without_camera
from calib.io.yaml_reader import is_opencv
from calib.rig.foreign_cameras import kalibr_cameras, mrcal_cameras, opencv_cameras
from calib.rig.imported_rig import ImportedCamera, ImportedRig
from calib.session.board import Board

SAME_MOMENT_MS = 5.0
"""Kalibr itself takes pictures of synchronised cameras together up to 20 ms, and their stamps
differ by far less.
"""
STAMP = re.compile(r"[0-9]{16,19}")
"""The name of a picture that kalibr_bagextractor wrote: its time in ns."""


def import_rig(
    files: Sequence[Path], board: Board | None, pictures: Sequence[Path] = ()
) -> ImportedRig:
    """Import a rig.

    Args:
        files: a camchain.yaml, the .cameramodel of each camera, or OpenCV's stereo files.
        board: the board on the pictures; not needed if the program's own files describe it.
        pictures: the folder with the pictures of each camera, in the order of the cameras.

    Raises:
        InputError: a file is of none of these kinds, or damaged, or something is missing.
    """
    first = files[0]
    if first.suffix == ".cameramodel":
        models = mrcal_cameras(files)
        return _with_sessions(first, models, board, pictures, _mrcal_sessions(files, models))
    if is_opencv(first):
        return _with_sessions(first, opencv_cameras(files), board, pictures, None)
    if len(files) > 1:
        raise InputError(f"{first} is one of {len(files)} files: give one camchain.yaml alone.")
    cameras = kalibr_cameras(first)
    own = _kalibr_sessions(first, cameras, board)
    return _with_sessions(first, cameras, board, pictures, own)


Sessions = Callable[[], dict[str, SessionDraft]]
"""A function that returns the sessions of what the program itself used, by the cameras' names."""


def _with_sessions(
    source: Path,
    cameras: tuple[ImportedCamera, ...],
    board: Board | None,
    pictures: Sequence[Path],
    own: Sessions | None,
) -> ImportedRig:
    if len(cameras) < 2:
        raise InputError(f"{source} has one camera: import it with calib import kalibr or mrcal.")
    for camera in cameras:
        camera.check_distance(source)
    if pictures:
        sessions = _picture_sessions(source, cameras, board, pictures)
    elif own:
        sessions = own()
    else:
        raise InputError(
            f"{source} names no pictures: add --pictures with the folder of each camera, --board"
            " and --square-mm."
        )
    completed = {}
    for camera in cameras:
        session = sessions[camera.name]
        size = session.camera.width, session.camera.height
        completed[camera.name] = replace(session, camera=camera.camera(size, source))
    tolerance = SAME_MOMENT_MS if all(session.times for session in sessions.values()) else None
    return ImportedRig(source, cameras, completed, tolerance)


def _picture_sessions(
    source: Path,
    cameras: tuple[ImportedCamera, ...],
    board: Board | None,
    folders: Sequence[Path],
) -> dict[str, SessionDraft]:
    """Return the sessions of pictures, under names that the pictures of one moment share."""
    if len(folders) != len(cameras):
        names = ", ".join(camera.name for camera in cameras)
        raise InputError(
            f"{source} has the cameras {names}: give --pictures {len(cameras)} folders, in this"
            " order."
        )
    if board is None:
        raise InputError("--pictures needs the board: add --board and --square-mm.")
    drafts = {
        camera.name: from_pictures(folder, board)
        for camera, folder in zip(cameras, folders, strict=True)
    }
    return _with_common_names(drafts)


def _with_common_names(drafts: Mapping[str, SessionDraft]) -> dict[str, SessionDraft]:
    """Return the sessions with their pictures under the names of `_common_names`."""
    contents = {name: _contents(draft) for name, draft in drafts.items()}
    common = _common_names({name: pictures.names for name, pictures in contents.items()})
    return {
        name: replace(draft, frames=replace(contents[name], names=tuple(common[name])))
        for name, draft in drafts.items()
    }


def _contents(draft: SessionDraft) -> PictureContents:
    assert isinstance(draft.frames, PictureContents)
    return draft.frames


def _common_names(names: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    """Return for each camera the names of its pictures, without the part that names the camera if
    they are the same only without it.

    Raises:
        InputError: the cameras have hardly a name in common.
    """
    for change in (str, without_camera):
        changed = {camera: [change(name) for name in of] for camera, of in names.items()}
        stems = [{PurePath(name).stem for name in of} for of in changed.values()]
        if len(set.intersection(*stems)) >= 0.5 * min(map(len, stems)):
            return changed
    raise InputError(
        "the pictures of the cameras have different names: call those of one moment the same, such"
        " as 00.png in each folder."
    )


def _kalibr_sessions(
    file: Path, cameras: tuple[ImportedCamera, ...], board: Board | None
) -> Sessions:
    def sessions() -> dict[str, SessionDraft]:
        drafts = {camera.name: from_kalibr(file.parent, board, camera.name) for camera in cameras}
        names = {name: _contents(draft).names for name, draft in drafts.items()}
        if all(STAMP.fullmatch(PurePath(name).stem) for files in names.values() for name in files):
            return {
                name: replace(draft, times=partial(_times, names[name]))
                for name, draft in drafts.items()
            }
        return _with_common_names(drafts)

    return sessions


def _times(names: Sequence[str]) -> dict[str, float]:
    """Return the time in s of each picture whose name is a stamp in ns."""
    return {name: int(PurePath(name).stem) / 1e9 for name in names}


def _mrcal_sessions(files: Sequence[Path], cameras: tuple[ImportedCamera, ...]) -> Sessions:
    def sessions() -> dict[str, SessionDraft]:
        return {
            camera.name: from_cameramodel(file, names_of_frames=True)
            for camera, file in zip(cameras, files, strict=True)
        }

    return sessions
