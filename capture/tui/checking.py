"""The check of a calibration in the screen's child process: the process that draws never loads
torch.
"""

from pathlib import Path

from calib.progress import Progress
from capture.tui.child import LOADING


def check_calibration(
    progress: Progress, place: Path, pictures: Path, updated: Path | None = None
) -> dict[str, object]:
    """Check a calibration as `calib check` does. With `updated`, write the updated calibration
    there, as its --update does.

    Returns the answer's word and sentence, a text with its evidence, whether these pictures can
    update the calibration, whether the calibration was made from them, and the written file, if
    any.
    """
    progress.task(LOADING, 1)
    from calib.calibration import DERIVED, Calibration
    from calib.checking.check import Checker
    from calib.checking.pictures import read_pictures
    from calib.checking.update import Moved, carries, update
    from calib.commands.check_lines import answer_lines
    from calib.io.file_set import FileSet

    calibration = Calibration.load(place)
    check_views = read_pictures([pictures], calibration, progress)
    checker = Checker.of(calibration)
    answer = checker.check(check_views, progress)
    moved: tuple[Moved, ...] = ()
    written = ""
    if updated:
        updated_calibration, moved = update(calibration, checker.known, answer, check_views)
        with FileSet(updated) as files:
            written = str(updated_calibration.write(files))
            files.commit(instead_of=DERIVED)
    text = "\n\n".join(answer_lines(answer, moved))
    return {
        "word": answer.word.value,
        "sentence": answer.word.sentence,
        "text": text,
        "usable": bool(check_views.views) and carries(answer),
        "known": bool(answer.views) and answer.known == answer.views,
        "written": written,
    }
