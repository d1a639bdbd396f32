"""The check of a calibration as the screen's child does it, for torch is never loaded in the
process that draws.
"""

from pathlib import Path

from calib.progress import Progress
from capture.tui.child import LOADING


def check_calibration(
    progress: Progress, place: Path, pictures: Path, updated: Path | None = None
) -> dict[str, object]:
    """Answer as `calib check` does, and with `updated` write the calibration brought up to date
    there, as its --update does.

    Returns the result's word and sentence, a text of what it rests on, whether these pictures can
    bring the calibration up to date, whether it was made from them, and the file that was written,
    if one was.
    """
    progress.task(LOADING, 1)
    from calib.calibration import DERIVED, Calibration
    from calib.checking.check import Checker
    from calib.checking.pictures import read_pictures
    from calib.checking.update import NumberUpdate, is_updatable, update
    from calib.commands.check_lines import result_lines
    from calib.io.file_set import FileSet

    calibration = Calibration.load(place)
    found = read_pictures([pictures], calibration, progress)
    checker = Checker.of(calibration)
    result = checker.check(found, progress)
    numbers: tuple[NumberUpdate, ...] = ()
    written = ""
    if updated:
        better, numbers = update(calibration, checker.prior, result, found)
        with FileSet(updated) as files:
            written = str(better.write(files))
            files.commit(instead_of=DERIVED)
    text = "\n\n".join(result_lines(result, numbers))
    return {
        "word": result.status.value,
        "sentence": result.status.sentence,
        "text": text,
        "usable": bool(found.views) and is_updatable(result),
        "known": result.statistics is not None and not result.has_new_views,
        "written": written,
    }
