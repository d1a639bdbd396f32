"""A folder that a person wants to record into, and that a calibration was written to."""

from pathlib import Path

from calib.errors import InputError
from calib.io.files import reading
from calib.io.images import session_pictures
from calib.io.result_names import (
    CALIBRATION_ARRAYS,
    CALIBRATION_FILE,
    RIG_CALIBRATION_ARRAYS,
    RIG_CALIBRATION_FILE,
)
from calib.io.shell import from_here, shell_path

RESULTS = (
    (CALIBRATION_FILE, CALIBRATION_ARRAYS),
    (RIG_CALIBRATION_FILE, RIG_CALIBRATION_ARRAYS),
)


def refuse_result_folder(folder: Path) -> None:
    """Raise InputError if a folder that is to be a session is that of a finished calibration."""
    session = folder.absolute().parent
    with reading(folder):
        if not _has_only_results(folder):
            return
        is_described = (session / "session.yaml").is_file()
    place = (
        f"go on with its session: `capture {shell_path(from_here(session))}`."
        if is_described
        else "name a new folder for the pictures: `capture NEW`."
    )
    raise InputError(f"{folder} holds a finished calibration, not pictures: {place}")


def _has_only_results(folder: Path) -> bool:
    """True if a folder has the files of a calibration, and neither pictures nor the description of
    a session or a rig: a session may have a calibration beside its pictures. OSError if the folder
    cannot be read.
    """
    has_results = any(all((folder / name).is_file() for name in names) for names in RESULTS)
    is_described = any((folder / name).is_file() for name in ("session.yaml", "rig.yaml"))
    return has_results and not is_described and not session_pictures(folder)
