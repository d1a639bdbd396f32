"""What an earlier fit was exported to: such files beside new ones look as if they belonged to the
same calibration.
"""

import re
from collections.abc import Sequence
from pathlib import Path


def earlier(written: Sequence[Path], calibration: Path) -> list[Path]:
    """Files named as those that were written, but for their numbers, which are older than the
    calibration (its file).
    """
    made = calibration.stat().st_mtime_ns
    forms = {_form(path) for path in written}
    folders = dict.fromkeys(path.parent for path in written)
    beside = (
        path
        for folder in folders
        for path in sorted(folder.iterdir())
        if path not in written and _form(path) in forms
    )
    return [path for path in beside if path.is_file() and path.stat().st_mtime_ns < made]


def _form(path: Path) -> str:
    return re.sub(r"[\d.]+", "", path.name.removesuffix(path.suffix)) + path.suffix
