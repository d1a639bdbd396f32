"""A folder that a person wants to record into, and that a calibration was written to."""

from pathlib import Path

from calib.errors import InputError
from calib.io.files import reading
from calib.io.result_names import has_only_results
from calib.io.shell import from_here, shell_path


def refuse_result_folder(folder: Path) -> None:
    """Raise InputError if a folder that is to be a session is that of a finished calibration."""
    session = folder.absolute().parent
    with reading(folder):
        if not has_only_results(folder):
            return
        is_described = (session / "session.yaml").is_file()
    place = (
        f"go on with its session: capture {shell_path(from_here(session))}"
        if is_described
        else "name a new folder for the pictures: capture NEW"
    )
    raise InputError(f"{folder} holds a finished calibration, not pictures: {place}")
