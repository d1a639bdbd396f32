"""The check of a calibration as the screen's child does it, for torch is never loaded in the
process that draws.
"""

from pathlib import Path

from calib.progress import Progress
from capture.tui.child import LOADING, MOVE_IT


def check_calibration(
    progress: Progress, place: Path, pictures: Path, updated: Path | None = None
) -> dict[str, object]:
    """Answer as `calib check` does, and with `updated` write the calibration brought up to date
    there, as its --update does.

    Returns the answer's word and sentence, a text of what it rests on, whether these pictures can
    bring the calibration up to date, whether it was made from them, and the file that was written,
    if one was.
    """
    progress.task(LOADING, 1)
    from calib.calibration import DERIVED, Calibration
    from calib.checking.check import Checker
    from calib.checking.pictures import read_pictures
    from calib.checking.update import Moved, carries, update
    from calib.commands.check_lines import answer_lines
    from calib.io.file_set import FileSet
    from calib.io.output_folder import check_no_link

    calibration = Calibration.load(place)
    found = read_pictures([pictures], calibration, progress)
    checker = Checker.of(calibration)
    answer = checker.check(found, progress)
    moved: tuple[Moved, ...] = ()
    written = ""
    if updated:
        better, moved = update(calibration, checker.known, answer, found)
        with FileSet(check_no_link(updated), elsewhere=MOVE_IT, flag="") as files:
            written = str(better.write(files))
            files.commit(instead_of=DERIVED)
    text = "\n\n".join(answer_lines(answer, moved))
    return {
        "word": answer.word.value,
        "sentence": answer.word.sentence,
        "text": text,
        "usable": bool(found.views) and carries(answer),
        "known": bool(answer.views) and answer.known == answer.views,
        "written": written,
    }
