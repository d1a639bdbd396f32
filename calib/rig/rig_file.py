"""rig.yaml: which cameras make a rig, and which of their pictures belong together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path

from calib.errors import InputError, wrong_type
from calib.io.files import reading
from calib.io.result_names import RIG_CALIBRATION_FILE
from calib.io.shell import shell_path
from calib.io.yaml_reader import read_yaml
from calib.session.board import Board
from calib.session.point_target import in_space
from calib.session.schema import Number, Quantity, Section
from calib.session.session import Session, read_session

NAME = "rig.yaml"
FORMAT = 1
BY_NAME = "by_name"
MAX_TOLERANCE_MS = 1e4
"""The largest tolerance between pictures that belong together; more is no rig of cameras."""
MAX_CAMERAS = 64
BASELINE = Quantity("baseline_mm", low=0.1, high=1e5)
MINIMAL = "{format: 1, cameras: {left: left, right: right}, reference: left, together: by_name}"


@dataclass(frozen=True, slots=True)
class RigDescription:
    """The contents of a rig.yaml, with the sessions of its cameras."""

    file: Path
    sessions: Mapping[str, Session]
    """The session of each camera, in the order of the file."""
    reference: str
    """The camera whose frame is that of the rig."""
    tolerance_s: float | None
    """Pictures belong together whose times differ by no more than this; None: those of the same
    name.
    """
    covers: Mapping[str, str] = field(default_factory=dict)
    """The first camera behind the same cover, by the name of each further camera behind it."""
    baseline: Number | None = None
    """m: the measured distance between the two cameras of a pair."""

    @property
    def files(self) -> tuple[Path, ...]:
        """Every file that a fit reads: no result may take the place of one."""
        return (self.file, *(f for session in self.sessions.values() for f in session.files))


RigSource = RigDescription | str | Path
"""A description of a rig, or the path of its rig.yaml or folder."""


def read_rig(path: RigSource) -> RigDescription:
    """Read and check a rig.yaml, or the one in a folder, and the sessions that it names.

    Raises:
        WrongTypeError: the argument is of another type.
        InputError: a file is missing or wrong; it says where, and what to write instead.
    """
    if isinstance(path, RigDescription):
        return path
    if not isinstance(path, str | PathLike):
        raise wrong_type("rig", path, "the path of a rig.yaml, or of its folder")
    file = Path(path)
    with reading(file):
        file = file / NAME if file.is_dir() else file
        _check_kind(file)
        if not file.exists():
            raise InputError(f"{file} does not exist: write a {NAME}, at the least {MINIMAL}")
    section = Section(read_yaml(file), str(file))
    section.choice("format", (FORMAT,), f"{FORMAT}, the format that this version of calib reads")
    section.allow_only(
        ("format", "cameras", "reference", "together", "shared_cover", "baseline_mm")
    )
    sessions = _read_sessions(section, file.parent)
    names = tuple(sessions)
    reference = section.choice("reference", names, f"one of the cameras: {', '.join(names)}")
    return RigDescription(
        file=file,
        sessions=sessions,
        reference=reference,
        tolerance_s=_read_tolerance(section),
        covers=_read_covers(section, sessions),
        baseline=_read_baseline(section, names),
    )


def _check_kind(file: Path) -> None:
    """Raise InputError where a session of one camera, or a calibrated rig, stands in place of a
    rig.yaml.
    """
    folder = file.parent
    if file.name == "session.yaml" or (not file.exists() and (folder / "session.yaml").exists()):
        around = folder.parent / NAME
        rig = f", or give its rig, {shell_path(around)}" if around.exists() else ""
        raise InputError(
            f"{folder} is a session of one camera, and no rig: `calib fit {shell_path(folder)}`"
            f" calibrates the camera{rig or f'. A rig has a {NAME}, at the least {MINIMAL}'}."
        )
    result = folder / RIG_CALIBRATION_FILE
    if file.name == result.name or (not file.exists() and result.exists()):
        raise InputError(f"{folder} is a calibrated rig: give a {NAME}, or the folder of one.")


def _read_sessions(section: Section, folder: Path) -> dict[str, Session]:
    cameras = section.section("cameras", "{left: left, right: right}")
    if not 1 <= len(cameras.values) <= MAX_CAMERAS:
        raise section.error(
            "cameras", cameras.values, f"one to {MAX_CAMERAS} cameras, such as left: left"
        )
    sessions: dict[str, Session] = {}
    for name in cameras.values:
        if not name.isidentifier():
            raise InputError(
                f"{section.file}: cameras has the name {name!r}: write letters, digits and"
                " underscores, such as left or cam0."
            )
        place = cameras.text(name, f"the folder of {name}'s session, from {section.file} on")
        sessions[name] = read_session(folder / place)
        for namesake, session in sessions.items():
            if namesake != name and session.path.resolve() == sessions[name].path.resolve():
                raise InputError(
                    f"{section.file}: cameras names the session {place} twice, for {namesake} and"
                    f" for {name}: each camera has a session of its own, so name that of {name}."
                )
    if not all(session.board.is_flat for session in sessions.values()):
        # a camera may see a flat part of a target that is not flat
        sessions = {name: replace(s, board=in_space(s.board)) for name, s in sessions.items()}
    boards = {session.board for session in sessions.values()}
    if len(boards) > 1:
        first, *others = sessions
        other = next(name for name in others if sessions[name].board != sessions[first].board)
        raise InputError(
            f"{section.file}: {first} has a {_words(sessions[first].board)}, and {other} a"
            f" {_words(sessions[other].board)}: a rig has one board, so write the same in both"
            " session.yaml files."
        )
    return sessions


def _words(board: Board) -> str:
    return f"{board} board with a {board.cell} of {1000 * board.square:g} mm"


def _read_tolerance(section: Section) -> float | None:
    """Return the tolerance in s, or None for pictures of the same name."""
    expected = f"{BY_NAME}, or {{tolerance_ms: 5}} for pictures by their times in frames.csv"
    together = section.get("together", expected)
    if together == BY_NAME:
        return None
    if not isinstance(together, Mapping):
        raise section.error("together", together, expected)
    inner = Section(together, section.file, section.key_path("together"))
    inner.allow_only(("tolerance_ms",))
    quantity = Quantity("tolerance_ms", low=0.0, high=MAX_TOLERANCE_MS)
    return inner.read(quantity)["tolerance_ms"].value / 1000


def _read_covers(section: Section, sessions: Mapping[str, Session]) -> dict[str, str]:
    """Return the first camera of each shared cover by the names of the further ones."""
    expected = "lists of cameras behind one cover, such as [[left, right]]"
    groups = section.values.get("shared_cover", [])
    if not isinstance(groups, list) or not all(isinstance(group, list) for group in groups):
        raise section.error("shared_cover", groups, expected)
    covers: dict[str, str] = {}
    listed: set[str] = set()
    for group in groups:
        for name in group:
            if name not in sessions or name in listed:
                problem = "twice" if name in listed else "which is no camera"
                raise InputError(
                    f"{section.file}: shared_cover names {name}, {problem}: write {expected}."
                )
            listed.add(name)
        first, *others = group or [""]
        if not others:
            raise section.error("shared_cover", groups, expected)
        if sessions[first].cover.shape == "none":
            raise InputError(
                f"{section.file}: shared_cover names {first}, whose session has no cover: describe"
                f" the shared cover in the session of {first}."
            )
        covers |= dict.fromkeys(others, first)
    return covers


def _read_baseline(section: Section, names: tuple[str, ...]) -> Number | None:
    if "baseline_mm" not in section.values:
        return None
    if len(names) != 2:
        raise InputError(
            f"{section.file}: baseline_mm is the distance between two cameras, and there are"
            f" {len(names)}: drop the key."
        )
    number = section.read(BASELINE)["baseline"]
    if not number.sigma:
        raise section.error(
            "baseline_mm",
            section.values["baseline_mm"],
            "the distance with its standard deviation, such as {value: 60.0, sigma: 0.5}",
        )
    return number
