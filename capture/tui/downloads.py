"""The files of a calibration that a page offers, so that they reach the device that shows it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.io.images import frames_folder
from calib.io.result_names import CALIBRATION_FILE
from capture.disk import is_regular_file
from capture.picture_pair import STRAIGHT
from capture.tui.farewell import REPORT, files_since, select_newer, updated_folder

OPEN_REPORT = "Open the report"
"""The label of the report's link."""


@dataclass(frozen=True, slots=True)
class Download:
    label: str
    name: str
    """The name under which a browser saves it. It ends in .zip for an archive of the files, and in
    .html for two pictures on a page.
    """
    files: tuple[Path, ...]


def find_downloads(
    session: Path, calibration: Path, exported: Sequence[Path]
) -> Iterator[Download]:
    """Yield what there is now: the report, and the files that were exported last.

    Args:
        calibration: the file of the calibration.
        exported: the files that were exported while this program runs; those of before are found
            in the session's export folder.
    """
    folder = calibration.parent
    pictures = frames_folder(session)
    if is_regular_file(report := folder / REPORT):
        yield Download(OPEN_REPORT, REPORT, (report.resolve(),))
    if renewed := updated_folder(folder):
        folder, session = renewed, renewed
    newer = select_newer(folder / CALIBRATION_FILE, exported)
    maps = newer or files_since(folder / CALIBRATION_FILE, session / "export")
    visible = [file for file in maps if not file.name.startswith(".")]
    if files := tuple(file.resolve() for file in visible if is_regular_file(file)):
        megabytes = sum(file.stat().st_size for file in files) / 1e6
        folders = list(dict.fromkeys(file.parent.name for file in files))
        depths = [name.removeprefix(STRAIGHT) for name in folders if name.startswith(STRAIGHT)]
        is_straight = len(depths) == len(folders)
        words = f"pictures, {', '.join(depths)}" if is_straight else "exports"
        label = f"Download {words} ({megabytes:.1f} MB)"
        yield Download(label, f"{session.resolve().name}-{'-'.join(folders)}.zip", files)
        if pair := _first_pair(files, pictures.resolve()):
            label = f"See before and after, {depths[0]}"
            yield Download(label, f"before-and-after-{depths[0]}.html", pair)


def _first_pair(files: Sequence[Path], pictures: Path) -> tuple[Path, Path] | None:
    """Return the first picture that was straightened, and its straight one; None where the folder
    of pictures has no such picture.
    """
    for straight in files:
        original = pictures / straight.name
        if straight.parent.name.startswith(STRAIGHT) and is_regular_file(original):
            return original, straight
    return None
