"""The session folder: session.yaml, the pictures or corners beside it, and the same camera without
its cover.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np

from calib.errors import InputError, harmless, wrong_type
from calib.io.images import SUFFIXES, TYPES, image_size, list_images, session_pictures
from calib.io.numerals import counted
from calib.io.shell import shell_path
from calib.io.videos import VIDEOS
from calib.io.yaml_reader import read_yaml
from calib.session.board import Board
from calib.session.board_section import KEYS, board_to_yaml, read_board
from calib.session.camera import (
    EXPLANATIONS,
    Camera,
    Intrinsics,
    camera_to_yaml,
    read_camera,
    unknown_intrinsics,
    without_unknown,
)
from calib.session.cover import Cover
from calib.session.cover_section import cover_sections, cover_to_yaml, read_cover
from calib.session.declared_table import declared_table
from calib.session.fleet_prior import FleetPrior, check_compatible, read_fleet_prior
from calib.session.lens import SPLINED
from calib.session.numbers import check_correlations
from calib.session.point_target import PITCH, PointTarget, PointView, join_places, near_origin
from calib.session.points_file import FOLDER, point_files, read_point_view
from calib.session.schema import Number, Section
from calib.session.shapes.registry import dimensions

__all__ = [
    "MIN_FIT_VIEWS",
    "Board",
    "Camera",
    "Cover",
    "Intrinsics",
    "Number",
    "Session",
    "check_images",
    "read_session",
    "session_from_mapping",
    "session_to_yaml",
]

FORMAT = 1
MIN_FIT_VIEWS = 3
"""Views that a fit needs."""
PRIOR_KEY = "prior"
INNER_KEYS = {
    "board": tuple(key for keys in KEYS.values() for key in keys),
    "camera": tuple(EXPLANATIONS),
    "cover": ("shape", *(entry.quantity.key for entry in dimensions())),
}
"""The keys of each section of session.yaml."""
TARGET_KEY = "target"
POINTS = "points"
"""The type of a target whose points come with each view."""
MINIMAL = (
    "{format: 1, board: {columns: 9, rows: 6, square_mm: 25.0}, camera: {width: 1640, height:"
    " 1232}, cover: {shape: none}}"
)


@dataclass(frozen=True, slots=True, repr=False)
class Session:
    """The contents of a session folder. Its pictures and corners are not read yet."""

    path: Path
    """The folder."""
    board: Board
    camera: Camera
    cover: Cover
    frames: tuple[Path, ...]
    """Pictures through the cover; may be empty if there are corners."""
    corners: Path | None
    """A corners file that is read in place of the frames."""
    bare: "Session | None"
    """The same camera without the cover."""
    prior: FleetPrior | None = None
    """The prior that a fleet of such cameras gives for this one."""
    points: tuple[PointView, ...] = ()
    """The views of a target of points, in place of pictures and corners."""

    @staticmethod
    def of(source: "SessionSource") -> "Session":
        """Return a session as it is, or read it from its folder.

        Raises:
            WrongTypeError: the source is neither.
        """
        if isinstance(source, Session):
            return source
        if isinstance(source, str | PathLike):
            return read_session(source)
        raise wrong_type("session", source, "a session of calib.read_session, or its folder's path")

    def __repr__(self) -> str:
        source = self.corners.name if self.corners else counted(len(self.frames), "picture")
        if self.points:
            source = counted(len(self.points), "view")
        bare = f", {len(self.bare.frames)} without the cover" if self.bare else ""
        camera = f"{self.camera.width}x{self.camera.height} px"
        target = f"{self.board} board" if self.board.has_grid else str(self.board)
        return harmless(
            f"<Session {self.path}: {camera}, {self.cover.words}, {target}, {source}{bare}>"
        )

    def _repr_html_(self) -> str:
        """Return the table of what the session declares, which a notebook shows."""
        return declared_table(self.path.name, self.board, self.camera, self.cover)._repr_html_()

    @property
    def files(self) -> tuple[Path, ...]:
        """Every file that a fit reads: no result may take the place of one."""
        return (
            self.path / "session.yaml",
            self.path / "frames.csv",
            *self.frames,
            *([self.corners] if self.corners else []),
            *self.point_files,
            *([self.prior.file] if self.prior else []),
            *(self.bare.files if self.bare else []),
        )

    @property
    def point_files(self) -> tuple[Path, ...]:
        """The files of the views of a target of points."""
        return tuple(self.path / FOLDER / view.name for view in self.points)


SessionSource = Session | str | Path
"""A session, or the path of its folder."""


def read_session(path: str | Path) -> Session:
    """Read and check a session folder. An InputError says what is wrong, where, and what to write
    instead.
    """
    if not isinstance(path, str | PathLike):
        raise wrong_type("path", path, "the path of the folder that holds session.yaml")
    try:
        return _read_folder(Path(path), bare_of=None)
    except OSError as error:
        raise InputError(
            f"{error.filename or path} cannot be read ({error.strerror}): check its name and"
            " permissions."
        ) from error


def check_images(session: Session) -> None:
    """Read every picture; raise InputError for one that is damaged or has another size than the
    camera.
    """
    camera = session.camera
    for frame in session.frames:
        width, height = image_size(frame)
        if (width, height) != (camera.width, camera.height):
            raise InputError(
                f"{frame} is {width}x{height} px where camera.width and camera.height in"
                f" session.yaml say {camera.width}x{camera.height}: correct them, or remove the"
                " picture."
            )
    if session.bare:
        check_images(session.bare)


def session_from_mapping(mapping: Mapping[str, object], where: str) -> tuple[Board, Camera, Cover]:
    """Read the keys board, camera and cover; `where` names the file in messages."""
    section = Section(mapping, where)
    section.allow_only(("board", "camera", "cover", TARGET_KEY))
    return _read_setup(section)


def session_to_yaml(board: Board, camera: Camera, cover: Cover) -> dict[str, object]:
    """Return the mapping that `session_from_mapping` reads as the same numbers."""
    is_grid = board.has_grid
    target = {"board": board_to_yaml(board)} if is_grid else {TARGET_KEY: _target_to_yaml(board)}
    return {
        **target,
        "camera": camera_to_yaml(camera),
        "cover": cover_to_yaml(cover),
    }


def _read_folder(path: Path, bare_of: Session | None) -> Session:
    """Read and check a folder with a session.yaml.

    Args:
        bare_of: the session whose `bare/` this folder is; None for a session of its own.
    """
    file = _session_file(path)
    section = Section(read_yaml(file), str(file))
    section.choice("format", (FORMAT,), f"{FORMAT}, the format that this version of calib reads")
    section.allow_only(
        (
            "format",
            "board",
            "camera",
            "cover",
            "corners",
            TARGET_KEY,
            *(() if bare_of else (PRIOR_KEY,)),
        ),
        inner=INNER_KEYS,
    )
    board, camera, cover = _read_setup(section)
    camera = without_unknown(camera)
    if not board.has_grid:
        points = _read_target(section, path, camera)
        assert isinstance(board, PointTarget)
        board = PointTarget.of(near_origin(join_places(points)), board.pitch)
        session = Session(path, board, camera, cover, (), None, None, points=points)
        return _with_surroundings(session, section, bare_of)
    corners = _read_corners_path(section, path)
    frames = session_pictures(path)
    if not frames and not corners:
        hint = (
            "write corners: corners.vnl in session.yaml to use that file, or put"
            if (path / "corners.vnl").exists()
            else "put"
        )
        raise InputError(
            f"{path} has no pictures: {hint} {TYPES} files in {path / 'frames'}, or record some by"
            f" capture {shell_path(path)}"
        )
    session = Session(path, board, camera, cover, frames, corners, None)
    return _with_surroundings(session, section, bare_of)


def _session_file(folder: Path) -> Path:
    """Return the session.yaml of a folder; raise InputError if there is none."""
    if not folder.exists():
        raise InputError(
            f"{folder} does not exist: give the folder of a session, or of pictures of the board."
        )
    if not folder.is_dir():
        advice = ""
        if is_media(folder):
            advice = f"; `{fit_pictures_command(folder)}` makes a session of it"
        raise InputError(
            f"{folder} is not a folder: give the folder that holds session.yaml{advice}."
        )
    file = folder / "session.yaml"
    if not file.exists():
        raise InputError(
            f"{folder} has no session.yaml: `{fit_pictures_command(folder)}` writes one for"
            f" pictures, `calib init {shell_path(folder)}` one to fill in, at the least {MINIMAL}"
        )
    return file


def _with_surroundings(session: Session, section: Section, bare_of: Session | None) -> Session:
    """Return the session with its bare pictures, its prior, and unknown intrinsics if nothing gives
    them. A session in `bare/` has none of these; it is checked against the session around it.
    """
    path, camera, cover = session.path, session.camera, session.cover
    file = path / "session.yaml"
    if bare_of:
        _check_bare(session, bare_of, file)
        return session
    session = replace(
        session, bare=_read_bare(session), prior=_read_prior(section, path, camera, cover)
    )
    if camera.intrinsics or session.bare or session.prior or cover.shape == "none":
        return session
    if camera.lens == SPLINED:
        raise InputError(
            f"{file}: camera.lens is {SPLINED}, which pictures through a cover do not determine:"
            f" put pictures taken without the cover in {path / 'bare'}, or drop the key."
        )
    return replace(session, camera=replace(camera, intrinsics=unknown_intrinsics(camera)))


def is_media(path: Path) -> bool:
    """Return True for the file of a picture or of a video."""
    return path.is_file() and path.suffix.lower() in (*SUFFIXES, *VIDEOS)


def fit_pictures_command(path: Path) -> str:
    """Return the command that makes a session of pictures or of a video, and calibrates it."""
    return f"calib fit {shell_path(path)} --board 9x6 --square-mm 25"


def _read_setup(section: Section) -> tuple[Board, Camera, Cover]:
    """Read the keys board or target, camera, and cover."""
    board = _read_board(section)
    camera = read_camera(section.section("camera", "{width: 1640, height: 1232}"))
    covers = cover_sections(section, "{shape: none}")
    cover = read_cover(*covers)
    check_correlations(covers[0], camera.intrinsics, cover)
    return board, camera, cover


def _read_board(section: Section) -> Board:
    """Return the board, or a target of points without its points."""
    if TARGET_KEY not in section.values:
        return read_board(section.section("board", "{columns: 9, rows: 6, square_mm: 25.0}"))
    if "board" in section.values:
        raise InputError(
            f"{section.file}: {TARGET_KEY} stands beside board: drop the one that the pictures do"
            " not show."
        )
    target = section.section(TARGET_KEY, f"{{type: {POINTS}}}")
    target.allow_only(("type", PITCH.key))
    kind = target.get("type", POINTS)
    if kind != POINTS:
        raise target.error("type", kind, f"{POINTS}, or describe a board under board")
    has_pitch = PITCH.key in target.values
    pitch = target.read(PITCH)[PITCH.stem] if has_pitch else None
    return PointTarget.of(np.zeros((0, 2)), pitch)


def _target_to_yaml(board: Board) -> dict[str, object]:
    """Return the section of a target of points."""
    pitch = board.pitch if isinstance(board, PointTarget) else None
    return {"type": POINTS} | ({PITCH.key: PITCH.to_yaml(pitch)} if pitch else {})


def _read_target(section: Section, path: Path, camera: Camera) -> tuple[PointView, ...]:
    """Read the views of a target of points."""
    if "corners" in section.values:
        raise InputError(
            f"{section.file}: corners stands beside {TARGET_KEY}: drop it, as points are read from"
            f" {path / FOLDER}."
        )
    return tuple(read_point_view(file, camera.width, camera.height) for file in point_files(path))


def _read_corners_path(section: Section, folder: Path) -> Path | None:
    """Return the corners file that a session names; None if it names none."""
    if "corners" not in section.values:
        return None
    path = folder / section.text("corners", "the name of a corners file, such as corners.vnl")
    if not path.is_file():
        raise InputError(
            f"{section.file}: corners names {path}, which is not a file: write the name of a"
            " corners file, or drop the key."
        )
    return path


def _read_prior(section: Section, folder: Path, camera: Camera, cover: Cover) -> FleetPrior | None:
    """Return the prior of a fleet that a session names; None if it names none."""
    if PRIOR_KEY not in section.values:
        return None
    path = folder / section.text(
        PRIOR_KEY,
        "the file that calib fleet-prior wrote, from the session's folder on, such as"
        " ../prior.yaml",
    )
    if not path.is_file():
        raise InputError(
            f"{section.file}: {PRIOR_KEY} names {path}, which is not a file: write it by calib"
            " fleet-prior, or drop the key."
        )
    prior = read_fleet_prior(path)
    check_compatible(prior, camera, cover, section.file)
    return prior


def _read_bare(session: Session) -> Session | None:
    """Read the folder bare/, if there is one."""
    folder = session.path / "bare"
    if not folder.is_dir():
        return None
    if (folder / "session.yaml").exists():
        return _read_folder(folder, bare_of=session)
    frames = list_images(folder)
    if not frames:
        raise InputError(
            f"{folder} has neither pictures nor a session.yaml: put pictures taken without the"
            " cover there, or remove it."
        )
    if not session.board.has_grid:
        raise InputError(
            f"{folder} has pictures, and {session.path / 'session.yaml'} has no board that they"
            f" show: describe it in a session.yaml in {folder}."
        )
    camera = replace(session.camera, intrinsics=None)
    return Session(folder, session.board, camera, Cover("none", {}), frames, None, None)


def _check_bare(bare: Session, session: Session, file: Path) -> None:
    """Raise InputError if bare/ describes another camera, or one with a cover."""
    if bare.cover.shape != "none":
        raise InputError(
            f"{file}: cover.shape is {bare.cover.shape}: write none, as bare/ is the camera without"
            " its cover."
        )
    camera = session.camera
    bare_camera = bare.camera
    if (camera.width, camera.height) != (bare_camera.width, bare_camera.height):
        raise InputError(
            f"{file}: camera is {bare_camera.width}x{bare_camera.height} px: write"
            f" {camera.width}x{camera.height}, as in the session around it, or take both with the"
            " same camera mode."
        )
