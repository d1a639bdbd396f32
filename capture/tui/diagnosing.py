"""The search for effects in the screen's child process: the process that draws never loads
torch.
"""

from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from calib.progress import Progress
from calib.table import board_error
from capture.tui.child import LOADING, MOVE_IT
from capture.tui.fitting import results_summary

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calib.diagnosis.finding import Candidate, Diagnosis


def diagnose_calibration(progress: Progress, place: Path, out: Path) -> dict[str, object]:
    """Find effects and save the result as `calib diagnose` does, from and to these places.

    Returns the summary of a fit, with the names of the accepted effects and a text for the screen.
    """
    progress.task(LOADING, 1)
    from calib.calibration import Calibration
    from calib.calibration_file import DERIVED, FILES
    from calib.diagnosis.diagnose import diagnose
    from calib.diagnosis.effect_description import describe_estimates
    from calib.effects.description import describe_effect
    from calib.fitting.provenance import record_diagnosis
    from calib.io.file_set import FileSet
    from calib.io.output_folder import check_no_link

    calibration = Calibration.load(place)
    with FileSet(check_no_link(out), elsewhere=MOVE_IT, flag="") as files:
        files.reserve(FILES)
        diagnosed_calibration, finding = diagnose(calibration, progress)
        diagnosed_calibration = record_diagnosis(
            diagnosed_calibration, place if place.is_dir() else place.parent, None
        )
        saved = diagnosed_calibration.write(files)
        files.commit(instead_of=DERIVED)
    record = diagnosed_calibration.history.diagnosis
    numbers = [
        [
            describe_effect(effect.name, effect.varies),
            *describe_estimates(effect, diagnosed_calibration),
        ]
        for effect in (record.accepted if record else ())
    ]
    words = {
        candidate.effect: describe_effect(candidate.effect, candidate.varies)
        for candidate in finding.candidates
    }
    return results_summary(diagnosed_calibration, saved) | {
        "accepted": list(finding.added),
        "text": as_text(finding, numbers, words),
    }


def as_text(
    finding: "Diagnosis",
    numbers: "Sequence[Sequence[str]]" = (),
    words: "Mapping[str, str]" = MappingProxyType({}),
) -> str:
    """Return the finding: the accepted effects, the error with and without them, and the other
    candidates. Rows of tables have at most 45 characters, which a phone can show; a
    sentence is one line, which every screen breaks at its own width.

    Args:
        numbers: the lines for each accepted effect: its description and its parameters.
        words: the description of an effect, by its name.
    """
    without, with_effects = finding.base_quality, finding.final_quality
    column_title = "with it" if len(finding.added) < 2 else "with them"
    lines = [
        finding.headline,
        "",
        _row("error (root mean square)", "without", column_title),
        _row("fitted views", f"{without.rms_px:.3f} px", f"{with_effects.rms_px:.3f} px"),
        _row("on the board", board_error(without.rmse_cm), board_error(with_effects.rmse_cm)),
        _row(
            "held-out views", f"{without.held_out_px:.3f} px", f"{with_effects.held_out_px:.3f} px"
        ),
    ]
    if finding.noise_px is not None:
        lines.append(_row("of which noise", *[f"{finding.noise_px:.3f} px"] * 2))
    for effect_lines in numbers:
        lines += ["", *effect_lines]
    tried = [
        candidate for candidate in finding.candidates if candidate.held_out_px_after is not None
    ]
    if tried:
        lines += ["", f"{'fitted':<26}{'held-out views':>18}", *map(_candidate_lines, tried)]
    names = {candidate.effect for candidate in tried}
    untried = dict.fromkeys(c.effect for c in finding.candidates if c.effect not in names)
    if untried:
        lines += ["", f"No sign of these in what is left: {', '.join(untried)}."]
    lines += [f"\nNote: {remark}" for remark in finding.remarks]
    for name in words:
        if name in names and name not in finding.accepted:
            lines += ["", f"{name}: {words[name]}"]
    return "\n".join(lines)


def _row(name: str, without: str, with_effects: str) -> str:
    return f"{name:<25}{without:>9}{with_effects:>11}"


def _candidate_lines(candidate: "Candidate") -> str:
    return (
        f"{candidate.title:<26} {candidate.held_out_px_before:.3f} to"
        f" {candidate.held_out_px_after:.3f} px\n  {candidate.outcome}"
    )
