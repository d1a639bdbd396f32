"""The search for effects as the screen's child does it, for torch is never loaded in the process
that draws.
"""

from pathlib import Path
from textwrap import fill
from types import MappingProxyType
from typing import TYPE_CHECKING

from calib.progress import Progress
from capture.tui.child import LOADING
from capture.tui.fitting import summary

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calib.diagnosis.finding import Candidate, Diagnosis


def diagnose_calibration(progress: Progress, place: Path, out: Path) -> dict[str, object]:
    """Find and save what `calib diagnose` does, from and to these places.

    Returns the summary of a fit, with the names of the effects that were accepted and a text for
    the screen.
    """
    progress.task(LOADING, 1)
    from calib.calibration import DERIVED, Calibration
    from calib.diagnosis.diagnose import diagnose
    from calib.diagnosis.found import found
    from calib.effects.description import describe_effect
    from calib.fitting.provenance import diagnosed
    from calib.io.file_set import FileSet

    calibration = Calibration.load(place)
    with FileSet(out) as files:
        better, finding = diagnose(calibration, progress)
        better = diagnosed(better, place if place.is_dir() else place.parent, None)
        saved = better.write(files)
        files.commit(instead_of=DERIVED)
    numbers = [
        [describe_effect(one.effect), *found(one.effect, better, one.parameters)]
        for one in finding.candidates
        if one.accepted
    ]
    words = {one.effect: describe_effect(one.effect) for one in finding.candidates}
    return summary(better, saved) | {
        "accepted": list(finding.accepted),
        "text": as_text(finding, numbers, words),
    }


def as_text(
    finding: "Diagnosis",
    numbers: "Sequence[Sequence[str]]" = (),
    words: "Mapping[str, str]" = MappingProxyType({}),
) -> str:
    """The finding in lines of at most 78 characters: what was found, the error before and after,
    and what else was looked into.

    Args:
        numbers: what is to be said of each accepted effect: what it is, and its numbers.
        words: what an effect is, by its name.
    """
    before, after = finding.before, finding.after
    found = (
        ", ".join(finding.accepted)
        or "nothing: no effect that is known here improves held-out views beyond chance"
    )
    with_them = "with it" if len(finding.accepted) < 2 else "with them"
    lines = [
        f"Found: {found}.",
        "",
        f"{'error (root mean square)':<26}{'without':>12}{with_them:>12}",
    ]
    lines += [
        f"{'fitted views':<26}{before.rms_px:>9.3f} px{after.rms_px:>9.3f} px",
        f"{'on the board':<26}{10 * before.rmse_cm:>9.3f} mm{10 * after.rmse_cm:>9.3f} mm",
        f"{'held-out views':<26}{before.held_out_px:>9.3f} px{after.held_out_px:>9.3f} px",
        f"{'of which noise':<26}{finding.noise_px:>9.3f} px{finding.noise_px:>9.3f} px",
    ]
    for each in numbers:
        lines += ["", *each]
    tried = [one for one in finding.candidates if one.held_out_px_after is not None]
    if tried:
        lines += ["", f"{'fitted':<26}{'held-out views':<24}verdict", *map(_line, tried)]
    if rest := ", ".join(one.effect for one in finding.candidates if one not in tried):
        lines += ["", f"No sign of these in what is left: {rest}."]
    lines += [f"\nNote: {remark}" for remark in finding.remarks]
    if words:
        lines += ["", "What they are:", *(_wrapped(name, said) for name, said in words.items())]
    return "\n".join(lines)


def _line(one: "Candidate") -> str:
    return (
        f"{one.title:<25} {one.held_out_px_before:>5.3f} to {one.held_out_px_after:>5.3f} px      "
        f" {one.outcome}"
    )


def _wrapped(name: str, said: str) -> str:
    return fill(f"{name:<18}{said}", 78, subsequent_indent=" " * 18)
