"""Find the exported files of an earlier fit: beside new files they look as if they belonged to the
same calibration.
"""

import re
from collections.abc import Sequence
from pathlib import Path


def find_outdated_files(written: Sequence[Path], calibration: Path) -> list[Path]:
    """Return files older than the calibration (its file) whose names differ from those of the
    written files only in their numbers.
    """
    calibration_time = calibration.stat().st_mtime_ns
    forms = {_name_without_numbers(path) for path in written}
    folders = dict.fromkeys(path.parent for path in written)
    neighbours = (
        path
        for folder in folders
        for path in sorted(folder.iterdir())
        if path not in written and _name_without_numbers(path) in forms
    )
    return [
        path for path in neighbours if path.is_file() and path.stat().st_mtime_ns < calibration_time
    ]


def _name_without_numbers(path: Path) -> str:
    return re.sub(r"[\d.]+", "", path.name.removesuffix(path.suffix)) + path.suffix
