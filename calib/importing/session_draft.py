"""A session that is made from another program's files, and its folder.

No existing file is ever overwritten.
"""

import secrets
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import yaml

from calib.corners.corners_file import write_corners
from calib.corners.view import View
from calib.errors import InputError, harmless
from calib.io.files import make_folder, write_atomically
from calib.io.frames_table import NAME, columns, to_csv
from calib.io.output_folder import OutputFolder
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.cover import Cover
from calib.session.session import check_images, read_session, session_from_mapping, session_to_yaml

COVER = """\
# Imported by calib import from {source}.
# The source has no cover. Describe yours by options, such as calib fit SESSION --cover dome
# --radius 40, or below in place of "shape: none". State camera.intrinsics, or put pictures of the
# same camera without its cover into bare/. As it is, the session is a plain camera calibration.
"""


@dataclass(frozen=True, slots=True)
class SessionDraft:
    """The corners or the pictures that an importer read."""

    source: Path
    """The file or folder that the user named."""
    board: Board
    camera: Camera
    views: tuple[View, ...] = ()
    frames: Iterable[tuple[str, bytes]] = ()
    """File names and contents. They are read one by one while they are written."""
    times: Callable[[], Mapping[str, float]] | None = None
    """Returns the time in s of each frame by its file name, once all frames were read. None: the
    source has no times.
    """
    remarks: tuple[str, ...] = ()
    """Comment lines for session.yaml: what the source knows and a session does not state."""
    notices: tuple[str, ...] = ()
    """Sentences to print: what is left out, and what is odd about the source."""
    late_notices: Callable[[], Sequence[str]] = tuple
    """Returns more such sentences, once all frames were read."""


def check_new(folder: Path) -> None:
    """Raise InputError if the folder holds anything."""
    try:
        occupied = folder.is_symlink() or (
            folder.exists() and (not folder.is_dir() or any(folder.iterdir()))
        )
    except OSError as error:
        raise InputError(
            f"{folder} cannot be read ({error.strerror}): give another folder with -o."
        ) from error
    if occupied:
        raise InputError(
            f"{folder} is there already, and no session is overwritten: give the name of a new"
            " folder with -o."
        )


def write_session(draft: SessionDraft, folder: Path) -> int:
    """Write the complete session folder or nothing, and return the number of its pictures, or of
    its views if it has corners.

    Raises:
        InputError: the folder is occupied, or the import gives no valid session; the message names
            the source.
    """
    check_new(folder)
    setup = session_to_yaml(draft.board, draft.camera, Cover("none", {}))
    session_from_mapping(setup, str(draft.source))
    with new_folder(folder) as unfinished:
        return _fill(draft, unfinished, setup)


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """A context with a folder beside the new one, which takes its place at the end; after an error,
    nothing is left of it.

    Raises:
        InputError: the new folder is occupied, or cannot be written.
    """
    check_new(folder)
    make_folder(folder.absolute().parent)
    unfinished = folder.absolute().with_name(f".refracal-{secrets.token_hex(8)}.tmp")
    make_folder(unfinished)
    try:
        yield unfinished
        check_new(folder)
        unfinished.rename(folder)
    except OSError as error:
        raise InputError(
            f"{folder} cannot be written ({error.strerror}): choose another folder with -o."
        ) from error
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


def _fill(draft: SessionDraft, folder: Path, setup: dict[str, object]) -> int:
    """Write the session's files, check them, and return the count."""
    content = {"format": 1, **setup} | ({"corners": "corners.vnl"} if draft.views else {})
    head = COVER.format(source=harmless(draft.source.name))
    head += "".join(f"# {harmless(line)}\n" for line in draft.remarks)
    text = head + yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=120)
    OutputFolder(folder).write("session.yaml", text)
    if draft.views:
        write_corners(folder / "corners.vnl", draft.views)
        read_session(folder)
        return len(draft.views)
    frames = folder / "frames"
    make_folder(frames)
    for name, data in draft.frames:
        write_atomically(frames / name, data)
    if draft.times:
        rows = [{"file": name, "time_s": f"{time:.6f}"} for name, time in draft.times().items()]
        write_atomically(folder / NAME, to_csv(rows, columns(rows)))
    try:
        session = read_session(folder)
        check_images(session)
    except InputError as error:
        raise InputError(str(error).replace(str(frames), str(draft.source))) from error
    return len(session.frames)
