"""The result of a check on the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from calib.calibration import Calibration
from calib.checking.pictures import OTHER_BOARD, OTHER_MODE
from calib.checking.result import CheckResult, CheckStatistics, CheckStatus
from calib.checking.significance import ALPHA
from calib.checking.update import NumberUpdate
from calib.commands.left_out_lines import left_out_lines
from calib.commands.program import runnable_command
from calib.errors import harmless
from calib.intrinsics.calibrate import MIN_BARE_POSES
from calib.io.images import frames_folder, list_images
from calib.io.shell import shell_line
from calib.rounding import with_sigma
from calib.verdict.judge import judge
from calib.verdict.verdict import Trust, uncapitalised

UNNAMED = ("unknown", "other_camera")
"""The names of changes that an estimate of this calibration's numbers does not describe."""
NOISY = 1.3
"""The ratio to the noise of the calibration's own corners above which the noise is reported."""
MIN_VIEWS = 3
"""The fewest views that a check should have."""
LEAST_PX = 0.001
"""The smallest error that a sentence states."""
SMALLEST_P = 1e-99
"""The smallest printed p-value; smaller ones underflow."""


def print_result(
    result: CheckResult, numbers: Sequence[NumberUpdate], written: Sequence[Path], following: str
) -> None:
    """Print the status, its reasons, the changes, the updated numbers and the next command."""
    console = Console(markup=False, highlight=False, soft_wrap=True)
    console.print(result.sentence, style="bold")
    for line in result_lines(result, numbers):
        console.print(line)
    for path in written:
        console.print(harmless(f"Wrote {path}"))
    console.print(harmless(f"Next: {runnable_command(following)}"))


def next_command(
    result: CheckResult,
    calibration: Path,
    pictures: Sequence[Path],
    *,
    updated: bool,
    size: tuple[int, int],
) -> str:
    """Return the command to type next: a diagnosis of a calibration that lacks an effect; a new
    recording if the pictures are a recorded session's, and the calibration is not valid or was
    fitted to most of them; a fit of pictures that cannot be compared, or whose change has no name;
    otherwise a report. Pictures that are too few for a fit are recorded anew as well, and a board
    that is described in two ways is checked again.

    Args:
        size: width and height of the calibration's pictures, px, which a new recording has too.
    """
    if result.lacking and not updated:
        return shell_line("calib", "diagnose", calibration)
    places = (pictures[0], *pictures[0].parents[:2])
    sessions = [folder for folder in places if (folder / "session.yaml").is_file()]
    session = sessions[0] if sessions else pictures[0]
    is_recorded = bool(sessions) and (session / "frames").is_dir()
    change = result.changes[0].name if result.changes else ""
    mode = size if change == OTHER_MODE else None
    if change == OTHER_BOARD and result.statistics:
        return shell_line("calib", "check", calibration, *pictures)
    if not (is_recorded or updated) and (change in UNNAMED or result.statistics is None):
        if _count_pictures(pictures) >= MIN_BARE_POSES:
            return shell_line("calib", "fit", *pictures)
        return _recording(session if session.is_dir() else session.parent, mode)
    is_checked = result.status is CheckStatus.VALID and not result.is_known
    if updated or is_checked or not is_recorded:
        return shell_line("calib", "report", calibration)
    return _recording(session, mode)


def _count_pictures(places: Sequence[Path]) -> int:
    """Return the number of picture files. A session counts as enough: it may list corners alone."""
    count = 0
    for place in places:
        if (place / "session.yaml").exists():
            return MIN_BARE_POSES
        count += len(list_images(frames_folder(place))) if place.is_dir() else 1
    return count


def _recording(session: Path, mode: tuple[int, int] | None) -> str:
    """Return the command that records a session again, into a folder beside it.

    Args:
        mode: width and height, px, if the pictures must have another size than they have.
    """
    if not session.name.strip("."):  # "." and ".." are not names
        session = session.resolve()
    source = ("--source", "SOURCE?size={}x{}".format(*mode)) if mode else ()
    return shell_line("capture", session.with_name(f"{session.name}-again"), *source)


def with_own_verdict(result: CheckResult, calibration: Calibration) -> CheckResult:
    """Return the result of a valid check with a note if the verdict on the calibration itself is
    not to trust its maps: then the pictures show no change, and no more than that.
    """
    if result.status is not CheckStatus.VALID or result.note or not result.has_new_views:
        return result
    verdict = judge(calibration)
    if verdict.word is Trust.TRUSTED or verdict.maps_hold:
        return result
    sentence = uncapitalised(verdict.headline).rstrip(".")
    note = f'the verdict on the calibration itself is "{sentence}": calib report says why'
    return replace(result, note=note)


def result_lines(result: CheckResult, numbers: Sequence[NumberUpdate] = ()) -> Iterator[str]:
    """Yield the reasons for the status as harmless text."""
    for line in _reasons(result):
        yield harmless(f"- {line}")
    pictures = ((picture.name, picture.reason) for picture in result.rejected)
    yield from map(harmless, left_out_lines(pictures, "Left out"))
    for number in numbers:
        prior = with_sigma(number.prior, number.prior_sigma)
        updated = with_sigma(number.updated, number.updated_sigma)
        yield (
            f"{number.name}: {prior} -> {updated} {number.unit}".rstrip()
            + f" ({number.sigmas:+.1f} sigma)"
        )


def _reasons(result: CheckResult) -> Iterator[str]:
    if result.statistics:
        yield from _test_reasons(result.statistics, result)
    alone = len(result.changes) == 1
    for change in result.changes:
        yield f"{change}." if alone else f"{100 * change.probability:.0f} %: {change}."
    if result.note:
        yield f"{result.note}."
    if result.lacking:
        yield (
            f"the calibration's own views show the same ({result.lacking}): probably nothing has"
            " changed, and the model has always lacked this effect."
        )


def _test_reasons(statistics: CheckStatistics, result: CheckResult) -> Iterator[str]:
    count, status = statistics.views, result.status
    if status is CheckStatus.VALID and not result.has_new_views:
        yield "the fit agrees with them anyway: take new pictures, which show the camera of today."
        return
    is_small = status is CheckStatus.VALID and statistics.p_value < ALPHA
    chance = f" (p {p_text(statistics.p_value)}; less than {ALPHA:g} is an alarm)"
    yield (
        f"the error on {count} view{'s' * (count > 1)} is {error_words(statistics)};"
        f" {statistics.expected_px:.3f} px are expected and up to {statistics.allowed_px:.3f} px"
        f" allowed{'' if is_small else chance}."
    )
    if is_small:
        yield (
            "something differs from the calibration's own views, but by too little to matter: it"
            f" adds {max(statistics.added_px, LEAST_PX):.3f} px or less to the corners."
        )
    if status is not CheckStatus.VALID:
        yield f"the change moves the corners by {statistics.added_px:.3f} px (root mean square)."
    is_unnamed = any(change.name in UNNAMED for change in result.changes)
    if statistics.noise_ratio > NOISY and not is_unnamed:  # else it holds the change
        yield (
            f"the corners are {statistics.noise_ratio:.1f} times as noisy as those of the"
            " calibration: sharper pictures give a stricter check."
        )
    if reused := statistics.reused_views:
        subject = "all of them" if reused == count else f"{reused} of them"
        yield (
            f"the calibration was fitted to {subject}, so they say nothing about today: take new"
            " pictures."
        )
    if count < MIN_VIEWS:
        yield (
            "that is few: three to five views of a tilted board, near and far, give a better check."
        )


def error_words(statistics: CheckStatistics) -> str:
    """Return the error, with that of a typical view, which decides, where only one of the two is
    larger than what is allowed.
    """
    typical, error = statistics.typical_px, f"{statistics.error_px:.3f} px"
    if (typical < statistics.allowed_px) != (statistics.error_px < statistics.allowed_px):
        return f"{error}, but {typical:.3f} px in a typical one"
    return error


def p_text(value: float) -> str:
    """Return "= " and a p-value, or "< " and the smallest printed one."""
    return f"= {value:.2g}" if value > SMALLEST_P else f"< {SMALLEST_P:g}"
