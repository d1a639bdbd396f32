"""The session.yaml of a recording: read and compared with the request, or written."""

from dataclasses import replace
from pathlib import Path

import yaml

from calib.errors import InputError
from calib.io.files import reading
from calib.io.images import frames_folder
from calib.io.output_folder import Content, OutputFolder
from calib.io.yaml_reader import read_yaml
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.coding import AprilGrid, Charuco, Coding
from calib.session.cover import Cover
from calib.session.schema import Section
from calib.session.session import FORMAT, PRIOR_KEY, session_from_mapping, session_to_yaml
from calib.session.shutter import Shutter
from capture.disk import write_durably, writing

Setup = tuple[Board, Camera, Cover]
BOARD_ADVICE = (
    "describe the board by --board COLSxROWS (its inner corners) and --square-mm MM (the side of a"
    " square), with --type where it has markers."
)
"""Advice on a session without a board; nobody has said which board it will have."""


def read_setup(file: Path) -> Setup:
    """Return board, camera and cover of a session.yaml, whose folder may have no pictures yet.

    Raises:
        InputError: its target is points.
    """
    setup = read_described(file)
    if not setup[0].has_grid:
        raise InputError(
            f"{file} has a target of points: fit it by `calib fit`, go on with its screen by"
            " `capture SESSION --screen --serve`, or record a board into another folder."
        )
    return setup


def read_described(file: Path) -> Setup:
    """Return target, camera and cover of a session.yaml, or of the one in a folder."""
    with reading(file):
        file = file / "session.yaml" if file.is_dir() else file
    written = read_yaml(file)
    Section(written, str(file)).choice(
        "format", (FORMAT,), f"{FORMAT}, the format that this version reads"
    )
    return session_from_mapping(
        {
            key: value
            for key, value in written.items()
            if key not in ("format", "corners", PRIOR_KEY)
        },
        str(file),
    )


def read_calibrated(calibration: Path) -> Setup:
    """Return board, camera and cover of a calibration's file: with the lens that its fit found."""
    document = read_yaml(calibration)
    return session_from_mapping(
        {key: document[key] for key in ("board", "camera", "cover") if key in document},
        str(calibration),
    )


def picture_folder(session: Path, *, bare: bool) -> Path:
    """Return the folder that pictures of a session are recorded into: bare/ or frames/, or the
    session's folder itself where its pictures lie beside session.yaml.
    """
    if bare:
        return session / "bare"
    is_described = (session / "session.yaml").exists()
    return frames_folder(session) if is_described else session / "frames"


def board_of(session: Path, requested: Board | None, like: Setup | None = None) -> Board:
    """Return the board that a session folder describes, or the requested one where it describes
    none yet.

    InputError where the folder describes another board than the requested one, or another cover
    than `like` has.
    """
    file = session / "session.yaml"
    with reading(file):
        described = file.exists()
    if not described:
        if requested is None:
            raise InputError(f"{session} has no session.yaml yet: {BOARD_ADVICE}")
        return requested
    if "corners" in read_yaml(file):
        raise InputError(
            f"{file} names a corners file, so calib would not look at new pictures: drop the key"
            " corners, or record elsewhere."
        )
    board, _, cover = read_setup(file)
    if requested not in (None, board):
        raise InputError(
            f"{file} describes a board of {_describe(board)} where {_describe(requested)} were"
            " asked for: leave --board and what belongs to it out, correct the file, or record"
            " elsewhere."
        )
    if like and like[2] != cover:
        raise InputError(
            f"{file} describes another cover than --cover-from's: leave that out, correct the file,"
            " or record elsewhere."
        )
    return board


def write_setup(
    session: Path, board: Board, size: tuple[int, int], like: Setup | None, shutter: Shutter | None
) -> Cover:
    """Describe a session whose pictures have this size. `like` gives the cover and, if its pictures
    have the same size, the camera. `shutter` counts where that camera states none.
    """
    camera, cover = Camera(*size), Cover("none", {})
    if like:
        cover = like[2]
        if (like[1].width, like[1].height) == size:
            camera = like[1]
    camera = replace(camera, shutter=camera.shutter or shutter)
    described = {"format": FORMAT, **session_to_yaml(board, camera, cover)}
    text = yaml.safe_dump(described, sort_keys=False, allow_unicode=True, width=120)
    write_description(session, text)
    return cover


def write_description(session: Path, text: str) -> None:
    """Write session.yaml. Unless a person has edited it, options of `calib fit` may change it."""
    file = session / "session.yaml"
    folder = OutputFolder(session)
    if not file.exists() or folder.owns(file.name):
        with writing(file):
            folder.add({file.name: Content.of(text)})
    write_durably(file, text)


def _describe(board: Board) -> str:
    match board.coding:
        case None:
            return f"{board} corners and {board.square * 1000:g} mm"
        case Charuco(marker, dictionary, legacy_pattern) as coding:
            pattern = " in the legacy pattern" if legacy_pattern else ""
            pattern += _describe_numbering(coding)
            return (
                f"{board}, {board.square * 1000:g} mm, with markers of {marker * 1000:g} mm of"
                f" {dictionary}{pattern}"
            )
        case AprilGrid(spacing) as coding:
            numbering = _describe_numbering(coding)
            return f"{board}, {board.square * 1000:g} mm, spacing {spacing:g}{numbering}"


def _describe_numbering(coding: Coding) -> str:
    first = f" from {coding.first_marker} on" if coding.first_marker else ""
    return first + (", white on black" if coding.inverted else "")
