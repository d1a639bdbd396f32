"""The check of a calibration in the screen's child process: the process that draws never loads
torch.
"""

from pathlib import Path

from calib.progress import Progress
from capture.tui.child import LOADING, MOVE_IT


def check_calibration(
    progress: Progress, place: Path, pictures: Path, updated: Path | None = None
) -> dict[str, object]:
    """Check a calibration as `calib check` does. With `updated`, write the updated calibration
    there, as its --update does.

    Returns the word and the sentence of the status, a text with the evidence, whether these
    pictures can update the calibration, whether it was fitted to them, and the written file, if
    any.
    """
    progress.task(LOADING, 1)
    from calib.calibration import Calibration
    from calib.calibration_file import DERIVED
    from calib.checking.check import Checker
    from calib.checking.pictures import read_pictures
    from calib.checking.update import NumberUpdate, is_updatable, update
    from calib.commands.check_lines import result_lines
    from calib.io.file_set import FileSet
    from calib.io.output_folder import check_no_link

    calibration = Calibration.load(place)
    check_views = read_pictures([pictures], calibration, progress)
    checker = Checker.of(calibration)
    result = checker.check(check_views, progress)
    numbers: tuple[NumberUpdate, ...] = ()
    written = ""
    if updated:
        updated_calibration, numbers = update(calibration, checker.prior, result, check_views)
        with FileSet(check_no_link(updated), elsewhere=MOVE_IT, flag="") as files:
            written = str(updated_calibration.write(files))
            files.commit(instead_of=DERIVED)
    text = "\n\n".join(result_lines(result, numbers))
    return {
        "word": result.status.value,
        "sentence": result.sentence,
        "text": text,
        "usable": bool(check_views.views) and is_updatable(result),
        "known": result.is_known,
        "written": written,
    }
